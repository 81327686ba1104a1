//! Epipolar tangency (Wong & Cipolla 2001): whether two outlines can be of one body.
//!
//! A plane through the centres of two cameras that touches a body touches its outline in both pictures. So the two
//! outermost planes of the one outline are those of the other, whatever the shape. That needs no point that both
//! cameras see, so opposite cameras serve as well as neighbours.

use glam::DVec3;

use super::outline::Cone;

/// An outermost plane through the baseline.
struct Tangent {
    /// Its angle about the baseline [rad].
    angle: f64,
    /// Standard deviation of the angle where the outline's is one pixel [rad].
    deviation: f64,
}

/// By how much the outermost planes through both cameras' centres differ between two outlines [pixels]; `None` where
/// the cameras are at one place, or one of them sees the other through the body, so that no plane is outermost.
/// `middle` [m] lies within the body.
pub(super) fn tangency(a: &Cone, b: &Cone, middle: DVec3) -> Option<[f64; 2]> {
    let baseline = (b.centre - a.centre).try_normalize()?;
    let ahead = (middle - a.centre).reject_from_normalized(baseline).try_normalize()?;
    let beside = baseline.cross(ahead);
    let (first, second) = (tangents(a, ahead, beside)?, tangents(b, ahead, beside)?);
    let between = |k: usize| {
        let (a, b) = (&first[k], &second[k]);
        (a.angle - b.angle) / a.deviation.hypot(b.deviation)
    };
    Some([between(0), between(1)])
}

/// The lowest and the highest angle of an outline's rays about a baseline, counted from `ahead` towards `beside`.
fn tangents(outline: &Cone, ahead: DVec3, beside: DVec3) -> Option<[Tangent; 2]> {
    let (mut low, mut high) = ((f64::INFINITY, 0.0), (f64::NEG_INFINITY, 0.0));
    for ray in &outline.rays {
        let (along, across) = (ray.dot(ahead), ray.dot(beside));
        if along <= 0.0 {
            return None;
        }
        let slope = across / along;
        let from_baseline = along.hypot(across);
        if slope < low.0 {
            low = (slope, from_baseline);
        }
        if slope > high.0 {
            high = (slope, from_baseline);
        }
    }
    let tangent = |(slope, from_baseline): (f64, f64)| Tangent {
        angle: slope.atan(),
        deviation: 1.0 / (outline.focal_px * from_baseline),
    };
    Some([tangent(low), tangent(high)])
}
