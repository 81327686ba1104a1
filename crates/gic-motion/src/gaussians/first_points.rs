//! The first points: the surface of the visual hull, the scene's sparse points, or points drawn in the object's box.

use gic_scene::{Camera, Hull, HullSettings, HullView, Mask, Picture, Scene};
use glam::DVec3;
use rand::{Rng, RngExt};
use rayon::prelude::*;

use crate::pictures::{Ball, Target};
use crate::tuning::{
    COARSE_HULL_RESOLUTION, MAX_HULL_RESOLUTION, MAX_HULL_VIEWS, MIN_HULL_RESOLUTION, SPACING_SAMPLE,
    SPARSE_POINT_MASK_SHARE,
};

/// Points with colours, all the same size.
#[derive(Clone, Debug, Default)]
pub(crate) struct FirstPoints {
    pub(crate) positions: Vec<[f32; 3]>,
    pub(crate) colors: Vec<[f32; 3]>,
    /// Distance between neighbours [m].
    pub(crate) spacing: f64,
}

/// The scene's sparse points near the object: those that most masks show.
pub(crate) fn sparse(scene: &Scene, targets: &[&Target]) -> FirstPoints {
    let points: Vec<_> = scene.points.iter().filter(|p| share(targets, p.position) > SPARSE_POINT_MASK_SHARE).collect();
    let positions: Vec<[f32; 3]> = points.iter().map(|p| p.position.as_vec3().to_array()).collect();
    let spacing = mean_spacing(&positions);
    FirstPoints { colors: points.iter().map(|p| p.rgb).collect(), positions, spacing }
}

/// Share of the pictures looking at `x` whose mask shows it.
fn share(targets: &[&Target], x: DVec3) -> f64 {
    let (mut seen, mut inside) = (0.0, 0.0);
    for target in targets {
        let Some((pixel, _)) = target.camera.project(x) else { continue };
        let within = pixel.x >= 0.0
            && pixel.y >= 0.0
            && pixel.x < target.camera.width as f64
            && pixel.y < target.camera.height as f64;
        if within {
            seen += 1.0;
            inside += f64::from(u8::from(target.coverage(pixel.x as usize, pixel.y as usize) >= 0.5));
        }
    }
    if seen > 0.0 { inside / seen } else { 0.0 }
}

/// About `count` points on the surface of the visual hull of `targets`, coloured by the pictures that see them.
///
/// The hull is what at most the share `misses` of the masks does not show. Points are the surface cells of a grid as
/// fine as `count` asks for, moved at random within them.
pub(crate) fn hull_surface(
    targets: &[&Target],
    misses: f64,
    (count, inset): (usize, f64),
    rng: &mut impl Rng,
) -> Option<FirstPoints> {
    let stride = targets.len().div_ceil(MAX_HULL_VIEWS);
    let views: Vec<(&Target, Mask, Picture)> =
        targets.par_iter().step_by(stride).map(|&target| (target, target.mask(), target.picture())).collect();
    let carving: Vec<HullView> =
        views.iter().map(|(target, mask, _)| HullView { camera: &target.camera, mask }).collect();
    let tolerated_misses = (misses * views.len() as f64) as usize;
    let carve = |resolution| Hull::carve(&carving, &HullSettings { resolution, tolerated_misses });
    let coarse = carve(COARSE_HULL_RESOLUTION)?;
    // The number of surface cells grows with the square of the resolution.
    let factor = (count as f64 / coarse.surface().len().max(1) as f64).sqrt();
    let hull = carve(
        ((COARSE_HULL_RESOLUTION as f64 * factor).round() as usize).clamp(MIN_HULL_RESOLUTION, MAX_HULL_RESOLUTION),
    )?;
    let surface = hull.surface();
    let pictures: Vec<(&Camera, &Picture)> =
        views.iter().map(|(target, _, picture)| (&target.camera, picture)).collect();
    let colors = hull.colours(&surface, &pictures);
    let mut jitter = || DVec3::from_array(core::array::from_fn(|_| rng.random_range(-0.5..0.5)));
    let positions = surface
        .iter()
        .map(|point| (point.position + hull.cell * (jitter() - inset * point.normal)).as_vec3().to_array())
        .collect();
    Some(FirstPoints { positions, colors, spacing: hull.cell })
}

/// `count` points drawn uniformly in the box around the ball, grey: the paper's start.
pub(crate) fn random(ball: &Ball, count: usize, rng: &mut impl Rng) -> FirstPoints {
    let positions = (0..count)
        .map(|_| {
            let offset: [f64; 3] = core::array::from_fn(|_| rng.random_range(-1.0..1.0));
            (ball.centre + ball.radius * DVec3::from_array(offset)).as_vec3().to_array()
        })
        .collect();
    let spacing = 2.0 * ball.radius / (count as f64).cbrt();
    FirstPoints { positions, colors: vec![[0.5; 3]; count], spacing }
}

/// Median distance to the nearest neighbour among a sample of the points.
fn mean_spacing(positions: &[[f32; 3]]) -> f64 {
    let stride = (positions.len() / SPACING_SAMPLE).max(1);
    let mut nearest: Vec<f64> = positions
        .par_iter()
        .enumerate()
        .step_by(stride)
        .map(|(i, a)| {
            let squared = |b: &[f32; 3]| (0..3).map(|k| f64::from(a[k] - b[k]).powi(2)).sum::<f64>();
            let others = positions.iter().enumerate().filter(|(j, _)| *j != i);
            others.map(|(_, b)| squared(b)).fold(f64::INFINITY, f64::min).sqrt()
        })
        .filter(|d| d.is_finite())
        .collect();
    nearest.sort_by(f64::total_cmp);
    nearest.get(nearest.len() / 2).copied().unwrap_or(0.0)
}
