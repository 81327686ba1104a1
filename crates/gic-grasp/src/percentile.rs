//! Percentiles of stresses.

/// The value that a share of the values does not exceed; 0 of none.
pub(crate) fn percentile(values: &[f32], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f32::total_cmp);
    sorted.get((share * sorted.len().saturating_sub(1) as f64) as usize).copied().map_or(0.0, f64::from)
}
