//! The damped step of Gauss-Newton's method.

use nalgebra::{DMatrix, DVector};

/// Share of the curvature that damps a fit's first step. Marquardt's is of this order.
pub const FIRST_DAMPING: f64 = 1e-3;

/// Factor by which the damping falls after a step that it allowed, and rises where none is: Marquardt's.
pub const DAMPING_FACTOR: f64 = 10.0;

/// The step -(H + D)^-1 g of Levenberg (1944) and Marquardt (1963) that lessens a sum of squares with gradient g, shape
/// [n], and approximate Hessian H = J^T J, shape [n, n]. D is diagonal: `damping` gives each of its elements from that
/// of H. `None` where H + D is not positive definite.
pub fn damped_step(
    hessian: &DMatrix<f64>,
    gradient: &DVector<f64>,
    damping: impl Fn(f64) -> f64,
) -> Option<DVector<f64>> {
    let mut damped = hessian.clone();
    for i in 0..damped.nrows() {
        damped[(i, i)] += damping(damped[(i, i)]);
    }
    Some(-damped.cholesky()?.solve(gradient))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn the_step_solves_its_equation_and_shortens_with_damping(
            rows in prop::collection::vec(-1.0f64..1.0, 24), gradient in prop::collection::vec(-1.0f64..1.0, 4),
        ) {
            let jacobian = DMatrix::from_row_slice(6, 4, &rows);
            let (hessian, gradient) = (jacobian.tr_mul(&jacobian), DVector::from_vec(gradient));
            let [weak, strong] = [0.1, 1.0].map(|damping| damped_step(&hessian, &gradient, |_| damping).unwrap());
            let left = (&hessian + DMatrix::identity(4, 4) * 0.1) * &weak + &gradient;
            prop_assert!(left.amax() < 1e-9, "{left}");
            prop_assert!(strong.norm() <= weak.norm());
        }
    }

    #[test]
    fn no_step_is_made_up_where_the_matrix_has_no_inverse() {
        let singular = DMatrix::from_row_slice(2, 2, &[1.0, 1.0, 1.0, 1.0]);
        let gradient = DVector::from_vec(vec![1.0, -1.0]);
        assert_eq!(damped_step(&(-singular.clone()), &gradient, |_| 0.0), None);
        assert!(damped_step(&singular, &gradient, |own| 0.5 * own).is_some());
    }
}
