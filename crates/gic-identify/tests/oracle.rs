//! Solver without reconstruction: true particles at time 0 and true surfaces in every frame give the true parameters.

use std::ops::ControlFlow;

use gic_identify::{
    Checkpoint, Estimates, Event, IdentifyError, Input, Observation, Settings, Stage, Start, Target, View, WorldDoubt,
    identify, sought, sought_values,
};
use gic_mpm::{
    Body, Collider, ColliderPath, Contact, Material, MaterialKind, Options, Primitive, Stepping, World, rollout,
};
use gic_scene::Camera;
use glam::{DMat3, DQuat, DVec2, DVec3};
use rand::{RngExt, SeedableRng};

fn run(input: &Input, kind: MaterialKind, settings: &Settings) -> Result<Estimates, IdentifyError> {
    identify(input, kind, settings, Checkpoint::default(), &mut |_| ControlFlow::Continue(()))
}

const SPACING: f64 = 0.02;
const SUBSTEPS: usize = 60;
const RATE: f64 = 24.0;
const GRAVITY: DVec3 = DVec3::new(0.0, -9.8, 0.0);

fn ground() -> Collider {
    Collider {
        primitive: Primitive::HalfSpace { normal: DVec3::Y },
        path: ColliderPath::Uniform {
            position_m: DVec3::ZERO,
            world_from_collider: DQuat::IDENTITY,
            velocity_m_s: DVec3::ZERO,
            angular_velocity_rad_s: DVec3::ZERO,
        },
        contact: Contact::Sticky,
    }
}

/// A tilted block of particles, 8 x 5 x 5.
fn block() -> Vec<DVec3> {
    let (size, tilt) = ([8, 5, 5], DQuat::from_scaled_axis(DVec3::new(0.3, 0.2, 0.5)));
    let mut positions = Vec::new();
    for x in 0..size[0] {
        for y in 0..size[1] {
            for z in 0..size[2] {
                let local = DVec3::new(f64::from(x) - 3.5, f64::from(y) - 2.0, f64::from(z) - 2.0) * 0.5 * SPACING;
                positions.push(tilt * local + DVec3::new(0.0, 0.16, 0.0));
            }
        }
    }
    positions
}

/// Particles whose neighbours lie to one side. Which ones these are changes as sand spreads, so it is decided anew in
/// each frame.
fn outer(points: &[DVec3]) -> Vec<DVec3> {
    let radius = 1.1 * SPACING;
    let lopsided = |p: &DVec3| {
        let near: Vec<DVec3> = points.iter().map(|q| *p - *q).filter(|d| d.length() < radius).collect();
        (near.iter().sum::<DVec3>() / near.len() as f64).length() > 0.2 * radius
    };
    points.iter().copied().filter(lopsided).collect()
}

/// Three cameras around the block, which look down on it.
fn cameras() -> Vec<Camera> {
    let around = |k: f64| {
        let centre = DQuat::from_rotation_y(2.1 * k) * DVec3::new(0.0, 0.7, 0.9);
        let z = (DVec3::new(0.0, 0.05, 0.0) - centre).normalize();
        let x = z.cross(DVec3::Y).normalize();
        Camera {
            width: 120,
            height: 120,
            focal: DVec2::splat(260.0),
            principal: DVec2::splat(60.0),
            world_from_camera: DMat3::from_cols(x, z.cross(x), z),
            centre,
        }
    };
    (0..3).map(|k| around(f64::from(k))).collect()
}

/// What a camera sees of particles: balls as wide as they lie apart.
fn mask(camera: &Camera, particles: &[DVec3]) -> Vec<f32> {
    let discs: Vec<(DVec2, f64)> = particles
        .iter()
        .filter_map(|p| camera.project(*p))
        .map(|(pixel, depth)| (pixel, 0.5 * SPACING * camera.focal.x / depth))
        .collect();
    let coverage = |i: usize| {
        let pixel = DVec2::new((i % camera.width) as f64 + 0.5, (i / camera.width) as f64 + 0.5);
        let covered = |(middle, radius): &(DVec2, f64)| (0.5 + radius - middle.distance(pixel)).clamp(0.0, 1.0);
        discs.iter().map(covered).fold(0.0, f64::max) as f32
    };
    (0..camera.width * camera.height).map(coverage).collect()
}

/// What a perfect reconstruction would see of the block made of `material`.
fn observed(material: Material, velocity: DVec3, frames: usize) -> Input {
    observed_on(ground(), Vec::new(), material, velocity, frames)
}

/// The same on another floor, and with the masks of `cameras`.
fn observed_on(floor: Collider, cameras: Vec<Camera>, material: Material, velocity: DVec3, frames: usize) -> Input {
    let positions = block();
    let volume = (0.5 * SPACING).powi(3);
    let world = World {
        bodies: vec![Body {
            material,
            density_kg_m3: 1000.0,
            particle_volume_m3: volume,
            volume_factors: Vec::new(),
            positions: positions.clone(),
            velocity_m_s: velocity,
            angular_velocity_rad_s: DVec3::ZERO,
            own_velocities_m_s: Vec::new(),
        }],
        colliders: vec![floor.clone()],
        gravity_m_s2: GRAVITY,
        grid_spacing_m: SPACING,
        frame_rate_hz: RATE,
        stepping: Stepping::at_least(SUBSTEPS),
    };
    let mut observations = Vec::new();
    rollout(&world, &Options::default(), frames, |frame| {
        let surface = outer(&frame.positions);
        observations.push(Observation {
            time_s: frame.index as f64 / RATE,
            surface,
            surface_doubts: Vec::new(),
            views: cameras
                .iter()
                .enumerate()
                .map(|(camera, c)| View { camera, mask: mask(c, &frame.positions) })
                .collect(),
        });
    })
    .expect("the truth can be simulated");
    let n = positions.len();
    Input {
        devices: Vec::new(),
        device_doubts: Vec::new(),
        positions,
        particle_volume_m3: volume,
        volume_factors: Vec::new(),
        doubts: Vec::new(),
        surface_error_m: 0.5 * volume.cbrt(),
        opacities: vec![0.9; n],
        scales: vec![0.5 * 0.01; n],
        cameras,
        observations,
        frame_rate_hz: RATE,
        gravity_m_s2: GRAVITY,
        colliders: vec![floor],
        world_doubt: None,
        was_filmed: false,
        density_kg_m3: 1000.0,
        grid_spacing_m: SPACING,
        substeps_per_frame: SUBSTEPS,
    }
}

/// A ground that was given too high or too low is found where it is, and the material with it.
#[test]
fn a_ground_that_is_elsewhere_is_found() {
    for off in [0.006, -0.004] {
        let mut input = observed(ELASTIC, DVec3::new(0.4, -1.5, 0.2), 8);
        input.colliders = vec![Collider::plane(DVec3::new(0.0, off, 0.0), DVec3::Y, Contact::Sticky)];
        input.world_doubt = Some(WorldDoubt { height_m: 0.02, ..WorldDoubt::default() });
        let settings = Settings { target: Target::Surfaces, grid_spacing_m: Some(SPACING), ..Settings::default() };
        let found = run(&input, ELASTIC.kind(), &settings).expect("identified");
        let height = found.world.expect("it was sought").height_m;
        let error = found.estimates[0].parameter.error(found.estimates[0].value, 1.0e5);
        println!("given {off} m off, found {height:.5} m from there; E off by {error:.4}");
        assert!((height + off).abs() < 3e-4 && error.abs() < 0.02, "{height} {error}");
        assert!((found.colliders[0].signed_distance(DVec3::ZERO, 0.0)).abs() < 3e-4);
    }
}

/// A floor that slopes and grips otherwise than was taken: what it does to a body that slides on it tells.
#[test]
fn a_ground_that_slopes_and_grips_otherwise_is_found() {
    let floor = |normal: DVec3, friction: f64| Collider::plane(DVec3::ZERO, normal, Contact::Separating { friction });
    let truth = floor(DVec3::new(0.02, 1.0, -0.015).normalize(), 0.3);
    let mut input = observed_on(truth.clone(), Vec::new(), ELASTIC, DVec3::new(0.9, -1.5, 0.4), 12);
    input.colliders = vec![floor(DVec3::Y, 0.5)];
    let log_friction = std::f64::consts::LN_2;
    let (height_m, tilt_rad, gravity_tilt_rad) = (0.005, 0.03, 0.03);
    let doubt = WorldDoubt { height_m, tilt_rad, log_friction, gravity_tilt_rad, ..WorldDoubt::default() };
    input.world_doubt = Some(doubt);
    let settings = Settings { target: Target::Surfaces, grid_spacing_m: Some(SPACING), ..Settings::default() };
    let found = run(&input, ELASTIC.kind(), &settings).expect("identified");
    let ground = found.world.expect("it was sought");
    let angle = found.colliders[0].normal().expect("a plane").angle_between(truth.normal().expect("a plane"));
    let friction = 0.5 * ground.log_friction.exp();
    println!("{angle:.4} rad off, friction {friction:.3} for .3, {ground:?}");
    assert!(angle < 0.004 && (friction / 0.3).ln().abs() < 0.1, "{angle} {friction}");
}

/// Whether a floor holds what touches it or lets it go shows in how a body leaves it, and the material with it.
#[test]
fn a_ground_that_holds_is_told_from_one_that_lets_go() {
    let floor = |contact: Contact| Collider::plane(DVec3::ZERO, DVec3::Y, contact);
    let lets_go = Contact::Separating { friction: 0.5 };
    for truth in [Contact::Sticky, lets_go] {
        let mut input = observed_on(floor(truth), Vec::new(), ELASTIC, DVec3::new(0.4, -1.5, 0.2), 12);
        input.colliders = vec![floor(lets_go)];
        input.world_doubt = Some(WorldDoubt { may_stick: true, ..WorldDoubt::default() });
        let settings = Settings { target: Target::Surfaces, grid_spacing_m: Some(SPACING), ..Settings::default() };
        let found = run(&input, ELASTIC.kind(), &settings).expect("identified");
        let error = found.estimates[0].parameter.error(found.estimates[0].value, 1.0e5);
        println!("{truth:?}: found {:?}, E off by {error:.4}", found.colliders[0].contact);
        assert_eq!(found.colliders[0].contact, truth);
        assert_eq!(found.world.expect("it was sought").sticks, truth == Contact::Sticky);
        assert!(error.abs() < 0.02, "{error}");
    }
}

/// Cameras whose focal lengths are all wrong alike see lengths in which gravity is another: the fall and the bounce say
/// which.
#[test]
fn a_gravity_in_other_lengths_is_found() {
    let velocity = DVec3::new(0.4, -1.5, 0.2);
    for log_gravity in [0.02f64, -0.015] {
        let mut input = observed(ELASTIC, velocity, 10);
        input.gravity_m_s2 = GRAVITY * (-log_gravity).exp();
        input.world_doubt = Some(WorldDoubt { log_gravity: 0.02, ..WorldDoubt::default() });
        let settings = Settings { target: Target::Surfaces, grid_spacing_m: Some(SPACING), ..Settings::default() };
        let found = run(&input, ELASTIC.kind(), &settings).expect("identified");
        let world = found.world.expect("it was sought");
        let error = found.estimates[0].parameter.error(found.estimates[0].value, 1.0e5);
        let off = (found.velocity_m_s - velocity).length();
        println!("{:.4} for {log_gravity}, E off by {error:.4}, velocity by {off:.4} m/s", world.log_gravity);
        assert!((world.log_gravity - log_gravity).abs() < 1e-3 && error.abs() < 0.02 && off < 3e-3);
        assert!((found.gravity_m_s2 - GRAVITY).length() < 0.01);
    }
}

/// Where cameras are all turned alike, or up is not quite up, gravity is tilted: the fall and the bounce say by how
/// much, and the ground's own tilt apart from it.
#[test]
fn a_gravity_that_is_tilted_is_found() {
    let velocity = DVec3::new(0.4, -1.5, 0.2);
    let mut input = observed(ELASTIC, velocity, 10);
    input.gravity_m_s2 = DQuat::from_scaled_axis(DVec3::new(0.012, 0.0, -0.008)) * GRAVITY;
    input.world_doubt = Some(WorldDoubt { tilt_rad: 0.02, gravity_tilt_rad: 0.02, ..WorldDoubt::default() });
    let settings = Settings { target: Target::Surfaces, grid_spacing_m: Some(SPACING), ..Settings::default() };
    let found = run(&input, ELASTIC.kind(), &settings).expect("identified");
    let error = found.estimates[0].parameter.error(found.estimates[0].value, 1.0e5);
    let (off, off_m_s) = (found.gravity_m_s2.angle_between(GRAVITY), (found.velocity_m_s - velocity).length());
    let normal = found.colliders[0].normal().expect("a plane");
    let slope = normal.angle_between(DVec3::Y);
    println!("gravity {off:.5} rad off, the ground {slope:.5}, E by {error:.4}, velocity by {off_m_s:.4} m/s");
    assert!(off < 0.002 && slope < 0.004 && error.abs() < 0.02 && off_m_s < 3e-3);
}

/// Identifies from `starts` random starts, two decades wide for moduli and the whole range for the others.
fn recovers(truth: Material, seed: u64, starts: u64) {
    let velocity = DVec3::new(0.4, -1.5, 0.2);
    let input = observed(truth, velocity, 8);
    let kind = truth.kind();
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    for trial in 0..starts {
        let start = sought(kind)
            .iter()
            .zip(sought_values(&truth))
            .map(|(p, value)| {
                let u: f64 = random.random();
                match p.name {
                    "poisson_ratio" => 0.05 + 0.4 * u,
                    "friction_angle_deg" => 10.0 + 45.0 * u,
                    _ => value * 10f64.powf(2.0 * u - 1.0),
                }
            })
            .collect();
        let settings = Settings {
            target: Target::Surfaces,
            starts: vec![Start { parameters: start, grid_spacing_m: None, sticks: false }],
            grid_spacing_m: Some(SPACING),
            ..Settings::default()
        };
        let found = run(&input, kind, &settings).expect("identified");
        println!(
            "start {trial} {:?} -> {:?}, {} rollouts + {} coarse, {:.0} s",
            settings.starts[0].parameters,
            found.material,
            found.rollouts,
            found.coarse_rollouts,
            found.seconds.iter().map(|(_, s)| s).sum::<f64>()
        );
        assert!(found.velocity_m_s.distance(velocity) < 5e-3, "start {trial}: {:?}", found.velocity_m_s);
        for (estimate, value) in found.estimates.iter().zip(sought_values(&truth)) {
            let error = estimate.parameter.error(estimate.value, value).abs();
            let allowed = if estimate.parameter.name == "friction_angle_deg" { 0.3 } else { 0.01 };
            assert!(
                error <= allowed,
                "start {trial}: {} = {} instead of {value}",
                estimate.parameter.name,
                estimate.value
            );
        }
    }
}

const ELASTIC: Material = Material::Elastic { youngs_modulus_pa: 1.0e5, poisson_ratio: 0.3 };
const PLASTICINE: Material =
    Material::Plasticine { youngs_modulus_pa: 3.0e5, poisson_ratio: 0.25, yield_stress_pa: 6.0e3 };
const SAND: Material = Material::Sand { friction_angle_deg: 30.0, youngs_modulus_pa: 1.0e6, poisson_ratio: 0.3 };
const NEWTONIAN: Material = Material::Newtonian { viscosity_pa_s: 60.0, bulk_modulus_pa: 5.0e4 };
const NON_NEWTONIAN: Material = Material::NonNewtonian {
    shear_modulus_pa: 2.0e4,
    bulk_modulus_pa: 8.0e4,
    yield_stress_pa: 1.5e3,
    plastic_viscosity_pa_s: 15.0,
};

const VISCOELASTIC: Material =
    Material::Viscoelastic { youngs_modulus_pa: 1.0e5, poisson_ratio: 0.3, retardation_time_s: 2.0e-3 };

/// What was made on other cells is explained by those: they decide how high the ground holds matter up and how much a
/// bounce loses.
#[test]
fn cells_of_another_size_are_found() {
    for given in [0.015, 0.024] {
        let substeps_per_frame = (SUBSTEPS as f64 * SPACING / given).ceil() as usize;
        let made = observed(ELASTIC, DVec3::new(0.4, -1.5, 0.2), 10);
        let input = Input { grid_spacing_m: given, substeps_per_frame, ..made };
        let settings = Settings { target: Target::Surfaces, ..Settings::default() };
        let sought = run(&input, ELASTIC.kind(), &settings).expect("identified");
        let settings = Settings { grid_spacing_m: Some(given), ..settings };
        let held = run(&input, ELASTIC.kind(), &settings).expect("identified");
        let error = |found: &Estimates| found.estimates[0].parameter.error(found.estimates[0].value, 1.0e5).abs();
        let cell = sought.grid_spacing_m;
        println!("given {given}, found {cell:.5}: E off by {:.4}, {:.4} if it is held", error(&sought), error(&held));
        assert_eq!(held.grid_spacing_m, given);
        assert!((cell / SPACING).ln().abs() < 0.02 && error(&sought) < 0.02, "{cell}");
        assert!(error(&sought) < error(&held));
    }
}

/// Where cells are neither given nor sought, other ones are not tried, but widen the interval.
#[test]
fn cells_in_doubt_widen_the_interval() {
    let input = Input { was_filmed: true, ..observed(ELASTIC, DVec3::new(0.4, -1.5, 0.2), 10) };
    // Poisson's ratio is known, or its mean would be taken where the interval reaches beyond its range.
    let fixed = vec![("poisson_ratio".to_owned(), 0.3)];
    let in_doubt = Settings { target: Target::Surfaces, fixed, ..Settings::default() };
    let given = Settings { grid_spacing_m: Some(SPACING), ..in_doubt.clone() };
    let [in_doubt, given] =
        [in_doubt, given].map(|settings| run(&input, ELASTIC.kind(), &settings).expect("identified"));
    let width = |found: &Estimates| found.estimates[0].interval_95.1 / found.estimates[0].interval_95.0;
    println!("E's interval spans a factor of {:.4}, {:.4} where cells are given", width(&in_doubt), width(&given));
    assert_eq!(in_doubt.grid_spacing_m, SPACING);
    assert_eq!(in_doubt.estimates[0].value.to_bits(), given.estimates[0].value.to_bits());
    assert!(width(&in_doubt) > width(&given));
}

/// A material that is known whole leaves the world to be found.
#[test]
fn the_ground_is_found_where_the_material_is_known() {
    let mut input = Input { was_filmed: true, ..observed(ELASTIC, DVec3::new(0.4, -1.5, 0.2), 8) };
    input.colliders = vec![Collider::plane(DVec3::new(0.0, 0.005, 0.0), DVec3::Y, Contact::Sticky)];
    input.world_doubt = Some(WorldDoubt { height_m: 0.02, ..WorldDoubt::default() });
    let fixed = sought(ELASTIC.kind()).iter().map(|p| p.name.to_owned()).zip(sought_values(&ELASTIC)).collect();
    let settings = Settings { target: Target::Surfaces, fixed, ..Settings::default() };
    let found = run(&input, ELASTIC.kind(), &settings).expect("identified");
    let height_m = found.world.expect("it was sought").height_m;
    assert!((height_m + 0.005).abs() < 3e-4, "{height_m}");
    assert!(found.estimates.iter().all(|estimate| estimate.fixed));
}

/// Plasticine that yields at once shows its bulk modulus and its yield stress. Wherever the best fit ends along the
/// valley of the others, the estimate is the mean of what is left open, and the stiffness follows.
#[test]
fn what_the_video_leaves_open_is_estimated_by_its_mean() {
    let (stiffness, yield_stress) = (2.2e5, 100.0);
    let truth =
        Material::Plasticine { youngs_modulus_pa: stiffness, poisson_ratio: 0.26, yield_stress_pa: yield_stress };
    let mut input = observed(truth, DVec3::new(0.4, -1.5, 0.2), 8);
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    for point in input.observations[1..].iter_mut().flat_map(|observation| &mut observation.surface) {
        *point += DVec3::from_array([0; 3].map(|_| random.random_range(-0.05..0.05) * SPACING));
    }
    for ratio in [0.02, 0.1, 0.2, 0.3, 0.4, 0.47] {
        let settings = Settings {
            target: Target::Surfaces,
            starts: vec![Start {
                parameters: vec![stiffness, ratio, yield_stress],
                grid_spacing_m: None,
                sticks: false,
            }],
            stages: Stage::Material..=Stage::Intervals,
            grid_spacing_m: Some(SPACING),
            ..Settings::default()
        };
        let found = run(&input, MaterialKind::Plasticine, &settings).expect("identified");
        for estimate in &found.estimates {
            let (low, high) = estimate.interval_95;
            assert!((low..=high).contains(&estimate.value), "{estimate:?} lies outside of its own interval");
        }
        let [modulus, ratio, yielding] = &found.estimates[..] else { panic!("three parameters") };
        println!("{:?}", [modulus, ratio, yielding].map(|e| (e.value, e.interval_95, e.identifiable)));
        assert!(!ratio.identifiable && (ratio.value - 0.245).abs() < 0.05);
        // Of the true bulk modulus, E / (3 (1 - 2 nu)), at the ratio that was estimated.
        let follows = stiffness * (1.0 - 2.0 * ratio.value) / (1.0 - 2.0 * 0.26);
        assert!(!modulus.identifiable && (modulus.value / follows).log10().abs() < 0.05);
        assert!(yielding.identifiable && (yielding.value / yield_stress).log10().abs() < 0.03);
    }
}

#[test]
fn elastic_is_recovered() {
    recovers(ELASTIC, 7, 1);
}

#[test]
fn viscoelastic_is_recovered() {
    recovers(VISCOELASTIC, 7, 1);
}

#[test]
fn newtonian_is_recovered() {
    recovers(NEWTONIAN, 7, 1);
}

#[test]
fn sand_is_recovered() {
    recovers(SAND, 7, 1);
}

#[test]
#[ignore = "minutes: cargo test --release -p gic-identify --test oracle -- --ignored --nocapture"]
fn every_material_is_recovered_from_ten_starts() {
    for truth in [ELASTIC, VISCOELASTIC, PLASTICINE, SAND, NEWTONIAN, NON_NEWTONIAN] {
        recovers(truth, 11, 10);
    }
}

#[test]
fn plastic_materials_are_recovered() {
    recovers(PLASTICINE, 7, 1);
    recovers(NON_NEWTONIAN, 7, 1);
}

#[test]
fn without_a_search_the_fit_goes_on_from_its_start() {
    let input = observed(ELASTIC, DVec3::new(0.4, -1.5, 0.2), 8);
    let stages = Stage::Material..=Stage::Intervals;
    let settings =
        |starts| Settings { target: Target::Surfaces, starts, stages: stages.clone(), ..Settings::default() };
    let start = Start { parameters: vec![8.0e4, 0.25], grid_spacing_m: None, sticks: false };
    let found = run(&input, MaterialKind::Elastic, &settings(vec![start])).expect("identified");
    assert_eq!(found.coarse_rollouts, 0);
    for (estimate, value) in found.estimates.iter().zip(sought_values(&ELASTIC)) {
        let error = estimate.parameter.error(estimate.value, value).abs();
        assert!(error <= 0.01, "{} = {} instead of {value}", estimate.parameter.name, estimate.value);
    }
    let error = run(&input, MaterialKind::Elastic, &settings(Vec::new())).unwrap_err();
    assert!(error.to_string().contains("start"), "{error}");
}

/// Stiffness, Poisson's ratio and yield stress of plasticine trade off against each other, so that the cost has many
/// valleys. All blocks are seen perfectly, and no start is given. Single ones may be missed: which, rounding decides.
#[test]
fn the_search_finds_the_right_valley_of_most_blocks() {
    let mut truths = Vec::new();
    for youngs_modulus_pa in [1.0e5, 2.0e5, 3.0e5, 5.0e5, 8.0e5] {
        for poisson_ratio in [0.15, 0.25, 0.35] {
            let of = |yield_stress_pa| Material::Plasticine { youngs_modulus_pa, poisson_ratio, yield_stress_pa };
            truths.extend([3.0e3, 6.0e3].map(of));
        }
    }
    let settings = Settings { target: Target::Surfaces, grid_spacing_m: Some(SPACING), ..Settings::default() };
    let is_found = |truth: &&Material| {
        let input = observed(**truth, DVec3::new(0.4, -1.5, 0.2), 8);
        let found = run(&input, truth.kind(), &settings).expect("identified");
        let errors = found.estimates.iter().zip(sought_values(truth)).map(|(e, t)| e.parameter.error(e.value, t));
        let largest = errors.fold(0.0, |largest: f64, error| largest.max(error.abs()));
        println!("{truth:?}: off by {largest:.3}, {} rollouts", found.rollouts);
        largest < 0.03
    };
    let count = truths.iter().filter(is_found).count();
    assert!(count > 27, "{count} of {}", truths.len());
}

#[test]
fn an_object_that_touches_nothing_keeps_its_velocity_only() {
    let velocity = DVec3::new(0.4, 1.5, 0.2);
    let found = run(
        &observed(ELASTIC, velocity, 4),
        MaterialKind::Elastic,
        &Settings { target: Target::Surfaces, ..Settings::default() },
    )
    .expect("the velocity is found");
    assert!(found.velocity_m_s.distance(velocity) < 2e-3, "{:?}", found.velocity_m_s);
    assert!(found.warnings.iter().any(|w| w.contains("never touches")), "{:?}", found.warnings);
    assert_eq!(found.rollouts, 0);
    for estimate in &found.estimates {
        assert!(!estimate.identifiable && estimate.interval_95 == estimate.parameter.bounds, "{estimate:?}");
    }
    let half_width = found.velocity_interval_95.expect("the velocity's interval is known");
    assert!(half_width.min_element() > 0.0 && half_width.max_element() < 0.05, "{half_width}");
}

/// What the masks say of the velocity after contact hangs on the body's shape: it is no surer than the flight is.
#[test]
fn the_velocity_is_as_sure_as_its_flight() {
    let velocity = DVec3::new(0.3, -0.6, 0.2);
    let input = observed_on(ground(), cameras(), ELASTIC, velocity, 9);
    let found = |stages| {
        let settings = Settings { target: Target::Masks, stages, ..Settings::default() };
        run(&input, ELASTIC.kind(), &settings).expect("identified")
    };
    let (flight, whole) = (found(Stage::Velocity..=Stage::Velocity), found(Stage::Search..=Stage::Intervals));
    let half_width = whole.velocity_interval_95.expect("the velocity's interval is known");
    println!("{} to {half_width}", whole.velocity_m_s - velocity);
    assert!(whole.rollouts > 0 && whole.velocity_interval_95 == flight.velocity_interval_95, "{flight:?}");
    assert!((whole.velocity_m_s - velocity).abs().cmple(half_width).all() && half_width.max_element() < 0.1);
}

/// The flight hangs on no material: it is fitted without one, and without a rollout.
#[test]
fn the_flight_alone_is_what_the_whole_fit_begins_with() {
    let velocity = DVec3::new(0.4, -1.5, 0.2);
    let input = observed(ELASTIC, velocity, 8);
    let stages = Stage::Velocity..=Stage::Velocity;
    let settings = Settings { target: Target::Surfaces, stages, ..Settings::default() };
    let found = run(&input, ELASTIC.kind(), &settings).expect("identified");
    assert!(found.velocity_m_s.distance(velocity) < 0.01, "{}", found.velocity_m_s);
    assert!((1..8).contains(&found.free_frames) && found.rollouts == 0, "{} {}", found.free_frames, found.rollouts);
    let of_density = |warning: &String| warning.starts_with("density is taken as");
    assert!(found.warnings.iter().all(of_density), "{:?}", found.warnings);
}

#[test]
fn a_spin_that_the_data_show_is_estimated() {
    let mut input = observed(ELASTIC, DVec3::new(0.0, 1.0, 0.0), 4);
    // What free flight of a spinning body looks like, in closed form.
    let centre = input.positions.iter().sum::<DVec3>() / input.positions.len() as f64;
    let spin = DVec3::new(1.0, -2.0, 3.0);
    let first = input.observations[0].surface.clone();
    for observation in &mut input.observations {
        let t = observation.time_s;
        let fall = GRAVITY * (0.5 * t * (t + 1.0 / (RATE * SUBSTEPS as f64)));
        let turn = DQuat::from_scaled_axis(spin * t);
        observation.surface = first.iter().map(|p| centre + turn * (*p - centre) + DVec3::Y * t + fall).collect();
    }
    let settings = Settings { target: Target::Surfaces, ..Settings::default() };
    let found = run(&input, MaterialKind::Elastic, &settings).expect("the motion is found");
    assert!(found.angular_velocity_rad_s.distance(spin) < 0.02, "{:?}", found.angular_velocity_rad_s);
}

#[test]
fn a_wrong_material_is_said_not_to_explain_the_data() {
    let input = observed(NEWTONIAN, DVec3::new(0.4, -1.5, 0.2), 10);
    let settings = Settings { target: Target::Surfaces, iterations: 2, ..Settings::default() };
    let warned = |kind: MaterialKind, settings: &Settings| {
        let found = run(&input, kind, settings).expect("something is found");
        let warned = found.warnings.iter().any(|w| w.contains("does not explain"));
        assert!(!warned || found.estimates.iter().all(|e| !e.identifiable), "{:?}", found.estimates);
        warned
    };
    // A stiff solid: a soft one would come near to the fluid.
    let stiff = Settings { fixed: vec![("youngs_modulus_pa".to_owned(), 1e6)], ..settings.clone() };
    assert!(warned(MaterialKind::Elastic, &stiff), "a fluid passes for a stiff solid");
    assert!(!warned(MaterialKind::Newtonian, &settings));
}

#[test]
fn two_frames_are_said_to_show_little() {
    let settings = Settings { target: Target::Surfaces, iterations: 1, ..Settings::default() };
    let found = run(&observed(SAND, DVec3::new(0.0, -1.5, 0.0), 2), MaterialKind::Sand, &settings).expect("a velocity");
    assert!(found.warnings.iter().any(|w| w.contains("two frames only")), "{:?}", found.warnings);
    assert!(found.estimates.iter().all(|e| !e.identifiable));
}

/// Stopped at every checkpoint and once in the middle of every stage, and taken up again through a file's text until it
/// is done.
#[test]
fn an_interrupted_identification_ends_at_the_same_answer() {
    let input = observed(NEWTONIAN, DVec3::new(0.4, -1.5, 0.2), 6);
    let settings = Settings { target: Target::Surfaces, iterations: 3, ..Settings::default() };
    let whole = run(&input, MaterialKind::Newtonian, &settings).expect("identified");
    let (mut kept, mut stops) = (Checkpoint::default(), 0);
    let pieces = loop {
        let (mut events, mut last) = (0, kept.clone());
        let result = identify(&input, MaterialKind::Newtonian, &settings, kept, &mut |event| {
            events += 1;
            if let Event::Reached(checkpoint) = event {
                last = checkpoint.clone();
                return ControlFlow::Break(());
            }
            if stops % 2 == 0 && events == 2 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        match result {
            Err(IdentifyError::Interrupted) => stops += 1,
            other => break other.expect("identified"),
        }
        assert!(stops < 30, "it never ends");
        let text = serde_json::to_string(&last).expect("a checkpoint can be written");
        kept = serde_json::from_str(&text).expect("and read");
        assert_eq!(kept, last);
    };
    assert!(stops >= 4, "stopped {stops} times only");
    let values = |found: &Estimates| -> Vec<_> {
        found
            .estimates
            .iter()
            .map(|e| (e.value.to_bits(), e.interval_95.0.to_bits(), e.interval_95.1.to_bits()))
            .collect()
    };
    assert_eq!(values(&pieces), values(&whole));
    assert_eq!(pieces.velocity_m_s, whole.velocity_m_s);
}

#[test]
fn bad_input_is_named() {
    let good = observed(SAND, DVec3::ZERO, 2);
    let settings = Settings { target: Target::Surfaces, ..Settings::default() };
    let message =
        |input: &Input, settings: &Settings| run(input, MaterialKind::Sand, settings).expect_err("refused").to_string();
    let mut one = good.clone();
    one.observations.truncate(1);
    assert!(message(&one, &settings).contains("1 frame"));
    let mut nan = good.clone();
    nan.positions[3].x = f64::NAN;
    assert!(message(&nan, &settings).contains("particle 3"));
    let mut sunk = good.clone();
    sunk.positions[0].y = -0.1;
    assert!(message(&sunk, &settings).contains("inside an obstacle"));
    let mut dense = good.clone();
    dense.density_kg_m3 = f64::NAN;
    assert!(message(&dense, &settings).contains("density_kg_m3"));
    let mut unordered = good.clone();
    unordered.observations[1].time_s = 0.0;
    assert!(message(&unordered, &settings).contains("not later"));
    let mut blind = good.clone();
    blind.observations[1].surface.clear();
    assert!(message(&blind, &settings).contains("no surface and no mask"));
    let unknown = Settings { fixed: vec![("friction_angle".to_owned(), 30.0)], ..settings.clone() };
    assert!(message(&good, &unknown).contains("friction_angle_deg"));
    let absurd = Settings { fixed: vec![("friction_angle_deg".to_owned(), 95.0)], ..settings.clone() };
    assert!(message(&good, &absurd).contains("give 1 to 75"));
}
