//! Worlds at the edge of what can be computed, and random ones: each is computed right or refused with its cause.

mod common;

use common::{block, body, world};
use gic_mpm::{
    Budget, Collider, ColliderPath, Contact, Doubt, Forecast, Frame, Material, MaterialKind, Options, Primitive,
    SimulationError, Simulator, Stepping, World, rollout,
};
use glam::{DQuat, DVec3};
use proptest::prelude::*;

const DX: f64 = 0.02;
const ELASTIC: Material = Material::Elastic { youngs_modulus_pa: 1e5, poisson_ratio: 0.3 };

/// A cube of eight cells, its lowest particles `height` above the origin.
fn cube(height: f64) -> World {
    let positions = block(DVec3::new(-0.04, height, -0.04), DVec3::splat(0.08), DX);
    world(body(ELASTIC, positions, DX), Vec::new(), DX, 24.0)
}

fn floor() -> Collider {
    Collider::plane(DVec3::ZERO, DVec3::Y, Contact::Sticky)
}

fn moving(primitive: Primitive, path: ColliderPath) -> Collider {
    Collider { primitive, path, contact: Contact::Sticky }
}

fn frames(world: &World, count: usize) -> Result<Vec<Frame>, SimulationError> {
    let mut all = Vec::new();
    rollout(world, &Options::default(), count, |frame| all.push(frame)).map(|()| all)
}

fn centre(frame: &Frame) -> DVec3 {
    frame.positions.iter().sum::<DVec3>() / frame.positions.len() as f64
}

/// Where a body is after `frame` frames of free fall in equal substeps.
fn fallen(world: &World, frame: &Frame) -> DVec3 {
    let (t, dt) = (frame.index as f64 / world.frame_rate_hz, 1.0 / (world.frame_rate_hz * frame.substeps as f64));
    world.bodies[0].velocity_m_s * t + world.gravity_m_s2 * (0.5 * t * (t + dt))
}

#[test]
fn light_particles_fall_as_heavy_ones_do() {
    for spacing_m in [1e-3f64, 1e-5, 1e-6, 1e-12, 1e-30] {
        let mut world = cube(1.0);
        world.bodies[0].particle_volume_m3 = spacing_m.powi(3);
        world.stepping = Stepping::at_least(200);
        let all = frames(&world, 4).unwrap();
        let fall = centre(&all[3]) - centre(&all[0]);
        assert!(fall.distance(fallen(&world, &all[3])) < 1e-5, "{spacing_m} m: {fall}");
    }
}

#[test]
fn a_small_world_is_the_large_one_seen_from_afar() {
    let scale = 1e-6;
    let large = { World { colliders: vec![floor()], stepping: Stepping::at_least(300), ..cube(0.03) } };
    let mut small = large.clone();
    small.bodies[0].positions.iter_mut().for_each(|x| *x *= scale);
    small.bodies[0].particle_volume_m3 *= scale.powi(3);
    // As fast relative to its size: the same waves, the same fall.
    small.bodies[0].density_kg_m3 /= scale * scale;
    small.grid_spacing_m *= scale;
    small.gravity_m_s2 *= scale;
    let heights =
        [(&large, 1.0), (&small, scale)].map(|(world, scale)| centre(&frames(world, 4).unwrap()[3]).y / scale);
    assert!((heights[0] - heights[1]).abs() < 1e-5, "{heights:?}");
}

#[test]
fn a_grid_that_does_not_see_the_body_is_refused_or_doubted() {
    let mut world = cube(0.5);
    assert_eq!(world.doubts(), []);
    world.grid_spacing_m = 0.5;
    assert!(matches!(frames(&world, 2), Err(SimulationError::Unresolved { body: 0, cells }) if cells < 0.2));
    world.grid_spacing_m = 0.04;
    assert!(matches!(world.doubts()[..], [Doubt::Coarse { body: 0, .. }]), "{:?}", world.doubts());
}

#[test]
fn particles_that_do_not_fill_their_place_are_doubted() {
    let filling = |spacing_m: f64| {
        let mut world = cube(0.5);
        world.bodies[0].particle_volume_m3 = spacing_m.powi(3);
        world.doubts()
    };
    for spacing_m in [1e-3, 0.1] {
        assert!(matches!(filling(spacing_m)[..], [Doubt::Filling { body: 0, .. }]), "{spacing_m}");
    }
    assert_eq!(filling(0.5 * DX), []);
}

#[test]
fn a_wall_does_not_jump_over_the_body() {
    let wall = |path: ColliderPath| World {
        colliders: vec![moving(Primitive::HalfSpace { normal: DVec3::X }, path)],
        gravity_m_s2: DVec3::ZERO,
        stepping: Stepping::at_least(20),
        frame_rate_hz: 240.0,
        ..cube(0.0)
    };
    let uniform = |speed: f64| ColliderPath::Uniform {
        position_m: DVec3::X * -0.1,
        world_from_collider: DQuat::IDENTITY,
        velocity_m_s: DVec3::X * speed,
        angular_velocity_rad_s: DVec3::ZERO,
    };
    // 500 m/s: five cells in each of the twenty substeps.
    let pushed = frames(&wall(uniform(500.0)), 2).unwrap();
    let front = pushed[1].positions.iter().map(|x| x.x).fold(f64::INFINITY, f64::min);
    assert!(front > -0.1 + 500.0 / 240.0 - 3.5 * DX, "{front}");
    let too_fast = frames(&wall(uniform(1e7)), 2).unwrap_err();
    assert!(matches!(too_fast, SimulationError::ColliderTooFast { frame: 1, collider: 0, .. }), "{too_fast}");
    let keys = vec![(0.0, DVec3::X * -0.1), (1e-9, DVec3::X * 0.5)];
    let jumps = frames(&wall(ColliderPath::Keyframed { keys, world_from_collider: DQuat::IDENTITY }), 2).unwrap_err();
    assert!(matches!(jumps, SimulationError::ColliderTooFast { .. }), "{jumps}");
    // What goes away from the body, or passes far from it, costs nothing.
    let away = frames(&wall(uniform(-1e7)), 2).unwrap();
    assert_eq!(centre(&away[0]), centre(&away[1]));
}

#[test]
fn a_body_is_not_pressed_through_the_floor() {
    let press = moving(
        Primitive::HalfSpace { normal: DVec3::NEG_Y },
        ColliderPath::Keyframed {
            keys: vec![(0.0, DVec3::Y * 0.14), (0.5, DVec3::Y * -2.0)],
            world_from_collider: DQuat::IDENTITY,
        },
    );
    let world = World { colliders: vec![floor(), press], ..cube(0.01) };
    let mut doubts = Vec::new();
    let stopped = rollout(&world, &Options::default(), 12, |frame| doubts.extend(frame.doubts())).unwrap_err();
    let SimulationError::ThroughCollider { frame, .. } = stopped else { panic!("{stopped}") };
    assert!(frame < 8, "{stopped}");
    assert!(matches!(doubts[..], [Doubt::Squeezed { jacobian, .. }, ..] if jacobian < 0.125), "{doubts:?}");
}

#[test]
fn substeps_that_rounding_swallows_are_refused() {
    let mut world = cube(3.0);
    world.stepping = Stepping::at_least(50_000);
    world.frame_rate_hz = 24_000.0;
    let slow = frames(&world, 2).unwrap_err();
    assert!(matches!(slow, SimulationError::Rounded { frame: 1, .. } | SimulationError::MomentumLost { .. }), "{slow}");
}

#[test]
fn a_thin_obstacle_is_doubted() {
    let still = |primitive| Collider { primitive, ..floor() };
    let doubts = |primitive| World { colliders: vec![still(primitive)], ..cube(0.5) }.doubts();
    assert!(matches!(
        doubts(Primitive::Box { half_size_m: DVec3::new(1.0, 0.5 * DX, 1.0) })[..],
        [Doubt::Thin { collider: 0, .. }]
    ));
    assert_eq!(doubts(Primitive::Sphere { radius_m: 0.1 }), []);
}

#[test]
fn what_takes_too_long_or_too_much_memory_is_refused_before_it_starts() {
    let fixed = |substeps: usize| World { stepping: Stepping::at_least(substeps), ..cube(0.5) };
    for substeps in [usize::MAX, 1_000_000_000, 200_001] {
        let refused = frames(&fixed(substeps), 2).unwrap_err();
        assert!(matches!(&refused, SimulationError::Invalid { field, .. } if field.contains("substeps")), "{refused}");
    }
    let long = frames(&fixed(200), 1_000_000_000).unwrap_err();
    assert!(matches!(long, SimulationError::OverBudget { .. }) && long.to_string().contains("hours"), "{long}");
    let small = Options { budget: Budget { memory_bytes: 1e4, ..Budget::default() }, ..Options::default() };
    assert!(matches!(Simulator::new(&fixed(200), &small), Err(SimulationError::OverBudget { .. })));
    let forecast = Forecast::of(&fixed(200), 24).unwrap();
    assert_eq!((forecast.particles, forecast.frames, forecast.substeps_per_frame), (512, 24, 200));
}

/// Anything that a twin may say, mostly within what makes sense.
fn any_world() -> impl Strategy<Value = World> {
    let vector = |size: f64| proptest::array::uniform3(-size..size).prop_map(DVec3::from);
    let kind = (0..MaterialKind::ALL.len()).prop_map(|i| MaterialKind::ALL[i]);
    let material =
        (kind, proptest::collection::vec(-3.0f64..3.0, 5)).prop_map(|(kind, decades)| material(kind, &decades));
    let start = (material, proptest::array::uniform3(2usize..9), -4.0f64..5.0, -2.0f64..2.0, vector(3.0), vector(10.0));
    let stepping = (1usize..300, 0.1f64..0.9)
        .prop_map(|(least_substeps_per_frame, courant)| Stepping { least_substeps_per_frame, courant });
    let colliders = proptest::collection::vec((0..5usize, 0..3usize, vector(1.0), vector(1.0), 0.0f64..4.0), 0..3);
    (start, stepping, colliders, vector(20.0), -5.0f64..1.0, 1.0f64..3.0, 0.2f64..2.5).prop_map(
        |((material, counts, density, factors, velocity, spin), stepping, obstacles, gravity, size, rate, cell)| {
            let dx = 10f64.powf(size);
            // Velocities and gravity as a body of that size shows them.
            let (per_second, h) = (10f64.powf(rate), 0.5 * dx);
            let size = DVec3::from(counts.map(|n| n as f64)) * h;
            let body = gic_mpm::Body {
                density_kg_m3: 10f64.powf(density),
                volume_factors: (0..counts.iter().product()).map(|p| (factors * (p % 5) as f64).exp()).collect(),
                velocity_m_s: velocity * dx * per_second,
                angular_velocity_rad_s: spin,
                own_velocities_m_s: Vec::new(),
                ..body(material, block(-0.5 * size, size, dx), dx)
            };
            World {
                bodies: vec![body],
                colliders: obstacles.into_iter().map(|o| obstacle(o, size, dx * per_second)).collect(),
                gravity_m_s2: gravity * dx * per_second,
                grid_spacing_m: dx * cell,
                frame_rate_hz: per_second,
                stepping,
            }
        },
    )
}

/// The law with each parameter so many decades from that of a soft thing.
fn material(kind: MaterialKind, decades: &[f64]) -> Material {
    let value = |(name, decade): (&&str, &f64)| match *name {
        "poisson_ratio" => 0.24 + 0.08 * decade,
        "friction_angle_deg" => 40.0 + 10.0 * decade,
        "retardation_time_s" => 10f64.powf(decade - 4.0),
        "viscosity_pa_s" | "plastic_viscosity_pa_s" => 10f64.powf(*decade),
        _ => 10f64.powf(4.0 + decade),
    };
    let values: Vec<f64> = kind.parameter_names().iter().zip(decades).map(value).collect();
    Material::new(kind, &values).expect("within the law's bounds")
}

/// An obstacle that begins outside of a body of that size around the origin, and may move.
fn obstacle(
    (shape, contact, way, velocity, pace): (usize, usize, DVec3, DVec3, f64),
    size: DVec3,
    speed: f64,
) -> Collider {
    let (towards, r) = (way.normalize_or(DVec3::Y), size.length());
    let primitive = match shape {
        0 => Primitive::HalfSpace { normal: -towards },
        1 => Primitive::Sphere { radius_m: r },
        2 => Primitive::Box { half_size_m: DVec3::splat(0.5 * r) },
        3 => Primitive::Cylinder { radius_m: 0.3 * r, half_height_m: r },
        _ => Primitive::Capsule { radius_m: 0.2 * r, half_height_m: r },
    };
    let distance = if shape == 0 { 0.6 * r } else { 2.8 * r };
    Collider {
        primitive,
        path: ColliderPath::Uniform {
            position_m: towards * distance,
            world_from_collider: DQuat::IDENTITY,
            velocity_m_s: velocity * (speed * 10f64.powf(pace - 2.0)),
            angular_velocity_rad_s: DVec3::ZERO,
        },
        contact: [Contact::Sticky, Contact::Slip { friction: 0.3 }, Contact::Separating { friction: 0.3 }][contact],
    }
}

/// Cases of the suite; `PROPTEST_CASES=100000` makes a long run of it.
fn cases() -> ProptestConfig {
    let own = ProptestConfig::default();
    if std::env::var_os("PROPTEST_CASES").is_some() { own } else { ProptestConfig { cases: 96, ..own } }
}

/// The frames of a world that is quickly computed.
fn quick_frames(world: &World, count: usize) -> Result<Vec<Frame>, SimulationError> {
    let options = Options { budget: Budget { seconds: 0.3, ..Budget::default() }, ..Options::default() };
    let mut all = Vec::new();
    rollout(world, &options, count, |frame| all.push(frame)).map(|()| all)
}

proptest! {
    #![proptest_config(cases())]

    /// Momentum changes by gravity and by what the obstacles take, and where there are none the body falls as bodies
    /// do, or the engine says why it stopped.
    #[test]
    fn a_random_world_keeps_momentum_and_mass_or_says_why_it_stopped(world in any_world()) {
        let all = match quick_frames(&world, 4) {
            Ok(all) => all,
            Err(reason) => {
                prop_assert!(!reason.to_string().is_empty());
                return Ok(());
            }
        };
        let masses = world.bodies[0].masses_kg();
        let total: f64 = masses.iter().sum();
        let seconds = 1.0 / world.frame_rate_hz;
        for pair in all.windows(2) {
            prop_assert_eq!(pair[1].positions.len(), masses.len());
            prop_assert!(pair[1].positions.iter().chain(&pair[1].velocities).all(|v| v.is_finite()));
            let momentum = |f: &Frame| f.velocities.iter().zip(&masses).map(|(v, m)| *v * *m).sum::<DVec3>();
            let size = |f: &Frame| f.velocities.iter().zip(&masses).map(|(v, m)| v.length() * m).sum::<f64>();
            let taken = pair[1].contacts.iter().map(|c| c.force_n * seconds);
            let weight = world.gravity_m_s2 * (total * seconds);
            let error = momentum(&pair[1]) - momentum(&pair[0]) - weight + taken.clone().sum::<DVec3>();
            let crossing = total * world.grid_spacing_m / seconds;
            let taken: f64 = taken.map(|t| t.length()).sum();
            let at_work = size(&pair[0]) + size(&pair[1]) + weight.length() + taken + crossing;
            prop_assert!(error.length() <= 1e-3 * at_work, "{} of {at_work}", error.length());
        }
        if world.colliders.is_empty() {
            let of_mass = |f: &Frame| f.positions.iter().zip(&masses).map(|(x, m)| *x * *m).sum::<DVec3>() / total;
            let (moved, last) = (of_mass(&all[3]) - of_mass(&all[0]), &all[3]);
            // Gravity acts in substeps, whose length may change from frame to frame.
            let longest = all[1..].iter().map(|frame| seconds / frame.substeps as f64).fold(0.0, f64::max);
            let by_substeps = world.gravity_m_s2.length() * 3.0 * seconds * longest;
            let (expected, error) = (fallen(&world, last), moved.distance(fallen(&world, last)));
            // At most what the engine lets rounding do.
            let by_rounding = 0.3 * world.grid_spacing_m;
            let allowed = 1e-3 * expected.length() + by_substeps + by_rounding;
            prop_assert!(error <= allowed, "{moved} instead of {expected}");
        }
    }
}
