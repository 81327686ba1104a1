//! Training on a scene made here: a ball with a coloured pattern that falls and stretches, seen by six cameras.

mod common;

use std::ops::ControlFlow;
use std::path::Path;

use gic_motion::{
    Architecture, DensitySettings, DynamicGaussians, MotionError, Phase, Progress, TrainSettings, ViewScore, evaluate,
    train,
};
use gic_scene::{Camera, FreeFlight, Scene};
use gic_splat::{Gaussians, Shape};
use glam::{DMat3, DVec2, DVec3};
use serde_json::json;

const SIZE: usize = 48;
const CAMERAS: usize = 6;
const FRAMES: usize = 4;

fn cameras() -> Vec<Camera> {
    (0..CAMERAS)
        .map(|i| {
            let angle = i as f64 / CAMERAS as f64 * core::f64::consts::TAU;
            let centre = DVec3::new(2.0 * angle.cos(), 0.6 + 0.4 * (i % 2) as f64, 2.0 * angle.sin());
            let forward = -centre.normalize();
            let right = forward.cross(DVec3::Y).normalize();
            Camera {
                width: SIZE,
                height: SIZE,
                focal: DVec2::splat(60.0),
                principal: DVec2::splat(SIZE as f64 / 2.0),
                world_from_camera: DMat3::from_cols(right, forward.cross(right), forward),
                centre,
            }
        })
        .collect()
}

/// The truth: a shell of points, falling with time and getting flatter.
fn truth(time: f64) -> Gaussians {
    let n = 1500;
    let mut positions = Vec::new();
    let mut sh = Vec::new();
    for i in 0..n {
        let z = 1.0 - 2.0 * (i as f64 + 0.5) / n as f64;
        let (s, c) = (i as f64 * 2.399_963).sin_cos();
        let r = (1.0 - z * z).sqrt();
        let flat = 1.0 - 0.5 * time;
        positions.push([0.3 * r * c, 0.3 * z * flat + 0.15 - 0.5 * time, 0.3 * r * s].map(|x| x as f32));
        sh.push([1.2 * r * c, 1.2 * z, -1.2 * r * s].map(|x| x as f32));
    }
    let shape = Shape::Isotropic { scales: vec![0.02; n] };
    Gaussians { positions, opacities: vec![0.9; n], shape, sh_degree: 0, sh }
}

fn scene() -> (tempfile::TempDir, Scene) {
    let frames: Vec<(f64, Gaussians)> = (0..FRAMES).map(|frame| frame as f64 / 10.0).map(|t| (t, truth(t))).collect();
    common::scene(&cameras(), &frames)
}

fn settings(steps: usize) -> TrainSettings {
    TrainSettings {
        steps,
        held_out: vec![2],
        warm_up_steps: steps / 6,
        growth_steps: steps / 4,
        mapped_steps: steps / 6,
        bent_steps: steps / 6,
        initial_spacing_px: 1.5,
        gaussians_per_pixel: 3.0,
        network: Architecture { width: 48, ..Architecture::default() },
        evaluate_every: 0,
        ..TrainSettings::default()
    }
}

fn run(scene: &Scene, settings: &TrainSettings, checkpoint: Option<&Path>, stop_at: usize) -> DynamicGaussians {
    run_until(scene, settings, checkpoint, &|p| p.phase != Phase::Tracking && p.step == stop_at)
}

fn run_until(
    scene: &Scene,
    settings: &TrainSettings,
    checkpoint: Option<&Path>,
    stops: &(dyn Fn(&Progress) -> bool + Sync),
) -> DynamicGaussians {
    let mut listener = |p: &Progress| if stops(p) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
    train(scene, settings, 11, &mut listener, checkpoint).unwrap()
}

fn same(a: &DynamicGaussians, b: &DynamicGaussians) -> bool {
    let motion = |m: &DynamicGaussians| m.motion.as_ref().map(|m| (m.network.parameters.clone(), m.base.clone()));
    a.canonical == b.canonical && motion(a) == motion(b)
}

#[test]
fn a_view_that_was_held_out_is_reproduced_at_every_frame() {
    let (_folder, scene) = scene();
    let settings = settings(500);
    let model = run(&scene, &settings, None, 0);
    let scores = evaluate(&model, &scene, &settings.held_out).unwrap();
    assert_eq!(scores.len(), FRAMES);
    let mean = ViewScore::mean(&scores);
    assert!(mean.psnr > 23.0, "PSNR {:.2} dB", mean.psnr);
    assert!(mean.iou > 0.93, "IoU {:.4}", mean.iou);
    // The motion is learned, not only the first frame.
    assert!(scores[FRAMES - 1].psnr > scores[0].psnr - 3.0, "{scores:?}");
}

/// The truth of a body that flies: the ball as it is at first, turned and shifted.
fn flying(flight: &FreeFlight, time: f64) -> Gaussians {
    let mut body = truth(0.0);
    for position in &mut body.positions {
        *position = flight.forth(DVec3::from_array(position.map(f64::from)), time).as_vec3().to_array();
    }
    body
}

/// Three cameras see every moment of a flight; what only a fourth one sees is known all the same, as the body turns.
#[test]
fn every_moment_of_a_flight_is_a_view_of_one_body() {
    let times: Vec<f64> = (0..FRAMES).map(|frame| frame as f64 / 10.0).collect();
    let flight = FreeFlight {
        about: DVec3::new(0.0, 0.15, 0.0),
        velocity: DVec3::new(0.2, 0.3, 0.0),
        angular_velocity: DVec3::new(0.5, 6.0, 0.0),
        acceleration: DVec3::NEG_Y * 2.0,
        times: times[..FRAMES - 1].to_vec(),
        ..FreeFlight::default()
    };
    let frames: Vec<(f64, Gaussians)> = times.iter().map(|&time| (time, flying(&flight, time))).collect();
    let (_folder, unaware) = common::scene(&cameras()[..4], &frames);
    let mut aware = unaware.clone();
    aware.flight = Some(flight.clone());
    let settings = TrainSettings { held_out: vec![2], ..settings(300) };
    let psnr = |scene: &Scene| {
        let model = run(scene, &settings, None, 0);
        (ViewScore::mean(&evaluate(&model, scene, &settings.held_out).unwrap()).psnr, model)
    };
    let ((with, model), (without, _)) = (psnr(&aware), psnr(&unaware));
    println!("held-out view: {with:.2} dB with the flight, {without:.2} dB without");
    assert!(with > without + 1.0, "{with} dB with the flight, {without} dB without");
    // A Gaussian of the first frame moves with the body, but for what the network adds to all of these frames alike.
    let start = model.at(0.0).positions;
    for &time in &flight.times {
        let far = start.iter().zip(model.at(time).positions).map(|(x, is)| {
            let should = flight.forth(DVec3::from_array(x.map(f64::from)), time);
            should.distance(DVec3::from_array(is.map(f64::from)))
        });
        let farthest = far.fold(0.0, f64::max);
        assert!(farthest < 0.01, "{time} s: {farthest} m from where the flight takes it");
    }
}

#[test]
fn same_seed_gives_the_same_bits_whatever_the_threads() {
    let (_folder, scene) = scene();
    let settings =
        TrainSettings { density: DensitySettings { from: 10, every: 10, ..settings(1).density }, ..settings(40) };
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| run(&scene, &settings, None, 0))
    };
    let (one, three) = (on(1), on(3));
    assert!(same(&one, &three));
    let other = train(&scene, &settings, 12, &mut |_| ControlFlow::Continue(()), None).unwrap();
    assert!(!same(&one, &other), "the seed must matter");
}

#[test]
fn there_are_never_more_gaussians_than_allowed() {
    let (_folder, scene) = scene();
    let count = |max_gaussians| run(&scene, &TrainSettings { max_gaussians, ..settings(5) }, None, 0).canonical.len();
    assert!(count(None) > 120, "the limit has something to do");
    // The hull has about as many surface cells as are asked for.
    let limited = count(Some(120));
    assert!((100..=120).contains(&limited), "{limited}");
}

#[test]
fn a_run_that_was_stopped_continues_as_if_it_had_not_been() {
    let (_folder, scene) = scene();
    let folder = tempfile::tempdir().unwrap();
    let settings = settings(30);
    let whole = run(&scene, &settings, None, 0);
    let half = run(&scene, &settings, Some(folder.path()), 17);
    assert!(!same(&whole, &half));
    let resumed = run(&scene, &settings, Some(folder.path()), 0);
    assert!(same(&whole, &resumed));

    let folder = tempfile::tempdir().unwrap();
    let in_tracking = |p: &Progress| p.phase == Phase::Tracking && p.step == 7;
    let early = run_until(&scene, &settings, Some(folder.path()), &in_tracking);
    assert!(early.motion.is_some_and(|motion| motion.base.is_none()));
    assert!(same(&whole, &run(&scene, &settings, Some(folder.path()), 0)));

    let other = TrainSettings { steps: 31, ..settings };
    let error = train(&scene, &other, 11, &mut |_| ControlFlow::Continue(()), Some(folder.path())).unwrap_err();
    assert!(error.to_string().contains("other settings"), "{error}");
}

#[test]
fn without_affine_steps_there_is_no_base_motion() {
    let (_folder, scene) = scene();
    let base = |affine_steps| {
        let model = run(&scene, &TrainSettings { affine_steps, ..settings(12) }, None, 0);
        model.motion.unwrap().base
    };
    assert!(base(0).is_none());
    let base = base(5).unwrap();
    assert_eq!(base.times.len(), FRAMES);
    assert!(base.maps[FRAMES - 1].shift[1] < -0.05, "the ball falls 0.15 m: {:?}", base.maps);
}

#[test]
fn a_static_scene_has_no_motion() {
    let (folder, scene) = scene();
    let path = folder.path().join("all_data.json");
    let list: Vec<serde_json::Value> = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    let first: Vec<_> = list.into_iter().filter(|v| v["time"] == json!(0.0)).collect();
    std::fs::write(&path, serde_json::to_vec(&first).unwrap()).unwrap();
    let still = Scene::open(folder.path()).unwrap();
    let defaults = TrainSettings::for_scene(&still);
    assert_eq!(defaults, TrainSettings::still());
    assert_eq!(TrainSettings::for_scene(&scene), TrainSettings::default());
    let settings =
        TrainSettings { steps: 300, initial_spacing_px: 1.5, held_out: vec![2], evaluate_every: 0, ..defaults };
    let model = run(&still, &settings, None, 0);
    assert!(model.motion.is_none());
    assert!(matches!(model.canonical.shape, Shape::Anisotropic { .. }));
    assert_eq!(model.at(0.0), model.at(5.0));
    let score = ViewScore::mean(&evaluate(&model, &still, &settings.held_out).unwrap());
    assert!(score.psnr > 22.0, "PSNR {:.2} dB", score.psnr);

    // Ellipsoids and half-sized pictures go on where they were stopped.
    let checkpoint = tempfile::tempdir().unwrap();
    run(&still, &settings, Some(checkpoint.path()), 43);
    assert!(same(&model, &run(&still, &settings, Some(checkpoint.path()), 0)));
}

/// With two steps in the mean, it lies in the middle between what each of them alone gives; a run that is stopped
/// between them goes on with the mean.
#[test]
fn the_mean_of_the_last_steps_is_what_training_gives() {
    let (_folder, scene) = scene();
    let averaged = TrainSettings { averaged: 0.05, held_out: Vec::new(), ..settings(40) };
    let checkpoint = tempfile::tempdir().unwrap();
    let mean = run(&scene, &averaged, None, 0);
    let first = run(&scene, &averaged, Some(checkpoint.path()), 39);
    assert!(same(&mean, &run(&scene, &averaged, Some(checkpoint.path()), 0)));
    let last = run(&scene, &TrainSettings { averaged: 0.0, ..averaged.clone() }, None, 0);
    let places = |model: &DynamicGaussians| model.canonical.positions.as_flattened().to_vec();
    let (mean, first, last) = (places(&mean), places(&first), places(&last));
    assert_ne!(first, last);
    for ((mean, first), last) in mean.iter().zip(&first).zip(&last) {
        assert!((mean - 0.5 * (first + last)).abs() < 1e-6, "{mean}, {first} and {last}");
    }
}

#[test]
fn one_moving_camera_is_told_from_several() {
    let (folder, _) = scene();
    let path = folder.path().join("all_data.json");
    let list: Vec<serde_json::Value> = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    // Frame f from camera f alone.
    let name = |v: &serde_json::Value| v["file_path"].as_str().unwrap().to_owned();
    let wanted = |v: &serde_json::Value| (0..FRAMES).any(|f| name(v).ends_with(&format!("r_{f}_{f}.png")));
    let one: Vec<_> = list.into_iter().filter(wanted).collect();
    assert_eq!(one.len(), FRAMES);
    std::fs::write(&path, serde_json::to_vec(&one).unwrap()).unwrap();
    let scene = Scene::open(folder.path()).unwrap();
    let defaults = TrainSettings::for_scene(&scene);
    assert_eq!(defaults, TrainSettings::one_camera());
    let network = Architecture { width: 32, ..defaults.network };
    let settings = TrainSettings { steps: 12, warm_up_steps: 6, evaluate_every: 0, network, ..defaults };
    let model = run(&scene, &settings, None, 0);
    assert!(model.motion.unwrap().base.is_none());
}

/// Two rays meet in a point: two cameras at each moment follow the object as more do.
#[test]
fn two_cameras_at_a_moment_are_several() {
    let (_folder, scene) = scene();
    let two = scene.with_cameras(&[0, 2]).unwrap();
    assert_eq!(TrainSettings::for_scene(&two), TrainSettings::default());
    let settings = TrainSettings { held_out: Vec::new(), ..settings(12) };
    assert!(run(&two, &settings, None, 0).motion.unwrap().base.is_some());
}

#[test]
fn settings_without_meaning_are_named() {
    let (_folder, scene) = scene();
    let refused = |settings: TrainSettings| {
        train(&scene, &settings, 0, &mut |_| ControlFlow::Continue(()), None).unwrap_err().to_string()
    };
    assert!(refused(TrainSettings { held_out: vec![99], ..settings(5) }).contains("held_out"));
    assert!(refused(TrainSettings { sh_degree: Some(4), ..settings(5) }).contains("sh_degree"));
    assert!(refused(TrainSettings { gaussians_per_pixel: f64::NAN, ..settings(5) }).contains("gaussians_per_pixel"));
    assert!(refused(TrainSettings { max_gaussians: Some(99), ..settings(5) }).contains("max_gaussians"));
    assert!(refused(TrainSettings { views_per_step: 0, ..settings(5) }).contains("views_per_step"));
    assert!(refused(TrainSettings { half_size: 1.5, ..settings(5) }).contains("half_size"));
    for averaged in [0.5, -0.1, f64::NAN] {
        assert!(refused(TrainSettings { averaged, ..settings(5) }).contains("averaged"));
    }
    for node_spacing in [-0.1, f64::NAN] {
        let network = Architecture { node_spacing, ..settings(5).network };
        assert!(refused(TrainSettings { network, ..settings(5) }).contains("network.node_spacing"));
    }
    let all: MotionError = train(
        &scene,
        &TrainSettings { held_out: (0..CAMERAS).collect(), ..settings(5) },
        0,
        &mut |_| ControlFlow::Continue(()),
        None,
    )
    .unwrap_err();
    assert!(all.to_string().contains("held out"), "{all}");
}

#[test]
fn settings_survive_json_and_unknown_keys_are_refused() {
    for settings in
        [TrainSettings::default(), TrainSettings::paper(), TrainSettings::still(), TrainSettings::one_camera()]
    {
        let text = serde_json::to_string(&settings).unwrap();
        assert_eq!(serde_json::from_str::<TrainSettings>(&text).unwrap(), settings);
    }
    assert!(serde_json::from_str::<TrainSettings>(r#"{"step": 3}"#).is_err());
}
