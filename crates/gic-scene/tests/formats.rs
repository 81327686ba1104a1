//! Every format is read into the same cameras, times and masks: known points project where they must, and the masks
//! agree with an independent ray tracer of the same ball.

mod common;

use common::{BALL, FOCAL, HEIGHT, TIMES, WIDTH};
use gic_scene::{CalibrationError, Camera, CameraOffset, Format, Mask, Scene, Split, View};
use glam::{DVec2, DVec3};

#[test]
#[ignore = "writes tests/data anew"]
fn write_fixtures() {
    common::write_pac_nerf(&common::data("pac_nerf"));
    common::write_spring_gaus(&common::data("spring_gaus"));
    common::write_blender(&common::data("blender"));
    common::write_nerfstudio(&common::data("nerfstudio"));
    common::write_colmap(&common::data("colmap_binary"), true);
    common::write_colmap(&common::data("colmap_text"), false);
    common::write_real_capture(&common::data("real_capture"));
}

fn open(format: &str) -> Scene {
    Scene::open(common::data(format)).unwrap_or_else(|error| panic!("{error}"))
}

fn assert_close(camera: &Camera, expected: &Camera) {
    assert_eq!((camera.width, camera.height), (WIDTH, HEIGHT));
    assert!((camera.focal - expected.focal).length() < 1e-6, "{:?}", camera.focal);
    assert!((camera.principal - expected.principal).length() < 1e-6, "{:?}", camera.principal);
    assert!((camera.centre - expected.centre).length() < 1e-6, "{:?} for {:?}", camera.centre, expected.centre);
    assert!(
        camera.world_from_camera.abs_diff_eq(expected.world_from_camera, 1e-6),
        "{:?} for {:?}",
        camera.world_from_camera,
        expected.world_from_camera
    );
}

/// Points whose pixels are worked out by hand for the first camera: it stands at (0, 0.2, 1) and looks along -z.
fn check_hand_computed_points(camera: &Camera) {
    let (cx, cy) = (WIDTH as f64 / 2.0, HEIGHT as f64 / 2.0);
    for (point, pixel, depth) in [
        (DVec3::new(0.0, 0.2, 0.0), DVec2::new(cx, cy), 1.0),
        (DVec3::new(0.1, 0.2, 0.0), DVec2::new(cx + 0.1 * FOCAL, cy), 1.0),
        (DVec3::new(0.0, 0.3, 0.0), DVec2::new(cx, cy - 0.1 * FOCAL), 1.0),
        (DVec3::new(0.2, 0.2, -1.0), DVec2::new(cx + 0.1 * FOCAL, cy), 2.0),
    ] {
        let (found, z) = camera.project(point).expect("in front");
        assert!((found - pixel).length() < 1e-6 && (z - depth).abs() < 1e-9, "{found} for {pixel}");
        assert!((camera.unproject(pixel, depth) - point).length() < 1e-6);
    }
    assert_eq!(camera.project(DVec3::new(0.0, 0.2, 1.5)), None, "behind the camera");
}

/// The mask and colours of a view against the ray tracer's, without distortion; returns the largest difference.
fn largest_difference(scene: &Scene, view: &View, camera: &Camera, ball: usize) -> f32 {
    let (picture, mask) = scene.load(view).expect("pixels");
    let drawn = common::draw(camera, ball, [0.0; 4]);
    let mut largest = 0.0_f32;
    for (i, pixel) in drawn.pixels().enumerate() {
        let expected = pixel.0.map(|value| f32::from(value) / 255.0);
        largest = largest.max((mask.coverage[i] - expected[3]).abs());
        // Colours: well inside the ball and away from the seam between its colours, JPEG and resampling aside.
        let red = picture.rgb[3 * i] > picture.rgb[3 * i + 2];
        let pure = expected[3] == 1.0 && [26, 230].contains(&pixel.0[0]);
        if pure && mask_margin(&mask, i) {
            assert_eq!(red, pixel.0[0] == 230, "{}: pixel {i}", view.picture.display());
        }
    }
    largest
}

/// Whether a pixel lies at least three pixels inside the mask, and away from the seam at mid-height.
fn mask_margin(mask: &Mask, i: usize) -> bool {
    let (x, y) = (i % mask.width, i / mask.width);
    let bounds = mask.bounding_box().expect("a ball");
    let seam = (bounds.y0 + bounds.y1) as f64 / 2.0;
    x > bounds.x0 + 4 && x + 4 < bounds.x1 && (y as f64 - seam).abs() > 6.0 && y > bounds.y0 + 1 && y + 1 < bounds.y1
}

fn check_synchronised(scene: &Scene, cameras: usize, format: Format) {
    assert_eq!((scene.format, scene.cameras.len(), scene.times.len()), (format, cameras, 2));
    assert!(scene.has_fixed_cameras() && !scene.is_static() && scene.warnings.is_empty());
    check_hand_computed_points(&scene.cameras[0]);
    for (camera, expected) in scene.cameras.iter().zip(common::cameras()) {
        assert_close(camera, &expected);
    }
    for view in &scene.views {
        let difference = largest_difference(scene, view, &common::cameras()[view.camera], view.frame);
        assert!(difference < 1e-6, "{}: {difference}", view.picture.display());
    }
    assert!(scene.view(0, 1).is_some() && scene.view(9, 0).is_none() && scene.load_view(0, 7).is_err());
}

#[test]
fn pac_nerf() {
    let scene = open("pac_nerf");
    check_synchronised(&scene, 4, Format::PacNerf);
    assert!((scene.times[1] - TIMES[1]).abs() < 1e-12 && (scene.frame_rate.expect("even") - 24.0).abs() < 1e-9);
    assert_eq!(scene.camera_names, ["0", "1", "2", "3"]);
    assert_eq!((scene.world.up, scene.world.metric), (Some(DVec3::Y), true));
    assert_eq!(scene.world.ground.expect("fixed").height(DVec3::new(1.0, 0.25, 2.0)), 0.25);
    // The background shows no ball.
    let background = scene.load_background(2).expect("readable").expect("there");
    assert!(background.rgb.chunks_exact(3).all(|p| (p[0] - p[1]).abs() < 0.01));
    // The file itself opens the scene too.
    assert_eq!(Scene::open(common::data("pac_nerf").join("all_data.json")).expect("opens").views, scene.views);
}

/// A scene whose cameras a fit found elsewhere and later: frames keep their numbers and begin with their first
/// picture.
#[test]
fn cameras_as_a_fit_found_them() {
    let scene = open("pac_nerf");
    assert_eq!(scene.as_fitted(&[]).cameras, scene.cameras);
    let error = CalibrationError { shift_m: DVec3::X, ..CalibrationError::default() };
    let late_s = |camera: usize| 0.01 * camera as f64 - 0.01;
    let found: Vec<CameraOffset> =
        (0..scene.cameras.len()).map(|camera| CameraOffset { error, late_s: late_s(camera) }).collect();
    let fitted = scene.as_fitted(&found);
    for (was, is) in scene.cameras.iter().zip(&fitted.cameras) {
        assert!((is.centre - was.centre - was.world_from_camera.x_axis).length() < 1e-12);
    }
    for (was, is) in scene.views.iter().zip(&fitted.views) {
        assert_eq!((is.camera, is.frame), (was.camera, was.frame));
        assert!((is.time_s - was.time_s - late_s(was.camera)).abs() < 1e-12);
        assert!(fitted.times[is.frame] <= is.time_s);
    }
    assert!(fitted.has_lags() && (fitted.times[1] - scene.times[1] + 0.01).abs() < 1e-12);
}

#[test]
fn spring_gaus_synthetic() {
    let scene = open("spring_gaus");
    check_synchronised(&scene, 4, Format::SpringGausSynthetic);
    assert_eq!(scene.camera_names[3], "camera_3");
    assert!((scene.world.ground.expect("fixed").height(DVec3::new(0.0, 0.5, 0.0)) - 0.2).abs() < 1e-12);
}

#[test]
fn spring_gaus_real_capture() {
    let scene = open("real_capture");
    check_synchronised(&scene, 3, Format::SpringGausReal);
    assert_eq!((scene.frame_rate, scene.world.up), (Some(30.0), Some(DVec3::NEG_Z)));
    assert!(scene.view(1, 0).expect("a view").picture.ends_with("C0787/00398.jpg"), "lists are aligned by position");
    let rest = scene.rest.as_ref().expect("photographs");
    assert!(rest.is_static() && rest.views.len() == 4 && rest.points.len() == 1);
    let faster = gic_scene::SceneSettings { frame_rate_hz: Some(120.0), ..Default::default() };
    let scene = Scene::open_with(common::data("real_capture"), &faster).expect("opens");
    assert_eq!((scene.times[1], scene.frame_rate), (1.0 / 120.0, Some(120.0)));
}

#[test]
fn blender_with_time_and_splits() {
    let scene = open("blender");
    assert_eq!((scene.format, scene.cameras.len(), scene.views.len()), (Format::Blender, 4, 4));
    assert_eq!(scene.times, [0.0, 1.0]);
    assert!(!scene.has_fixed_cameras() && !scene.is_static());
    check_hand_computed_points(&scene.cameras[0]);
    for view in &scene.views {
        let number: usize =
            scene.camera_names[view.camera][scene.camera_names[view.camera].len() - 1..].parse().expect("r_00N");
        assert_eq!((view.split, view.frame), (if number == 3 { Split::Test } else { Split::Train }, number % 2));
        assert_close(scene.camera_of(view), &common::cameras()[number]);
        assert!(largest_difference(&scene, view, &common::cameras()[number], view.frame) < 1e-6);
    }
}

/// Static formats with a lens: resampling blurs the outline, which moves coverage there by less than a third.
fn check_static(scene: &Scene, distorted: std::ops::Range<usize>) {
    assert!(scene.is_static() && scene.views.len() == 4);
    check_hand_computed_points(&scene.cameras[0]);
    for view in &scene.views {
        assert_close(scene.camera_of(view), &common::cameras()[view.camera]);
        let difference = largest_difference(scene, view, &common::cameras()[view.camera], 0);
        let limit = if distorted.contains(&view.camera) { 0.33 } else { 1e-6 };
        assert!(difference < limit, "{}: {difference}", view.picture.display());
    }
    // Without undistorting, the outline would be off by most of a pixel somewhere.
    let drawn = |distortion| common::mask_of(&common::draw(&common::cameras()[2], 0, distortion));
    let (bent, straight) = (drawn(common::DISTORTION), drawn([0.0; 4]));
    let off = bent.iter().zip(straight.iter()).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(off > Some(100), "the fixture's lens does something: {off:?}");
}

#[test]
fn nerfstudio_with_distortion() {
    let scene = open("nerfstudio");
    assert_eq!(scene.format, Format::Nerfstudio);
    check_static(&scene, 0..4);
}

#[test]
fn colmap_binary_and_text() {
    let (binary, text) = (open("colmap_binary"), open("colmap_text"));
    for scene in [&binary, &text] {
        assert_eq!((scene.format, scene.points.len()), (Format::Colmap, 1));
        assert!((scene.points[0].position - BALL[0]).length() < 1e-12);
        assert_eq!(scene.points[0].rgb, [1.0, 0.0, 0.2]);
        check_static(scene, 2..4);
    }
    assert_eq!(binary.camera_names, text.camera_names);
    for (a, b) in binary.cameras.iter().zip(&text.cameras) {
        assert_close(a, b);
    }
}

/// Formats that know no distortion may state it as OpenCV's coefficients, where a camera's other numbers stand.
#[test]
fn every_format_may_state_distortion() {
    for (format, list) in [("pac_nerf", "all_data.json"), ("spring_gaus", "camera.json")] {
        let state = |coefficients: &[f64]| {
            let copy = common::copy(format);
            let path = copy.path().join(list);
            let mut entries: Vec<serde_json::Value> =
                serde_json::from_str(&std::fs::read_to_string(&path).expect("a list")).expect("JSON");
            entries.iter_mut().for_each(|entry| entry["distortion"] = coefficients.into());
            std::fs::write(&path, serde_json::to_string(&entries).expect("JSON")).expect("a list");
            (Scene::open(copy.path()), copy)
        };
        let (bent, _copy) = state(&[0.1, 0.0, 0.0, 0.02]);
        let bent = bent.unwrap_or_else(|error| panic!("{format}: {error}"));
        let lenses = bent.lenses().expect("lenses");
        assert!(lenses.contains("k: [0.1, 0.0, 0.0, 0.0, 0.0, 0.0], p: [0.0, 0.02]"), "{format}: {lenses}");
        let straight = open(format);
        assert_eq!(straight.lenses(), None);
        let read = |scene: &Scene| scene.load_view(0, 0).expect("a picture").0.rgb;
        assert_ne!(read(&bent), read(&straight), "{format}");
        let refused = state(&[0.1; 9]).0.expect_err("nine").to_string();
        assert!(refused.contains(list) && refused.contains("9 distortion coefficients"), "{refused}");
    }
    let copy = common::copy("blender");
    let path = copy.path().join("transforms_train.json");
    let text = std::fs::read_to_string(&path).expect("a list");
    std::fs::write(&path, text.replacen('{', "{\"distortion\": [0.1],", 1)).expect("a list");
    assert!(Scene::open(copy.path()).expect("opens").lenses().is_some());
}
