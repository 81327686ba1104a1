//! Which way the outside is, for points that fill a body: what light on them depends on.

use rayon::prelude::*;

/// Radius of the neighbourhood, in spacings of the points.
const RADIUS: f64 = 2.5;

/// For points about `spacing` [m] apart that fill a body: the direction to the outside, shape [n, 3]. About of length 1 on the
/// surface, shorter below it, and near zero where there is matter all around.
///
/// It is the mean offset from the neighbours within 2.5 spacings, weighted by (1 - r^2 / R^2)^2 and divided by what a flat
/// surface gives, cut at length 1. Points that are not finite get zero.
pub fn outward_normals(points: &[[f32; 3]], spacing: f64) -> Vec<[f32; 3]> {
    // In units of half the radius, which is the cells' side: cells are few to look into and little larger than the ball.
    let scale = 2.0 / (RADIUS * spacing);
    let scaled: Vec<[f32; 3]> = points.iter().map(|p| p.map(|x| (f64::from(x) * scale) as f32)).collect();
    let cells = Cells::new(&scaled);
    // Integral of the weighted height over a half ball of matter: pi (R / s)^3 / 24, in units of R.
    let flat = (2.0 * core::f64::consts::PI * RADIUS.powi(3) / 24.0) as f32;
    scaled.par_iter().map(|&p| shortened(cells.offset(p).map(|o| o / flat))).collect()
}

fn shortened(v: [f32; 3]) -> [f32; 3] {
    let length = v.iter().map(|x| x * x).sum::<f32>().sqrt();
    if length.is_finite() { v.map(|x| x / length.max(1.0)) } else { [0.0; 3] }
}

/// Points sorted by the cell of a grid of side 1 that they are in.
struct Cells {
    /// The cells, ascending.
    cells: Vec<[i32; 3]>,
    /// The point of each entry.
    points: Vec<[f32; 3]>,
}

impl Cells {
    fn new(points: &[[f32; 3]]) -> Cells {
        let mut order: Vec<([i32; 3], u32)> = points.iter().enumerate().map(|(i, &p)| (cell(p), i as u32)).collect();
        order.par_sort_unstable();
        let points = order.iter().map(|&(_, i)| points[i as usize]).collect();
        Cells { cells: order.into_iter().map(|(cell, _)| cell).collect(), points }
    }

    /// Weighted sum of the offsets of `p` from its neighbours, those nearer than 2.
    fn offset(&self, p: [f32; 3]) -> [f32; 3] {
        let [cx, cy, cz] = cell(p);
        let mut sum = [0.0f32; 3];
        for x in cx.saturating_sub(2)..=cx.saturating_add(2) {
            for y in cy.saturating_sub(2)..=cy.saturating_add(2) {
                // Cells that differ in z only lie side by side.
                let (low, high) = ([x, y, cz.saturating_sub(2)], [x, y, cz.saturating_add(2)]);
                let start = self.cells.partition_point(|cell| *cell < low);
                let end = start + self.cells[start..].partition_point(|cell| *cell <= high);
                for q in &self.points[start..end] {
                    let d = [p[0] - q[0], p[1] - q[1], p[2] - q[2]];
                    // Phrased so that points that are no numbers weigh nothing.
                    let left = 1.0 - 0.25 * (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
                    if left > 0.0 {
                        let weight = left * left;
                        for axis in 0..3 {
                            sum[axis] += weight * d[axis];
                        }
                    }
                }
            }
        }
        sum
    }
}

/// Casting saturates, so that far away points share the outermost cells.
fn cell(p: [f32; 3]) -> [i32; 3] {
    p.map(|x| x.floor() as i32)
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
}
