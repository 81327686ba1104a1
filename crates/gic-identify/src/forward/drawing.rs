//! What changes pictures and no motion: the size of the particles' Gaussians, and the devices that take the pictures.
//!
//! A device that lags, or that is not where the input says, sees the body as a moved camera at a later time: what it is
//! off by is turned, shifted and focused as [`CalibrationError`] says, and each particle `x` is seen at `x + v d`, with
//! its velocity v and the delay d.

use std::borrow::Cow;

use gic_scene::{CalibrationError, Camera};
use glam::DVec3;

use crate::forward::footprint::IsotropicGaussians;
use crate::unknowns::state::{DEVICE_UNKNOWNS, State, Unknown};

/// How motions are drawn.
#[derive(Clone, Debug)]
pub(crate) struct Drawing {
    /// Factor on the Gaussians' standard deviations.
    pub splat_factor: f32,
    /// The numbers of one device after the other; those that are missing are zero.
    devices: Vec<f64>,
}

impl Drawing {
    pub(crate) fn of(state: &State) -> Drawing {
        Drawing { splat_factor: state.splat.exp() as f32, devices: state.devices.clone() }
    }

    /// With devices as the input says.
    pub(crate) fn of_factor(splat_factor: f32) -> Drawing {
        Drawing { splat_factor, devices: Vec::new() }
    }

    /// The same with an unknown of the drawing `step` higher.
    pub(crate) fn nudged(&self, unknown: Unknown, step: f64) -> Drawing {
        let mut nudged = self.clone();
        match unknown {
            Unknown::Splat => nudged.splat_factor *= step.exp() as f32,
            Unknown::Device(k) => {
                nudged.devices.resize(nudged.devices.len().max(k + 1), 0.0);
                nudged.devices[k] += step;
            }
            _ => (),
        }
        nudged
    }

    /// What a device is off by.
    pub(crate) fn sight(&self, device: usize) -> Sight {
        let number = |k: usize| self.devices.get(DEVICE_UNKNOWNS * device + k).copied().unwrap_or(0.0);
        Sight {
            error: CalibrationError {
                turn_rad: DVec3::new(number(0), number(1), number(2)),
                shift_m: DVec3::new(number(3), number(4), number(5)),
                focal: number(6),
                radial: 0.0,
            },
            late_s: number(7),
        }
    }
}

/// What a device is off by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sight {
    /// Of its calibration.
    pub error: CalibrationError,
    /// By how much its pictures are later than the input says [s].
    pub late_s: f64,
}

impl Sight {
    /// The camera that it is.
    fn camera<'a>(&self, camera: &'a Camera) -> Cow<'a, Camera> {
        if self.error == CalibrationError::default() {
            Cow::Borrowed(camera)
        } else {
            Cow::Owned(self.error.mended(camera))
        }
    }
}

/// A motion at one moment, and how it is drawn.
#[derive(Clone, Copy)]
pub(crate) struct Shown<'a> {
    pub gaussians: IsotropicGaussians<'a>,
    /// Of the particles [m/s], shape [n]; empty where all clocks are exact.
    pub velocities: &'a [[f32; 3]],
    pub drawing: &'a Drawing,
}

impl<'a> Shown<'a> {
    /// The same drawn otherwise.
    pub(crate) fn drawn_as<'b>(&'b self, drawing: &'b Drawing) -> Shown<'b> {
        let gaussians = IsotropicGaussians { factor: drawing.splat_factor, ..self.gaussians };
        Shown { gaussians, drawing, ..*self }
    }

    /// What `drawn` makes of the Gaussians and the camera with which a device sees them that is said to have `camera`.
    pub(crate) fn seen<T>(
        &self,
        device: usize,
        camera: &Camera,
        drawn: impl FnOnce(IsotropicGaussians, &Camera) -> T,
    ) -> T {
        let sight = self.drawing.sight(device);
        let positions = match sight.late_s {
            0.0 => Cow::Borrowed(self.gaussians.positions),
            late_s => Cow::Owned(self.positions_after(late_s as f32)),
        };
        drawn(IsotropicGaussians { positions: &positions, ..self.gaussians }, &sight.camera(camera))
    }

    fn positions_after(&self, time_s: f32) -> Vec<[f32; 3]> {
        let later = |(x, v): (&[f32; 3], &[f32; 3])| std::array::from_fn(|axis| x[axis] + time_s * v[axis]);
        self.gaussians.positions.iter().zip(self.velocities).map(later).collect()
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec2};

    use super::*;
    use crate::forward::silhouette::coverage;

    fn camera() -> Camera {
        Camera {
            width: 80,
            height: 80,
            focal: DVec2::splat(200.0),
            principal: DVec2::splat(40.0),
            world_from_camera: DMat3::IDENTITY,
            centre: DVec3::new(0.02, 0.02, -1.0),
        }
    }

    /// What a device sees of a square of particles that move along x, drawn with the device's numbers.
    fn seen(devices: &[(usize, f64)], device: usize) -> Vec<f32> {
        let place = |i: i32| [0.01 * (i % 5) as f32, 0.01 * (i / 5) as f32, 0.0];
        let positions: Vec<[f32; 3]> = (0..25).map(place).collect();
        let velocities = vec![[2.0, 0.0, 0.0]; positions.len()];
        let (opacities, scales) = (vec![0.9; positions.len()], vec![0.006; positions.len()]);
        let drawing = devices
            .iter()
            .fold(Drawing::of_factor(1.0), |drawing, (k, number)| drawing.nudged(Unknown::Device(*k), *number));
        let gaussians =
            IsotropicGaussians { positions: &positions, opacities: &opacities, scales: &scales, factor: 1.0 };
        let shown = Shown { gaussians, velocities: &velocities, drawing: &drawing };
        shown.seen(device, &camera(), coverage)
    }

    /// Middle of the picture's light along x [pixels].
    fn middle(picture: &[f32]) -> f64 {
        let (sum, moment) = picture
            .iter()
            .enumerate()
            .fold((0.0, 0.0), |(sum, moment), (i, a)| (sum + f64::from(*a), moment + f64::from(*a) * (i % 80) as f64));
        moment / sum
    }

    #[test]
    fn a_late_device_and_one_that_is_shifted_see_the_body_elsewhere() {
        let (at_rest, first) = (seen(&[], 0), DEVICE_UNKNOWNS);
        // 2 m/s for 10 ms at 200 pixels a metre, and the same by a camera that is 20 mm to the left.
        for device in [seen(&[(7, 0.01)], 0), seen(&[(3, -0.02)], 0), seen(&[(first + 3, -0.02)], 1)] {
            assert!((middle(&device) - middle(&at_rest) - 4.0).abs() < 0.05, "{}", middle(&device));
        }
        assert_eq!(seen(&[(first + 3, -0.02)], 0), at_rest, "that of another device");
    }
}
