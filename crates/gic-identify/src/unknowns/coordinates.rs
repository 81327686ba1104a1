//! How far each unknown goes at once, and how far at all.

use std::f64::consts::LN_2;

use crate::tuning::DescentTuning;
use crate::unknowns::parameter::Parameter;
use crate::unknowns::state::{State, Unknown};

/// The coordinates of a search.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Coordinates<'a> {
    /// Of the material; empty where it is not sought.
    pub parameters: &'a [Parameter],
    pub tuning: &'a DescentTuning,
}

impl Coordinates<'_> {
    /// Limits of the coordinate. A cell holds three particles at least, or a solid falls apart, and 64 at most.
    pub(crate) fn limits(&self, unknown: Unknown) -> (f64, f64) {
        match unknown {
            Unknown::Material(i) => self.parameters[i].limits(),
            Unknown::Cell => (-0.5 * LN_2, LN_2),
            _ => (f64::NEG_INFINITY, f64::INFINITY),
        }
    }

    /// Largest step of one iteration: of the material a unit, beyond which the quadratic model says little. The others
    /// act almost linearly, and the damping bounds them.
    pub(crate) fn largest_step(&self, unknown: Unknown) -> f64 {
        match unknown {
            Unknown::Material(_) => self.unit(unknown),
            _ => f64::INFINITY,
        }
    }

    /// What changes the motion visibly.
    fn unit(&self, unknown: Unknown) -> f64 {
        match unknown {
            Unknown::Material(i) => self.parameters[i].unit(),
            // [m/s]: a cell of 0.02 m in a tenth of a second, the time of a free flight.
            Unknown::Velocity(_) => 0.2,
            // [rad/s]
            Unknown::Angular(_) => 1.0,
            // [m]: a cell.
            Unknown::Offset(_) => 0.02,
            // A factor of e.
            Unknown::Splat | Unknown::Cell => 1.0,
            // Standard deviations of a fifth of a particle spacing: a cell.
            Unknown::Shape(_) => 10.0,
            // [m]: a cell; [rad]: a cell under a body of ten; factors of e.
            Unknown::World(k) => [0.02, 0.1, 0.1, 1.0, 1.0, 0.1, 0.1][k],
            // Some ten pixels: [rad], [m], a share of the focal length, [s].
            Unknown::Device(_, k) => [0.02, 0.02, 0.02, 0.02, 0.02, 0.02, 0.1, 0.01][k],
        }
    }

    /// Step of the finite differences.
    pub(crate) fn difference(&self, unknown: Unknown) -> f64 {
        self.tuning.difference * self.unit(unknown)
    }

    /// Whether the coordinate of a material parameter is at one of its limits, to a step of the finite differences.
    pub(crate) fn is_at_limit(&self, parameter: usize, coordinate: f64) -> bool {
        let (low, high) = self.parameters[parameter].limits();
        (coordinate - low).min(high - coordinate) < self.difference(Unknown::Material(parameter))
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

#[cfg(test)]
mod tests {
    use gic_mpm::MaterialKind;

    use super::*;
    use crate::unknowns::parameter::sought;

    #[test]
    fn only_what_lies_at_a_limit_is_said_to() {
        let tuning = DescentTuning::default();
        for kind in MaterialKind::ALL {
            let coordinates = Coordinates { parameters: sought(kind), tuning: &tuning };
            for (i, p) in coordinates.parameters.iter().enumerate() {
                let (low, high) = p.limits();
                let is_at_limit = |coordinate: f64| coordinates.is_at_limit(i, coordinate);
                assert!(is_at_limit(low) && is_at_limit(high), "{}", p.name);
                assert!(!is_at_limit(f64::midpoint(low, high)), "{}", p.name);
                assert!(!is_at_limit(high - 2.0 * coordinates.difference(Unknown::Material(i))), "{}", p.name);
            }
        }
    }
}
