use std::convert::Infallible;

use glam::{DMat3, DQuat, DVec2, DVec3};
use nalgebra::Matrix6;
use proptest::prelude::*;

use super::{CalibrationError, FlightView, FreeFlight, Seek};
use crate::{Camera, Mask};

const SIZE: usize = 160;
const SPIN: DVec3 = DVec3::new(0.6, -0.3, 0.9);
const BOTH: Seek = Seek { delays: true, errors: true };

/// Balls at the corners of a crooked tetrahedron: no plane mirrors them.
const BALLS: [(DVec3, f64); 4] = [
    (DVec3::new(0.0, 0.0, 0.0), 0.06),
    (DVec3::new(0.13, 0.02, 0.0), 0.045),
    (DVec3::new(0.03, 0.12, 0.02), 0.035),
    (DVec3::new(-0.02, 0.05, 0.11), 0.05),
];

/// Three cameras around the body, which look down on it.
fn cameras() -> Vec<Camera> {
    let around = |k: f64| {
        let centre = DQuat::from_rotation_y(2.1 * k) * DVec3::new(0.0, 0.7, 1.4);
        let z = (DVec3::new(0.0, -0.05, 0.0) - centre).normalize();
        let x = z.cross(DVec3::Y).normalize();
        Camera {
            width: SIZE,
            height: SIZE,
            focal: DVec2::splat(260.0),
            principal: DVec2::splat(0.5 * SIZE as f64),
            world_from_camera: DMat3::from_cols(x, z.cross(x), z),
            centre,
        }
    };
    (0..3).map(|k| around(f64::from(k))).collect()
}

/// The antialiased mask of the balls, each where `place` takes its centre.
fn mask(camera: &Camera, place: impl Fn(DVec3) -> DVec3) -> Mask {
    let balls: Vec<(DVec3, f64)> = BALLS.iter().map(|(centre, radius)| (place(*centre), *radius)).collect();
    let coverage = |i: usize| {
        let pixel = DVec2::new((i % SIZE) as f64 + 0.5, (i / SIZE) as f64 + 0.5);
        let ray = (camera.unproject(pixel, 1.0) - camera.centre).normalize();
        let covered = |(centre, radius): &(DVec3, f64)| {
            let to = *centre - camera.centre;
            let off = to.reject_from_normalized(ray).length();
            (0.5 + (radius - off) * camera.focal.x / to.length()).clamp(0.0, 1.0)
        };
        balls.iter().map(covered).fold(0.0, f64::max) as f32
    };
    Mask { width: SIZE, height: SIZE, coverage: (0..SIZE * SIZE).map(coverage).collect() }
}

/// What is found of a body that moves so.
fn find(times: &[f64], place: impl Fn(f64, DVec3) -> DVec3) -> Option<FreeFlight> {
    find_by_late_cameras(times, [0.0; 3], place)
}

/// The same by cameras that are late [s].
fn find_by_late_cameras(times: &[f64], delays: [f64; 3], place: impl Fn(f64, DVec3) -> DVec3) -> Option<FreeFlight> {
    find_by(&cameras(), times, delays, place)
}

/// The same by cameras that are not as they are stated to be either.
fn find_by(
    stated: &[Camera],
    times: &[f64],
    delays: [f64; 3],
    place: impl Fn(f64, DVec3) -> DVec3,
) -> Option<FreeFlight> {
    let cameras = cameras();
    let views = |frame: usize| {
        let late = |(camera, delay): (&Camera, f64)| mask(camera, |p| place(times[frame] + delay, p));
        let masks = cameras.iter().zip(delays).map(late);
        let view = |(index, (camera, mask)): (usize, (&Camera, Mask))| FlightView {
            index,
            camera: camera.clone(),
            lag_s: 0.0,
            mask,
        };
        Ok::<_, Infallible>(stated.iter().zip(masks).enumerate().map(view).collect())
    };
    let Ok(found) = FreeFlight::find(times, None, BOTH, views);
    found
}

fn times() -> Vec<f64> {
    (0..6).map(|k| f64::from(k) / 24.0).collect()
}

fn flown(t: f64, p: DVec3, spin: DVec3) -> DVec3 {
    let middle = DVec3::new(0.03, 0.05, 0.03);
    let (velocity, gravity) = (DVec3::new(0.5, 0.3, -0.4), DVec3::new(0.0, -9.8, 0.0));
    middle + t * velocity + 0.5 * t * t * gravity + DQuat::from_scaled_axis(t * spin) * (p - middle)
}

#[test]
fn a_tumbling_body_is_followed_to_a_millimetre() {
    for spin in [DVec3::ZERO, SPIN] {
        let found = find(&times(), |t, p| flown(t, p, spin)).expect("it flies");
        assert_eq!(found.frames(), 6);
        let off =
            BALLS.iter().map(|(centre, _)| found.forth(*centre, 5.0 / 24.0).distance(flown(5.0 / 24.0, *centre, spin)));
        let off = off.fold(0.0, f64::max);
        let falls = found.acceleration.distance(DVec3::new(0.0, -9.8, 0.0));
        println!("{off:.5} m off, gravity by {falls:.3}, {:.3} pixels", found.miss_px);
        assert!(off < 1e-3 && falls < 0.2, "{off} {falls}");
        assert!(found.delays == [0.0; 3] && found.errors.is_empty(), "the cameras are as stated");
    }
}

/// With the acceleration known, the velocity is as sure as its covariance says.
#[test]
fn a_known_acceleration_makes_the_velocity_sure() {
    let cameras = cameras();
    for spin in [DVec3::ZERO, SPIN] {
        let views = |frame: usize| {
            let view = |(index, camera): (usize, &Camera)| {
                let mask = mask(camera, |p| flown(times()[frame], p, spin));
                FlightView { index, camera: camera.clone(), lag_s: 0.0, mask }
            };
            Ok::<_, Infallible>(cameras.iter().enumerate().map(view).collect())
        };
        let Ok(found) = FreeFlight::find(&times(), Some(DVec3::new(0.0, -9.8, 0.0)), BOTH, views);
        let found = found.expect("it flies");
        // Of the point about which `flown` turns it.
        let middle = DVec3::new(0.03, 0.05, 0.03);
        let velocity = found.velocity + found.angular_velocity.cross(middle - found.about);
        let off = velocity - DVec3::new(0.5, 0.3, -0.4);
        for axis in 0..3 {
            let deviation = found.covariance[(axis, axis)].sqrt();
            println!("{:.2} mm/s off, deviation {:.2}", 1e3 * off[axis], 1e3 * deviation);
            assert!(off[axis].abs() < 2.5 * deviation && deviation < 5e-3, "{off} {deviation}");
        }
    }
}

#[test]
fn cameras_that_are_late_are_found_with_the_flight() {
    let frame = 1.0 / 24.0;
    let delays = [0.0, 0.6 * frame, -0.25 * frame];
    let found = find_by_late_cameras(&times(), delays, |t, p| flown(t, p, DVec3::ZERO)).expect("it flies");
    let off = found.delays.iter().zip(delays).map(|(found, truth)| (found - truth).abs() / frame).fold(0.0, f64::max);
    let falls = found.acceleration.distance(DVec3::new(0.0, -9.8, 0.0));
    println!("{off:.4} frames off, gravity by {falls:.3}, {:.3} pixels", found.miss_px);
    assert!(found.frames() == 6 && off < 0.02 && falls < 0.2, "{off} {falls}");
}

/// Turns [rad], shifts [m], logarithms of focal lengths and distortion that tripods and calibrations leave.
const ERRORS: [[f64; 8]; 3] = [
    [0.004, -0.003, 0.005, 0.002, 0.001, -0.002, 0.01, 0.0],
    [-0.005, 0.004, 0.0, 0.0, 0.002, 0.001, -0.02, 0.0],
    [0.003, 0.004, -0.004, -0.002, 0.0, 0.002, 0.015, 0.01],
];

#[test]
fn cameras_that_are_not_as_stated_are_found_with_the_flight() {
    let errors = ERRORS.map(|numbers| CalibrationError::of_numbers(&numbers));
    let stated: Vec<Camera> = cameras().iter().zip(&errors).map(|(camera, error)| error.mended(camera)).collect();
    for delays in [[0.0; 3], [0.0, 0.025, -0.01]] {
        let found = find_by(&stated, &times(), delays, |t, p| flown(t, p, SPIN)).expect("it flies");
        let late = found.delays.iter().zip(delays).map(|(found, truth)| 24.0 * (found - truth).abs());
        let late = late.fold(0.0, f64::max);
        let falls = found.acceleration.distance(DVec3::new(0.0, -9.8, 0.0));
        // What all focal lengths have in common is a question of scale, and not told.
        let focal = found.errors.iter().zip(&errors).map(|(found, made)| found.focal + made.focal);
        let common = focal.clone().sum::<f64>() / 3.0;
        let focal = focal.map(|left| (left - common).abs()).fold(0.0, f64::max);
        println!("{late:.4} frames, focal lengths {focal:.4} off, gravity by {falls:.3}, {:.3} pixels", found.miss_px);
        assert!(found.frames() == 6 && late < 0.02 && focal < 0.005 && falls < 0.2, "{late} {focal} {falls}");
        assert!(found.error_deviations.iter().all(|deviation| deviation.focal < 0.01), "less sure than before");
        assert!(found.miss_px < 0.1, "{} pixels", found.miss_px);
    }
}

/// Two frames leave room for many errors, which take so much of the outlines' noise that the third seems to miss them.
#[test]
fn all_of_the_flight_is_seen_where_two_frames_do_not_tell_the_errors() {
    let gravity = Some(DVec3::new(0.0, -9.8, 0.0));
    let errors = ERRORS.map(|numbers| CalibrationError::of_numbers(&numbers));
    let stated: Vec<Camera> = cameras().iter().zip(&errors).map(|(camera, error)| error.mended(camera)).collect();
    for seed in 0..8_u64 {
        let mut state = seed;
        let mut noise = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64 / f64::from(1 << 23) - 1.0
        };
        let views = |frame: usize| {
            let view = |(index, (camera, seen)): (usize, (&Camera, &Camera))| {
                let time = times()[frame] + [0.0, 0.025, 0.008][index];
                // A tenth of a pixel for each ball, as of a mask that was made by difference.
                let shift = BALLS.map(|_| 5e-4 * DVec3::new(noise(), noise(), noise()));
                let place = |p: DVec3| {
                    let ball = BALLS.iter().position(|(centre, _)| *centre == p).expect("a ball");
                    flown(time, p, SPIN) + shift[ball]
                };
                FlightView { index, camera: camera.clone(), lag_s: 0.0, mask: mask(seen, place) }
            };
            Ok::<_, Infallible>(stated.iter().zip(&cameras()).enumerate().map(view).collect())
        };
        let Ok(found) = FreeFlight::find(&times(), gravity, BOTH, views);
        let frames = found.map(|found| found.frames()).unwrap_or_default();
        println!("seed {seed}: {frames} frames");
        assert!(frames >= 4, "seed {seed}: {frames} frames of six");
    }
}

#[test]
fn the_flight_ends_where_the_body_changes_its_shape() {
    let squeezed = |t: f64, p: DVec3| {
        let p = if t > 0.15 { DVec3::new(p.x, 0.9 * p.y, p.z) } else { p };
        flown(t, p, DVec3::ZERO)
    };
    assert_eq!(find(&times(), squeezed).map(|found| found.frames()), Some(4));
    assert_eq!(find(&times(), |t, p| (1.0 + 3.0 * t) * p), None, "a body that swells");
}

#[test]
fn a_body_at_rest_flies_nowhere() {
    let found = find(&times(), |_, p| p).expect("it keeps its shape");
    assert!(found.frames() == 6 && found.velocity.length() < 1e-3 && found.angular_velocity.length() < 1e-2);
}

#[test]
fn one_camera_tells_no_flight() {
    let camera = cameras().remove(0);
    let views = |_| {
        Ok::<_, Infallible>(vec![FlightView {
            index: 0,
            camera: camera.clone(),
            lag_s: 0.0,
            mask: mask(&camera, |p| p),
        }])
    };
    assert_eq!(FreeFlight::find(&times(), None, BOTH, views), Ok(None));
}

proptest! {
    /// What a camera sees of a moved point, it sees of the point itself from where the motion takes it back to.
    #[test]
    fn a_moved_camera_sees_the_body_at_rest(
        velocities in prop::array::uniform9(-2.0f64..2.0), point in prop::array::uniform3(-0.1f64..0.1),
    ) {
        let vector = |k: usize| DVec3::new(velocities[k], velocities[k + 1], velocities[k + 2]);
        let flight = FreeFlight {
            about: DVec3::new(0.1, 0.0, 0.05),
            velocity: 0.1 * vector(0),
            acceleration: vector(3),
            angular_velocity: vector(6),
            times: vec![0.0, 0.2],
            delays: vec![0.0],
            covariance: Matrix6::zeros(),
            errors: Vec::new(),
            error_deviations: Vec::new(),
            miss_px: 0.0,
            spread_px: 0.0,
        };
        let (camera, point) = (&cameras()[1], DVec3::from_array(point));
        let moved = flight.forth(point, 0.2);
        prop_assert!(flight.back(moved, 0.2).distance(point) < 1e-12);
        let (then, _) = camera.project(moved).expect("in front");
        let (now, _) = flight.camera_at_start(camera, 0.2).project(point).expect("in front");
        prop_assert!(then.distance(now) < 1e-9, "{} {}", then, now);
    }
}
