//! How far the quadratic model of a minimum holds: there a state belongs to it.

use crate::solve::levenberg_marquardt::{Fit, Iterate};
use crate::solve::normal_equations::Normal;
use crate::solve::problem::Problem;
use crate::unknowns::state::{State, Unknown};

/// A minimum and what its quadratic model says of the states around it.
pub(crate) struct Basin {
    pub state: State,
    pub cost: f64,
    pub normal: Normal,
    unknowns: Vec<Unknown>,
    /// The model holds where a state's cost rises by at least this share of what it predicts, and by at most the
    /// inverse of that.
    trusted_share: f64,
}

impl Basin {
    pub(crate) fn of(problem: &Problem, fit: &mut Fit) -> Basin {
        let mut normal = problem.normal(fit.linearisation.blocks(problem), &fit.state);
        // At a minimum nothing pulls; what is left of the gradient counts for less than a fit's last gain.
        normal.gradient.fill(0.0);
        Basin {
            state: fit.state.clone(),
            cost: fit.cost,
            normal,
            unknowns: problem.unknowns.clone(),
            trusted_share: problem.descent.trusted_gain_share,
        }
    }

    /// How much more a state costs than the minimum, as a share of what the model predicts.
    fn risen(&self, at: &Iterate) -> f64 {
        let delta: Vec<f64> = self.unknowns.iter().map(|u| at.state.get(*u) - self.state.get(*u)).collect();
        (at.cost - self.cost) / -self.normal.predicted_decrease(&delta)
    }

    /// The model knows of one contact with the ground only.
    fn has_contact_of(&self, at: &Iterate) -> bool {
        at.state.sticks == self.state.sticks
    }

    /// Whether the model holds at a state, which then belongs to this minimum.
    pub(crate) fn holds(&self, at: &Iterate) -> bool {
        self.has_contact_of(at) && (self.trusted_share..=self.trusted_share.recip()).contains(&self.risen(at))
    }

    /// Whether a state costs so much less than the model predicts that another minimum may begin there.
    pub(crate) fn is_left(&self, at: &Iterate) -> bool {
        !self.has_contact_of(at) || self.risen(at) < self.trusted_share
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::*;

    /// A valley along the sum of two coordinates, with the minimum in (1, 2).
    fn valley() -> Basin {
        let normal = Normal {
            cost: 10.0,
            gradient: DVector::zeros(2),
            hessian: DMatrix::from_row_slice(2, 2, &[51.0, -49.0, -49.0, 51.0]),
        };
        let unknowns = vec![Unknown::Material(0), Unknown::Material(1)];
        Basin { state: State::new(vec![1.0, 2.0]), cost: 10.0, normal, unknowns, trusted_share: 0.5 }
    }

    fn at(material: [f64; 2], cost: f64) -> Iterate {
        Iterate { state: State::new(material.to_vec()), cost }
    }

    #[test]
    fn a_state_belongs_to_a_minimum_where_its_quadratic_model_holds() {
        let basin = valley();
        // Along the valley the model rises by 2, across it by 100.
        for (place, rise) in [([2.0, 3.0], 2.0), ([2.0, 1.0], 100.0)] {
            for (share, holds, is_left) in
                [(1.0, true, false), (0.6, true, false), (1.9, true, false), (0.4, false, true), (2.1, false, false)]
            {
                let state = at(place, 10.0 + share * rise);
                assert!((basin.risen(&state) - share).abs() < 1e-12, "{}", basin.risen(&state));
                assert_eq!((basin.holds(&state), basin.is_left(&state)), (holds, is_left), "{share} of {rise}");
            }
        }
    }

    #[test]
    fn a_minimum_knows_of_one_contact() {
        let mut held = at([2.0, 3.0], 12.0);
        assert!(valley().holds(&held));
        held.state.sticks = true;
        assert!(!valley().holds(&held) && valley().is_left(&held));
    }

    #[test]
    fn what_costs_less_than_a_minimum_is_none_of_its_states() {
        let better = at([4.0, 5.0], 9.0);
        assert!(!valley().holds(&better) && valley().is_left(&better));
    }
}
