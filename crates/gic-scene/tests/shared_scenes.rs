//! True particles project into the masks: poses, intrinsics, axes, times and masks of every format fit together.
//! Needs the measured scenes next to the repository (`../shared`); says so and passes without them.

use std::fs::File;
use std::io::{BufReader, Write};
use std::path::{Path, PathBuf};

use gic_scene::{Camera, Format, Hull, HullSettings, HullView, Mask, Scene, Seek, inspect};
use glam::DVec3;

fn shared(relative: &str) -> Option<PathBuf> {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")).join(relative);
    if !path.exists() {
        // Past the capture of the test harness: a skip must be seen.
        let _ = writeln!(std::io::stderr(), "SKIPPED: {} is not there", path.display());
        return None;
    }
    Some(path)
}

fn particles(path: &Path) -> Vec<DVec3> {
    let file = File::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut archive = npyz::npz::NpzArchive::new(BufReader::new(file)).expect("an npz archive");
    let array = archive.by_name("x").expect("readable").expect("key x");
    let values: Vec<f32> = array.into_vec().expect("f32");
    values.chunks_exact(3).map(|x| DVec3::new(x[0].into(), x[1].into(), x[2].into())).collect()
}

/// Fraction of the points that fall on the mask, and fraction of the mask's pixels within a particle's spacing of a
/// point.
fn overlap(camera: &Camera, mask: &Mask, points: &[DVec3], spacing: f64) -> (f64, f64) {
    let mut near = vec![false; mask.width * mask.height];
    let mut inside = 0;
    for &x in points {
        let Some((pixel, depth)) = camera.project(x) else { continue };
        if mask.sample(pixel.x, pixel.y) > 0.05 {
            inside += 1;
        }
        let reach = spacing * camera.focal.x / depth;
        let range = |at: f64, size: usize| (at - reach).max(0.0) as usize..((at + reach).ceil() as usize).min(size);
        for y in range(pixel.y, mask.height) {
            for x in range(pixel.x, mask.width) {
                near[y * mask.width + x] = true;
            }
        }
    }
    let covered = mask.coverage.iter().zip(&near).filter(|&(&a, _)| a > 0.5);
    let (hit, all) = covered.fold((0_usize, 0_usize), |(hit, all), (_, &near)| (hit + usize::from(near), all + 1));
    (f64::from(inside) / points.len() as f64, hit as f64 / all.max(1) as f64)
}

fn check(relative: &str, format: Format, cameras: usize, frames: usize, rate: f64) {
    let Some(root) = shared(relative) else { return };
    let scene = Scene::open(&root).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!((scene.format, scene.cameras.len(), scene.times.len()), (format, cameras, frames), "{relative}");
    assert_eq!(scene.views.len(), cameras * frames);
    assert!((scene.frame_rate.expect("even") - rate).abs() < 0.01 * rate);
    assert_eq!(scene.times[0], 0.0);
    for frame in [0, frames / 2, frames - 1] {
        let points = particles(&root.join(format!("gt/particles_{frame}.npz")));
        for view in scene.views_at(frame) {
            let mask = scene.load_mask(view).expect("mask");
            let (inside, hit) = overlap(scene.camera_of(view), &mask, &points, 0.01);
            assert!(
                inside > 0.99 && hit > 0.99,
                "{}: {inside} of the points, {hit} of the mask",
                view.picture.display()
            );
        }
    }
}

#[test]
fn pac_nerf_particles_project_into_the_masks() {
    check("demo", Format::PacNerf, 11, 14, 24.0);
    check("scenes/torus", Format::PacNerf, 11, 14, 24.0);
    check("scenes/sand_1", Format::PacNerf, 11, 14, 24.0);
}

#[test]
fn spring_gaus_synthetic_particles_project_into_the_masks() {
    check("spring_gaus/sg_torus", Format::SpringGausSynthetic, 10, 30, 100.0 / 3.0);
    check("spring_gaus/sg_cross", Format::SpringGausSynthetic, 10, 30, 100.0 / 3.0);
}

#[test]
fn the_hull_holds_the_object_and_projects_onto_the_masks() {
    let Some(root) = shared("scenes/torus") else { return };
    let scene = Scene::open(&root).unwrap_or_else(|error| panic!("{error}"));
    let masks = scene.load_masks(scene.views_at(0)).expect("masks");
    let views: Vec<HullView> = scene
        .views_at(0)
        .iter()
        .zip(&masks)
        .map(|(view, mask)| HullView { camera: scene.camera_of(view), mask })
        .collect();
    let hull = Hull::carve(&views, &HullSettings { resolution: 128, tolerated_misses: 0 }).expect("a hull");
    let points = particles(&root.join("gt/particles_0.npz"));
    let held = points.iter().filter(|&&x| hull.contains(x)).count();
    assert_eq!(held, points.len(), "the hull holds the whole object");
    // Eleven silhouettes of a torus leave little beyond it: particles of 1e-6 m^3 each.
    let excess = hull.volume() / (points.len() as f64 * 1e-6);
    assert!((1.0..1.15).contains(&excess), "hull / object volume = {excess}");
    for view in &views {
        let iou = hull.reprojection_iou(view);
        assert!(iou > 0.97, "{iou}");
    }
}

/// Three cameras, none of which sees what another one does.
#[test]
fn outlines_tell_how_a_body_falls() {
    for name in ["bunny_elastic", "bear_sand", "elastic_2", "sand_1"] {
        let Some(root) = shared(&format!("scenes/{name}")) else { return };
        let scene = Scene::open(&root).and_then(|scene| scene.with_cameras(&[0, 4, 8]));
        let flight = inspect(&scene.unwrap_or_else(|error| panic!("{error}"))).expect("a report").flight;
        let flight = flight.unwrap_or_else(|| panic!("{name} flies"));
        let truth = std::fs::read_to_string(root.join("gt/params.json")).expect("the truth");
        let truth: serde_json::Value = serde_json::from_str(&truth).expect("the truth");
        let off = |found: [f64; 3], key: &str| {
            let truth = |axis: usize| truth[key][axis].as_f64().expect("a number");
            (0..3).map(|axis| (found[axis] - truth(axis)).powi(2)).sum::<f64>().sqrt()
        };
        let (v, g) = (off(flight.velocity_m_s, "initial_velocity"), off(flight.acceleration_m_s2, "gravity"));
        println!("{name}: {} frames, {v:.4} m/s and {g:.3} m/s^2 off, {:.3} pixels", flight.frames, flight.miss_px);
        assert!(flight.frames >= 4 && v < 0.03 && g < 0.4, "{name}: {v} {g}");
        assert!(flight.calibration_errors.is_empty(), "{name}: {:?}", flight.calibration_errors);
    }
}

#[test]
fn spring_gaus_real_particles_project_into_the_masks_of_videos_and_photographs() {
    check("spring_gaus/sg_plush", Format::SpringGausReal, 3, 20, 30.0);
    let Some(root) = shared("spring_gaus/sg_plush") else { return };
    let scene = Scene::open(&root).unwrap_or_else(|error| panic!("{error}"));
    let rest = scene.rest.expect("photographs of the object at rest");
    assert_eq!((rest.format, rest.cameras.len(), rest.points.len()), (Format::Colmap, 50, 1981));
    let points = particles(&root.join("gt/static_particles.npz"));
    // A third of 0.02 m, at 3.1 units a metre.
    let spacing = 0.02 / 3.0 * 3.1;
    for view in &rest.views {
        let mask = rest.load_mask(view).expect("mask");
        let (inside, hit) = overlap(rest.camera_of(view), &mask, &points, spacing);
        assert!(inside > 0.99 && hit > 0.99, "{}: {inside} of the points, {hit} of the mask", view.picture.display());
    }
}

#[test]
fn d_nerf_and_static_blender_scenes_keep_their_splits_and_times() {
    let Some(root) = shared("dnerf_mutant") else { return };
    let scene = Scene::open(&root).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!((scene.format, scene.cameras.len(), scene.views.len()), (Format::Blender, 170, 170));
    assert!(!scene.is_static() && !scene.has_fixed_cameras());
    assert_eq!(scene.views.iter().filter(|view| view.split == gic_scene::Split::Test).count(), 20);
    assert_eq!((scene.times[0], *scene.times.last().expect("times")), (0.0, 1.0));

    let Some(root) = shared("nerf_lego_400") else { return };
    let scene = Scene::open(&root).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!((scene.cameras.len(), scene.times.len()), (125, 1));
    assert!(scene.is_static());
    // The hull of a static scene agrees with all its masks only if poses and intrinsics are right.
    let some: Vec<_> = scene.views.iter().step_by(3).cloned().collect();
    let masks = scene.load_masks(&some).expect("masks");
    let views: Vec<HullView> =
        some.iter().zip(&masks).map(|(view, mask)| HullView { camera: scene.camera_of(view), mask }).collect();
    let hull = Hull::carve(&views, &HullSettings { resolution: 128, tolerated_misses: 0 }).expect("a hull");
    let worst = views.iter().step_by(10).map(|view| hull.reprojection_iou(view)).fold(1.0, f64::min);
    println!("lego: {:?}, worst IoU {worst:.4}", hull.bounds());
    assert!(worst > 0.9, "{worst}");
}

/// Delays of the four cameras of the filmed ball behind the first one [frames], as its README measured them.
const FILMED_DELAYS: [f64; 4] = [0.0, 0.094, -0.151, -0.394];

/// All that a flight tells of cameras.
const BOTH: Seek = Seek { delays: true, errors: true };

fn delays_frames(scene: &Scene) -> Vec<f64> {
    let rate = scene.frame_rate.expect("even");
    scene.delays_s.iter().map(|delay| delay * rate).collect()
}

#[test]
fn cameras_that_film_without_a_common_clock_are_found_to_lag() {
    let Some(root) = shared("film_ball/as_filmed") else { return };
    // The times that a user has: every camera's n-th picture at n / 60 s.
    let copy = tempfile::tempdir().expect("a folder");
    std::fs::create_dir(copy.path().join("data")).expect("a folder");
    for entry in std::fs::read_dir(root.join("data")).expect("pictures") {
        let path = entry.expect("a file").path();
        std::fs::copy(&path, copy.path().join("data").join(path.file_name().expect("a name"))).expect("a copy");
    }
    let text = std::fs::read_to_string(root.join("all_data.json")).expect("a list");
    let mut entries: Vec<serde_json::Value> = serde_json::from_str(&text).expect("JSON");
    for entry in &mut entries {
        let name = entry["file_path"].as_str().expect("a path").trim_end_matches(".png").to_owned();
        let number: f64 = name.rsplit('_').next().expect("a number").parse().expect("a number");
        entry["time"] = (number / 60.0).into();
    }
    std::fs::write(copy.path().join("all_data.json"), serde_json::to_string(&entries).expect("JSON")).expect("a list");
    let nominal = Scene::open(copy.path()).expect("a scene");
    assert!(!nominal.has_lags());
    let scene = nominal.corrected(nominal.world.gravity, nominal.times.len(), BOTH).expect("masks");
    let found = delays_frames(&scene);
    println!("{found:.3?} for {FILMED_DELAYS:?}");
    assert!(found.iter().zip(FILMED_DELAYS).all(|(found, measured)| (found - measured).abs() < 0.1), "{found:?}");
    assert!(scene.has_lags() && scene.times.len() == 10 && scene.views_at(0).len() == 4);
    // With the times that were measured there is nothing to find, and the views of a frame differ as much.
    let stated = Scene::open(&root).expect("a scene");
    let same = stated.corrected(stated.world.gravity, stated.times.len(), BOTH).expect("masks");
    assert!(stated.has_lags() && stated.times.len() == 10 && same.delays_s.is_empty(), "{:?}", same.delays_s);
    let lag = |view: &gic_scene::View| view.time_s - scene.times[view.frame];
    for (view, other) in scene.views_at(3).iter().zip(stated.views_at(3)) {
        let measured = other.time_s - stated.times[3];
        assert!((lag(view) - measured).abs() * 60.0 < 0.1, "{} for {measured}", lag(view));
    }
}

#[test]
fn a_film_whose_pictures_repeat_poses_is_of_a_few_cameras() {
    let Some(root) = shared("film_ball/nerfstudio") else { return };
    let scene = Scene::open(&root).expect("a scene");
    assert_eq!((scene.cameras.len(), scene.times.len(), scene.views.len()), (4, 10, 40));
    assert_eq!(scene.camera_names, ["c0", "c1", "c2", "c3"]);
    assert!(scene.has_fixed_cameras());
}
