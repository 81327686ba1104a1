//! What the differences of a place's colours say of its depth.
//!
//! `D(d)` is the sum of the squared differences over their variances at a depth. At the right depth colours differ by
//! their noise, at all others by that and by the texture, whose variance is `t` times the noise's. So the likelihood of
//! a depth is that of its own differences by noise alone over that by both, `exp(-D(d) / 2 e * t / (1 + t))`: the noise
//! is corrected by `e`, the minimum over its degrees of freedom, and `t` is what the mean of the curve has over its
//! minimum, `1 + t = mean D / min D`. A curve that is as high everywhere tells nothing, however noisy it is.

use crate::carve::{Curve, DEPTH_STEP, outward};
use crate::tuning::{SWEEP_DEPTHS, SWEEP_SURFACE};

/// The first and the last depth that are looked at: as far to the inside as to the outside, so that noise moves no
/// surface. Derived.
const FIRST: usize = 2 * SWEEP_SURFACE + 1 - SWEEP_DEPTHS;
const LAST: usize = SWEEP_DEPTHS - 1;

/// Parts that a step between two depths is cut into, where the likelihood is summed. Budget.
const PARTS: usize = 8;

/// Depths at which the likelihood is summed.
const FINER: usize = (LAST - FIRST) * PARTS + 1;

/// Where the surface is [units outward], and the inverse variance of that [1/units^2]; nothing is known where that
/// is zero.
///
/// It is the Gaussian that turns the moments of a depth that may be anywhere among those that are tried into those
/// of the likelihood (a site of expectation propagation: Minka 2001).
pub(super) fn surface(curve: &Curve) -> (f64, f64) {
    let finer: [f64; FINER] = std::array::from_fn(|i| between(curve, depth(i)));
    let least = finer.iter().copied().fold(f64::INFINITY, f64::min).max(0.0);
    let mean = finer.iter().sum::<f64>() / FINER as f64;
    if curve.freedom <= 0.0 || mean <= least {
        return (0.0, 0.0);
    }
    // Noise that is smaller than expected is no better known for that.
    let excess = (least / f64::from(curve.freedom)).max(1.0);
    let texture = 1.0 - least / mean;
    let (_, open) = moments(finer.map(|_| 1.0));
    let (at, variance) = moments(finer.map(|value| (-0.5 * texture / excess * (value - least)).exp()));
    let weight = variance.recip() - open.recip();
    if weight > 0.0 { (at / variance / weight, weight) } else { (0.0, 0.0) }
}

/// The curve between its depths: the parabola through the three nearest.
fn between(curve: &Curve, depth: f64) -> f64 {
    let middle = (depth.round() as usize).clamp(FIRST + 1, LAST - 1);
    let [a, b, c] = [middle - 1, middle, middle + 1].map(|k| f64::from(curve.squared[k]));
    let x = depth - middle as f64;
    b + 0.5 * (c - a) * x + 0.5 * (a - 2.0 * b + c) * x * x
}

/// Mean [units outward] and variance [units^2] of a depth by its likelihood, each value of which stands for all depths
/// around it.
fn moments(likelihood: [f64; FINER]) -> (f64, f64) {
    let total: f64 = likelihood.iter().sum();
    let weighted = || likelihood.iter().enumerate().map(|(i, l)| (outward(depth(i)), l / total));
    let mean: f64 = weighted().map(|(at, weight)| weight * at).sum();
    let variance: f64 = weighted().map(|(at, weight)| weight * (at - mean).powi(2)).sum();
    (mean, variance + (DEPTH_STEP / PARTS as f64).powi(2) / 12.0)
}

/// The number of the `i`-th of the depths at which the likelihood is summed.
fn depth(i: usize) -> f64 {
    FIRST as f64 + i as f64 / PARTS as f64
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::carve::{SeenColours, difference_of};

    /// Squared distances from a place [units outward] of this inverse variance, beside a `least`.
    fn parabola(at: f64, weight: f64, least: f64, freedom: f32) -> Curve {
        let value = |k: usize| (weight * (outward(k as f64) - at).powi(2) + least) as f32;
        Curve { squared: std::array::from_fn(value), freedom }
    }

    /// A sharp minimum is a Gaussian, but for what little is not texture.
    #[test]
    fn the_least_of_a_parabola_is_the_surface() {
        for at in [-1.3, -0.63, 0.0, 0.4, 1.2] {
            let (found, weight) = surface(&parabola(at, 200.0, 3.0, 6.0));
            assert!((found - at).abs() < 0.01 && (weight / 200.0 - 1.0).abs() < 0.1, "{at}: {found} {weight}");
        }
        let (once, thrice) = (surface(&parabola(0.4, 200.0, 6.0, 6.0)), surface(&parabola(0.4, 200.0, 18.0, 6.0)));
        assert!((once.0 - thrice.0).abs() < 0.01, "{once:?} {thrice:?}");
        assert!(
            (once.1 / thrice.1 - 3.0).abs() < 0.3,
            "noise three times as large counts a third: {once:?} {thrice:?}"
        );
    }

    /// Beyond the last depth the surface is far away, and little is known of how far.
    #[test]
    fn a_slope_points_down() {
        let (near, far) = (surface(&parabola(1.0, 20.0, 3.0, 6.0)), surface(&parabola(-4.0, 20.0, 3.0, 6.0)));
        assert!(far.0 < -1.8 && far.1 > 0.0 && near.0 > 0.9, "{near:?} {far:?}");
    }

    /// What differs as much at all depths, and what nobody sees.
    #[test]
    fn flat_curves_tell_nothing() {
        assert_eq!(surface(&parabola(0.3, 0.0, 9.0, 6.0)), (0.0, 0.0));
        assert_eq!(surface(&parabola(0.3, 9.0, 9.0, 0.0)), (0.0, 0.0));
    }

    /// Noise alone, of forty views of seven places: its lowest value is a minimum with a bend, but tells nothing.
    #[test]
    fn noise_moves_no_surface() {
        let mut state = 1u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1u64 << 24) as f32
        };
        let mut normal = || (0..12).map(|_| uniform()).sum::<f32>() - 6.0;
        let mut colours = || Vec3::new(normal(), normal(), normal());
        let mut view = || SeenColours { moment: 0, colours: std::array::from_fn(|_| colours()), variance: Vec3::ONE };
        let mut place = |sum: &mut Curve| sum.add(&difference_of(&(0..40).map(|_| view()).collect::<Vec<_>>()));
        let mut pull = || {
            let mut sum = Curve::NONE;
            (0..7).for_each(|_| place(&mut sum));
            surface(&sum.scaled(1.0 / 7.0)).1
        };
        let largest = (0..50).map(|_| pull()).fold(0.0, f64::max);
        let textured = surface(&parabola(0.0, 40.0, 117.0, 117.0)).1;
        assert!(largest < 0.1 * textured, "{largest} of noise, {textured} of a texture");
    }
}
