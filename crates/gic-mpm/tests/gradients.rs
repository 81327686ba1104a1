//! The adjoint against central differences, over rollouts with contact and active plasticity, for every parameter of
//! every material.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use gic_mpm::{
    Frame, FrameAdjoint, Options, Precision, Recording, Rules, SimulationError, Stepping, Unknown, gradcheck,
    gradcheck_materials, gradcheck_world, gradient, jacobian, rollout,
};
use glam::DVec3;

fn assert_gradients(substeps: usize, tolerance: f64) {
    for material in gradcheck_materials() {
        let mut world = gradcheck_world(material);
        world.frame_rate_hz = 5000.0 / substeps as f64;
        world.stepping = Stepping::at_least(substeps);
        for row in gradcheck(&world, Rules::Exact, 2).unwrap() {
            println!("{} {substeps} substeps: {row:?}", material.model());
            assert!(row.relative_error <= tolerance, "{} {row:?}", material.model());
        }
    }
}

#[test]
fn adjoint_matches_differences_over_fifty_substeps() {
    assert_gradients(50, 1e-3);
}

/// One substep from the exact rest state F = I.
#[test]
fn adjoint_matches_differences_over_the_first_substep() {
    assert_gradients(1, 1e-5);
}

#[test]
fn parameters_change_the_outcome_of_the_check() {
    // Otherwise the tests above would compare zeros: contact and yield must have happened.
    for material in gradcheck_materials() {
        let rows = gradcheck(&gradcheck_world(material), Rules::Exact, 2).unwrap();
        for row in rows.iter().take(material.parameters().len()) {
            assert!(row.finite_difference != 0.0, "{}: {row:?}", material.model());
        }
    }
}

#[test]
fn fast_adjoint_agrees_with_the_twin() {
    for material in gradcheck_materials() {
        let world = gradcheck_world(material);
        let of = |options: &Options| {
            let loss = |frame: &gic_mpm::Frame| {
                (frame.index == 1).then(|| frame.positions.iter().map(|x| *x + DVec3::new(1.0, -0.5, 0.3)).collect())
            };
            gradient(&world, options, 2, loss).unwrap().bodies.remove(0)
        };
        let fast = of(&Options::default());
        let twin = of(&Options { precision: Precision::F64, ..Options::default() });
        let mut pairs: Vec<(f64, f64, f64)> = Vec::new();
        for ((value, a), b) in material.parameters().iter().zip(&fast.material).zip(&twin.material) {
            pairs.push((*value, *a, *b));
        }
        pairs.push((1000.0, fast.density, twin.density));
        for axis in 0..3 {
            pairs.push((1.0, fast.velocity[axis], twin.velocity[axis]));
            pairs.push((1.0, fast.angular_velocity[axis], twin.angular_velocity[axis]));
        }
        let largest = pairs.iter().map(|(value, _, b)| (value * b).abs()).fold(0.0, f64::max);
        for (value, a, b) in pairs {
            println!("{}: {a:.6e} {b:.6e}", material.model());
            let error = (a - b).abs() * value;
            assert!(error <= 2e-3 * (b * value).abs() + 1e-4 * largest, "{}: {a} against {b}", material.model());
        }
        let size = twin.positions.iter().map(|b| b.length()).fold(0.0, f64::max);
        for (a, b) in fast.positions.iter().zip(&twin.positions) {
            assert!(a.distance(*b) <= 5e-3 * size, "{}: {a} against {b}", material.model());
        }
        let size = twin.volume_factors.iter().map(|b| b.abs()).fold(0.0, f64::max);
        for (a, b) in fast.volume_factors.iter().zip(&twin.volume_factors) {
            assert!((a - b).abs() <= 5e-3 * size, "{}: {a} against {b}", material.model());
        }
    }
}

#[test]
fn a_tight_memory_budget_gives_the_same_gradient() {
    let mut world = gradcheck_world(gradcheck_materials()[0]);
    world.stepping = Stepping::at_least(160);
    let of = |bytes: usize| {
        let options = Options { gradient_memory_bytes: bytes, precision: Precision::F64, ..Options::default() };
        gradient(&world, &options, 6, |frame| (frame.index == 5).then(|| frame.positions.clone()))
    };
    let state = 210 * 24 * 8;
    let roomy = of(1 << 30).unwrap().bodies.remove(0);
    let tight = of(state * 55).unwrap().bodies.remove(0);
    assert_eq!(roomy.material, tight.material);
    assert_eq!(roomy.positions, tight.positions);
    assert!(matches!(of(state * 10), Err(SimulationError::MemoryBudget { .. })));
}

#[test]
fn a_recording_gives_the_gradients_of_many_losses() {
    let mut world = gradcheck_world(gradcheck_materials()[0]);
    world.stepping = Stepping::at_least(120);
    let state = 210 * 24 * 8;
    // Room for a few checkpoints only.
    let options = Options { gradient_memory_bytes: state * 55, precision: Precision::F64, ..Options::default() };
    let mut frames = Vec::new();
    let recording = Recording::new(&world, &options, 4, &mut |frame| frames.push(frame)).unwrap();
    for chosen in [3, 1] {
        let adjoint = |frame: &Frame| {
            let is_chosen = frame.index == chosen;
            FrameAdjoint {
                positions: is_chosen.then(|| frame.positions.clone()),
                velocities: is_chosen.then(|| frame.velocities.clone()),
            }
        };
        let adjoints: Vec<FrameAdjoint> = frames.iter().map(adjoint).collect();
        let again = recording.gradient(&adjoints).unwrap().bodies.remove(0);
        let alone = gradient(&world, &options, 4, adjoint).unwrap().bodies.remove(0);
        assert!(again.material[0] != 0.0);
        assert_eq!((again.material, again.positions), (alone.material, alone.positions));
    }
    let late = vec![FrameAdjoint::default(), FrameAdjoint::default(), FrameAdjoint::default()];
    recording.gradient(&late).unwrap();
    let beyond = [late, vec![FrameAdjoint::default(), Some(vec![DVec3::ZERO; 210]).into()]].concat();
    assert!(matches!(recording.gradient(&beyond), Err(SimulationError::LossGradient { frame: 4, .. })));
}

#[test]
fn a_raised_flag_ends_rollouts_and_gradients() {
    let world = gradcheck_world(gradcheck_materials()[0]);
    let flag = Arc::new(AtomicBool::new(false));
    let options = Options { interrupt: Some(flag.clone()), ..Options::default() };
    let recording = Recording::new(&world, &options, 2, &mut |_| {}).unwrap();
    flag.store(true, Ordering::SeqCst);
    assert_eq!(rollout(&world, &options, 2, |_| {}), Err(SimulationError::Interrupted));
    let adjoints = [FrameAdjoint::default(), Some(vec![DVec3::X; 210]).into()];
    assert!(matches!(recording.gradient(&adjoints), Err(SimulationError::Interrupted)));
}

#[test]
fn the_jacobian_is_that_of_the_adjoint() {
    for material in gradcheck_materials() {
        let world = gradcheck_world(material);
        let options = Options { precision: Precision::F64, ..Options::default() };
        let mut unknowns = vec![Unknown::Density { body: 0 }, Unknown::Velocity { body: 0, axis: 1 }];
        unknowns.extend((0..material.parameters().len()).map(|parameter| Unknown::Material { body: 0, parameter }));
        let tangents = jacobian(&world, &options, &[2, 1], &unknowns).unwrap();
        let loss = |frame: &Frame| FrameAdjoint {
            positions: Some(frame.positions.iter().map(|_| DVec3::new(1.0, -0.5, 0.3) / 210.0).collect()),
            velocities: (frame.index == 2).then(|| vec![DVec3::new(0.01, 0.02, -0.01) / 210.0; 210]),
        };
        let body = gradient(&world, &options, 3, loss).unwrap().bodies.remove(0);
        let by_adjoint = [&[body.density, body.velocity.y][..], &body.material].concat();
        for ((unknown, tangent), adjoint) in unknowns.iter().zip(&tangents).zip(by_adjoint) {
            // Frame 0 changes with none of these.
            let positions = tangent.positions.iter().flatten().sum::<DVec3>().dot(DVec3::new(1.0, -0.5, 0.3));
            let velocities = tangent.velocities[0].iter().sum::<DVec3>().dot(DVec3::new(0.01, 0.02, -0.01));
            let difference = (positions + velocities) / 210.0;
            let error = (difference - adjoint).abs() / adjoint.abs();
            assert!(error < 1e-4, "{} {unknown:?}: {difference:e} against {adjoint:e}", material.model());
        }
    }
}

#[test]
fn a_loss_gradient_that_makes_no_sense_is_refused() {
    let world = gradcheck_world(gradcheck_materials()[0]);
    let options = Options::default();
    let short = gradient(&world, &options, 2, |_| Some(vec![DVec3::ZERO]));
    let nan = gradient(&world, &options, 2, |frame| Some(vec![DVec3::NAN; frame.positions.len()]));
    assert!(matches!(short, Err(SimulationError::LossGradient { frame: 0, .. })), "{short:?}");
    assert!(matches!(nan, Err(SimulationError::LossGradient { frame: 0, .. })), "{nan:?}");
}
