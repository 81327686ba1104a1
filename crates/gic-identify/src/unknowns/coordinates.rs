//! How far each unknown may go, and how far it goes at once.

use crate::tuning::{CoordinateTuning, Steps};
use crate::unknowns::parameter::Parameter;
use crate::unknowns::state::{State, Unknown};

/// The coordinates of a search.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Coordinates<'a> {
    /// Of the material; empty where it is not sought.
    pub parameters: &'a [Parameter],
    pub tuning: &'a CoordinateTuning,
}

impl Coordinates<'_> {
    /// Limits of the coordinate.
    pub(crate) fn limits(&self, unknown: Unknown) -> (f64, f64) {
        let most = match unknown {
            Unknown::Material(i) => return self.parameters[i].limits(),
            Unknown::Velocity(_) => self.tuning.most_velocity_m_s,
            Unknown::Angular(_) => self.tuning.most_angular_velocity_rad_s,
            Unknown::Offset(_) => self.tuning.most_offset_m,
            Unknown::Splat => self.tuning.most_log_splat_factor,
            Unknown::Shape(_) => self.tuning.most_shape,
        };
        (-most, most)
    }

    /// Step of the finite differences, and the largest of one iteration.
    pub(crate) fn steps(&self, unknown: Unknown) -> Steps {
        match unknown {
            Unknown::Material(i) => self.parameters[i].steps(self.tuning),
            Unknown::Velocity(_) => self.tuning.velocity_m_s,
            Unknown::Angular(_) => self.tuning.angular_velocity_rad_s,
            Unknown::Offset(_) => self.tuning.offset_m,
            Unknown::Splat => self.tuning.log_splat_factor,
            Unknown::Shape(_) => self.tuning.shape,
        }
    }

    /// `state` displaced by `delta` along `unknowns`, kept inside the limits.
    pub(crate) fn moved(&self, state: &State, unknowns: &[Unknown], delta: &[f64]) -> State {
        let mut next = state.clone();
        for (&unknown, d) in unknowns.iter().zip(delta) {
            let (low, high) = self.limits(unknown);
            next.set(unknown, (state.get(unknown) + d).clamp(low, high));
        }
        next
    }
}
