//! Points embedded in a cloud of particles: a mesh follows the particles it was made with.

use gic_geometry::Neighbours;
use glam::{DMat3, DVec3};

/// A point follows this many particles.
const NEIGHBOURS: usize = 24;
/// Share of the neighbours' mean squared distance that is added along the diagonal: keeps the fit defined in thin
/// parts.
const RIDGE: f64 = 1e-3;

/// Binds points to particles at rest, and finds where the points are when the particles have moved: each follows the
/// affine map that fits its nearest particles best (weighted least squares).
pub struct EmbeddedPoints {
    /// For each point: its position at rest [m] and its particles.
    points: Vec<(DVec3, Vec<u32>)>,
    rest: Vec<DVec3>,
}

impl EmbeddedPoints {
    /// Binds `points` [m] to particles at `rest` [m], which lie about `spacing` [m] apart.
    pub fn new(points: &[DVec3], rest: &[DVec3], spacing: f64) -> Self {
        let particles = Neighbours::new(rest, 2.0 * spacing);
        let nearest = |p: &DVec3| {
            let found = particles.nearest::<NEIGHBOURS>(*p);
            let mut nearest: Vec<u32> = found.iter().filter(|f| f.0.is_finite()).map(|f| f.1 as u32).collect();
            nearest.sort_unstable();
            nearest
        };
        Self { points: points.iter().map(|p| (*p, nearest(p))).collect(), rest: rest.to_vec() }
    }

    /// The points when the particles are at `now` [m].
    pub fn deformed(&self, now: &[DVec3]) -> Vec<DVec3> {
        self.points.iter().map(|(point, particles)| self.deformed_point(*point, particles, now)).collect()
    }

    fn deformed_point(&self, point: DVec3, particles: &[u32], now: &[DVec3]) -> DVec3 {
        let pairs = || particles.iter().map(|&i| (self.rest[i as usize], now[i as usize]));
        let count = particles.len().max(1) as f64;
        let (rest_mean, now_mean) =
            pairs().fold((DVec3::ZERO, DVec3::ZERO), |(a, b), (p, q)| (a + p / count, b + q / count));
        let spread = pairs().map(|(p, _)| p.distance_squared(rest_mean)).sum::<f64>() / count;
        let ridge = DMat3::from_diagonal(DVec3::splat(RIDGE * spread.max(f64::MIN_POSITIVE)));
        let (mut moment, mut cross) = (ridge, ridge);
        for (p, q) in pairs() {
            let (d, e) = ((p - rest_mean) / count, q - now_mean);
            moment += outer(p - rest_mean, d);
            cross += outer(e, d);
        }
        now_mean + cross * moment.inverse() * (point - rest_mean)
    }
}

/// a b^T.
fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_follow_an_affine_motion() {
        let rest: Vec<DVec3> = (0..512)
            .map(|i| DVec3::new((i % 8) as f64, (i / 8 % 8) as f64, (i / 64) as f64) * 0.01 + DVec3::splat(0.3))
            .collect();
        let points = [DVec3::splat(0.33), DVec3::new(0.295, 0.31, 0.375)];
        let carrier = EmbeddedPoints::new(&points, &rest, 0.01);
        for (p, q) in points.iter().zip(carrier.deformed(&rest)) {
            assert!(p.distance(q) < 1e-12);
        }
        let turn = DMat3::from_rotation_y(1.0) * DMat3::from_diagonal(DVec3::new(1.1, 0.9, 1.0));
        let moved: Vec<DVec3> = rest.iter().map(|p| turn * *p + DVec3::X).collect();
        for (p, q) in points.iter().zip(carrier.deformed(&moved)) {
            // The ridge holds the map back by its own share of the neighbours' spread over their spread in the thinnest
            // direction, which is at most six at a corner of a lattice, times the distance from their centre, 2 cm.
            let error = (turn * *p + DVec3::X).distance(q);
            assert!(error < 6.0 * RIDGE * 0.02, "{error}");
        }
    }
}
