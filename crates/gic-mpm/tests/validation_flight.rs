//! Flight: what needs no material law, to rounding.

mod common;

use common::{DENSITY, GRAVITY, block, body, world};
use gic_mpm::{Material, Options, Precision, Simulator, Stepping, World};
use glam::DVec3;

const DX: f64 = 0.02;
const SUBSTEPS: usize = 50;
const FRAMES: usize = 4;
const RATE: f64 = 100.0;

fn materials() -> [Material; 6] {
    [
        Material::Elastic { youngs_modulus_pa: 3e5, poisson_ratio: 0.3 },
        Material::Plasticine { youngs_modulus_pa: 3e5, poisson_ratio: 0.3, yield_stress_pa: 1e3 },
        Material::Sand { friction_angle_deg: 30.0, youngs_modulus_pa: 3e5, poisson_ratio: 0.3 },
        Material::Newtonian { viscosity_pa_s: 20.0, bulk_modulus_pa: 1e5 },
        Material::NonNewtonian {
            shear_modulus_pa: 1e4,
            bulk_modulus_pa: 1e5,
            yield_stress_pa: 1e2,
            plastic_viscosity_pa_s: 10.0,
        },
        Material::Viscoelastic { youngs_modulus_pa: 1e5, poisson_ratio: 0.3, retardation_time_s: 1e-3 },
    ]
}

fn thrown(material: Material) -> World {
    let positions = block(DVec3::new(0.013, 0.5, -0.07), DVec3::new(0.12, 0.06, 0.08), DX);
    let mut body = body(material, positions, DX);
    body.velocity_m_s = DVec3::new(1.0, 2.0, -0.5);
    World { stepping: Stepping::at_least(SUBSTEPS), ..world(body, vec![], DX, RATE) }
}

fn in_f64(world: &World) -> Simulator {
    Simulator::new(world, &Options { precision: Precision::F64, ..Options::default() }).unwrap()
}

#[test]
fn free_fall_is_exact() {
    for material in materials() {
        let world = thrown(material);
        for (precision, tolerance) in [(Precision::F64, 1e-12), (Precision::F32, 2e-6)] {
            let mut simulator = Simulator::new(&world, &Options { precision, ..Options::default() }).unwrap();
            for frame in 1..=FRAMES {
                let found = simulator.advance_frame().unwrap();
                // Symplectic Euler: v_n = v_0 + n dt g, x_n = x_0 + n dt v_0 + n (n + 1) / 2 dt^2 g.
                let (n, dt) = ((frame * SUBSTEPS) as f64, 1.0 / (RATE * SUBSTEPS as f64));
                let g = DVec3::NEG_Y * GRAVITY;
                let shift = world.bodies[0].velocity_m_s * (n * dt) + g * (0.5 * n * (n + 1.0) * dt * dt);
                let velocity = world.bodies[0].velocity_m_s + g * (n * dt);
                for (p, start) in world.bodies[0].positions.iter().enumerate() {
                    let error = (found.positions[p] - *start - shift).abs().max_element();
                    assert!(
                        error <= tolerance,
                        "{} {precision:?}, frame {frame}: off by {error:e} m",
                        material.model()
                    );
                    // A rounding error of 1e-7 of strain in f32 is a stress, and drives a velocity.
                    let error = (found.velocities[p] - velocity).abs().max_element();
                    assert!(error <= 100.0 * tolerance, "{} {precision:?}: off by {error:e} m/s", material.model());
                }
            }
        }
    }
}

/// Linear momentum [kg m/s] and angular momentum about the origin [kg m^2/s], the affine part of the velocity included:
/// `m x cross v + m dx^2/4 (axial vector of C)`.
fn momenta(simulator: &Simulator) -> (DVec3, DVec3) {
    let mass = DENSITY * (0.5 * DX).powi(3);
    let mut total = (DVec3::ZERO, DVec3::ZERO);
    for particle in &simulator.snapshot().particles {
        let (x, v, c) = (DVec3::from_slice(particle), DVec3::from_slice(&particle[3..]), &particle[6..15]);
        let axial = DVec3::new(c[7] - c[5], c[2] - c[6], c[3] - c[1]);
        total.0 += v * mass;
        total.1 += (x.cross(v) + axial * (0.25 * DX * DX)) * mass;
    }
    total
}

/// Grid nodes that hold less than 1e-8 dx^3 of mass are taken for empty, and their momentum is dropped: each drop is at
/// most 1e-13 of this body's.
const DRIFT: f64 = 1e-10;

#[test]
fn momenta_are_conserved_in_free_flight() {
    for material in materials() {
        let mut world = thrown(material);
        world.gravity_m_s2 = DVec3::ZERO;
        // Fast enough that the spin strains the body, and the plastic ones flow.
        world.bodies[0].angular_velocity_rad_s = DVec3::new(10.0, -6.0, 20.0);
        let mut simulator = in_f64(&world);
        let count = simulator.frame().positions.len();
        simulator.advance_frame().unwrap();
        let (linear, angular) = momenta(&simulator);
        for _ in 1..FRAMES {
            let frame = simulator.advance_frame().unwrap();
            assert_eq!(frame.positions.len(), count, "mass is carried by the particles");
        }
        let (first, last) = (0, count - 1);
        let diagonal = |x: &[DVec3]| x[first].distance(x[last]);
        let stretch = diagonal(&simulator.frame().positions) / diagonal(&world.bodies[0].positions) - 1.0;
        assert!(stretch.abs() > 1e-4, "{}: the spin must have strained it, {stretch}", material.model());
        let (linear_after, angular_after) = momenta(&simulator);
        let drift = (linear_after - linear).length() / linear.length();
        assert!(drift <= DRIFT, "{}: linear momentum drifts by {drift:e}", material.model());
        let drift = (angular_after - angular).length() / angular.length();
        assert!(drift <= DRIFT, "{}: angular momentum drifts by {drift:e}", material.model());
    }
}

#[test]
fn gravity_adds_its_impulse_and_no_spin_about_the_centre_of_mass() {
    let mut world = thrown(materials()[0]);
    world.bodies[0].angular_velocity_rad_s = DVec3::new(10.0, -6.0, 20.0);
    let mut simulator = in_f64(&world);
    let about_centre = |simulator: &Simulator| {
        let (linear, angular) = momenta(simulator);
        let positions = simulator.frame().positions;
        let centre = positions.iter().sum::<DVec3>() / positions.len() as f64;
        (linear, angular - centre.cross(linear))
    };
    simulator.advance_frame().unwrap();
    let (linear, spin) = about_centre(&simulator);
    simulator.advance_frame().unwrap();
    let (linear_after, spin_after) = about_centre(&simulator);
    let mass = DENSITY * (0.5 * DX).powi(3) * world.bodies[0].positions.len() as f64;
    let impulse = DVec3::NEG_Y * GRAVITY * mass / RATE;
    assert!((linear_after - linear - impulse).length() <= DRIFT * linear.length());
    assert!((spin_after - spin).length() <= DRIFT * spin.length());
}
