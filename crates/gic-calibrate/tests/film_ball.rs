//! Real film: four cameras over four printed sheets of tags, against the cameras that come with it.

use std::io::Write;
use std::path::Path;

use gic_calibrate::{BoardOn, CalibrateRequest, Motion, calibrate};
use gic_twin::Interrupt;
use gic_twin::events::Events;
use nalgebra::{Matrix3, Vector3};
use serde_json::Value;

/// The pixels of the films are 1.0133 times as wide as high (README).
const PIXEL_ASPECT: f64 = 1.0133;

/// Distances of places from the truth [m], after the turn and shift that bring them nearest to it (Kabsch 1976).
fn distances(found: &[Vector3<f64>], truth: &[Vector3<f64>]) -> Vec<f64> {
    let mean = |all: &[Vector3<f64>]| all.iter().sum::<Vector3<f64>>() / all.len() as f64;
    let (from, to) = (mean(found), mean(truth));
    let moment: Matrix3<f64> = found.iter().zip(truth).map(|(a, b)| (b - to) * (a - from).transpose()).sum();
    let svd = moment.svd(true, true);
    let (u, v) = (svd.u.expect("u"), svd.v_t.expect("v"));
    let turn = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v).determinant())) * v;
    found.iter().zip(truth).map(|(a, b)| (turn * (a - from) + to - b).norm()).collect()
}

#[test]
fn the_tags_under_the_ball_tell_its_four_cameras() {
    let film = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data/film_ball/as_filmed"));
    if !film.is_dir() {
        // Past the capture of the test harness: a skip must be seen.
        let _ = writeln!(std::io::stderr(), "SKIPPED: {} is not there", film.display());
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let mut films = Vec::new();
    for camera in 0..4 {
        let own = folder.path().join(format!("c{camera}"));
        std::fs::create_dir(&own).unwrap();
        for frame in -1..10 {
            let picture = film.join(format!("data/r_{camera}_{frame}.png"));
            std::fs::copy(picture, own.join(format!("{}.png", frame + 1))).unwrap();
        }
        films.push(own);
    }
    let request = CalibrateRequest {
        films,
        board: "sheets:6x4,gap=0.494".parse().unwrap(),
        tag_size_m: 0.0289,
        motion: Motion::Still,
        intrinsics_only: false,
        lenses: None,
        pixel_aspect: PIXEL_ASPECT,
        board_on: BoardOn::Floor,
        frame_rate_hz: None,
        out: folder.path().join("out"),
    };
    let found = calibrate(&request, &Events::silent(), &Interrupt::default()).unwrap();
    let all: Value = serde_json::from_slice(&std::fs::read(film.join("all_data.json")).unwrap()).unwrap();
    let truth = |camera: usize| {
        let name = format!("./data/r_{camera}_0.png");
        all.as_array().unwrap().iter().find(|entry| entry["file_path"] == *name).expect("a picture of each camera")
    };
    let (mut centres, mut true_centres, mut squares) = (Vec::new(), Vec::new(), 0.0);
    let tags: usize = found.cameras.iter().map(|camera| camera.tags).sum();
    for (n, camera) in found.cameras.iter().enumerate() {
        let focal = truth(n)["intrinsic"][0][0].as_f64().unwrap();
        eprintln!(
            "{} {} tags, {:.3} px, fx {:+.2} %",
            camera.name,
            camera.tags,
            camera.rms_px,
            100.0 * (camera.fx_px / focal - 1.0)
        );
        assert!((camera.fx_px / focal - 1.0).abs() < 0.0075, "{}: {} instead of {focal}", camera.name, camera.fx_px);
        squares += camera.tags as f64 * camera.rms_px.powi(2);
        centres.push(Vector3::from(camera.world_from_camera.unwrap().map(|row| row[3])));
        true_centres.push(Vector3::from([0, 1, 2].map(|row| truth(n)["c2w"][row][3].as_f64().unwrap())));
    }
    let (rms, off) = ((squares / tags as f64).sqrt(), distances(&centres, &true_centres));
    eprintln!("{tags} tags, {rms:.3} px, centres off by {off:.4?} m");
    assert!(tags >= 200, "{tags} tags");
    assert!(rms < 0.3, "{rms} px");
    assert!(off.iter().all(|off| *off < 0.004), "{off:?}");
}
