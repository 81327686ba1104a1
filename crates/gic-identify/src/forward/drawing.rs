//! What changes pictures and no motion: the size of the particles' Gaussians, and the devices that take the pictures.
//!
//! A device that lags, or that is not where the input says, sees the body as a moved camera at a later time: what it is
//! off by is turned, shifted and focused as [`CalibrationError`] says, and each particle `x` is seen at `x + v d`, with
//! its velocity v and the delay d.

use std::borrow::Cow;

use gic_scene::{CalibrationError, Camera, CameraOffset};

use crate::forward::footprint::IsotropicGaussians;
use crate::unknowns::state::{State, Unknown, entry};

/// How motions are drawn.
#[derive(Clone, Debug)]
pub(crate) struct Drawing {
    /// Factor on the Gaussians' standard deviations.
    pub splat_factor: f32,
    /// The numbers of each device's offset; those that are missing are zero.
    devices: Vec<[f64; CameraOffset::NUMBERS]>,
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
            Unknown::Device(device, k) => entry(&mut nudged.devices, device)[k] += step,
            _ => (),
        }
        nudged
    }

    /// What a device is off by.
    pub(crate) fn offset(&self, device: usize) -> CameraOffset {
        self.devices.get(device).map_or_else(CameraOffset::default, |numbers| CameraOffset::of_numbers(*numbers))
    }
}

/// A motion at one moment, and how it is drawn.
#[derive(Clone, Copy)]
pub(crate) struct Shown<'a> {
    /// The particles' Gaussians; the factor on their widths is the drawing's.
    pub gaussians: IsotropicGaussians<'a>,
    /// Of the particles [m/s], shape [n]; empty where all clocks are exact.
    pub velocities: &'a [[f32; 3]],
    pub drawing: &'a Drawing,
}

impl Shown<'_> {
    /// What `drawn` makes of the Gaussians and the camera with which a device sees them that is said to have `camera`.
    pub(crate) fn seen<T>(
        &self,
        device: usize,
        camera: &Camera,
        drawn: impl FnOnce(IsotropicGaussians, &Camera) -> T,
    ) -> T {
        let CameraOffset { error, late_s } = self.drawing.offset(device);
        let positions = match late_s {
            0.0 => Cow::Borrowed(self.gaussians.positions),
            late_s => Cow::Owned(self.positions_after(late_s as f32)),
        };
        let is_exact = error == CalibrationError::default();
        let camera = if is_exact { Cow::Borrowed(camera) } else { Cow::Owned(error.mended(camera)) };
        let factor = self.drawing.splat_factor;
        drawn(IsotropicGaussians { positions: &positions, factor, ..self.gaussians }, &camera)
    }

    fn positions_after(&self, time_s: f32) -> Vec<[f32; 3]> {
        let later = |(x, v): (&[f32; 3], &[f32; 3])| std::array::from_fn(|axis| x[axis] + time_s * v[axis]);
        self.gaussians.positions.iter().zip(self.velocities).map(later).collect()
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::forward::silhouette::coverage;
    use crate::observe::test_camera::test_camera;

    /// What a device sees of a square of particles that move along x, drawn with the device's numbers.
    fn seen(numbers: &[(Unknown, f64)], device: usize) -> Vec<f32> {
        let place = |i: i32| [0.01 * (i % 5) as f32, 0.01 * (i / 5) as f32, 0.0];
        let positions: Vec<[f32; 3]> = (0..25).map(place).collect();
        let velocities = vec![[2.0, 0.0, 0.0]; positions.len()];
        let (opacities, scales) = (vec![0.9; positions.len()], vec![0.006; positions.len()]);
        let exact = Drawing::of_factor(1.0);
        let drawing = numbers.iter().fold(exact, |drawing, (unknown, number)| drawing.nudged(*unknown, *number));
        let camera = test_camera(80, 200.0, DMat3::IDENTITY, DVec3::new(0.02, 0.02, -1.0));
        let gaussians =
            IsotropicGaussians { positions: &positions, opacities: &opacities, scales: &scales, factor: 1.0 };
        let shown = Shown { gaussians, velocities: &velocities, drawing: &drawing };
        shown.seen(device, &camera, coverage)
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
        let (at_rest, late, shifted) = (seen(&[], 0), Unknown::Device(0, 7), |device| Unknown::Device(device, 3));
        // 2 m/s for 10 ms at 200 pixels a metre, and the same by a camera that is 20 mm to the left.
        for seen in [seen(&[(late, 0.01)], 0), seen(&[(shifted(0), -0.02)], 0), seen(&[(shifted(1), -0.02)], 1)] {
            assert!((middle(&seen) - middle(&at_rest) - 4.0).abs() < 0.05, "{}", middle(&seen));
        }
        assert_eq!(seen(&[(shifted(1), -0.02)], 0), at_rest, "that of another device");
    }
}
