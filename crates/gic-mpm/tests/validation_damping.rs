//! The energy that a viscoelastic solid loses: a vibrating bar, and a sphere that bounces.

mod common;

use std::f64::consts::PI;

use common::{DENSITY, block, body, next, set_velocities, simulator, world};
use gic_mpm::{Collider, Contact, Frame, Material, Stepping, World};
use glam::DVec3;

const YOUNG: f64 = 1e5;

fn material(poisson_ratio: f64, retardation_time_s: f64) -> Material {
    Material::Viscoelastic { youngs_modulus_pa: YOUNG, poisson_ratio, retardation_time_s }
}

fn without_gravity(world: World) -> World {
    World { gravity_m_s2: DVec3::ZERO, ..world }
}

/// Damping ratio of the fundamental longitudinal vibration of a free bar, from the first two extrema of the mode's
/// displacement: a mode of frequency w decays by exp(-pi zeta / sqrt(1 - zeta^2)) in half a period.
fn damping_ratio(cells: usize, retardation_time_s: f64) -> f64 {
    let length = 0.4;
    let dx = length / cells as f64;
    let positions = block(DVec3::ZERO, DVec3::new(length, 2.0 * dx, 2.0 * dx), dx);
    let speed = (YOUNG / DENSITY).sqrt();
    let rate = 40.0 * speed / length;
    let material = material(0.0, retardation_time_s);
    let world = without_gravity(world(body(material, positions.clone(), dx), vec![], dx, rate));
    let mode = |x: DVec3| (PI * x.x / length).cos();
    let mut simulator = simulator(&world);
    set_velocities(&mut simulator, |x| DVec3::X * (mode(x) * 1e-2 * speed));
    let displacement = |now: &[DVec3]| positions.iter().zip(now).map(|(x, now)| mode(*x) * (now.x - x.x)).sum::<f64>();
    let signal: Vec<f64> = (0..75).map(|_| displacement(&next(&mut simulator).positions)).collect();
    let highest = signal.iter().copied().fold(0.0, f64::max);
    let lowest = signal.iter().copied().fold(0.0, f64::min);
    let decrement = (highest / -lowest).ln();
    decrement / decrement.hypot(PI)
}

#[test]
fn a_bar_is_damped_in_proportion_to_its_retardation_time() {
    let frequency = PI * (YOUNG / DENSITY).sqrt() / 0.4;
    let cells = 40;
    // What the transfers between particles and grid take away.
    let numerical = damping_ratio(cells, 0.0);
    assert!(numerical < 0.02, "{numerical}");
    for expected in [0.05, 0.1, 0.2] {
        let found = damping_ratio(cells, 2.0 * expected / frequency) - numerical;
        println!("damping ratio {found:.4}, exact {expected}, the grid's own {numerical:.4}");
        assert!((found / expected - 1.0).abs() < 0.06, "{found}, not {expected}");
    }
}

/// Coefficient of restitution of a sphere of radius `radius` that hits a rigid smooth plane at `speed`, by Hertz' law
/// with both moduli delayed: `m x'' = -k (x^(3/2) + 3/2 t_r sqrt(x) x')` (Brilliantov et al. 1996), until nothing
/// pushes any more.
fn hertz_restitution(radius: f64, speed: f64, nu: f64, retardation_time_s: f64) -> f64 {
    let mass = DENSITY * 4.0 / 3.0 * PI * radius.powi(3);
    let stiffness = 4.0 / 3.0 * YOUNG / (1.0 - nu * nu) * radius.sqrt();
    let force = |x: f64, v: f64| stiffness * x.sqrt() * (x + 1.5 * retardation_time_s * v);
    let (mut x, mut v, dt) = (0.0_f64, speed, 1e-7);
    loop {
        v -= dt * force(x, v) / mass;
        x += dt * v;
        if x <= 0.0 || force(x, v) <= 0.0 {
            return -v / speed;
        }
    }
}

/// The same by simulation, `cells` along the radius: speed of the centre after the bounce over that before.
fn restitution(cells: usize, (radius, speed, nu): (f64, f64, f64), retardation_time_s: f64) -> f64 {
    let dx = radius / cells as f64;
    let centre = DVec3::Y * (radius + 0.5 * dx);
    let mut positions = block(centre - DVec3::splat(radius), DVec3::splat(2.0 * radius), dx);
    positions.retain(|x| x.distance(centre) <= radius);
    let ground = Collider::plane(DVec3::ZERO, DVec3::Y, Contact::Separating { friction: 0.0 });
    let mut world = world(body(material(nu, retardation_time_s), positions, dx), vec![ground], dx, 200.0);
    world.bodies[0].velocity_m_s = DVec3::NEG_Y * speed;
    let world = without_gravity(world);
    let mut simulator = simulator(&world);
    let mean = |velocities: &[DVec3]| velocities.iter().map(|v| v.y).sum::<f64>() / velocities.len() as f64;
    (0..40).map(|_| mean(&next(&mut simulator).velocities)).last().expect("frames") / speed
}

/// On a grid, what comes to the plane is stopped within a cell, at a higher rate than where a curved surface rolls on:
/// the grid's contact loses up to twice as much, and less the finer it is.
#[test]
fn a_sphere_loses_energy_in_its_bounce_as_its_retardation_time_says() {
    let sphere @ (radius, speed, nu) = (0.04, 0.5, 0.3);
    let retardation_time_s = 1e-3;
    let exact = 1.0 - hertz_restitution(radius, speed, nu, retardation_time_s);
    let [coarse, fine] = [6, 9].map(|cells| {
        let elastic = restitution(cells, sphere, 0.0);
        1.0 - restitution(cells, sphere, retardation_time_s) / elastic
    });
    println!("speed lost beside the elastic sphere {coarse:.3}, {fine:.3}; Hertz {exact:.3}");
    assert!(exact < fine && fine < coarse && fine < 2.0 * exact, "{coarse}, {fine}, {exact}");
}

/// Substeps as long as the bound allows never add energy, whatever the motion: the noisiest one is damped fastest.
#[test]
fn noise_dies_at_the_longest_substep() {
    let dx = 0.02;
    for (nu, retardation_time_s) in [(0.0, 0.05), (0.3, 0.05), (0.45, 0.05), (0.3, 1e-3)] {
        let world = without_gravity(world(
            body(material(nu, retardation_time_s), block(DVec3::ZERO, DVec3::splat(0.16), dx), dx),
            vec![],
            dx,
            2e3,
        ));
        let world = World { stepping: Stepping { courant: 0.999, ..Stepping::STABLE }, ..world };
        let mut simulator = simulator(&world);
        let mut seed = 1_u32;
        let mut random = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(seed >> 8) / f64::from(1 << 23) - 1.0
        };
        set_velocities(&mut simulator, |_| 0.1 * DVec3::new(random(), random(), random()));
        let energy = |frame: &Frame| frame.velocities.iter().map(|v| v.length_squared()).sum::<f64>();
        let energies: Vec<f64> = (0..40).map(|_| energy(&next(&mut simulator))).collect();
        let substeps = next(&mut simulator).substeps;
        println!(
            "nu {nu}, t_r {retardation_time_s} s, {substeps} substeps a frame: {:.1e} to {:.1e}",
            energies[0], energies[39]
        );
        assert!(energies[39] < energies[0], "{energies:?}");
    }
}
