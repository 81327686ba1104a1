//! How much the colours of a place differ between the views that see it, over the depth at which it is looked for
//! (plane sweep: Collins 1996), and what that says of the depth.
//!
//! `D(d) = sum over views and channels of (c - mean)^2 / variance`, of as many degrees of freedom as there are
//! differences: one less than views, for each channel. At the right depth colours differ by their noise, at all others
//! by that and by the texture, whose variance is `t` times the noise's. So the likelihood of a depth is that of its own
//! differences by noise alone over that by both, `exp(-D(d) / 2 e * t / (1 + t))`: `e = min D / degrees of freedom`
//! corrects the noise, and `t` is what the mean of the curve has over its minimum, `1 + t = mean D / min D`. A curve
//! that is as high everywhere tells nothing, however noisy it is.
//!
//! The surface may also lie deeper than all depths that are tried, as in a notch that was taken for full. Then even the
//! least of the differences is the texture's, and not what it is elsewhere on the body: [`deeper`].

use glam::Vec3;

use super::{median, robust_deviation};

/// Depths at which colours are compared: the surface, and as many outside as inside of it, so that noise moves no
/// surface. Budget: more cost time in proportion.
const DEPTHS: usize = 9;

/// Number of the depth at the surface, from the innermost on.
const SURFACE: usize = DEPTHS / 2;

/// Distance between two depths [units].
pub(super) const DEPTH_STEP: f64 = 0.5;

/// Parts that a step between two depths is cut into, where the likelihood is summed. Budget.
const PARTS: usize = 8;

/// Distance between two depths at which the likelihood is summed [units]: nothing finer is told.
pub(super) const RESOLUTION: f64 = DEPTH_STEP / PARTS as f64;

/// Rounds of expectation maximisation. Budget: each costs nothing.
const MAXIMISATIONS: usize = 20;

/// Depths at which the likelihood is summed.
const FINER: usize = (DEPTHS - 1) * PARTS + 1;

/// Something at each depth.
pub(super) type AtDepths<T> = [T; DEPTHS];

/// How far outward the depths lie [m], in a unit [m].
pub(super) fn depths(unit: f64) -> AtDepths<f64> {
    std::array::from_fn(|k| outward(k as f64) * unit)
}

/// How far outward a depth lies [units].
fn outward(depth: f64) -> f64 {
    DEPTH_STEP * (depth - SURFACE as f64)
}

/// What a view shows of a place at each depth.
pub(super) struct SeenColours {
    pub(super) colours: AtDepths<Vec3>,
    pub(super) variance: Vec3,
}

/// How much colours differ at each depth.
#[derive(Clone, Copy)]
pub(super) struct Curve {
    /// Squared differences over their variances, summed.
    squared: AtDepths<f32>,
    /// Degrees of freedom of these sums.
    freedom: f32,
}

impl Curve {
    /// Of what all views show that see a place.
    pub(super) fn of(seen: &[SeenColours]) -> Curve {
        let weight: Vec3 = seen.iter().map(|view| view.variance.recip()).sum();
        let squared = |k: usize| {
            let mean = seen.iter().map(|view| view.colours[k] / view.variance).sum::<Vec3>() / weight;
            let square = |view: &SeenColours| (view.colours[k] - mean) * (view.colours[k] - mean) / view.variance;
            seen.iter().map(square).sum::<Vec3>().element_sum()
        };
        Curve { squared: std::array::from_fn(squared), freedom: 3.0 * seen.len().saturating_sub(1) as f32 }
    }

    /// The mean of curves of places beside each other: what neighbours see is no further evidence of a place itself.
    pub(super) fn mean(curves: impl Iterator<Item = Curve>) -> Curve {
        let none = Curve { squared: [0.0; DEPTHS], freedom: 0.0 };
        let add = |(sum, count): (Curve, f32), curve: Curve| {
            let squared = std::array::from_fn(|k| sum.squared[k] + curve.squared[k]);
            (Curve { squared, freedom: sum.freedom + curve.freedom }, count + 1.0)
        };
        let (sum, count) = curves.fold((none, 0.0), add);
        Curve { squared: sum.squared.map(|squared| squared / count), freedom: sum.freedom / count }
    }

    /// Where the surface is [units outward], and the inverse variance of that [1/units^2]; nothing is known where that
    /// is zero. `probability` is that of a surface that lies deeper than the depths, by [`deeper`].
    ///
    /// It is the Gaussian that turns the moments of a depth that may be anywhere into those of the likelihood (a site
    /// of expectation propagation: Minka 2001).
    pub(super) fn surface(&self, probability: f64) -> (f64, f64) {
        let finer: [f64; FINER] = std::array::from_fn(|i| self.between(i as f64 / PARTS as f64));
        let least = finer.iter().copied().fold(f64::INFINITY, f64::min).max(0.0);
        let mean = finer.iter().sum::<f64>() / FINER as f64;
        if self.freedom <= 0.0 || mean <= least {
            return (0.0, 0.0);
        }
        // Noise that is smaller than expected is no better known for that.
        let excess = (least / f64::from(self.freedom)).max(1.0);
        let texture = 1.0 - least / mean;
        let open = Moments::of(&[1.0; FINER]);
        let found = Moments::of(&finer.map(|value| (-0.5 * texture / excess * (value - least)).exp()));
        let among = (found.variance.recip() - open.variance.recip()).max(0.0);
        let at = if among > 0.0 { found.mean / found.variance / among } else { 0.0 };
        // Each pulls by its probability, as in the expectation step of a mixture.
        let (among, deeper) = ((1.0 - probability) * among, probability / Moments::DEEPER.variance);
        let weight = among + deeper;
        if weight > 0.0 { ((among * at + deeper * Moments::DEEPER.mean) / weight, weight) } else { (0.0, 0.0) }
    }

    /// Logarithm of the least of the differences per degree of freedom; `None` where nobody sees the place.
    fn log_least(&self) -> Option<f64> {
        let least = self.squared.iter().copied().fold(f32::INFINITY, f32::min).max(f32::MIN_POSITIVE);
        (self.freedom > 0.0).then(|| f64::from(least / self.freedom).ln())
    }

    /// The curve between its depths: the parabola through the three nearest.
    fn between(&self, depth: f64) -> f64 {
        let middle = (depth.round() as usize).clamp(1, DEPTHS - 2);
        let [a, b, c] = [middle - 1, middle, middle + 1].map(|k| f64::from(self.squared[k]));
        let x = depth - middle as f64;
        b + 0.5 * (c - a) * x + 0.5 * (a - 2.0 * b + c) * x * x
    }
}

/// What is known of a depth.
#[derive(Clone, Copy)]
struct Moments {
    /// Mean [units outward].
    mean: f64,
    /// Variance [units^2].
    variance: f64,
}

impl Moments {
    /// Of one that is as far again inside of the innermost as this is of the surface.
    const DEEPER: Moments = {
        let reach = DEPTH_STEP * SURFACE as f64;
        Moments { mean: -1.5 * reach, variance: reach * reach / 12.0 }
    };

    /// By its likelihood, each value of which stands for all depths around it.
    fn of(likelihood: &[f64; FINER]) -> Moments {
        let total: f64 = likelihood.iter().sum();
        let weighted = || likelihood.iter().enumerate().map(|(i, l)| (outward(i as f64 / PARTS as f64), l / total));
        let mean: f64 = weighted().map(|(at, weight)| weight * at).sum();
        let variance: f64 = weighted().map(|(at, weight)| weight * (at - mean).powi(2)).sum();
        Moments { mean, variance: variance + RESOLUTION.powi(2) / 12.0 }
    }
}

/// How probable it is, for each of a body's places, that the surface lies deeper than all depths at which its colours
/// differ by these curves, beyond the share of places where it does: no more than that is 0, and certainty 1.
///
/// How the least differences scatter is told by medians, for of most places one of the depths is right; the share by
/// expectation maximisation.
pub(super) fn deeper(curves: &[Curve]) -> Vec<f64> {
    let Some(others) = LeastDifferences::of(curves) else { return vec![0.0; curves.len()] };
    let inverse_odds: Vec<Option<f64>> = curves.iter().map(|curve| Some((-others.log_odds(curve)?).exp())).collect();
    let probability = |share: f64, inverse_odds: f64| share / (share + (1.0 - share) * inverse_odds);
    let mut share = 0.5;
    for _ in 0..MAXIMISATIONS {
        let seen = inverse_odds.iter().flatten();
        share = seen.clone().map(|inverse| probability(share, *inverse)).sum::<f64>() / seen.count() as f64;
    }
    let beyond = |inverse| (probability(share, inverse) - share) / (1.0 - share);
    inverse_odds.into_iter().map(|inverse| inverse.map_or(0.0, |inverse| beyond(inverse).max(0.0))).collect()
}

/// How the least differences of a body's places scatter where one of the depths is right.
struct LeastDifferences {
    /// Mean of their logarithms, per degree of freedom.
    log_mean: f64,
    /// Standard deviation of these.
    log_deviation: f64,
}

impl LeastDifferences {
    /// `None` where nothing is seen, or nothing differs.
    fn of(curves: &[Curve]) -> Option<LeastDifferences> {
        let logs: Vec<f64> = curves.iter().filter_map(Curve::log_least).collect();
        let log_mean = median(logs.clone())?;
        let log_deviation = robust_deviation(logs.iter().map(|log| (log - log_mean).abs()).collect())?;
        (log_deviation > 0.0).then_some(LeastDifferences { log_mean, log_deviation })
    }

    /// Logarithm of the likelihood of a surface that lies deeper over that of one among the depths: there the least
    /// difference is the texture's, as the mean is, and here what it is elsewhere. Both scatter alike, and count by the
    /// share of texture: where there is none, the two are the same. `None` where nobody sees the place.
    fn log_odds(&self, curve: &Curve) -> Option<f64> {
        let (log_least, mean) = (curve.log_least()?, curve.squared.iter().sum::<f32>() / DEPTHS as f32);
        let log_mean = f64::from(mean / curve.freedom).ln();
        let from_others = (log_least - self.log_mean).max(0.0) / self.log_deviation;
        let from_texture = (log_mean - log_least).max(0.0) / self.log_deviation;
        let texture = 1.0 - (log_least - log_mean).min(0.0).exp();
        Some(0.5 * texture * (from_others.powi(2) - from_texture.powi(2)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Squared distances from a place [units outward] of this inverse variance, beside a `least`.
    fn parabola(at: f64, weight: f64, least: f64, freedom: f32) -> Curve {
        let value = |k: usize| (weight * (outward(k as f64) - at).powi(2) + least) as f32;
        Curve { squared: std::array::from_fn(value), freedom }
    }

    /// A sharp minimum is a Gaussian, but for what little is not texture.
    #[test]
    fn the_least_of_a_parabola_is_the_surface() {
        for at in [-1.3, -0.63, 0.0, 0.4, 1.2] {
            let (found, weight) = parabola(at, 200.0, 3.0, 6.0).surface(0.0);
            assert!((found - at).abs() < 0.01 && (weight / 200.0 - 1.0).abs() < 0.1, "{at}: {found} {weight}");
        }
        let (once, thrice) =
            (parabola(0.4, 200.0, 6.0, 6.0).surface(0.0), parabola(0.4, 200.0, 18.0, 6.0).surface(0.0));
        assert!((once.0 - thrice.0).abs() < 0.01, "{once:?} {thrice:?}");
        assert!(
            (once.1 / thrice.1 - 3.0).abs() < 0.3,
            "noise three times as large counts a third: {once:?} {thrice:?}"
        );
    }

    /// Beyond the last depth the surface is far away, and little is known of how far.
    #[test]
    fn a_slope_points_down() {
        let (near, far) = (parabola(1.0, 20.0, 3.0, 6.0).surface(0.0), parabola(-4.0, 20.0, 3.0, 6.0).surface(0.0));
        assert!(far.0 < -1.8 && far.1 > 0.0 && near.0 > 0.9, "{near:?} {far:?}");
    }

    /// What differs as much at all depths, and what nobody sees.
    #[test]
    fn flat_curves_tell_nothing() {
        assert_eq!(parabola(0.3, 0.0, 9.0, 6.0).surface(0.0), (0.0, 0.0));
        assert_eq!(parabola(0.3, 9.0, 9.0, 0.0).surface(0.0), (0.0, 0.0));
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
        let mut view = || SeenColours { colours: std::array::from_fn(|_| colours()), variance: Vec3::ONE };
        let mut place = || Curve::of(&(0..40).map(|_| view()).collect::<Vec<_>>());
        let places: Vec<Curve> = (0..50).map(|_| Curve::mean((0..7).map(|_| place()))).collect();
        let pulls = places.iter().zip(deeper(&places)).map(|(place, deeper)| place.surface(deeper).1);
        let textured = parabola(0.0, 40.0, 117.0, 117.0).surface(0.0).1;
        let largest = pulls.fold(0.0, f64::max);
        assert!(largest < 0.1 * textured, "{largest} of noise, {textured} of a texture");
    }

    /// Where colours differ at all depths as only a texture does, the surface lies deeper; where the least is what it
    /// is elsewhere, it lies there.
    #[test]
    fn what_agrees_nowhere_lies_deeper() {
        let textured = Curve { squared: [9.0, 6.0, 8.0, 11.0, 7.0, 6.5, 12.0, 8.0, 9.5], freedom: 12.0 };
        // Least differences about .01 per degree of freedom, within a factor of two or so.
        let right = |k: i32| parabola(0.4, 200.0, 0.12 * 2f64.powf(0.1 * f64::from(k)), 12.0);
        let body: Vec<Curve> = std::iter::once(textured).chain((-5..=5).map(right)).collect();
        let probabilities = deeper(&body);
        let (at, weight) = textured.surface(probabilities[0]);
        assert!(at < outward(0.0) && weight > 1.0, "{at} {weight}");
        for (curve, probability) in body.iter().zip(&probabilities).skip(1) {
            let (at, weight) = curve.surface(*probability);
            assert!((at - 0.4).abs() < 0.05 && weight > 50.0, "{at} {weight}");
        }
    }
}
