//! How far a parameter may go until the residuals object: the profile of the likelihood.
//!
//! Gauss-Newton's curvature is that of the residuals' derivatives. Where a motion is rough on a small scale, for matter
//! yields here or there, these are large and say nothing of how the motion changes on the scale that matters, and along
//! a bent valley they do not see the bend: the interval is too narrow. The cost itself says how far the valley goes.

/// How far to one side of a fit the interval goes that reaches `half_width` by the curvature, and at most to `limit`.
/// `told` says what is told of a place at a distance: 1 where the interval would end, growing with the distance's
/// square in a quadratic valley, and `None` where there is nothing. Never less than the `half_width`.
pub(crate) fn reach(half_width: f64, limit: f64, told: &dyn Fn(f64) -> Option<f64>) -> f64 {
    if half_width <= 0.0 {
        // Without an error nothing is open, and no doubling would lead away.
        return half_width;
    }
    let (mut inner, mut told_inside, mut distance) = (0.0, 0.0, half_width);
    while distance < limit {
        // Linear in the distance where the valley is quadratic.
        let told = told(distance).map_or(f64::INFINITY, |told| told.max(0.0).sqrt());
        if told >= 1.0 {
            let end = inner + (distance - inner) * (1.0 - told_inside) / (told - told_inside);
            return end.max(half_width);
        }
        (inner, told_inside, distance) = (distance, told, 2.0 * distance);
    }
    distance.min(limit).max(half_width)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(half_width: f64, limit: f64, told: impl Fn(f64) -> Option<f64>) -> f64 {
        reach(half_width, limit, &told)
    }

    #[test]
    fn a_quadratic_valley_ends_where_it_is_told() {
        for width in [1.0, 1.3, 2.0, 5.0, 70.0] {
            let end = of(1.0, 1e3, |distance| Some((distance / width).powi(2)));
            assert!((end - width).abs() < 1e-12, "{end} instead of {width}");
        }
    }

    #[test]
    fn the_curvature_is_not_undercut() {
        assert_eq!(of(1.0, 1e3, |distance| Some(100.0 * distance.powi(2))), 1.0);
    }

    #[test]
    fn a_flat_valley_ends_at_its_wall_or_at_the_limit() {
        let wall = |distance: f64| Some(if distance < 5.0 { 0.0 } else { 4.0 });
        let end = of(1.0, 1e3, wall);
        assert!(end > 4.0 && end <= 8.0, "{end}");
        assert_eq!(of(1.0, 3.0, |_| Some(0.0)), 3.0);
        // A place that costs less than the fit tells nothing, and one that cannot be simulated ends the valley.
        assert_eq!(of(1.0, 3.0, |_| Some(-1.0)), 3.0);
        assert_eq!(of(1.0, 1e3, |distance| (distance < 3.0).then_some(0.0)), 2.0);
        assert_eq!(of(0.0, 1e3, |_| Some(f64::NAN)), 0.0);
        // Beyond the limit the range ends anyway.
        assert_eq!(of(2.0, 1.0, |_| Some(0.0)), 2.0);
    }
}
