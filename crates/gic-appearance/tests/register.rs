//! Registration of a scan made here: three coloured lobes, moved, turned and scaled, seen by three cameras.

#[path = "../../gic-motion/tests/common/mod.rs"]
mod common;

use std::f64::consts::TAU;
use std::ops::ControlFlow;

use gic_appearance::{AppearanceError, Candidate, RegisterSettings, Registration, place_scan, register};
use gic_scene::{Camera, Scene, Similarity};
use gic_splat::{Gaussians, Shape};
use glam::{DMat3, DQuat, DVec2, DVec3, EulerRot};

const SIZE: usize = 72;

/// A camera that looks at the origin, y up.
fn camera(centre: DVec3) -> Camera {
    let forward = -centre.normalize();
    let right = forward.cross(DVec3::Y).normalize();
    Camera {
        width: SIZE,
        height: SIZE,
        focal: DVec2::splat(130.0),
        principal: DVec2::splat(SIZE as f64 / 2.0),
        world_from_camera: DMat3::from_cols(right, forward.cross(right), forward),
        centre,
    }
}

fn cameras() -> Vec<Camera> {
    [(0.0, 0.5), (0.35, 0.2), (0.6, 0.9)]
        .map(|(turn, height)| {
            let (sin, cos) = f64::sin_cos(TAU * turn);
            camera(DVec3::new(1.2 * cos, height, 1.2 * sin))
        })
        .to_vec()
}

/// Points on spheres (centre, radius), coloured by where they are.
fn lobes(spheres: &[(DVec3, f64)]) -> Gaussians {
    let mut points = Vec::new();
    for &(centre, radius) in spheres {
        let n = (2_500.0 * radius) as usize;
        for i in 0..n {
            let z = 1.0 - 2.0 * (i as f64 + 0.5) / n as f64;
            let (sin, cos) = (i as f64 * 2.399_963).sin_cos();
            let r = (1.0 - z * z).sqrt();
            points.push(centre + radius * DVec3::new(r * cos, r * sin, z));
        }
    }
    let n = points.len();
    Gaussians {
        sh: points.iter().map(|p| (*p * 1.2).as_vec3().to_array()).collect(),
        positions: points.iter().map(|p| p.as_vec3().to_array()).collect(),
        opacities: vec![0.9; n],
        shape: Shape::Isotropic { scales: vec![0.05; n] },
        sh_degree: 0,
    }
}

fn scan() -> Gaussians {
    let spheres = [
        (DVec3::new(2.0, 1.0, -0.5), 0.5),
        (DVec3::new(2.3, 1.65, -0.4), 0.3),
        (DVec3::new(2.65, 0.9, -0.2), 0.2),
        (DVec3::new(1.7, 0.8, 0.15), 0.25),
    ];
    lobes(&spheres)
}

fn truth() -> Similarity {
    let rotation = DMat3::from_euler(EulerRot::XYZ, 2.1, -0.7, 1.3);
    let scale = 0.15;
    Similarity {
        scale,
        rotation,
        translation: DVec3::new(0.02, -0.03, 0.01) - scale * (rotation * DVec3::new(2.1, 1.1, -0.4)),
    }
}

const SETTINGS: RegisterSettings =
    RegisterSettings { starts: 1_500, candidates: 6, steps: 40, final_steps: 80, color: 0.5, least_iou: 0.9 };

fn least_iou(candidate: &Candidate) -> f64 {
    candidate.iou.iter().copied().fold(f64::INFINITY, f64::min)
}

fn find(scan: &Gaussians, video: &Scene) -> Result<Registration, AppearanceError> {
    register(scan, video, &SETTINGS, &mut |_, _| ControlFlow::Continue(()))
}

fn video(cameras: &[Camera]) -> (tempfile::TempDir, Scene) {
    common::scene(cameras, &[(0.0, place_scan(&scan(), &truth()))])
}

#[test]
fn the_pose_is_found_from_nothing() {
    let (_folder, video) = video(&cameras());
    let found = find(&scan(), &video).unwrap();
    let (best, truth) = (&found.candidates[0], truth());
    let turn =
        DQuat::from_mat3(&(best.world_from_scan.rotation * truth.rotation.transpose())).to_scaled_axis().length();
    assert!(turn.to_degrees() < 0.5, "turned by {} degrees", turn.to_degrees());
    assert!((best.world_from_scan.scale / truth.scale - 1.0).abs() < 0.005, "scale {}", best.world_from_scan.scale);
    let centre = DVec3::new(2.1, 1.1, -0.4);
    let shift = (best.world_from_scan.point(centre) - truth.point(centre)).length();
    assert!(shift < 1e-3, "{shift} m away");
    assert!(least_iou(best) > 0.97 && best.apart_rad == 0.0, "{:?}", best.iou);
    assert_eq!(found.cameras, [0, 1, 2]);
    assert!(found.candidates[1..].iter().all(|other| other.loss > 1.5 * best.loss && other.apart_rad > 0.1));
    assert_eq!(find(&scan(), &video).unwrap(), found, "the same bits again");
}

#[test]
fn another_object_overlaps_badly() {
    let (_folder, video) = video(&cameras());
    let bone = lobes(&[(DVec3::ZERO, 0.2), (DVec3::new(0.4, 0.0, 0.0), 0.2), (DVec3::new(0.8, 0.0, 0.1), 0.2)]);
    let found = find(&bone, &video).unwrap();
    assert!(least_iou(&found.candidates[0]) < SETTINGS.least_iou, "{:?}", found.candidates[0].iou);
}

fn complaint(scan: &Gaussians, video: &Scene) -> String {
    match find(scan, video) {
        Err(AppearanceError::Unregistrable(reason)) => reason,
        other => panic!("{other:?}"),
    }
}

#[test]
fn one_view_cannot_tell_size_from_distance() {
    let (_folder, video) = video(&cameras());
    let reason = complaint(&scan(), &video.with_cameras(&[1]).unwrap());
    assert!(reason.contains("only camera") && reason.contains("at least two"), "{reason}");
    let beside = [camera(DVec3::new(1.2, 0.3, 0.0)), camera(DVec3::new(1.2, 0.3, 0.03))];
    let (_folder, video) = self::video(&beside);
    let reason = complaint(&scan(), &video);
    assert!(reason.contains("degrees apart"), "{reason}");
}

#[test]
fn a_mirrored_camera_is_named() {
    let (_folder, mut video) = video(&cameras());
    video.cameras[2].centre.z *= -1.0;
    let reason = complaint(&scan(), &video);
    assert!(reason.contains("mirrored"), "{reason}");
}

#[test]
fn a_camera_that_misses_the_object_takes_no_part() {
    let mut all = cameras();
    let mut away = camera(DVec3::new(-1.2, 0.3, -0.4));
    away.world_from_camera = DMat3::from_rotation_y(2.0) * away.world_from_camera;
    all.insert(1, away);
    let (_folder, video) = video(&all);
    let settings = RegisterSettings { starts: 300, candidates: 1, steps: 5, final_steps: 5, ..SETTINGS };
    let found = register(&scan(), &video, &settings, &mut |_, _| ControlFlow::Continue(())).unwrap();
    assert_eq!(found.cameras, [0, 2, 3]);
    assert_eq!(found.candidates[0].iou.len(), 3);
    let none = RegisterSettings { starts: 0, ..SETTINGS };
    let error = register(&scan(), &video, &none, &mut |_, _| ControlFlow::Continue(())).unwrap_err();
    assert!(matches!(error, AppearanceError::Setting { .. }), "{error}");
}

#[test]
fn an_empty_scan_is_refused() {
    let (_folder, video) = video(&cameras());
    let mut faint = scan();
    faint.opacities.fill(0.1);
    assert!(complaint(&faint, &video).contains("opaque"));
}
