//! Friction and plasticity: slopes, heaps and dents.
//!
//! The longer ones: `cargo test --release -p gic-mpm --test validation_contact -- --include-ignored --nocapture`.

mod common;

use common::{GRAVITY, block, body, frame_after, mean, next, side_walls, simulator, world};
use gic_mpm::{Collider, ColliderPath, Contact, Material, Primitive};
use glam::{DQuat, DVec3};

/// A stiff box put on a slope of `angle`: its acceleration downhill [m/s^2] over the last four fifths of `seconds`, and
/// how far [m] it has moved downhill and sideways. (In the first fifth its own shear builds up to what friction asks
/// for.)
fn slide(angle: f64, friction: f64, seconds: f64) -> (f64, f64, f64) {
    let dx = 0.02;
    let material = Material::Elastic { youngs_modulus_pa: 2e5, poisson_ratio: 0.3 };
    let tilt = DQuat::from_rotation_z(-angle);
    // A box lying on the plane through the origin, which falls towards +x.
    let positions: Vec<DVec3> =
        block(DVec3::new(-0.06, 0.0, -0.06), DVec3::new(0.12, 0.06, 0.12), dx).into_iter().map(|x| tilt * x).collect();
    let ground = Collider::plane(DVec3::ZERO, tilt * DVec3::Y, Contact::Separating { friction });
    let world = world(body(material, positions.clone(), dx), vec![ground], dx, 10.0 / seconds);
    let mut simulator = simulator(&world);
    next(&mut simulator);
    let early = next(&mut simulator);
    let end = (2..10).map(|_| next(&mut simulator)).last().expect("eight frames");
    let gain = mean_of(&end.velocities) - mean_of(&early.velocities);
    let shift = mean_of(&end.positions) - mean_of(&positions);
    (gain.dot(tilt * DVec3::X) / (0.8 * seconds), shift.dot(tilt * DVec3::X), shift.z)
}

fn mean_of(positions: &[DVec3]) -> DVec3 {
    positions.iter().sum::<DVec3>() / positions.len() as f64
}

#[test]
fn a_box_on_a_slope_slides_or_sticks_by_its_friction() {
    let (angle, seconds) = (20.0_f64.to_radians(), 0.5);
    for friction in [0.0, 0.1, 0.2, 0.3] {
        let expected = GRAVITY * (angle.sin() - friction * angle.cos());
        let (found, _, sideways) = slide(angle, friction, seconds);
        println!(
            "friction {friction}: accelerates at {found:.4} m/s^2, Coulomb {expected:.4}, {:+.2} %",
            100.0 * (found / expected - 1.0)
        );
        assert!((found / expected - 1.0).abs() <= 0.05, "friction {friction}: {found}, not {expected} m/s^2");
        assert!(sideways.abs() < 1e-3);
    }
    // tan 20 degrees is 0.364. It leans by its own shear, but stays.
    for friction in [0.45, 0.8] {
        let (_, found, _) = slide(angle, friction, seconds);
        println!("friction {friction}: moves {found:.5} m");
        assert!(found.abs() < 2e-3, "friction {friction} must hold it: {found} m");
    }
}

/// Slope [degrees] of the heap that is left of a collapsed column of sand, 0.1 m wide from its wall and as high.
fn heap_angle(friction_angle_deg: f64) -> f64 {
    let (dx, width) = (0.01, 0.02);
    let material = Material::Sand { friction_angle_deg, youngs_modulus_pa: 1e5, poisson_ratio: 0.3 };
    let positions = block(DVec3::ZERO, DVec3::new(0.1, 0.1, width), dx);
    let mut walls = vec![
        Collider::plane(DVec3::ZERO, DVec3::Y, Contact::Sticky),
        Collider::plane(DVec3::ZERO, DVec3::X, Contact::Slip { friction: 0.0 }),
    ];
    walls.extend(side_walls(width));
    let end = frame_after(&world(body(material, positions, dx), walls, dx, 5.0), 5);
    // The surface: the highest particle of each column of one cell, between a tenth and nine tenths of the heap's
    // height.
    let columns = end.positions.iter().map(|x| (x.x / dx) as usize).max().unwrap_or(0) + 1;
    let mut surface = vec![0.0_f64; columns];
    for x in &end.positions {
        let column = &mut surface[(x.x / dx) as usize];
        *column = column.max(x.y);
    }
    let top = surface[0];
    let points: Vec<(f64, f64)> = surface
        .iter()
        .enumerate()
        .map(|(i, y)| (dx * (i as f64 + 0.5), *y))
        .filter(|(_, y)| *y > 0.1 * top && *y < 0.9 * top)
        .collect();
    let (x, y) = (mean(points.iter().map(|p| p.0)), mean(points.iter().map(|p| p.1)));
    let slope = mean(points.iter().map(|p| (p.0 - x) * (p.1 - y))) / mean(points.iter().map(|p| (p.0 - x).powi(2)));
    (-slope).atan().to_degrees()
}

/// Up to 35 degrees: in plane flow the Drucker-Prager cone, which is fitted to triaxial compression, has `sin(angle) =
/// 3 alpha / sqrt 2`: 19, 35 and 55 degrees for 15, 25 and 35, and from 42.7 degrees on it bears tension.
#[test]
#[ignore = "15 s of CPU; see the top of this file"]
fn angle_of_repose_grows_with_the_friction_angle() {
    let friction = [15.0, 25.0, 35.0];
    let angles = friction.map(heap_angle);
    println!("friction angles {friction:?} leave heaps of {angles:.1?} degrees");
    assert!(angles.windows(2).all(|pair| pair[1] > pair[0] + 1.0), "{angles:?}");
    for (friction, angle) in friction.iter().zip(angles) {
        assert!(angle > 0.3 * friction && angle <= friction + 3.0, "{friction} degrees left a heap of {angle}");
    }
}

/// Depth [m] of the dent in a block's top, under a ball pressed 0.02 m into it, and after the ball is gone.
fn dent(material: Material) -> (f64, f64) {
    let (dx, height, radius) = (0.01, 0.06, 0.03);
    let positions = block(DVec3::new(-0.06, 0.0, -0.06), DVec3::new(0.12, height, 0.12), dx);
    let above = |gap: f64| DVec3::Y * (height + radius + gap);
    let ball = Collider {
        primitive: Primitive::Sphere { radius_m: radius },
        path: ColliderPath::Keyframed {
            keys: vec![(0.0, above(0.0)), (0.2, above(-0.02)), (0.3, above(-0.02)), (0.5, above(0.1))],
            world_from_collider: DQuat::IDENTITY,
        },
        contact: Contact::Separating { friction: 0.0 },
    };
    let ground = Collider::plane(DVec3::ZERO, DVec3::Y, Contact::Sticky);
    let world = world(body(material, positions.clone(), dx), vec![ground, ball], dx, 10.0);
    let mut simulator = simulator(&world);
    // The particles of the top layer around the axis.
    let centre: Vec<usize> = (0..positions.len())
        .filter(|&p| {
            positions[p].y > height - 0.5 * dx && positions[p].x.abs() < 0.6 * dx && positions[p].z.abs() < 0.6 * dx
        })
        .collect();
    let depth = |now: &[DVec3]| mean(centre.iter().map(|&p| positions[p].y - now[p].y));
    let mut pressed = 0.0_f64;
    for _ in 0..3 {
        pressed = pressed.max(depth(&next(&mut simulator).positions));
    }
    for _ in 3..7 {
        next(&mut simulator);
    }
    (pressed, depth(&simulator.frame().positions))
}

#[test]
#[ignore = "10 s of CPU; see the top of this file"]
fn a_plastic_block_keeps_its_dent_and_an_elastic_one_does_not() {
    let (youngs_modulus_pa, poisson_ratio) = (1e5, 0.3);
    let elastic = dent(Material::Elastic { youngs_modulus_pa, poisson_ratio });
    let plastic = dent(Material::Plasticine { youngs_modulus_pa, poisson_ratio, yield_stress_pa: 2e3 });
    println!("dents (pressed, left): elastic {elastic:.4?} m, plastic {plastic:.4?} m");
    assert!(elastic.0 > 0.01 && plastic.0 > 0.01, "both must have been pressed");
    assert!(plastic.1 > 0.8 * plastic.0, "{plastic:?}");
    assert!(elastic.1.abs() < 0.1 * elastic.0, "{elastic:?}");
}
