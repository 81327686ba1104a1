//! Variances, and how well they are known.
//!
//! A variance that a few groups measure is itself uncertain: an interval is as wide as Student's distribution has it
//! for the freedom of the variance.

use nalgebra::DMatrix;
use statrs::distribution::{ContinuousCDF, StudentsT};

/// A variance, and by how many independent pieces of information it is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Variance {
    pub value: f64,
    pub freedom: f64,
}

impl Variance {
    /// Half-width of the 95 % interval. A freedom is one at least.
    pub(crate) fn half_width(self) -> f64 {
        quantile(self.freedom) * self.value.max(0.0).sqrt()
    }
}

/// How many standard deviations a 95 % interval reaches to each side. By bisection: the library's own inverse does not
/// end for some freedoms.
fn quantile(freedom: f64) -> f64 {
    let Ok(student) = StudentsT::new(0.0, 1.0, freedom.max(1.0)) else { return f64::INFINITY };
    // Those of a Gaussian, and of a freedom of one.
    let (mut low, mut high) = (1.95, 12.75);
    for _ in 0..f64::MANTISSA_DIGITS {
        let middle = f64::midpoint(low, high);
        *(if student.cdf(middle) < 0.975 { &mut low } else { &mut high }) = middle;
    }
    low
}

/// A covariance, and the freedom of each unknown's variance.
#[derive(Clone, Debug)]
pub(crate) struct Covariance {
    pub matrix: DMatrix<f64>,
    pub freedom: Vec<f64>,
}

impl Covariance {
    /// The sum of independent parts, each of which has one freedom.
    pub(crate) fn sum(parts: &[(DMatrix<f64>, f64)]) -> Option<Covariance> {
        let matrix = parts.iter().map(|(part, _)| part.clone()).reduce(|sum, part| sum + part)?;
        let freedom = |k: usize| {
            let square_over_freedom = |(part, freedom): &(DMatrix<f64>, f64)| part[(k, k)].powi(2) / freedom;
            matrix[(k, k)].powi(2) / parts.iter().map(square_over_freedom).sum::<f64>()
        };
        let freedom = (0..matrix.nrows()).map(freedom).collect();
        matrix.iter().all(|entry| entry.is_finite()).then_some(Covariance { matrix, freedom })
    }

    /// The variance of the `k`-th unknown.
    pub(crate) fn variance(&self, k: usize) -> Variance {
        Variance { value: self.matrix[(k, k)], freedom: self.freedom[k] }
    }

    /// That of some unknowns.
    pub(crate) fn of(&self, places: &[usize]) -> Covariance {
        let matrix = self.matrix.select_rows(places).select_columns(places);
        Covariance { matrix, freedom: places.iter().map(|k| self.freedom[*k]).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_are_students() {
        for (freedom, quantile) in [(1.0, 12.706_205), (2.0, 4.302_653), (10.0, 2.228_139), (1e9, 1.959_964)] {
            let half_width = Variance { value: 4.0, freedom }.half_width();
            assert!((half_width - 2.0 * quantile).abs() < 1e-5, "{half_width} of {freedom}");
        }
        assert_eq!(Variance { value: 0.0, freedom: f64::NAN }.half_width(), 0.0);
    }

    /// Two equal parts of freedom n have one of 2 n together; one that outweighs the others has its own.
    #[test]
    fn parts_have_a_freedom_together() {
        let part = |value: f64, freedom: f64| (DMatrix::from_element(1, 1, value), freedom);
        let freedom = |parts: &[(DMatrix<f64>, f64)]| Covariance::sum(parts).unwrap().variance(0).freedom;
        assert!((freedom(&[part(3.0, 5.0), part(3.0, 5.0)]) - 10.0).abs() < 1e-12);
        assert!((freedom(&[part(1.0, 1.0), part(1e-6, 9.0)]) - 1.0).abs() < 1e-5);
        assert!(Covariance::sum(&[part(f64::NAN, 2.0)]).is_none());
    }
}
