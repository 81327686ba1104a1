//! Fluids at rest, in flow, and stopping.
//!
//! The longer ones: `cargo test --release -p gic-mpm --test validation_fluids -- --include-ignored --nocapture`.

mod common;

use common::{DENSITY, GRAVITY, block, body, frame_after, mean, next, side_walls, simulator, world};
use gic_mpm::{Collider, Contact, Frame, Material, World};
use glam::DVec3;

const FRICTIONLESS: Contact = Contact::Slip { friction: 0.0 };

/// Intercept and slope of a line, by least squares.
fn line(points: &[(f64, f64)]) -> (f64, f64) {
    let (x, y) = (mean(points.iter().map(|p| p.0)), mean(points.iter().map(|p| p.1)));
    let covariance = mean(points.iter().map(|p| (p.0 - x) * (p.1 - y)));
    let slope = covariance / mean(points.iter().map(|p| (p.0 - x).powi(2)));
    (y - slope * x, slope)
}

/// A column of liquid in a frictionless box of 3 x 3 cells, after it has come to rest; and its bulk modulus [Pa].
fn resting_column(cells_high: usize, height: f64) -> (World, Frame, f64) {
    let dx = height / cells_high as f64;
    let bulk_modulus_pa = 2e4;
    // Viscous enough to damp the sound of the start in half a second.
    let material = Material::Newtonian { viscosity_pa_s: 300.0, bulk_modulus_pa };
    let width = 3.0 * dx;
    let mut walls = vec![
        Collider::plane(DVec3::ZERO, DVec3::Y, FRICTIONLESS),
        Collider::plane(DVec3::ZERO, DVec3::X, FRICTIONLESS),
        Collider::plane(DVec3::X * width, DVec3::NEG_X, FRICTIONLESS),
    ];
    walls.extend(side_walls(width));
    let positions = block(DVec3::ZERO, DVec3::new(width, height, width), dx);
    let world = world(body(material, positions, dx), walls, dx, 10.0);
    let frame = frame_after(&world, 8);
    (world, frame, bulk_modulus_pa)
}

#[test]
fn pressure_in_a_resting_column_grows_by_its_weight() {
    let (cells, height) = (10, 0.2);
    let (world, frame, bulk_modulus) = resting_column(cells, height);
    let speed = frame.velocities.iter().map(|v| v.length()).fold(0.0, f64::max);
    assert!(speed < 1e-3, "not at rest: {speed} m/s");

    // The mean over each cell of the start: the two particles in a cell may differ as long as their mean carries the
    // weight.
    let dx = world.grid_spacing_m;
    let pressure = |j: f64| -bulk_modulus * (j - j.powi(-6)) / j;
    let layers: Vec<(f64, f64)> = (0..cells)
        .map(|cell| {
            let low = cell as f64 * dx;
            let inside = |x: f64| x > low && x < low + dx;
            let particles = world.bodies[0].positions.iter().zip(&frame.jacobian).filter(|(x, _)| inside(x.y));
            (height - low - 0.5 * dx, mean(particles.map(|(_, j)| pressure(f64::from(*j)))))
        })
        .collect();
    let weight = DENSITY * GRAVITY;
    for (depth, found) in &layers {
        println!("depth {depth:.3} m: {found:.1} Pa, hydrostatic {:.1}", weight * depth);
    }
    // The first cell above the floor is the boundary layer of the splines, which reach through the floor.
    for (depth, found) in &layers[1..] {
        assert!((found - weight * depth).abs() <= 0.02 * weight * height, "{found} Pa at a depth of {depth} m");
    }
    let (_, slope) = line(&layers[1..]);
    println!("grows by {slope:.1} Pa/m, exact {weight:.1}, error {:+.2} %", 100.0 * (slope / weight - 1.0));
    assert!((slope / weight - 1.0).abs() <= 0.05, "{slope}");

    let floor = frame.contacts[0].force_n.y.abs();
    let total = weight * height * (3.0 * dx) * (3.0 * dx);
    println!("the floor carries {floor:.4} N of {total:.4} N");
    assert!((floor / total - 1.0).abs() <= 0.01, "{floor} against {total}");
}

/// Front of a water column `a` wide and `2 a` high after its wall is gone: `(T, Z)` with `T = t sqrt(2 g / a)`, `Z =
/// front / a`.
fn dam_break(cells: usize) -> Vec<(f64, f64)> {
    let a = 0.1;
    let dx = a / cells as f64;
    // The speed of sound is ten times that of the flow, about 2 sqrt(g a).
    let bulk_modulus_pa = DENSITY * 400.0 * GRAVITY * a / 7.0;
    let material = Material::Newtonian { viscosity_pa_s: 1e-3, bulk_modulus_pa };
    let width = 2.0 * dx;
    let mut walls = vec![
        Collider::plane(DVec3::ZERO, DVec3::Y, FRICTIONLESS),
        Collider::plane(DVec3::ZERO, DVec3::X, FRICTIONLESS),
    ];
    walls.extend(side_walls(width));
    let positions = block(DVec3::ZERO, DVec3::new(a, 2.0 * a, width), dx);
    let rate = 20.0 * (2.0 * GRAVITY / a).sqrt();
    let world = world(body(material, positions, dx), walls, dx, rate);
    let mut simulator = simulator(&world);
    (1..=70)
        .map(|frame| {
            let mut x: Vec<f64> = next(&mut simulator).positions.iter().map(|x| x.x).collect();
            x.sort_by(f64::total_cmp);
            // The mean of the foremost layer, half a particle's spacing behind the surface; single drops do not count.
            let foremost = &x[x.len() - 16..];
            (f64::from(frame) / 20.0, (mean(foremost.iter().copied()) + 0.25 * dx) / a)
        })
        .collect()
}

/// Martin & Moyce 1952, table 2: water, square-based column twice as high as wide (n^2 = 2, a = 2 1/4 in): time T,
/// front Z.
const MARTIN_MOYCE: [(f64, f64); 12] = [
    (0.84, 1.22),
    (1.19, 1.44),
    (1.43, 1.67),
    (1.63, 1.89),
    (1.83, 2.11),
    (1.98, 2.33),
    (2.20, 2.56),
    (2.32, 2.78),
    (2.51, 3.00),
    (2.65, 3.22),
    (2.83, 3.44),
    (2.97, 3.67),
];

#[test]
#[ignore = "15 s of CPU; see the top of this file"]
fn dam_break_spreads_as_in_the_experiment_of_martin_and_moyce() {
    let front = dam_break(16);
    for (time, measured) in MARTIN_MOYCE {
        let after = front.iter().position(|(t, _)| *t >= time).expect("simulated long enough");
        let ((t0, z0), (t1, z1)) = (front[after - 1], front[after]);
        let found = z0 + (z1 - z0) * (time - t0) / (t1 - t0);
        println!(
            "T {time:.2}: front at {found:.3}, measured {measured:.2}, {:+.1} %",
            100.0 * (found / measured - 1.0)
        );
        assert!((found / measured - 1.0).abs() <= 0.1, "front at T = {time}: {found} against {measured}");
    }
}

/// Height and speed of a column of viscoplastic fluid over time, released on sticky ground: `[(height, largest speed)]`
/// every 0.1 s.
fn slump(yield_stress_pa: f64, frames: usize) -> Vec<(f64, f64)> {
    let dx = 0.0125;
    let material = Material::NonNewtonian {
        shear_modulus_pa: 1e4,
        bulk_modulus_pa: 5e4,
        yield_stress_pa,
        plastic_viscosity_pa_s: 20.0,
    };
    let positions = block(DVec3::new(-0.05, 0.0, -0.05), DVec3::new(0.1, 0.15, 0.1), dx);
    let world =
        world(body(material, positions, dx), vec![Collider::plane(DVec3::ZERO, DVec3::Y, Contact::Sticky)], dx, 10.0);
    let mut simulator = simulator(&world);
    (0..frames)
        .map(|_| {
            let frame = next(&mut simulator);
            let height = frame.positions.iter().map(|x| x.y).fold(0.0, f64::max);
            (height, frame.velocities.iter().map(|v| v.length()).fold(0.0, f64::max))
        })
        .collect()
}

#[test]
#[ignore = "15 s of CPU; see the top of this file"]
fn a_bingham_column_slumps_and_stops_where_a_fluid_flows_on() {
    // Its own weight is 1470 Pa at the bottom: above one yield stress, below the other.
    let [flows_on, stops, stands] = [1.0, 400.0, 4000.0].map(|yield_stress| {
        let history = slump(yield_stress, 12);
        println!("yield stress {yield_stress} Pa: (height, speed) {history:.4?}");
        history
    });
    let last = |history: &[(f64, f64)]| history[history.len() - 1];
    let sank = |history: &[(f64, f64)]| history[history.len() - 5].0 - last(history).0;
    let peak = stops.iter().map(|(_, speed)| *speed).fold(0.0, f64::max);
    assert!(last(&stops).0 < 0.12, "it must have slumped: {stops:?}");
    assert!(last(&stops).1 < 0.02 * peak && sank(&stops) < 5e-4, "it must have stopped: {stops:?}");
    assert!(last(&flows_on).0 < 0.5 * last(&stops).0, "a fluid must go further: {flows_on:?}");
    assert!(last(&stands).0 > 0.14, "a stiff one must stand: {stands:?}");
}
