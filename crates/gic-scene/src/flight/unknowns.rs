//! The unknowns of a flight in a row, with the steps of their finite differences and their prior.

use glam::DVec3;
use nalgebra::{DMatrix, DVector};

use super::FreeFlight;
use super::calibration_error::{CalibrationError, NUMBERS};
use super::moment::Moment;

/// Velocity and angular velocity, which come first.
pub(super) const VELOCITIES: usize = 6;
/// Steps of finite differences of velocity [m/s] and angular velocity [rad/s]. Derived: they move outlines by less than
/// a tenth of a pixel.
const VELOCITY_DIFFERENCES: [f64; VELOCITIES] = [1e-3, 1e-3, 1e-3, 1e-2, 1e-2, 1e-2];
/// The same of the acceleration [m/s^2].
const ACCELERATION_DIFFERENCES: [f64; 3] = [1e-2; 3];
/// The same of a camera's delay [frames].
const DELAY_DIFFERENCE_FRAMES: f64 = 1e-3;
/// The same of a camera's error [standard deviations].
const ERROR_DIFFERENCE: f64 = 0.02;

/// What a fit seeks besides velocity and angular velocity.
#[derive(Clone, Copy)]
pub(super) struct Sought {
    pub(super) acceleration: bool,
    pub(super) delays: bool,
    pub(super) errors: bool,
}

/// The unknowns of a fit: velocity, angular velocity, and where they are sought the acceleration, the delays of all
/// cameras but the first, and all cameras' errors in standard deviations.
pub(super) struct Unknowns {
    sought: Sought,
    delay_difference: f64,
    /// Delays that are sought.
    delays: usize,
    /// Standard deviations of the errors that are sought, camera by camera.
    deviations: Vec<f64>,
}

impl Unknowns {
    pub(super) fn new(sought: Sought, flight: &FreeFlight, moments: &[Moment]) -> Unknowns {
        let cameras = flight.delays.len();
        let deviation = |camera: usize| {
            let seen = moments.iter().find(|moment| moment.camera == camera);
            let distance = seen.map_or(1.0, |moment| moment.outline.camera.centre.distance(flight.about));
            CalibrationError::deviation(distance).numbers()
        };
        Unknowns {
            sought,
            delay_difference: DELAY_DIFFERENCE_FRAMES * flight.frame_seconds(),
            delays: if sought.delays { cameras - 1 } else { 0 },
            deviations: if sought.errors { (0..cameras).flat_map(deviation).collect() } else { Vec::new() },
        }
    }

    /// Their values in a flight.
    pub(super) fn of(&self, flight: &FreeFlight) -> DVector<f64> {
        let mut values = [flight.velocity, flight.angular_velocity].map(|v| v.to_array()).concat();
        if self.sought.acceleration {
            values.extend(flight.acceleration.to_array());
        }
        values.extend(flight.delays.iter().skip(1).take(self.delays));
        let numbers = flight.errors.iter().flat_map(CalibrationError::numbers).chain(std::iter::repeat(0.0));
        values.extend(numbers.zip(&self.deviations).map(|(number, deviation)| number / deviation));
        DVector::from_vec(values)
    }

    /// A flight with other values.
    pub(super) fn put(&self, flight: &FreeFlight, values: &DVector<f64>) -> FreeFlight {
        let vector = |k: usize| DVec3::new(values[k], values[k + 1], values[k + 2]);
        let mut flight = FreeFlight { velocity: vector(0), angular_velocity: vector(3), ..flight.clone() };
        if self.sought.acceleration {
            flight.acceleration = vector(VELOCITIES);
        }
        let (known, errors) = values.as_slice().split_at(values.len() - self.deviations.len());
        if self.delays > 0 {
            flight.delays[1..].copy_from_slice(&known[known.len() - self.delays..]);
        }
        if self.sought.errors {
            let numbers: Vec<f64> = errors.iter().zip(&self.deviations).map(|(value, one)| value * one).collect();
            flight.errors = numbers.chunks(NUMBERS).map(CalibrationError::of_numbers).collect();
        }
        flight
    }

    /// Steps of the finite differences.
    pub(super) fn differences(&self) -> Vec<f64> {
        let mut differences = VELOCITY_DIFFERENCES.to_vec();
        if self.sought.acceleration {
            differences.extend(ACCELERATION_DIFFERENCES);
        }
        differences.extend(std::iter::repeat_n(self.delay_difference, self.delays));
        differences.extend(self.deviations.iter().map(|_| ERROR_DIFFERENCE));
        differences
    }

    /// Residuals with those of the prior behind them: `weight` for each standard deviation of an error.
    pub(super) fn with_prior(&self, residuals: DVector<f64>, values: &DVector<f64>, weight: f64) -> DVector<f64> {
        let errors = values.rows(values.len() - self.deviations.len(), self.deviations.len());
        let mut all = residuals.data.as_vec().clone();
        all.extend(errors.iter().map(|value| weight * value));
        DVector::from_vec(all)
    }

    /// How many numbers the outlines tell: all unknowns but what the prior tells, whose `weight` is the given one, of
    /// the inverse of the curvature.
    pub(super) fn told(&self, inverse: &DMatrix<f64>, weight: f64) -> f64 {
        let first = inverse.nrows() - self.deviations.len();
        let prior: f64 = (first..inverse.nrows()).map(|k| weight * weight * inverse[(k, k)]).sum();
        inverse.nrows() as f64 - prior
    }

    /// Standard deviations of the cameras' errors, given the covariance of all values.
    pub(super) fn error_deviations(&self, covariance: &DMatrix<f64>) -> Vec<CalibrationError> {
        let first = covariance.nrows() - self.deviations.len();
        let deviation = |(k, prior): (usize, &f64)| covariance[(first + k, first + k)].sqrt() * prior;
        let numbers: Vec<f64> = self.deviations.iter().enumerate().map(deviation).collect();
        numbers.chunks(NUMBERS).map(CalibrationError::of_numbers).collect()
    }
}
