//! Free flight: how a rigid body moves before it touches anything, by its outlines alone.
//!
//! A camera that films a falling body sees it as a moving camera would see the body at rest: every moment is a view.
//! For that the motion must be known, but not the shape: [`tangency`] tells of two outlines and the places of their
//! cameras whether they can be of one body. [`FreeFlight::find`] fits velocity v, acceleration a and angular velocity w
//! of
//!
//! `x(t) = m + R(w t) (x0 - m) + v t + a t^2 / 2`, with m near the body's middle at the first frame,
//!
//! so that all outlines can, and follows the frames until they no longer can: then the body has touched something, or
//! changed its shape. A body at rest is one that flies with v, a and w zero. Cameras that lag behind the first one are
//! found with it: their delays are unknowns as v, a and w are. So are errors of their calibration
//! ([`CalibrationError`]), each with a prior. The simplest of these explanations is kept that explains the outlines as
//! well as all together do.

mod calibration_error;
mod camera_offset;
mod fit;
mod moment;
mod outline;
mod tangency;
#[cfg(test)]
mod tests;
mod unknowns;

use glam::{DMat3, DQuat, DVec3};
use nalgebra::Matrix6;

use crate::Camera;
pub use calibration_error::CalibrationError;
pub use camera_offset::CameraOffset;
pub use fit::Seek;
pub use moment::FlightView;

/// The motion of a rigid body in its first frames.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FreeFlight {
    /// The point about which it turns, at the first frame [m].
    pub about: DVec3,
    /// Velocity of that point at the first frame [m/s].
    pub velocity: DVec3,
    /// Angular velocity [rad/s].
    pub angular_velocity: DVec3,
    /// Acceleration of that point [m/s^2]: gravity in free fall.
    pub acceleration: DVec3,
    /// Times of the frames since the first [s], one a frame.
    pub times: Vec<f64>,
    /// By how much each camera's pictures are later than the frames' times [s], by its index; the first one's are not.
    pub delays: Vec<f64>,
    /// By what each camera differs from what the scene says, by its index; empty where none does.
    pub errors: Vec<CalibrationError>,
    /// Standard deviations of these errors.
    pub error_deviations: Vec<CalibrationError>,
    /// Covariance of velocity [m/s] and angular velocity [rad/s].
    pub covariance: Matrix6<f64>,
    /// How far outlines are from touching common tangents, root mean square [pixels].
    pub miss_px: f64,
    /// The same for each degree of freedom: what the outlines' own errors are [pixels].
    pub spread_px: f64,
}

impl FreeFlight {
    /// Frames in which the body is rigid and flies.
    pub fn frames(&self) -> usize {
        self.times.len()
    }

    /// Mean time between frames [s].
    pub fn frame_seconds(&self) -> f64 {
        self.times.last().copied().unwrap_or_default() / (self.times.len() - 1).max(1) as f64
    }

    /// Turn and shift [m] about [`FreeFlight::about`] since the first frame, after `time` [s].
    fn pose(&self, time: f64) -> (DMat3, DVec3) {
        let turn = DMat3::from_quat(DQuat::from_scaled_axis(time * self.angular_velocity));
        (turn, time * self.velocity + 0.5 * time * time * self.acceleration)
    }

    /// The body's turn since the first frame, after `time` [s].
    pub fn turn(&self, time: f64) -> DMat3 {
        self.pose(time).0
    }

    /// Where in the first frame a point of the body was that is at `point` [m] after `time` [s].
    pub fn back(&self, point: DVec3, time: f64) -> DVec3 {
        let (turn, shift) = self.pose(time);
        self.about + turn.transpose() * (point - self.about - shift)
    }

    /// Where after `time` [s] a point of the body is that was at `point` [m] in the first frame.
    pub fn forth(&self, point: DVec3, time: f64) -> DVec3 {
        let (turn, shift) = self.pose(time);
        self.about + shift + turn * (point - self.about)
    }

    /// A camera that sees the body at time `to` as `camera` sees it at time `from` [s].
    pub fn camera_between(&self, camera: &Camera, from: f64, to: f64) -> Camera {
        let start = self.camera_at_start(camera, from);
        Camera {
            world_from_camera: self.pose(to).0 * start.world_from_camera,
            centre: self.forth(start.centre, to),
            ..start
        }
    }

    /// A camera that sees the body of the first frame as `camera` sees it after `time` [s].
    pub fn camera_at_start(&self, camera: &Camera, time: f64) -> Camera {
        let (turn, _) = self.pose(time);
        Camera {
            world_from_camera: turn.transpose() * camera.world_from_camera,
            centre: self.back(camera.centre, time),
            ..camera.clone()
        }
    }
}
