//! Gauss-Newton's normal equations, kept apart by block (one picture, or one frame's surface).
//!
//! The residuals of one picture are correlated: a shape that is a millimetre too fat is wrong along its whole outline. The blocks'
//! gradients at the optimum measure that correlation, which is what the sandwich estimate of the covariance needs.

use nalgebra::{DMatrix, DVector};

/// Where residuals come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Modality {
    /// Rendered alpha against a mask.
    Mask,
    /// Simulated against extracted surface.
    Surface,
}

/// Sums over the residuals r of one block with Jacobian J: half the squared norm, J^T r, J^T J.
#[derive(Clone, Debug)]
pub(crate) struct ResidualBlock {
    pub modality: Modality,
    /// Index of the observation.
    pub observation: usize,
    /// Index of the camera; `None` for surfaces.
    pub camera: Option<usize>,
    /// 1/2 sum r^2.
    pub cost: f64,
    /// J^T r.
    pub gradient: DVector<f64>,
    /// J^T J.
    pub hessian: DMatrix<f64>,
}

impl ResidualBlock {
    pub(crate) fn new(modality: Modality, observation: usize, camera: Option<usize>, unknowns: usize) -> ResidualBlock {
        ResidualBlock {
            modality,
            observation,
            camera,
            cost: 0.0,
            gradient: DVector::zeros(unknowns),
            hessian: DMatrix::zeros(unknowns, unknowns),
        }
    }

    /// Adds one residual with its row of the Jacobian and its weight.
    pub(crate) fn add(&mut self, residual: f64, row: &[f64], weight: f64) {
        self.cost += 0.5 * weight * residual * residual;
        for (i, a) in row.iter().enumerate() {
            if *a == 0.0 {
                continue;
            }
            self.gradient[i] += weight * residual * a;
            for (j, b) in row.iter().enumerate().take(i + 1) {
                self.hessian[(i, j)] += weight * a * b;
            }
        }
    }

    /// Mirrors the lower triangle that [`ResidualBlock::add`] fills.
    pub(crate) fn finish(mut self) -> ResidualBlock {
        self.hessian.fill_upper_triangle_with_lower_triangle();
        self
    }
}

/// Weight of each modality's residuals in the sum, by observation.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Weights {
    pub mask: Vec<f64>,
    pub surface: Vec<f64>,
    /// How many times larger the surfaces' errors are than their scatter shows.
    pub error_inflation: Vec<f64>,
}

impl Weights {
    /// The same in all of `observations`.
    pub(crate) fn uniform(mask: f64, surface: f64, observations: usize) -> Weights {
        Weights {
            mask: vec![mask; observations],
            surface: vec![surface; observations],
            error_inflation: vec![1.0; observations],
        }
    }

    /// That of one block, times how much larger its errors are than its residuals.
    pub(crate) fn of_errors(&self, block: &ResidualBlock) -> f64 {
        match block.modality {
            Modality::Mask => self.of(block),
            Modality::Surface => self.of(block) * self.error_inflation[block.observation],
        }
    }

    /// That of one block.
    pub(crate) fn of(&self, block: &ResidualBlock) -> f64 {
        match block.modality {
            Modality::Mask => self.mask[block.observation],
            Modality::Surface => self.surface[block.observation],
        }
    }
}

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

    /// How much the quadratic model can fall at all: g^T H^-1 g / 2.
    pub(crate) fn largest_predicted_decrease(&self) -> f64 {
        self.step(0.0).map_or(f64::INFINITY, |step| -0.5 * self.gradient.dot(&step))
    }

    /// The step whose `k`-th component is `length` and whose others lead to where the quadratic model is lowest then; `None` where the
    /// others' matrix is not positive definite.
    pub(crate) fn step_along(&self, k: usize, length: f64) -> Option<DVector<f64>> {
        let others = self.hessian.clone().remove_row(k).remove_column(k);
        let pull = self.gradient.clone() + self.hessian.column(k) * length;
        Some((-others.cholesky()?.solve(&pull.remove_row(k))).insert_row(k, length))
    }

    /// The damped step -(H + lambda diag H)^-1 g; `None` where the matrix is not positive definite.
    pub(crate) fn step(&self, lambda: f64) -> Option<DVector<f64>> {
        let mut damped = self.hessian.clone();
        let largest = (0..damped.nrows()).map(|i| damped[(i, i)]).fold(0.0, f64::max);
        for i in 0..damped.nrows() {
            // An unknown without any effect keeps its value.
            damped[(i, i)] += lambda * damped[(i, i)] + 1e-12 * largest + f64::MIN_POSITIVE;
        }
        Some(-damped.cholesky()?.solve(&self.gradient))
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
            let step = normal.step_along(k, length).expect("positive definite");
            prop_assert_eq!(step[k], length);
            let mut other = step.clone() + DVector::from_vec(nudge.clone());
            other[k] = length;
            let moved = (&other - &step).norm_squared();
            // The curvature is at least a tenth in every direction.
            prop_assert!(normal.predicted_decrease(step.as_slice()) >= normal.predicted_decrease(other.as_slice()) + 0.049 * moved - 1e-9);
        }
    }
}
