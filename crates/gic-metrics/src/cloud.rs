//! Metrics of point clouds [m]: chamfer distance and earth mover's distance as the paper reports them.

use gic_geometry::{KdTree, squared_distance};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::error::usable_cloud;

use crate::{MetricError, assign};

/// Random points of each cloud that the chamfer distance looks at.
pub const CHAMFER_POINTS: usize = 8192;
/// Random points of each cloud that the earth mover's distance assigns.
pub const EMD_POINTS: usize = 2048;

/// Chamfer and earth mover's distance of the same pair of clouds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CloudMetrics {
    /// Chamfer distance [1e3 mm^2], as [`chamfer`].
    pub chamfer: f64,
    /// Earth mover's distance [m], as [`earth_mover`].
    pub emd: f64,
}

/// Chamfer distance [1e3 mm^2 = 1e-3 m^2]: mean squared distance to the nearest point of the other cloud, both
/// directions added, over [`CHAMFER_POINTS`] random points of each cloud (all of a cloud that has fewer).
pub fn chamfer(a: &[[f32; 3]], b: &[[f32; 3]], seed: u64) -> Result<f64, MetricError> {
    usable_cloud("first cloud", a)?;
    usable_cloud("second cloud", b)?;
    let (a, b) = (sample_points(a, CHAMFER_POINTS, seed), sample_points(b, CHAMFER_POINTS, seed.wrapping_add(1)));
    Ok(1e3 * (mean_squared_nearest(&a, &b) + mean_squared_nearest(&b, &a)))
}

/// Earth mover's distance [m]: mean distance of matched pairs in the optimal one-to-one assignment of [`EMD_POINTS`]
/// random points of each cloud (as many as the smaller cloud has, if fewer). Exact on those points.
pub fn earth_mover(a: &[[f32; 3]], b: &[[f32; 3]], seed: u64) -> Result<f64, MetricError> {
    usable_cloud("first cloud", a)?;
    usable_cloud("second cloud", b)?;
    let n = EMD_POINTS.min(a.len()).min(b.len());
    let (a, b) = (sample_points(a, n, seed), sample_points(b, n, seed.wrapping_add(1)));
    let mut distances = vec![0.0f32; n * n];
    distances.par_chunks_exact_mut(n).zip(&a).for_each(|(row, &p)| {
        for (d, &q) in row.iter_mut().zip(&b) {
            *d = squared_distance(p, q).sqrt();
        }
    });
    Ok(assign(&distances, n).cost / n as f64)
}

/// Both metrics of a pair of clouds.
pub fn compare_clouds(a: &[[f32; 3]], b: &[[f32; 3]], seed: u64) -> Result<CloudMetrics, MetricError> {
    let (chamfer, emd) = rayon::join(|| chamfer(a, b, seed), || earth_mover(a, b, seed));
    Ok(CloudMetrics { chamfer: chamfer?, emd: emd? })
}

/// The value that the metrics have for a perfect answer: both metrics between two independent random samplings of the
/// truth.
///
/// The truth is taken to be the union of cubes of side `spacing` [m] around its points (see [`sample_volume`]); a
/// reconstruction whose own points lie on a lattice can score a little below this.
pub fn noise_floor(truth: &[[f32; 3]], spacing: f32, seed: u64) -> Result<CloudMetrics, MetricError> {
    usable_cloud("truth", truth)?;
    let (a, b) = (
        sample_volume(truth, spacing, CHAMFER_POINTS, seed),
        sample_volume(truth, spacing, CHAMFER_POINTS, seed.wrapping_add(2)),
    );
    compare_clouds(&a, &b, seed)
}

/// `count` different points of a cloud at random; the whole cloud, in its order, if it has no more than that.
pub fn sample_points(points: &[[f32; 3]], count: usize, seed: u64) -> Vec<[f32; 3]> {
    if points.len() <= count {
        return points.to_vec();
    }
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut pool = points.to_vec();
    for i in 0..count {
        let other = random.random_range(i..pool.len());
        pool.swap(i, other);
    }
    pool.truncate(count);
    pool
}

/// `count` independent points, uniform in the cubes of side `spacing` [m] centred on the points of a cloud; empty if
/// that is.
pub fn sample_volume(points: &[[f32; 3]], spacing: f32, count: usize, seed: u64) -> Vec<[f32; 3]> {
    if points.is_empty() {
        return Vec::new();
    }
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    (0..count)
        .map(|_| {
            let p = points[random.random_range(0..points.len())];
            p.map(|c| c + spacing * (random.random::<f32>() - 0.5))
        })
        .collect()
}

/// Mean over `from` of the squared distance to the nearest point of `to` [m^2].
fn mean_squared_nearest(from: &[[f32; 3]], to: &[[f32; 3]]) -> f64 {
    let tree = KdTree::new(to);
    let squared: Vec<f32> =
        from.par_iter().map(|&p| tree.nearest(p).map_or(f32::NAN, |(_, distance)| distance)).collect();
    squared.iter().map(|&d| f64::from(d)).sum::<f64>() / from.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A block of points [m] on a lattice of spacing 0.01.
    fn block(nx: usize, ny: usize, nz: usize) -> Vec<[f32; 3]> {
        (0..nx * ny * nz).map(|i| [i % nx, i / nx % ny, i / nx / ny].map(|c| 0.01 * c as f32)).collect()
    }

    #[test]
    fn chamfer_of_a_known_pair() {
        let a = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0]];
        let b = [[0.0f32, 0.5, 0.0]];
        // a -> b: (0.25 + 1.25) / 2; b -> a: 0.25.
        assert!((chamfer(&a, &b, 0).unwrap() - 1000.0).abs() < 1e-3);
        assert!((chamfer(&a, &a, 0).unwrap()).abs() < 1e-12);
    }

    #[test]
    fn earth_mover_of_a_shifted_block_is_the_shift() {
        let a = block(12, 12, 12);
        let b: Vec<[f32; 3]> = a.iter().map(|p| [p[0], p[1] + 0.003, p[2]]).collect();
        assert!((earth_mover(&a, &b, 3).unwrap() - 0.003).abs() < 1e-6);
    }

    #[test]
    fn the_same_seed_gives_the_same_number_and_another_seed_another() {
        let a = block(25, 25, 20);
        let b: Vec<[f32; 3]> = a.iter().map(|p| [p[0] + 0.004, p[1], p[2]]).collect();
        assert_eq!(compare_clouds(&a, &b, 7).unwrap(), compare_clouds(&a, &b, 7).unwrap());
        assert_ne!(chamfer(&a, &b, 7).unwrap(), chamfer(&a, &b, 8).unwrap());
    }

    #[test]
    fn noise_floor_agrees_with_the_theory_of_random_points() {
        // Nearest neighbour of a point among n per volume at random: E r^2 = Gamma(5/3) (4 pi n / 3)^(-2/3), a little
        // more near the surface. 7,000 cubes of side 0.01 hold 8,192 random points.
        let truth = block(28, 25, 10);
        let floor = noise_floor(&truth, 0.01, 1).unwrap();
        let n = 8192.0 / (truth.len() as f64 * 1e-6);
        let inside = 2.0 * 1e3 * 0.9027 * (4.0 * std::f64::consts::PI * n / 3.0).powf(-2.0 / 3.0);
        assert!(floor.chamfer > inside && floor.chamfer < 1.15 * inside, "{} {inside}", floor.chamfer);
        assert!(floor.emd > 0.008 && floor.emd < 0.025, "{}", floor.emd);
    }

    #[test]
    fn samples_are_different_points_of_the_cloud() {
        let a = block(10, 10, 10);
        let mut s = sample_points(&a, 100, 5);
        assert_eq!(s.len(), 100);
        assert!(s.iter().all(|p| a.contains(p)));
        s.sort_by(|p, q| p.partial_cmp(q).unwrap());
        s.dedup();
        assert_eq!(s.len(), 100);
    }

    #[test]
    fn unusable_clouds_are_errors() {
        let a = block(3, 3, 3);
        assert_eq!(chamfer(&[], &a, 0), Err(MetricError::Empty { what: "first cloud" }));
        let mut b = a.clone();
        b[4][1] = f32::NAN;
        assert_eq!(earth_mover(&a, &b, 0), Err(MetricError::NotFinite { what: "second cloud", index: 4 }));
    }
}
