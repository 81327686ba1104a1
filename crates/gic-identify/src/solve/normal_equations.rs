//! Gauss-Newton's normal equations: the weighted sum of all blocks, and steps on its quadratic model.
//!
//! `cost(d) = cost(0) + g^T d + d^T H d / 2` with `g = sum w J^T r` and `H = sum w J^T J`.

use gic_optimize::damped_step;
use nalgebra::{DMatrix, DVector};

use crate::solve::residual_block::{ResidualBlock, Weights};

/// Weighted sum of all blocks.
#[derive(Clone, Debug)]
pub(crate) struct Normal {
    pub cost: f64,
    pub gradient: DVector<f64>,
    pub hessian: DMatrix<f64>,
}

impl Normal {
    /// Sums in the order of the blocks, so that the result does not depend on threads.
    pub(crate) fn sum(blocks: &[ResidualBlock], weights: &Weights, unknowns: usize) -> Normal {
        let mut total =
            Normal { cost: 0.0, gradient: DVector::zeros(unknowns), hessian: DMatrix::zeros(unknowns, unknowns) };
        for block in blocks {
            let w = weights.of(block);
            total.cost += w * block.cost;
            total.gradient += &block.gradient * w;
            total.hessian += &block.hessian * w;
        }
        total
    }

    /// How much the quadratic model falls along `delta`: -(g^T d + d^T H d / 2).
    pub(crate) fn predicted_decrease(&self, delta: &[f64]) -> f64 {
        let d = DVector::from_column_slice(delta);
        -(self.gradient.dot(&d) + 0.5 * (&self.hessian * &d).dot(&d))
    }

    /// The step in which an unknown that would leave its `room`, from the least to the largest component, ends there,
    /// and the others go where that suits them best. Those in `held` have their lengths. `None` where the matrix is not
    /// positive definite.
    pub(crate) fn step_within(
        &self,
        lambda: f64,
        room: &[(f64, f64)],
        mut held: Vec<(usize, f64)>,
    ) -> Option<DVector<f64>> {
        loop {
            let step = self.step(lambda, &held)?;
            let is_held = |k: usize| held.iter().any(|(other, _)| *other == k);
            let stopped = |(k, (low, high)): (usize, &(f64, f64))| {
                (!is_held(k) && !(*low..=*high).contains(&step[k])).then(|| (k, step[k].clamp(*low, *high)))
            };
            let stopped: Vec<(usize, f64)> = room.iter().enumerate().filter_map(stopped).collect();
            if stopped.is_empty() {
                return Some(step);
            }
            held.extend(stopped);
        }
    }

    /// The step whose components `held` have the given lengths, and whose others f lead, damped, to where the quadratic
    /// model is lowest then: -(H_ff + lambda diag H_ff)^-1 (g_f + H_fh d_h). `None` where the matrix is not positive
    /// definite.
    fn step(&self, lambda: f64, held: &[(usize, f64)]) -> Option<DVector<f64>> {
        let mut step = DVector::zeros(self.gradient.len());
        held.iter().for_each(|(k, length)| step[*k] = *length);
        let free: Vec<usize> = (0..step.len()).filter(|k| held.iter().all(|(other, _)| other != k)).collect();
        let pull = (&self.gradient + &self.hessian * &step).select_rows(&free);
        let hessian = self.hessian.select_rows(&free).select_columns(&free);
        let largest = hessian.diagonal().iter().copied().fold(0.0, f64::max);
        // An unknown without any effect keeps its value.
        let of_free = damped_step(&hessian, &pull, |own| lambda * own + 1e-12 * largest + f64::MIN_POSITIVE)?;
        free.into_iter().zip(of_free.iter()).for_each(|(k, length)| step[k] = *length);
        Some(step)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn no_other_step_of_that_length_along_an_unknown_promises_more(
            rows in prop::collection::vec(-1.0f64..1.0, 16),
            gradient in prop::collection::vec(-1.0f64..1.0, 4),
            nudge in prop::collection::vec(-1.0f64..1.0, 4),
            k in 0usize..4,
            length in -1.0f64..1.0,
        ) {
            let rows = DMatrix::from_vec(4, 4, rows);
            let hessian = rows.transpose() * &rows + DMatrix::identity(4, 4) * 0.1;
            let normal = Normal { cost: 1.0, gradient: DVector::from_vec(gradient), hessian };
            let step = normal.step(0.0, &[(k, length)]).expect("positive definite");
            prop_assert_eq!(step[k], length);
            let mut other = step.clone() + DVector::from_vec(nudge.clone());
            other[k] = length;
            let moved = (&other - &step).norm_squared();
            // The curvature is at least a tenth in every direction.
            let decrease = |step: &DVector<f64>| normal.predicted_decrease(step.as_slice());
            prop_assert!(decrease(&step) >= decrease(&other) + 0.049 * moved - 1e-9);
        }

        #[test]
        fn a_step_that_ends_at_a_limit_promises_at_least_as_much_as_one_that_is_cut_off_there(
            rows in prop::collection::vec(-1.0f64..1.0, 16),
            gradient in prop::collection::vec(-1.0f64..1.0, 4),
            k in 0usize..4,
            (low, high) in (-0.2f64..0.0, 0.0f64..0.2),
        ) {
            let rows = DMatrix::from_vec(4, 4, rows);
            let hessian = rows.transpose() * &rows + DMatrix::identity(4, 4) * 0.1;
            let normal = Normal { cost: 1.0, gradient: DVector::from_vec(gradient), hessian };
            let mut room = vec![(f64::NEG_INFINITY, f64::INFINITY); 4];
            let mut cut = normal.step_within(0.0, &room, Vec::new()).expect("positive definite");
            room[k] = (low, high);
            let step = normal.step_within(0.0, &room, Vec::new()).expect("positive definite");
            let is_inside = (low..=high).contains(&cut[k]);
            prop_assert!((low..=high).contains(&step[k]));
            prop_assert!(!is_inside || step == cut);
            cut[k] = cut[k].clamp(low, high);
            let [ended, cut_off] = [step, cut].map(|step| normal.predicted_decrease(step.as_slice()));
            prop_assert!(ended >= -1e-9 && ended >= cut_off - 1e-9);
        }
    }
}
