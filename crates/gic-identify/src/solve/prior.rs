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
    /// Of unknowns that have nothing to do with each other, with their means and standard deviations: those of which
    /// the deviation is zero are known, and no unknowns.
    pub(crate) fn independent(known: impl Iterator<Item = (Unknown, f64, f64)>) -> Prior {
        let unsure = known.filter(|(_, _, deviation)| *deviation > 0.0);
        let (unknowns, (mean, information)): (Vec<Unknown>, (Vec<f64>, Vec<f64>)) =
            unsure.map(|(unknown, mean, deviation)| (unknown, (mean, deviation.powi(-2)))).unzip();
        let information = DMatrix::from_diagonal(&DVector::from_vec(information));
        Prior { unknowns, mean: DVector::from_vec(mean), information }
    }

    pub(crate) fn deviation(&self, state: &State) -> DVector<f64> {
        DVector::from_iterator(self.unknowns.len(), self.unknowns.iter().map(|u| state.get(*u))) - &self.mean
    }

    /// Standard deviation of one of its unknowns; `None` of others.
    pub(crate) fn deviation_of(&self, unknown: Unknown) -> Option<f64> {
        let k = self.unknowns.iter().position(|own| *own == unknown)?;
        self.information.clone().try_inverse().map(|covariance| covariance[(k, k)].sqrt())
    }

    /// What this and another, independent one say of different unknowns.
    pub(crate) fn and(mut self, other: Prior) -> Prior {
        let (own, all) = (self.unknowns.len(), self.unknowns.len() + other.unknowns.len());
        let mut information = DMatrix::zeros(all, all);
        information.view_mut((0, 0), (own, own)).copy_from(&self.information);
        information.view_mut((own, own), (all - own, all - own)).copy_from(&other.information);
        self.unknowns.extend(other.unknowns);
        let mean = DVector::from_iterator(all, self.mean.iter().chain(other.mean.iter()).copied());
        Prior { unknowns: self.unknowns, mean, information }
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
