//! What is known of unknowns besides the observations.

use nalgebra::{DMatrix, DVector};

use crate::unknowns::state::{State, Unknown};

/// What is known of some unknowns besides the observations: a Gaussian.
#[derive(Clone, Debug)]
pub(crate) struct Prior {
    pub unknowns: Vec<Unknown>,
    pub mean: DVector<f64>,
    /// Inverse of the covariance.
    pub information: DMatrix<f64>,
}

impl Prior {
    pub(crate) fn deviation(&self, state: &State) -> DVector<f64> {
        DVector::from_iterator(self.unknowns.len(), self.unknowns.iter().map(|u| state.get(*u))) - &self.mean
    }

    /// Its information matrix in the order of `unknowns`, zero elsewhere.
    pub(crate) fn information_of(&self, unknowns: &[Unknown]) -> DMatrix<f64> {
        let place = |u: &Unknown| self.unknowns.iter().position(|own| own == u);
        DMatrix::from_fn(unknowns.len(), unknowns.len(), |i, j| match (place(&unknowns[i]), place(&unknowns[j])) {
            (Some(a), Some(b)) => self.information[(a, b)],
            _ => 0.0,
        })
    }
}
