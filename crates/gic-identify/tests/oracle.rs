//! Solver without reconstruction: true particles at time 0 and true surfaces in every frame give the true parameters.

use gic_identify::{Input, MaterialKind, Observation, Settings, Target, identify};
use gic_mpm::{Body, Collider, Contact, Material, Motion, Options, Primitive, Stepping, World, rollout};
use glam::{DQuat, DVec3};
use rand::{RngExt, SeedableRng};

const SPACING: f64 = 0.02;
const SUBSTEPS: usize = 60;
const RATE: f64 = 24.0;
const GRAVITY: DVec3 = DVec3::new(0.0, -9.8, 0.0);

fn ground() -> Collider {
    Collider {
        primitive: Primitive::HalfSpace { normal: DVec3::Y },
        motion: Motion::Uniform {
            position_m: DVec3::ZERO,
            rotation: DQuat::IDENTITY,
            velocity_m_s: DVec3::ZERO,
            angular_velocity_rad_s: DVec3::ZERO,
        },
        contact: Contact::Sticky,
    }
}

/// A tilted block of particles, 12 x 6 x 6, and whether each is on its surface.
fn block() -> (Vec<DVec3>, Vec<bool>) {
    let (size, tilt) = ([8, 5, 5], DQuat::from_scaled_axis(DVec3::new(0.3, 0.2, 0.5)));
    let mut positions = Vec::new();
    let mut surface = Vec::new();
    for x in 0..size[0] {
        for y in 0..size[1] {
            for z in 0..size[2] {
                let local = DVec3::new(f64::from(x) - 3.5, f64::from(y) - 2.0, f64::from(z) - 2.0) * 0.5 * SPACING;
                positions.push(tilt * local + DVec3::new(0.0, 0.16, 0.0));
                surface.push([x, y, z].iter().zip(size).any(|(i, n)| *i == 0 || *i == n - 1));
            }
        }
    }
    (positions, surface)
}

/// What a perfect reconstruction would see of the block made of `material`.
fn observed(material: Material, velocity: DVec3, frames: usize) -> Input {
    let (positions, on_surface) = block();
    let volume = (0.5 * SPACING).powi(3);
    let world = World {
        bodies: vec![Body {
            material,
            density_kg_m3: 1000.0,
            particle_volume_m3: volume,
            positions: positions.clone(),
            velocity_m_s: velocity,
            angular_velocity_rad_s: DVec3::ZERO,
        }],
        colliders: vec![ground()],
        gravity_m_s2: GRAVITY,
        grid_spacing_m: SPACING,
        frame_rate_hz: RATE,
        stepping: Stepping::Fixed { substeps_per_frame: SUBSTEPS },
    };
    let mut observations = Vec::new();
    rollout(&world, &Options::default(), frames, |frame| {
        let surface = frame.positions.iter().zip(&on_surface).filter(|(_, s)| **s).map(|(p, _)| *p).collect();
        observations.push(Observation { time_s: frame.index as f64 / RATE, surface, views: Vec::new() });
    })
    .expect("the truth can be simulated");
    let n = positions.len();
    Input {
        positions,
        particle_volume_m3: volume,
        opacities: vec![0.9; n],
        scales: vec![0.5 * 0.01; n],
        on_surface,
        cameras: Vec::new(),
        observations,
        frame_rate_hz: RATE,
        gravity_m_s2: GRAVITY,
        colliders: vec![ground()],
        density_kg_m3: 1000.0,
        grid_spacing_m: SPACING,
        substeps_per_frame: SUBSTEPS,
    }
}

fn recovers(truth: Material, starts: u64) {
    let velocity = DVec3::new(0.4, -1.5, 0.2);
    let input = observed(truth, velocity, 9);
    let kind = MaterialKind::of(&truth);
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(7);
    for trial in 0..starts {
        // Two decades around the truth for moduli; the whole range for the others.
        let start = kind
            .parameters()
            .iter()
            .zip(kind.values(&truth))
            .map(|(p, value)| {
                let u: f64 = random.random();
                match p.name {
                    "poisson_ratio" => 0.05 + 0.4 * u,
                    "friction_angle_deg" => 10.0 + 45.0 * u,
                    _ => value * 10f64.powf(2.0 * u - 1.0),
                }
            })
            .collect();
        let settings =
            Settings { target: Target::Surfaces, start: Some(start), resolution_check: None, ..Settings::default() };
        let found = identify(&input, kind, &settings, &mut |s| {
            println!(
                "{:?} {} {:.3e} {:?} {:.4} rollouts {} {:.1}s",
                s.stage, s.iteration, s.objective, s.values, s.velocity_m_s, s.rollouts, s.seconds
            )
        })
        .expect("identified");
        println!("{:?} {:?} {} {}", found.angular_velocity_rad_s, found.seconds, found.rollouts, found.coarse_rollouts);
        assert!(found.velocity_m_s.distance(velocity) < 5e-3, "start {trial}: {:?}", found.velocity_m_s);
        for (estimate, value) in found.estimates.iter().zip(kind.values(&truth)) {
            let error = estimate.parameter.error(estimate.value, value).abs();
            let allowed = if estimate.parameter.name == "friction_angle_deg" { 0.3 } else { 0.01 };
            assert!(
                error <= allowed,
                "start {trial} ({:?}): {} = {} instead of {value}",
                settings.start,
                estimate.parameter.name,
                estimate.value
            );
        }
    }
}

#[test]
fn elastic_block_is_recovered() {
    recovers(Material::Elastic { youngs_modulus_pa: 1.0e5, poisson_ratio: 0.3 }, 2);
}
