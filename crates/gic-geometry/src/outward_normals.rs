//! Which way the outside is, for points that fill a body: what light on them depends on.

use std::ops::Range;

use gic_simd::{Kernel, Lanes, Level, dispatch};
use rayon::prelude::*;

use crate::weighted_sum::Nearby;

/// Radius of the neighbourhood, in spacings of the points.
const RADIUS: f64 = 2.5;
/// Cells, of some fifteen points each, that one task works on.
const CELLS_PER_TASK: usize = 32;

/// For points about `spacing` [m] apart that fill a body: the direction to the outside, shape [n, 3]. About of length 1
/// on the surface, shorter below it, and near zero where there is matter all around.
///
/// It is the mean offset from the neighbours within 2.5 spacings, weighted by (1 - r^2 / R^2)^2 and divided by what a
/// flat surface gives, cut at length 1. Points that are not finite get zero.
pub fn outward_normals(points: &[[f32; 3]], spacing: f64) -> Vec<[f32; 3]> {
    normals_with(Level::active(), points, spacing)
}

fn normals_with(level: Level, points: &[[f32; 3]], spacing: f64) -> Vec<[f32; 3]> {
    let cells = Cells::new(points, RADIUS * spacing);
    // Integral of the weighted height over a half ball of matter: pi (R / s)^3 / 24, in units of R.
    let flat = (core::f64::consts::PI * RADIUS.powi(3) / 24.0) as f32;
    let of_task = |task: &[Range<usize>]| {
        let mut nearby = Nearby::default();
        let mut normals = Vec::new();
        for own in task {
            let runs = cells.around(cells.cells[own.start]);
            nearby.gather(runs.flat_map(|run| cells.points[run].iter().copied()));
            let points = &cells.points[own.clone()];
            dispatch(level, Offsets { points, nearby: &nearby, flat, normals: &mut normals });
        }
        normals
    };
    let tasks: Vec<Vec<[f32; 3]>> = cells.occupied.par_chunks(CELLS_PER_TASK).map(of_task).collect();
    let mut normals = vec![[0.0; 3]; points.len()];
    for (&i, normal) in cells.order.iter().zip(tasks.into_iter().flatten()) {
        normals[i as usize] = normal;
    }
    normals
}

/// Points sorted by the cell of a grid that they are in, in units of the cells' side.
struct Cells {
    /// The cell of each point, ascending.
    cells: Vec<[i32; 3]>,
    /// The points in that order, and their places in the caller's.
    points: Vec<[f32; 3]>,
    order: Vec<u32>,
    /// The points of each cell that has any.
    occupied: Vec<Range<usize>>,
}

impl Cells {
    fn new(points: &[[f32; 3]], side: f64) -> Cells {
        let scaled = |p: [f32; 3]| p.map(|x| (f64::from(x) / side) as f32);
        let mut order: Vec<([i32; 3], u32)> =
            points.iter().enumerate().map(|(i, &p)| (cell(scaled(p)), i as u32)).collect();
        order.par_sort_unstable();
        let mut occupied = Vec::new();
        let mut start = 0;
        for own in order.chunk_by(|a, b| a.0 == b.0) {
            occupied.push(start..start + own.len());
            start += own.len();
        }
        Cells {
            cells: order.iter().map(|(cell, _)| *cell).collect(),
            points: order.iter().map(|&(_, i)| scaled(points[i as usize])).collect(),
            order: order.into_iter().map(|(_, i)| i).collect(),
            occupied,
        }
    }

    /// The points of a cell and those around it, in runs.
    fn around(&self, [cx, cy, cz]: [i32; 3]) -> impl Iterator<Item = Range<usize>> + '_ {
        let reach = |c: i32| c.saturating_sub(1)..=c.saturating_add(1);
        reach(cx).flat_map(move |x| reach(cy).map(move |y| (x, y))).map(move |(x, y)| {
            // Cells that differ in z only lie side by side.
            let (low, high) = ([x, y, cz.saturating_sub(1)], [x, y, cz.saturating_add(1)]);
            let start = self.cells.partition_point(|cell| *cell < low);
            start..start + self.cells[start..].partition_point(|cell| *cell <= high)
        })
    }
}

/// Casting saturates, so that far away points share the outermost cells.
fn cell(p: [f32; 3]) -> [i32; 3] {
    p.map(|x| x.floor() as i32)
}

/// The normals of some points: the weighted sum of their offsets from those nearby.
struct Offsets<'a> {
    points: &'a [[f32; 3]],
    nearby: &'a Nearby,
    /// What a flat surface gives.
    flat: f32,
    normals: &'a mut Vec<[f32; 3]>,
}

impl Kernel for Offsets<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes<Scalar = f32>>(self) {
        for p in self.points {
            let offset = self.nearby.sums::<L, true>(*p).offset;
            self.normals.push(shortened(offset.map(|o| o as f32 / self.flat)));
        }
    }
}

fn shortened(v: [f32; 3]) -> [f32; 3] {
    let length = v.iter().map(|x| x * x).sum::<f32>().sqrt();
    if length.is_finite() { v.map(|x| x / length.max(1.0)) } else { [0.0; 3] }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cube of 15^3 points, spacing 0.02 m, around the origin.
    fn cube() -> Vec<[f32; 3]> {
        (0..15 * 15 * 15).map(|i| [i % 15, i / 15 % 15, i / 225].map(|k| (k as f32 - 7.0) * 0.02)).collect()
    }

    #[test]
    fn normals_of_a_cube_point_out_of_its_faces_and_vanish_inside() {
        let points = cube();
        let normals = outward_normals(&points, 0.02);
        let at = |x: f32, y: f32, z: f32| {
            let i = points.iter().position(|p| (p[0] - x).abs() + (p[1] - y).abs() + (p[2] - z).abs() < 1e-4).unwrap();
            normals[i]
        };
        let face = at(0.14, 0.0, 0.0);
        assert!(face[0] > 0.7 && face[0] <= 1.0 && face[1].abs() + face[2].abs() < 1e-3, "{face:?}");
        let edge = at(0.0, -0.14, 0.14);
        assert!((edge[1] + edge[2]).abs() < 1e-3 && edge[2] > 0.6, "{edge:?}");
        let inside = at(0.0, 0.0, 0.0);
        assert!(inside.iter().all(|x| x.abs() < 1e-3), "{inside:?}");
    }

    #[test]
    fn points_that_are_no_numbers_get_no_normal() {
        let normals = outward_normals(&[[f32::NAN; 3], [0.0; 3], [0.01, 0.0, 0.0]], 0.01);
        assert_eq!(normals[0], [0.0; 3]);
        assert!(normals[2][0] > 0.0);
    }

    /// The definition, point by point.
    fn plain(points: &[[f32; 3]], spacing: f64) -> Vec<[f32; 3]> {
        let radius = RADIUS * spacing;
        let flat = core::f64::consts::PI * RADIUS.powi(3) / 24.0;
        let normal = |p: &[f32; 3]| {
            let mut sum = [0.0f64; 3];
            for q in points {
                let d = [0, 1, 2].map(|a| (f64::from(p[a]) - f64::from(q[a])) / radius);
                let left = (1.0 - d.iter().map(|x| x * x).sum::<f64>()).max(0.0);
                (0..3).for_each(|a| sum[a] += left * left * d[a] / flat);
            }
            let length = sum.iter().map(|x| x * x).sum::<f64>().sqrt();
            sum.map(|x| (x / length.max(1.0)) as f32)
        };
        points.iter().map(normal).collect()
    }

    #[test]
    fn all_levels_agree_with_the_definition() {
        let mut points = cube();
        // Off the lattice, and across cells of either sign.
        for (i, p) in points.iter_mut().enumerate() {
            let t = i as f32;
            *p = [p[0] + 0.004 * (1.7 * t).sin(), p[1] - 0.05 + 0.004 * (2.3 * t).sin(), p[2] + 0.003 * t.cos()];
        }
        points.push([5.0, 0.0, 0.0]);
        let wanted = plain(&points, 0.02);
        for level in Level::supported() {
            let normals = normals_with(level, &points, 0.02);
            for (n, w) in normals.iter().zip(&wanted) {
                assert!((0..3).all(|a| (n[a] - w[a]).abs() < 1e-5), "{level:?}: {n:?} {w:?}");
            }
        }
    }
}
