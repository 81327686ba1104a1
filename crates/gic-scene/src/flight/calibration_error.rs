//! What may be wrong with a camera's calibration, and how likely that is.

use glam::{DMat3, DQuat, DVec2, DVec3};

use crate::Camera;

/// Standard deviation of a camera's turn about each of its axes before the pictures are asked [rad]. Budget: .3
/// degrees, what a knock at a tripod leaves.
const TURN_DEVIATION_RAD: f64 = 0.005;
/// The same of its place along each of its axes, as a share of its distance from the body. Budget: 4 mm at 2 m.
const SHIFT_DEVIATION: f64 = 0.002;
/// The same of the focal length, as a share of it. Budget: what the focus moves it by.
const FOCAL_DEVIATION: f64 = 0.02;
/// The same of the coefficient of radial distortion. Budget: half of what lenses of phones have.
const RADIAL_DEVIATION: f64 = 0.02;
/// Numbers that describe an error.
pub(super) const NUMBERS: usize = 8;
/// The iterations that undo a distortion. Derived: each gains a factor of the distortion, a few hundredths.
const STRAIGHTENING_STEPS: usize = 6;

/// By what a camera differs from what the scene says of it: a turn, a shift, a share of the focal length and radial
/// distortion. Zero of a camera that is as the scene says.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CalibrationError {
    /// Rotation vector in the axes of the camera [rad].
    pub turn_rad: DVec3,
    /// Shift of its centre along the camera's axes [m].
    pub shift_m: DVec3,
    /// Share by which the focal lengths are longer, as a logarithm.
    pub focal: f64,
    /// Coefficient k of what remains of radial distortion: a ray at `u` = (X/Z, Y/Z) is seen at `u (1 + k u^2)`.
    pub radial: f64,
}

impl CalibrationError {
    /// One standard deviation of a camera at this distance from the body [m].
    pub fn deviation(distance_m: f64) -> CalibrationError {
        CalibrationError {
            turn_rad: DVec3::splat(TURN_DEVIATION_RAD),
            shift_m: DVec3::splat(SHIFT_DEVIATION * distance_m),
            focal: FOCAL_DEVIATION,
            radial: RADIAL_DEVIATION,
        }
    }

    /// Turn, shift, focal and radial in this order.
    pub(super) fn numbers(&self) -> [f64; NUMBERS] {
        let (turn, shift) = (self.turn_rad, self.shift_m);
        [turn.x, turn.y, turn.z, shift.x, shift.y, shift.z, self.focal, self.radial]
    }

    /// The error of these numbers.
    pub(super) fn of_numbers(numbers: &[f64]) -> CalibrationError {
        CalibrationError {
            turn_rad: DVec3::from_slice(numbers),
            shift_m: DVec3::from_slice(&numbers[3..]),
            focal: numbers[6],
            radial: numbers[7],
        }
    }

    /// The pinhole that a camera really is, its distortion apart.
    pub fn mended(&self, camera: &Camera) -> Camera {
        Camera {
            focal: camera.focal * self.focal.exp(),
            world_from_camera: camera.world_from_camera * DMat3::from_quat(DQuat::from_scaled_axis(self.turn_rad)),
            centre: camera.centre + camera.world_from_camera * self.shift_m,
            ..camera.clone()
        }
    }

    /// Where the mended camera sees a ray at `u` = (X/Z, Y/Z), in the same coordinates.
    pub(crate) fn bent(&self, u: DVec2) -> DVec2 {
        u * (1.0 + self.radial * u.length_squared())
    }

    /// The ray that the mended camera sees at `seen`: undoes [`CalibrationError::bent`].
    pub(super) fn straightened(&self, seen: DVec2) -> DVec2 {
        (0..STRAIGHTENING_STEPS).fold(seen, |u, _| seen / (1.0 + self.radial * u.length_squared()))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn straightening_undoes_bending(
            u in prop::array::uniform2(-0.5f64..0.5), radial in -0.1f64..0.1,
            numbers in prop::array::uniform8(-0.1f64..0.1),
        ) {
            let error = CalibrationError { radial, ..CalibrationError::default() };
            let u = DVec2::from_array(u);
            // Less than a ten thousandth of a pixel.
            prop_assert!(error.straightened(error.bent(u)).distance(u) < 1e-7);
            prop_assert_eq!(CalibrationError::of_numbers(&numbers).numbers(), numbers);
        }
    }
}
