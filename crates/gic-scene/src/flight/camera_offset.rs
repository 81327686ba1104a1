//! By what a camera is off in space and time.

use super::calibration_error::CalibrationError;

/// By what a camera differs from what is said of it: in its calibration, and in when its pictures were taken.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CameraOffset {
    /// The error of its calibration.
    pub error: CalibrationError,
    /// How much later its pictures were taken [s].
    pub late_s: f64,
}

impl CameraOffset {
    /// Numbers that describe one whose distortion is known.
    pub const NUMBERS: usize = 8;

    /// Turn, shift, focal length and delay in this order.
    pub fn numbers(&self) -> [f64; Self::NUMBERS] {
        let [turn_x, turn_y, turn_z, shift_x, shift_y, shift_z, focal, _] = self.error.numbers();
        [turn_x, turn_y, turn_z, shift_x, shift_y, shift_z, focal, self.late_s]
    }

    /// The offset of these numbers.
    pub fn of_numbers(numbers: [f64; Self::NUMBERS]) -> CameraOffset {
        let [.., late_s] = numbers;
        CameraOffset { error: CalibrationError { radial: 0.0, ..CalibrationError::of_numbers(&numbers) }, late_s }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_describe_an_offset() {
        let numbers = std::array::from_fn(|k| k as f64);
        let offset = CameraOffset::of_numbers(numbers);
        assert_eq!((offset.numbers(), offset.late_s, offset.error.radial), (numbers, 7.0, 0.0));
    }
}
