//! Levenberg-Marquardt on a few unknowns, with derivatives by differences.

use nalgebra::{DMatrix, DVector};

use crate::damped_step::{DAMPING_FACTOR, FIRST_DAMPING, damped_step};

/// Steps of one round that may lose before the fit ends: by then a step is next to nothing.
const STEPS_TRIED: usize = 8;
/// A fit ends with a round that gains less than this share of the cost.
const CONVERGED_GAIN: f64 = 1e-4;
/// Rounds after which a fit ends in any case.
const MOST_ROUNDS: usize = 30;

/// Where a sum of squares is least, as far as the fit came.
#[derive(Clone, Debug)]
pub struct Minimum {
    /// The unknowns, shape [n].
    pub unknowns: DVector<f64>,
    /// The residuals there, shape [m].
    pub residuals: DVector<f64>,
}

impl Minimum {
    /// Root mean square of the residuals.
    pub fn rms(&self) -> f64 {
        (self.residuals.norm_squared() / self.residuals.len().max(1) as f64).sqrt()
    }

    /// J^T J of the residuals here, shape [n, n], by `differences` of the unknowns to both sides. A residual that has a
    /// kink bounds the unknowns on one side only: its flatter side counts.
    pub fn curvature(&self, residuals: impl Fn(&DVector<f64>) -> DVector<f64>, differences: &[f64]) -> DMatrix<f64> {
        let backward: Vec<f64> = differences.iter().map(|difference| -difference).collect();
        let (ahead, behind) = (jacobian(&residuals, self, differences), jacobian(&residuals, self, &backward));
        let flatter = |ahead: f64, behind: f64| {
            if ahead * behind <= 0.0 { 0.0 } else { ahead.signum() * ahead.abs().min(behind.abs()) }
        };
        let mut jacobian = ahead.zip_map(&behind, |ahead, behind| flatter(ahead, -behind));
        for (mut column, difference) in jacobian.column_iter_mut().zip(differences) {
            column /= *difference;
        }
        jacobian.tr_mul(&jacobian)
    }
}

/// Lessens the sum of squares of `residuals`, shape [m], from `start`, shape [n]. Derivatives are differences over
/// `differences`, shape [n]: steps of the unknowns that change little, which also set their units.
pub fn least_squares(
    residuals: impl Fn(&DVector<f64>) -> DVector<f64>,
    start: DVector<f64>,
    differences: &[f64],
) -> Minimum {
    let mut best = Minimum { residuals: residuals(&start), unknowns: start };
    let mut damping = FIRST_DAMPING;
    for _ in 0..MOST_ROUNDS {
        let jacobian = jacobian(&residuals, &best, differences);
        let (hessian, gradient) = (jacobian.tr_mul(&jacobian), jacobian.tr_mul(&best.residuals));
        let cost = best.residuals.norm_squared();
        // An unknown without effect stays where it is.
        let least = f64::MIN_POSITIVE + 1e-9 * hessian.trace();
        let mut gain = 0.0;
        for _ in 0..STEPS_TRIED {
            let Some(step) = damped_step(&hessian, &gradient, |own| damping * (own + least)) else { break };
            let unknowns = &best.unknowns + scaled(&step, differences);
            let tried = Minimum { residuals: residuals(&unknowns), unknowns };
            gain = cost - tried.residuals.norm_squared();
            if gain > 0.0 {
                (best, damping) = (tried, damping / DAMPING_FACTOR);
                break;
            }
            damping *= DAMPING_FACTOR;
        }
        // Also where the gain is no number.
        if gain.is_nan() || gain <= CONVERGED_GAIN * cost {
            break;
        }
    }
    best
}

/// Derivatives of the residuals by the unknowns, each in units of its difference, shape [m, n].
fn jacobian(residuals: &impl Fn(&DVector<f64>) -> DVector<f64>, at: &Minimum, differences: &[f64]) -> DMatrix<f64> {
    let mut jacobian = DMatrix::zeros(at.residuals.len(), differences.len());
    for (k, difference) in differences.iter().enumerate() {
        let mut moved = at.unknowns.clone();
        moved[k] += difference;
        jacobian.set_column(k, &(residuals(&moved) - &at.residuals));
    }
    jacobian
}

fn scaled(step: &DVector<f64>, differences: &[f64]) -> DVector<f64> {
    DVector::from_iterator(step.len(), step.iter().zip(differences).map(|(s, d)| s * d))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// A circle through points of one: not linear in its centre and radius.
        #[test]
        fn a_circle_is_found_through_its_points(x in -1.0f64..1.0, y in -1.0f64..1.0, radius in 0.5f64..2.0) {
            let points: Vec<[f64; 2]> = (0..9).map(|k| f64::from(k) * 0.7)
                .map(|a| [x + radius * a.cos(), y + radius * a.sin()])
                .collect();
            let residuals = |u: &DVector<f64>| {
                DVector::from_iterator(9, points.iter().map(|p| (p[0] - u[0]).hypot(p[1] - u[1]) - u[2]))
            };
            let found = least_squares(residuals, DVector::from_vec(vec![0.0, 0.0, 1.0]), &[1e-6; 3]);
            prop_assert!(found.rms() < 1e-6, "{}", found.rms());
            prop_assert!((found.unknowns - DVector::from_vec(vec![x, y, radius])).amax() < 1e-5);
        }
    }

    #[test]
    fn an_unknown_without_effect_stays() {
        let found =
            least_squares(|u| DVector::from_element(1, u[0] - 3.0), DVector::from_vec(vec![0.0, 7.0]), &[1e-3; 2]);
        assert!((found.unknowns[0] - 3.0).abs() < 1e-6 && found.unknowns[1] == 7.0, "{}", found.unknowns);
    }

    /// A residual that is steep on one side and flat on the other bounds the unknown as the flat side does; where it
    /// comes back on both sides it says nothing.
    #[test]
    fn the_flatter_side_of_a_kink_counts() {
        let kinked =
            |x: &DVector<f64>| DVector::from_vec(vec![if x[0] < 0.0 { 10.0 * x[0] } else { x[0] }, x[1].abs()]);
        let here = Minimum { unknowns: DVector::zeros(2), residuals: DVector::zeros(2) };
        let curvature = here.curvature(kinked, &[0.1, 0.1]);
        assert!((curvature[(0, 0)] - 1.0).abs() < 1e-12 && curvature[(1, 1)] == 0.0, "{curvature}");
    }
}
