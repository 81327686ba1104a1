//! Means and their scatter.

/// Mean of some numbers; NaN of none.
pub fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0), |(sum, n), v| (sum + v, n + 1));
    sum / f64::from(n)
}

/// Mean of some numbers and their variance, both NaN of none.
pub fn mean_and_variance(values: &[f64]) -> (f64, f64) {
    let average = mean(values.iter().copied());
    (average, mean(values.iter().map(|v| (v - average).powi(2))))
}
