//! What the free flight shows: the motion, delays and calibration errors of cameras, and the unit of length.

use std::fmt;

use glam::DVec3;
use serde::Serialize;

use crate::flight::{CalibrationError, FreeFlight};
use crate::scene::Scene;

/// Gravity where the scene does not state any [m/s^2].
const STANDARD_GRAVITY_M_S2: f64 = 9.8;
/// A scene whose unit would be longer than this shows something that rolls or floats, not a fall [m].
const MOST_UNIT_M: f64 = 10.0;

/// The motion of the object before it touches anything, by its outlines alone.
#[derive(Clone, Debug, Serialize)]
pub struct FlightReport {
    /// Number of frames.
    pub frames: usize,
    /// Velocity at the first of them [m/s].
    pub velocity_m_s: [f64; 3],
    /// Acceleration [m/s^2]: gravity, if lengths are metres and the frame rate is right.
    pub acceleration_m_s2: [f64; 3],
    /// Angular velocity [rad/s].
    pub angular_velocity_rad_s: [f64; 3],
    /// By how much the pictures of each camera are later than those of the first one [frames]; empty where the scene's
    /// times explain the outlines.
    pub delays_frames: Vec<f64>,
    /// What is wrong with the calibration of each camera; empty where the stated one explains the outlines.
    pub calibration_errors: Vec<CalibrationErrorReport>,
    /// How far outlines are from touching common tangents, root mean square in pixels.
    pub miss_px: f64,
}

/// By what a camera differs from what the scene states, each with its standard deviation.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct CalibrationErrorReport {
    /// Angle by which it is turned [degrees].
    pub turn_deg: [f64; 2],
    /// Distance by which it is moved [m].
    pub shift_m: [f64; 2],
    /// By how much its focal length is longer [per cent].
    pub focal_percent: [f64; 2],
    /// Coefficient of radial distortion that remained.
    pub radial: [f64; 2],
}

/// Of the unit of length, the frame rate and gravity, each one by the other two: `|a| = g rate^2 / (unit rate_0^2)`.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct FallReport {
    /// Gravity [m/s^2] that the others are measured with.
    pub gravity_m_s2: f64,
    /// Length of the scene's unit [m] at the stated frame rate.
    pub unit_m: f64,
    /// Frames a second where the scene's unit is a metre; `None` of frames that are not evenly spaced.
    pub frame_rate_hz: Option<f64>,
}

impl Scene {
    /// What the free flight showed to be otherwise than the scene states, a sentence each; empty where nothing is.
    pub fn corrections(&self) -> Vec<String> {
        self.flight.iter().flat_map(|flight| flight_report(self, flight).corrections(&self.camera_names)).collect()
    }
}

pub(super) fn flight_report(scene: &Scene, flight: &FreeFlight) -> FlightReport {
    FlightReport {
        frames: flight.frames(),
        velocity_m_s: flight.velocity.to_array(),
        acceleration_m_s2: flight.acceleration.to_array(),
        angular_velocity_rad_s: flight.angular_velocity.to_array(),
        delays_frames: scene.delays_s.iter().map(|delay| delay / flight.frame_seconds()).collect(),
        calibration_errors: (scene.calibration_errors.iter().zip(&scene.calibration_error_deviations))
            .map(CalibrationErrorReport::new)
            .collect(),
        miss_px: flight.miss_px,
    }
}

impl FlightReport {
    /// The cameras that do not take their pictures at the times of the first one.
    fn lags(&self) -> Option<String> {
        let lag = |(camera, delay): (usize, &f64)| format!("{camera} by {delay:+.2} frames");
        let late = self.delays_frames.iter().enumerate().filter(|(_, delay)| **delay != 0.0);
        let lags: Vec<String> = late.map(lag).collect();
        (!lags.is_empty()).then(|| format!("cameras lag behind the first one: {}", lags.join(", ")))
    }

    /// The cameras that are not as the scene states.
    fn errors(&self, names: &[String]) -> Vec<String> {
        let error =
            |(name, error): (&String, &CalibrationErrorReport)| format!("camera {name} is not as stated: {error}");
        names.iter().zip(&self.calibration_errors).map(error).collect()
    }

    /// What the flight shows to be otherwise than the scene states, a sentence each; `names` are the cameras'.
    pub(super) fn corrections(&self, names: &[String]) -> Vec<String> {
        let mut found: Vec<String> = self.lags().into_iter().chain(self.errors(names)).collect();
        if !found.is_empty() {
            found.push(format!("with that, outlines of the flight agree to {:.2} pixels", self.miss_px));
        }
        found
    }
}

impl CalibrationErrorReport {
    fn new((error, deviation): (&CalibrationError, &CalibrationError)) -> CalibrationErrorReport {
        let degrees = |turn: DVec3| turn.length().to_degrees();
        CalibrationErrorReport {
            turn_deg: [degrees(error.turn_rad), degrees(deviation.turn_rad)],
            shift_m: [error.shift_m.length(), deviation.shift_m.length()],
            focal_percent: [error.focal, deviation.focal].map(|share| 100.0 * share),
            radial: [error.radial, deviation.radial],
        }
    }
}

impl fmt::Display for CalibrationErrorReport {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let [turn, shift, focal, radial] = [self.turn_deg, self.shift_m, self.focal_percent, self.radial];
        write!(
            f,
            "turned by {:.2} +- {:.2} degrees, moved by {:.1} +- {:.1} mm, ",
            turn[0],
            turn[1],
            1e3 * shift[0],
            1e3 * shift[1]
        )?;
        write!(
            f,
            "focal length {:+.2} +- {:.2} %, distortion {:+.3} +- {:.3}",
            focal[0], focal[1], radial[0], radial[1]
        )
    }
}

impl FallReport {
    /// `None` of a body that does not fall: whose acceleration is not a tenth of what gravity would be if lengths were
    /// metres, nor the way that things fall.
    pub(super) fn of(scene: &Scene, flight: &FreeFlight, up: DVec3) -> Option<FallReport> {
        let gravity_m_s2 = scene.world.gravity.map_or(STANDARD_GRAVITY_M_S2, DVec3::length);
        let falls = -flight.acceleration.dot(up);
        let unit_m = gravity_m_s2 / falls;
        let is_fall = falls > 0.9 * flight.acceleration.length() && unit_m < MOST_UNIT_M;
        is_fall.then(|| FallReport {
            gravity_m_s2,
            unit_m,
            frame_rate_hz: scene.frame_rate.map(|rate| rate * unit_m.sqrt()),
        })
    }
}
