//! Rotations that cover all of SO(3) evenly.

use std::f64::consts::TAU;

use glam::DQuat;

/// `count` rotations on a spiral over the sphere of quaternions (Alexa, "Super-Fibonacci Spirals: Fast, Low-Discrepancy
/// Sampling of SO(3)", CVPR 2022, algorithm 1). For 4,000 the farthest rotation is about 16 degrees from its nearest
/// one.
pub(crate) fn super_fibonacci_rotations(count: usize) -> Vec<DQuat> {
    let first = std::f64::consts::SQRT_2;
    // The positive root of x^4 = x + 4.
    let second = 1.533_751_168_755_204_3;
    let point = |i: usize| {
        let s = i as f64 + 0.5;
        let share = s / count as f64;
        let (inner, outer) = (share.sqrt(), (1.0 - share).sqrt());
        let ((sin_a, cos_a), (sin_b, cos_b)) = ((TAU * s / first).sin_cos(), (TAU * s / second).sin_cos());
        DQuat::from_xyzw(inner * sin_a, inner * cos_a, outer * sin_b, outer * cos_b)
    };
    (0..count).map(point).collect()
}

/// Angle between two rotations [rad].
pub(crate) fn angle(a: DQuat, b: DQuat) -> f64 {
    2.0 * a.dot(b).abs().min(1.0).acos()
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn no_rotation_is_far_from_the_covering() {
        let all = super_fibonacci_rotations(4_000);
        assert!(all.iter().all(|q| (q.length() - 1.0).abs() < 1e-12));
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut farthest = 0.0f64;
        for _ in 0..2_000 {
            let mut number = || rng.random_range(-1.0..1.0);
            let q = DQuat::from_xyzw(number(), number(), number(), number());
            if q.length() > 1.0 || q.length() < 0.1 {
                continue;
            }
            let nearest = all.iter().map(|a| angle(*a, q.normalize())).fold(f64::INFINITY, f64::min);
            farthest = farthest.max(nearest);
        }
        assert!(farthest.to_degrees() < 16.0, "{} degrees", farthest.to_degrees());
    }
}
