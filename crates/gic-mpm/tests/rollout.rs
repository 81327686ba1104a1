//! Rollouts as users meet them: engines that agree, bits that repeat, states that resume, bounds that hold, errors that
//! help.

use gic_mpm::{
    Ball, Body, ColliderPath, Frame, Level, Material, MaterialError, Options, Precision, Primitive, SimulationError,
    Simulator, Snapshot, Stepping, World, gradcheck_materials, gradcheck_world, rollout,
};
use glam::{DQuat, DVec3};
use proptest::prelude::*;

fn f64_options() -> Options {
    Options { precision: Precision::F64, ..Options::default() }
}

fn frames(world: &World, options: &Options, count: usize) -> Vec<Frame> {
    let mut all = Vec::new();
    rollout(world, options, count, |frame| all.push(frame)).unwrap();
    all
}

/// A block large enough for several chunks per body.
fn large_world() -> World {
    let mut world = gradcheck_world(gradcheck_materials()[1]);
    let positions = |corner: DVec3, n: usize| -> Vec<DVec3> {
        (0..n).map(|i| corner + DVec3::new((i % 40) as f64, (i / 40 % 20) as f64, (i / 800) as f64) * 0.01).collect()
    };
    world.bodies[0].positions = positions(DVec3::new(0.0, 0.06, 0.0), 36_000);
    world.bodies[0].volume_factors = (0..36_000).map(|p| 0.7 + 0.1 * f64::from(p % 7)).collect();
    let second = Body {
        material: gradcheck_materials()[3],
        positions: positions(DVec3::new(-0.45, 0.12, 0.0), 5_000),
        volume_factors: Vec::new(),
        ..world.bodies[0].clone()
    };
    world.bodies.push(second);
    world.colliders.truncate(1);
    world.stepping = Stepping::at_least(50);
    world
}

/// Largest difference relative to the largest number, for positions (about the centre), velocities and deformation
/// gradients.
fn relative_differences(a: &Snapshot, b: &Snapshot) -> [f64; 3] {
    let mean: Vec<f64> =
        (0..3).map(|k| b.particles.iter().map(|p| p[k]).sum::<f64>() / b.particles.len() as f64).collect();
    let of = |range: core::ops::Range<usize>, shift: &[f64]| {
        let (mut difference, mut size) = (0.0f64, 0.0f64);
        for (p, q) in a.particles.iter().zip(&b.particles) {
            for k in range.clone() {
                difference = difference.max((p[k] - q[k]).abs());
                size = size.max((q[k] - shift.get(k).copied().unwrap_or(0.0)).abs());
            }
        }
        difference / size
    };
    [of(0..3, &mean), of(3..6, &[]), of(15..24, &[])]
}

#[test]
fn every_level_agrees_with_the_f64_twin_after_ten_substeps() {
    for material in gradcheck_materials() {
        let mut world = gradcheck_world(material);
        world.frame_rate_hz = 500.0;
        world.stepping = Stepping::at_least(10);
        let after = |options: &Options| {
            let mut simulator = Simulator::new(&world, options).unwrap();
            simulator.advance_frame().unwrap();
            simulator.snapshot()
        };
        let oracle = after(&f64_options());
        let levels = Level::supported().map(|level| Options { level: Some(level), ..Options::default() });
        for options in levels.chain([Options { twin: true, ..Options::default() }]) {
            let differences = relative_differences(&after(&options), &oracle);
            println!("{} {:?} twin {}: {differences:?}", material.model(), options.level, options.twin);
            assert!(
                differences.iter().all(|d| *d <= 1e-5),
                "{} {:?}: {differences:?}",
                material.model(),
                options.level
            );
        }
    }
}

#[test]
fn the_result_does_not_depend_on_the_threads() {
    let world = large_world();
    let run = |threads: usize, parallel: bool| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| frames(&world, &Options { parallel, ..Options::default() }, 2))
    };
    let one = run(1, false);
    assert_eq!(one, run(1, true));
    assert_eq!(one, run(2, true));
    assert_eq!(one, run(3, true));
}

#[test]
fn particles_keep_their_order_and_bodies_their_places() {
    let world = large_world();
    let last = frames(&world, &Options::default(), 2).pop().unwrap();
    assert_eq!(last.positions.len(), 41_000);
    let start = world.bodies.iter().flat_map(|body| &body.positions);
    // 3 m/s for a hundredth of a second.
    assert!(start.zip(&last.positions).all(|(a, b)| a.distance(*b) < 0.06));
}

#[test]
fn a_restored_state_continues_with_the_same_bits() {
    for options in [Options::default(), f64_options()] {
        let world = gradcheck_world(gradcheck_materials()[2]);
        let mut straight = Simulator::new(&world, &options).unwrap();
        for _ in 0..2 {
            straight.advance_frame().unwrap();
        }
        let mut file = Vec::new();
        straight.snapshot().write(&mut file).unwrap();
        let expected = straight.advance_frame().unwrap();

        let mut resumed = Simulator::new(&world, &options).unwrap();
        resumed.restore(&Snapshot::read(&file[..]).unwrap()).unwrap();
        assert_eq!(resumed.frame().index, 2);
        assert_eq!(resumed.advance_frame().unwrap(), expected);

        let cut = Snapshot::read(&file[..file.len() - 1]).unwrap_err();
        assert_eq!(cut.kind(), std::io::ErrorKind::UnexpectedEof);
        let mut other = resumed.snapshot();
        other.particles.pop();
        assert!(matches!(resumed.restore(&other), Err(SimulationError::StateMismatch { .. })));
    }
}

#[test]
fn contact_forces_balance_the_change_of_momentum() {
    let world = gradcheck_world(gradcheck_materials()[0]);
    let all = frames(&world, &f64_options(), 4);
    let body = &world.bodies[0];
    let masses = body.masses_kg();
    let momentum = |frame: &Frame| frame.velocities.iter().zip(&masses).map(|(v, mass)| *v * *mass).sum::<DVec3>();
    let mut touched = false;
    for pair in all.windows(2) {
        let contact: DVec3 = pair[1].contacts.iter().map(|c| c.force_n).sum();
        let weight = world.gravity_m_s2 * masses.iter().sum::<f64>();
        let rate = (momentum(&pair[1]) - momentum(&pair[0])) * world.frame_rate_hz;
        touched |= contact.length() > weight.length();
        assert!(
            (rate - (weight - contact)).length() <= 1e-6 * (rate.length() + weight.length()),
            "{rate} {weight} {contact}"
        );
    }
    assert!(touched);
}

/// A particle of twice the volume is two particles in one place.
#[test]
fn a_volume_factor_counts_particles() {
    for material in gradcheck_materials() {
        let mut twice = gradcheck_world(material);
        let body = &mut twice.bodies[0];
        body.volume_factors = body.positions.iter().enumerate().map(|(p, _)| 1.0 + (p % 2) as f64).collect();
        let mut pairs = twice.clone();
        let odd: Vec<DVec3> = pairs.bodies[0].positions.iter().copied().skip(1).step_by(2).collect();
        pairs.bodies[0].positions.extend(odd);
        pairs.bodies[0].volume_factors.clear();
        let ends = [&twice, &pairs].map(|world| frames(world, &f64_options(), 4).pop().unwrap().positions);
        let moved = ends[0].iter().zip(&ends[1]).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
        assert!(moved < 1e-9, "{material:?}: {moved}");
    }
}

#[test]
fn a_frame_that_turns_out_unstable_is_redone_with_more_substeps() {
    for options in [Options::default(), f64_options()] {
        let mut world = gradcheck_world(Material::Elastic { youngs_modulus_pa: 2e4, poisson_ratio: 0.3 });
        world.bodies[0].velocity_m_s = DVec3::ZERO;
        world.colliders.clear();
        world.frame_rate_hz = 100.0;
        world.stepping = Stepping::at_least(10);
        // Pressed to a tenth of its size, it bursts: faster than waves in a body at rest, from which substeps are
        // planned.
        let mut simulator = Simulator::new(&world, &options).unwrap();
        let mut pressed = simulator.snapshot();
        for particle in &mut pressed.particles {
            particle[15..].copy_from_slice(&[0.1, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.1]);
        }
        simulator.restore(&pressed).unwrap();
        let frame = simulator.advance_frame().unwrap();
        assert!(frame.substeps > 10, "{}", frame.substeps);
        assert!(frame.velocities.iter().all(|v| v.is_finite()));
    }
}

#[test]
fn stepping_by_the_bound_takes_what_the_wave_speed_asks() {
    let mut world = gradcheck_world(gradcheck_materials()[0]);
    world.stepping = Stepping { courant: 0.5, ..Stepping::STABLE };
    let speed = gradcheck_materials()[0].wave_speed_m_s(1000.0);
    let frame = frames(&world, &Options::default(), 2).pop().unwrap();
    let at_least = speed / (0.5 * world.grid_spacing_m * world.frame_rate_hz);
    assert!(frame.substeps as f64 >= at_least && (frame.substeps as f64) < 2.0 * at_least, "{}", frame.substeps);
}

fn error(change: impl FnOnce(&mut World)) -> SimulationError {
    let mut world = gradcheck_world(gradcheck_materials()[0]);
    change(&mut world);
    rollout(&world, &Options::default(), 2, |_| {}).unwrap_err()
}

fn field(error: &SimulationError) -> &str {
    match error {
        SimulationError::Invalid { field, .. } => field,
        other => panic!("{other}"),
    }
}

#[test]
fn bad_worlds_are_refused_by_name() {
    assert_eq!(error(|w| w.bodies.clear()), SimulationError::Empty);
    assert_eq!(field(&error(|w| w.bodies[0].positions.clear())), "bodies[0].positions");
    assert_eq!(field(&error(|w| w.bodies[0].positions[7].y = f64::NAN)), "bodies[0].positions[7]");
    assert_eq!(field(&error(|w| w.bodies[0].density_kg_m3 = -1.0)), "bodies[0].density_kg_m3");
    assert_eq!(field(&error(|w| w.bodies[0].particle_volume_m3 = f64::NAN)), "bodies[0].particle_volume_m3");
    assert_eq!(field(&error(|w| w.grid_spacing_m = 0.0)), "grid_spacing_m");
    assert_eq!(field(&error(|w| w.stepping = Stepping { courant: 1.5, ..Stepping::STABLE })), "stepping.courant");
    assert_eq!(
        field(&error(|w| w.colliders[1].primitive = Primitive::Sphere { radius_m: 0.0 })),
        "colliders[1].radius_m"
    );
    let normal = Primitive::HalfSpace { normal: DVec3::new(0.0, 2.0, 0.0) };
    assert_eq!(field(&error(|w| w.colliders[0].primitive = normal)), "colliders[0].normal");
    let nu = error(|w| w.bodies[0].material = Material::Elastic { youngs_modulus_pa: 1e5, poisson_ratio: 0.5 });
    assert!(matches!(
        nu,
        SimulationError::Material { body: 0, source: MaterialError::OutOfRange { name: "poisson_ratio", .. } }
    ));
    assert_eq!(field(&error(|w| w.bodies[0].volume_factors.truncate(3))), "bodies[0].volume_factors");
    assert_eq!(field(&error(|w| w.bodies[0].volume_factors[3] = 0.0)), "bodies[0].volume_factors[3]");
    let sunk = error(|w| w.bodies[0].positions[3].y = -0.5);
    assert!(matches!(sunk, SimulationError::InsideCollider { particle: 3, collider: 0, .. }), "{sunk}");
}

#[test]
fn rollouts_that_cannot_go_on_say_why() {
    let stiff = error(|w| w.bodies[0].material = Material::Elastic { youngs_modulus_pa: 1e16, poisson_ratio: 0.3 });
    assert!(matches!(stiff, SimulationError::TooStiff { body: 0, .. }), "{stiff}");
    assert!(stiff.to_string().contains("grid_spacing_m"), "{stiff}");
    let far = error(|w| w.bodies[0].positions[5] = DVec3::new(1e4, 1.0, 0.0));
    assert!(matches!(far, SimulationError::LeftDomain { particle: 5, frame: 1, .. }), "{far}");
    let apart = error(|w| w.bodies[0].positions[5] = DVec3::new(200.0, 200.0, 200.0));
    assert!(matches!(apart, SimulationError::LeftDomain { particle: 5, frame: 1, .. }), "{apart}");
}

/// A block that falls through a ball of space, and one that stays within it.
#[test]
fn what_leaves_the_domain_ends_the_rollout() {
    let mut world = gradcheck_world(gradcheck_materials()[0]);
    world.colliders.clear();
    world.bodies[0].velocity_m_s = DVec3::ZERO;
    world.gravity_m_s2 = DVec3::new(0.0, -10.0, 0.0);
    world.frame_rate_hz = 10.0;
    let centre_m = world.bodies[0].positions[0];
    let within = |radius_m: f64| {
        let options = Options { domain: Some(Ball { centre_m, radius_m }), ..Options::default() };
        let mut last = 0;
        (rollout(&world, &options, 6, |frame| last = frame.index), last)
    };
    // 1.25 m in five frames, and the block is a tenth as large.
    assert!(matches!(within(2.0), (Ok(()), 5)));
    let (left, last) = within(0.6);
    assert!(matches!(left, Err(SimulationError::LeftDomain { .. })) && last == 3, "{left:?} after frame {last}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, ..ProptestConfig::default() })]

    /// In free flight, linear and angular momentum of the particles (the latter with that of their affine motion) are
    /// kept.
    #[test]
    fn free_flight_keeps_momentum(
        velocity in proptest::array::uniform3(-2.0f64..2.0), spin in proptest::array::uniform3(-5.0f64..5.0),
        material in 0usize..5,
    ) {
        let mut world = gradcheck_world(gradcheck_materials()[material]);
        world.colliders.clear();
        world.gravity_m_s2 = DVec3::ZERO;
        world.bodies[0].velocity_m_s = DVec3::from(velocity);
        world.bodies[0].angular_velocity_rad_s = DVec3::from(spin);
        let mut simulator = Simulator::new(&world, &f64_options()).unwrap();
        let momenta = |snapshot: &Snapshot| {
            let (mut linear, mut angular) = (DVec3::ZERO, DVec3::ZERO);
            for (p, factor) in snapshot.particles.iter().zip(&world.bodies[0].volume_factors) {
                let (x, v, c) = (DVec3::from_slice(&p[..3]), DVec3::from_slice(&p[3..6]), &p[6..15]);
                linear += v * *factor;
                // The affine part of APIC: the second moment of the kernel is dx^2 / 4.
                let curl = DVec3::new(c[7] - c[5], c[2] - c[6], c[3] - c[1]);
                angular += (x.cross(v) + curl * (world.grid_spacing_m.powi(2) / 4.0)) * *factor;
            }
            (linear, angular)
        };
        let before = momenta(&simulator.snapshot());
        simulator.advance_frame().unwrap();
        let after = momenta(&simulator.snapshot());
        let size = 210.0;
        prop_assert!((after.0 - before.0).length() <= 1e-10 * size, "{} {}", before.0, after.0);
        prop_assert!((after.1 - before.1).length() <= 1e-10 * size, "{} {}", before.1, after.1);
    }
}

/// The grid lies on the ground, so nothing depends on how a scene is tilted: a slanted floor is no staircase.
#[test]
fn a_world_that_is_tilted_as_a_whole_moves_as_before() {
    let turn = DQuat::from_rotation_arc(DVec3::Y, DVec3::new(0.3, 0.9, -0.4).normalize());
    let options = f64_options();
    for material in gradcheck_materials() {
        let mut world = gradcheck_world(material);
        world.colliders[0].primitive = Primitive::HalfSpace { normal: DVec3::Y };
        let mut turned = world.clone();
        let body = &mut turned.bodies[0];
        body.positions.iter_mut().for_each(|x| *x = turn * *x);
        body.velocity_m_s = turn * body.velocity_m_s;
        body.angular_velocity_rad_s = turn * body.angular_velocity_rad_s;
        turned.gravity_m_s2 = turn * world.gravity_m_s2;
        turned.colliders[0].primitive = Primitive::HalfSpace { normal: turn * DVec3::Y };
        let ColliderPath::Uniform { position_m, velocity_m_s, .. } = &mut turned.colliders[1].path else {
            panic!("the ball moves evenly")
        };
        (*position_m, *velocity_m_s) = (turn * *position_m, turn * *velocity_m_s);
        for (before, after) in frames(&world, &options, 4).iter().zip(frames(&turned, &options, 4)) {
            let off = before.positions.iter().zip(&after.positions).map(|(a, b)| (turn * *a).distance(*b));
            let off = off.fold(0.0, f64::max);
            assert!(off < 1e-9, "{}: {off} m in frame {}", material.model(), before.index);
            let speeds = before.velocities.iter().zip(&after.velocities).map(|(a, b)| (turn * *a).distance(*b));
            assert!(speeds.fold(0.0, f64::max) < 1e-6, "{}", material.model());
            for (a, b) in before.contacts.iter().zip(&after.contacts) {
                assert!((turn * a.force_n).distance(b.force_n) <= 1e-6 * (1.0 + a.force_n.length()), "{a:?} {b:?}");
            }
        }
    }
}
