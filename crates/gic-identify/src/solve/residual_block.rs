//! Gauss-Newton's normal equations, kept apart by block (one picture, or one frame's surface).
//!
//! The residuals of one picture are correlated: a shape that is a millimetre too fat is wrong along its whole outline.
//! The blocks' gradients at the optimum measure that correlation, which is what the covariance by the jackknife needs.

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

    /// The same after a step, as its linear model has it.
    pub(crate) fn moved(&self, step: &DVector<f64>) -> ResidualBlock {
        let change = &self.hessian * step;
        let cost = self.cost + (&self.gradient + 0.5 * &change).dot(step);
        ResidualBlock { cost, gradient: &self.gradient + change, ..self.clone() }
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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_moved_block_is_that_of_the_moved_residuals(
            rows in prop::collection::vec(prop::array::uniform3(-1.0f64..1.0), 1..9),
            residual in -1.0f64..1.0,
            step in prop::array::uniform3(-1.0f64..1.0),
        ) {
            let block_at = |step: &[f64; 3]| {
                let mut block = ResidualBlock::new(Modality::Mask, 0, None, 3);
                for row in &rows {
                    let moved = residual + row.iter().zip(step).map(|(a, d)| a * d).sum::<f64>();
                    block.add(moved, row, 2.0);
                }
                block.finish()
            };
            let moved = block_at(&[0.0; 3]).moved(&DVector::from_column_slice(&step));
            let expected = block_at(&step);
            prop_assert!((moved.cost - expected.cost).abs() < 1e-9);
            prop_assert!((&moved.gradient - &expected.gradient).amax() < 1e-9);
            prop_assert_eq!(moved.hessian, expected.hessian);
        }
    }
}
