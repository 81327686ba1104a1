//! Cameras from rendered boards: what comes out is what they were rendered with.

mod common;

use std::path::{Path, PathBuf};

use common::{Camera, Page, on_floor};
use gic_calibrate::{Board, BoardOn, CalibrateRequest, Calibrated, CalibratedCamera, Lens, Motion, calibrate};
use gic_twin::Interrupt;
use gic_twin::events::Events;
use nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector3};

const SIDE_M: f64 = 0.03;
const SIZE: [usize; 2] = [640, 480];

fn request(films: Vec<PathBuf>, board: Board, out: &Path) -> CalibrateRequest {
    CalibrateRequest {
        films,
        board,
        tag_size_m: SIDE_M,
        motion: Motion::Still,
        intrinsics_only: false,
        lenses: None,
        pixel_aspect: 1.0,
        board_on: BoardOn::Floor,
        frame_rate_hz: None,
        out: out.to_owned(),
    }
}

fn run(request: &CalibrateRequest) -> gic_calibrate::Result<Calibrated> {
    calibrate(request, &Events::silent(), &Interrupt::default())
}

fn place(camera: &CalibratedCamera) -> (Vector3<f64>, Matrix3<f64>) {
    let rows = camera.world_from_camera.expect("a place");
    (Vector3::from(rows.map(|row| row[3])), Matrix3::from_fn(|i, j| rows[i][j]))
}

fn close(found: f64, truth: f64, within: f64, what: &str) {
    assert!((found - truth).abs() <= within, "{what}: {found}, truth {truth} +- {within}");
}

/// The cameras' places against the truth, in the frame of the page that is the world's.
fn check_places(found: &Calibrated, cameras: &[Camera], page: &Isometry3<f64>, within_m: f64, within_rad: f64) {
    for (found, truth) in found.cameras.iter().zip(cameras) {
        let truth = page.inverse() * truth.world_from_camera;
        let (centre, rotation) = place(found);
        let off = (centre - truth.translation.vector).norm();
        assert!(off < within_m, "{}: centre {off} m off, sd {:?}", found.name, found.sd.centre_m);
        let turned = rotation.transpose() * truth.rotation.to_rotation_matrix().matrix();
        let angle = ((turned.trace() - 1.0) / 2.0).clamp(-1.0, 1.0).acos();
        assert!(angle < within_rad, "{}: {angle} rad off", found.name);
    }
}

/// Three cameras around pages that lie anywhere on the floor; no camera sees all of them.
#[test]
fn pages_on_the_floor_tell_still_cameras() {
    let folder = tempfile::tempdir().unwrap();
    let board: Board = "sheets:4x6,gap=0.5".parse().unwrap();
    let pages = [
        on_floor(board, 0, SIDE_M, 0.3, [0.1, 0.05]),
        on_floor(board, 1, SIDE_M, -0.4, [0.4, 0.02]),
        on_floor(board, 2, SIDE_M, 1.2, [0.2, 0.42]),
    ];
    let lens = |f: f64, k1: f64| Lens::new([f, f], [322.0, 238.5], [k1, 0.0, 0.0, 0.0]);
    let cameras = [
        Camera::looking(lens(520.0, -0.1), SIZE, [-0.3, -0.4, 0.6], [0.22, 0.1, 0.0]),
        Camera::looking(lens(540.0, 0.05), SIZE, [0.8, -0.3, 0.5], [0.3, 0.1, 0.0]),
        Camera::looking(lens(500.0, 0.0), SIZE, [0.5, 0.9, 0.6], [0.25, 0.25, 0.0]),
    ];
    let mut films = Vec::new();
    for (n, camera) in cameras.iter().enumerate() {
        films.push(folder.path().join(format!("camera{n}.png")));
        camera.draw(&pages, 2.0, n as u64, &films[n]);
    }
    let out = folder.path().join("out");
    let found = run(&request(films.clone(), board, &out)).unwrap();
    for (found, truth) in found.cameras.iter().zip(&cameras) {
        assert!(found.tags >= 36 && found.rms_px < 0.15, "{}: {} tags, {} px", found.name, found.tags, found.rms_px);
        let [fx, _] = truth.lens.focal_px();
        close(found.fx_px, fx, 0.006 * fx, "fx");
        close(found.distortion.k1, truth.lens.distortion()[0], 0.012, "k1");
        assert!(found.sd.focal_px.unwrap()[0] < 0.015 * fx && found.sd.centre_m.unwrap() < 0.008);
    }
    check_places(&found, &cameras, &pages[0].place(), 0.004, 0.006);
    for file in ["calibration.json", "report.html", "residuals/camera0.png", "residuals/camera2.png"] {
        assert!(out.join(file).is_file(), "{file}");
    }

    // The same with known lenses, for which the file serves, too.
    let again = CalibrateRequest { lenses: Some(out.join("calibration.json")), ..request(films, board, &out) };
    let again = run(&again).unwrap();
    assert!(again.cameras[0].sd.focal_px.is_none());
    close(again.cameras[0].fx_px, found.cameras[0].fx_px, 1e-9, "a known lens");
    check_places(&again, &cameras, &pages[0].place(), 0.004, 0.006);
}

/// A board that two cameras see in many places tells all of their lenses, whatever its kind.
fn moving_board(board: &str, poses: usize) -> (Calibrated, Vec<Camera>, Isometry3<f64>, tempfile::TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let board: Board = board.parse().unwrap();
    let lens = |f: f64| Lens::new([f, f * 1.001], [326.0, 236.0], [-0.2, 0.06, 0.001, -0.0005]);
    let cameras = vec![
        Camera::looking(lens(450.0), SIZE, [-0.2, -0.5, 0.15], [0.0, 0.0, 0.1]),
        Camera::looking(lens(470.0), SIZE, [0.25, -0.5, 0.2], [0.0, 0.0, 0.1]),
    ];
    let mut last = Isometry3::identity();
    for pose in 0..poses {
        // Held upright before the cameras, tilted and moved; in the end on the floor.
        let t = pose as f64;
        let upright = UnitQuaternion::from_euler_angles(1.2 + 0.3 * (1.7 * t).sin(), 0.0, 0.0);
        let tilt =
            UnitQuaternion::from_euler_angles(0.3 * (2.1 * t).cos(), 0.5 * (1.3 * t).sin(), 0.4 * (0.9 * t).sin());
        let turn = if pose + 1 == poses { UnitQuaternion::from_euler_angles(0.5, 0.0, 0.1) } else { upright * tilt };
        let shift = Vector3::new(0.08 * (1.1 * t).sin(), 0.05 * (0.7 * t).cos(), 0.1 + 0.05 * (1.9 * t).sin());
        last = Isometry3::from_parts(shift.into(), turn);
        for (n, camera) in cameras.iter().enumerate() {
            let film = folder.path().join(format!("films/camera{n}"));
            std::fs::create_dir_all(&film).unwrap();
            camera.draw(
                &[Page::new(last, &board.black(0, SIDE_M))],
                2.0,
                pose as u64,
                &film.join(format!("{pose:03}.png")),
            );
        }
    }
    let films = vec![folder.path().join("films")];
    let out = folder.path().join("out");
    let found = run(&CalibrateRequest { motion: Motion::Moving, ..request(films, board, &out) }).unwrap();
    (found, cameras, last, folder)
}

fn check_lens(found: &CalibratedCamera, truth: &Camera, scale: f64) {
    let [fx, fy] = truth.lens.focal_px();
    let [cx, cy] = truth.lens.principal_px();
    close(found.fx_px, fx, 0.003 * scale * fx, "fx");
    close(found.fy_px, fy, 0.003 * scale * fy, "fy");
    close(found.cx_px, cx, 4.0 * scale, "cx");
    close(found.cy_px, cy, 4.0 * scale, "cy");
    close(found.distortion.k1, truth.lens.distortion()[0], 0.015 * scale, "k1");
    assert!(found.rms_px < 0.12, "{} px", found.rms_px);
}

#[test]
fn a_moving_kalibr_board_tells_all_of_a_lens() {
    let (found, cameras, last, _folder) = moving_board("kalibr:4x4,gap=0.3", 7);
    found.cameras.iter().zip(&cameras).for_each(|(found, truth)| check_lens(found, truth, 1.0));
    check_places(&found, &cameras, &last, 0.004, 0.012);
}

#[test]
fn a_moving_charuco_board_tells_all_of_a_lens_and_lenses_alone_are_told() {
    let (found, cameras, last, folder) = moving_board("charuco:5x4,tag=0.75", 6);
    found.cameras.iter().zip(&cameras).for_each(|(found, truth)| check_lens(found, truth, 2.0));
    check_places(&found, &cameras, &last, 0.004, 0.006);
    let board: Board = "charuco:5x4,tag=0.75".parse().unwrap();
    let out = folder.path().join("lenses");
    let alone = CalibrateRequest {
        motion: Motion::Moving,
        intrinsics_only: true,
        ..request(vec![folder.path().join("films/camera1")], board, &out)
    };
    let alone = run(&alone).unwrap();
    check_lens(&alone.cameras[0], &cameras[1], 2.0);
    assert!(alone.cameras[0].world_from_camera.is_none() && out.join("intrinsics.json").is_file());
}

/// What `gic import` reads is what was written, in its frame and with its world.
#[test]
fn import_reads_what_calibration_writes() {
    let folder = tempfile::tempdir().unwrap();
    let board: Board = "kalibr:4x4".parse().unwrap();
    let page = on_floor(board, 0, SIDE_M, 0.0, [0.0, 0.0]);
    let films = folder.path().join("films");
    for (name, eye) in [("left", [-0.3, -0.3, 0.4]), ("right", [0.3, -0.3, 0.4])] {
        std::fs::create_dir_all(films.join(name)).unwrap();
        let lens = Lens::new([520.0, 520.0], [320.0, 240.0], [0.0; 4]);
        let camera = Camera::looking(lens, SIZE, eye, [0.0, 0.0, 0.0]);
        for frame in 0..3 {
            camera.draw(std::slice::from_ref(&page), 2.0, frame, &films.join(name).join(format!("{frame}.png")));
        }
    }
    let out = folder.path().join("out");
    run(&request(vec![films.clone()], board, &out)).unwrap();
    let scene = folder.path().join("scene");
    let import = gic_film::ImportRequest {
        films: vec![films],
        scene: scene.clone(),
        start_s: None,
        frames: None,
        every: 1,
        frame_rate_hz: Some(30.0),
        calibration: Some(out.join("calibration.json")),
        align: gic_film::Align::None,
    };
    let imported = gic_film::import(&import, &Events::silent(), &Interrupt::default()).unwrap();
    assert!(imported.is_calibrated);
    let read = gic_scene::Scene::open(&scene).unwrap();
    assert!(read.world.metric && read.world.up.unwrap().z > 0.999 && read.world.gravity.unwrap().z < -9.8);
    assert!(read.world.ground.unwrap().point.length() < 1e-9);
    let camera: &gic_scene::Camera = &read.cameras[0];
    let (centre, forward) = (camera.centre, camera.world_from_camera.z_axis);
    assert!((centre - glam::DVec3::new(-0.3, -0.3, 0.4)).length() < 0.004, "{centre}");
    assert!(forward.dot(-centre.normalize()) > 0.9999, "it looks at the board: {forward}");
}

#[test]
fn what_the_pictures_cannot_tell_is_said_with_the_cameras_name() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let board: Board = "sheets:2x2".parse().unwrap();
    let lens = Lens::new([520.0, 520.0], [320.0, 240.0], [0.0; 4]);
    let camera = Camera::looking(lens, SIZE, [0.0, -0.2, 0.3], [0.0, 0.0, 0.0]);
    let (left, right, blank) =
        (folder.path().join("left.png"), folder.path().join("right.png"), folder.path().join("blank.png"));
    camera.draw(&[on_floor(board, 0, SIDE_M, 0.0, [0.0, 0.0])], 1.0, 1, &left);
    camera.draw(&[on_floor(board, 1, SIDE_M, 0.0, [0.0, 0.0])], 1.0, 1, &right);
    camera.draw(&[], 1.0, 1, &blank);
    let fails = |request: CalibrateRequest| {
        let error = run(&request).unwrap_err();
        assert!(error.hint().is_some_and(|hint| hint.len() > 20), "{error}");
        error.to_string()
    };
    let none = fails(request(vec![left.clone(), blank], board, &out));
    assert!(none.contains("camera blank") && none.contains("no tag"), "{none}");
    let apart = fails(request(vec![left.clone(), right.clone()], board, &out));
    assert!(apart.contains("left and the other") && apart.contains("share no"), "{apart}");
    let other = fails(request(vec![right], "charuco:3x2".parse().unwrap(), &out));
    assert!(other.contains("sees tag 4") && other.contains("charuco:3x2"), "{other}");
    let border = fails(request(vec![left.clone()], "kalibr:2x2".parse().unwrap(), &out));
    assert!(border.contains("border of another width"), "{border}");
    let size = fails(CalibrateRequest { tag_size_m: f64::NAN, ..request(vec![left], board, &out) });
    assert!(size.contains("size is missing"), "{size}");
    assert!(!out.exists(), "nothing is written");
}

/// A board that moves in what is said to be still.
#[test]
fn a_board_that_moves_is_not_taken_for_a_still_one() {
    let folder = tempfile::tempdir().unwrap();
    let board: Board = "sheets:2x2".parse().unwrap();
    let lens = Lens::new([520.0, 520.0], [320.0, 240.0], [0.0; 4]);
    let camera = Camera::looking(lens, SIZE, [0.0, -0.2, 0.3], [0.0, 0.0, 0.0]);
    let film = folder.path().join("left");
    std::fs::create_dir_all(&film).unwrap();
    for frame in 0..3 {
        let page = on_floor(board, 0, SIDE_M, 0.0, [0.01 * frame as f64, 0.0]);
        camera.draw(&[page], 1.0, 1, &film.join(format!("{frame}.png")));
    }
    let error = run(&request(vec![film], board, &folder.path().join("out"))).unwrap_err();
    assert!(error.is_usage() && error.hint().unwrap().contains("--moving"), "{error}");
}
