//! How much room a field's level set takes up.

use rayon::prelude::*;

use crate::field::DensityField;

impl DensityField {
    /// Volume where the interpolated field is at least `threshold` [m^3]: each voxel counted at 2x2x2 interior
    /// points, with a linear ramp across the threshold so that the value varies smoothly with it.
    pub fn volume(&self, threshold: f64) -> f64 {
        let [nx, ny, nz] = self.size;
        let slice_volume = |z: usize| -> f64 {
            let (low, high) = self.bounds_around(z);
            let share = |i: usize| {
                // The slope at no interior point of a voxel is more than this: further from the threshold, the ramp
                // is saturated.
                let steepest = 3f64.sqrt() * 0.5 * f64::from(high[i] - low[i]);
                if f64::from(low[i]) - threshold > 0.5 * steepest {
                    1.0
                } else if threshold - f64::from(high[i]) > 0.5 * steepest {
                    0.0
                } else {
                    self.share_within(threshold, [i % nx, i / nx, z])
                }
            };
            (0..nx * ny).map(share).sum()
        };
        let slices: Vec<f64> = (0..nz).into_par_iter().map(slice_volume).collect();
        slices.iter().sum::<f64>() * self.spacing.powi(3)
    }

    /// Least and largest value of the 3x3x3 voxels around each voxel of slice `z`.
    fn bounds_around(&self, z: usize) -> (Vec<f32>, Vec<f32>) {
        let [nx, ny, nz] = self.size;
        let slice = |z: usize| &self.values[z * nx * ny..(z + 1) * nx * ny];
        let bound = |of: fn(f32, f32) -> f32| {
            let join = |values: &mut [f32], others: &[f32]| {
                values.iter_mut().zip(others).for_each(|(v, &other)| *v = of(*v, other));
            };
            let mut column = slice(z).to_vec();
            for z in [z.max(1) - 1, (z + 1).min(nz - 1)] {
                join(&mut column, slice(z));
            }
            let mut sheet = column.clone();
            join(&mut sheet[nx..], &column[..nx * (ny - 1)]);
            join(&mut sheet[..nx * (ny - 1)], &column[nx..]);
            let mut all = sheet.clone();
            for (row, around) in all.chunks_exact_mut(nx).zip(sheet.chunks_exact(nx)) {
                join(&mut row[1..], &around[..nx - 1]);
                join(&mut row[..nx - 1], &around[1..]);
            }
            all
        };
        (bound(f32::min), bound(f32::max))
    }

    /// Share of a voxel where the interpolated field is at least `threshold`.
    fn share_within(&self, threshold: f64, voxel: [usize; 3]) -> f64 {
        let patch = self.neighbourhood(voxel);
        let fine = refine(&patch);
        let at = |x: usize, y: usize, z: usize| fine[x + 4 * (y + 4 * z)];
        let interior = |k: usize| {
            let (x, y, z) = (1 + k % 2, 1 + k / 2 % 2, 1 + k / 4);
            let d = |a: f32, b: f32| f64::from(a - b) * 0.5;
            let gx = d(at(x + 1, y, z), at(x - 1, y, z));
            let gy = d(at(x, y + 1, z), at(x, y - 1, z));
            let gz = d(at(x, y, z + 1), at(x, y, z - 1));
            // Signed distance to the level in fine voxels, along the gradient; a plane cuts a voxel roughly linearly.
            let slope = (gx * gx + gy * gy + gz * gz).sqrt().max(1e-6);
            (0.5 + (f64::from(at(x, y, z)) - threshold) / slope).clamp(0.0, 1.0)
        };
        (0..8).map(interior).sum::<f64>() / 8.0
    }

    /// The values of the 3x3x3 voxels around one, x fastest; beyond the grid those of the outermost voxels.
    #[inline]
    fn neighbourhood(&self, [x, y, z]: [usize; 3]) -> [f32; 27] {
        let around = |c: usize, n: usize| [c.max(1) - 1, c, (c + 1).min(n - 1)];
        let (xs, ys, zs) = (around(x, self.size[0]), around(y, self.size[1]), around(z, self.size[2]));
        let mut values = [0.0; 27];
        for (k, value) in values.iter_mut().enumerate() {
            *value = self.values[self.index(xs[k % 3], ys[k / 3 % 3], zs[k / 9])];
        }
        values
    }
}

/// Trilinear interpolation of 3x3x3 values at 4x4x4 points half as far apart, around the same centre.
fn refine(coarse: &[f32; 27]) -> [f32; 64] {
    // Along each axis a point lies between two neighbours, a quarter of their distance from the nearer one.
    const BETWEEN: [(usize, usize); 4] = [(0, 1), (1, 0), (1, 2), (2, 1)];
    let mut fine = [0.0; 64];
    for (k, value) in fine.iter_mut().enumerate() {
        let [(x0, x1), (y0, y1), (z0, z1)] = [k % 4, k / 4 % 4, k / 16].map(|i| BETWEEN[i]);
        let along_x = |y, z| 0.75 * coarse[x0 + 3 * (y + 3 * z)] + 0.25 * coarse[x1 + 3 * (y + 3 * z)];
        let along_y = |z| 0.75 * along_x(y0, z) + 0.25 * along_x(y1, z);
        *value = 0.75 * along_y(z0) + 0.25 * along_y(z1);
    }
    fine
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    /// A field with the antialiased share of each voxel inside a ball.
    fn ball(radius: f64, spacing: f64) -> DensityField {
        let r = DVec3::splat(1.3 * radius);
        let mut field = DensityField::covering(-r, r, spacing, 2).unwrap();
        for i in 0..field.len() {
            let distance = radius - field.centre(field.voxel(i)).length();
            field.values[i] = (0.5 + distance / spacing).clamp(0.0, 1.0) as f32;
        }
        field
    }

    #[test]
    fn volume_of_a_ball_is_sub_voxel_accurate() {
        for spacing in [0.02, 0.0125] {
            let field = ball(0.1, spacing);
            let truth = 4.0 / 3.0 * std::f64::consts::PI * 1e-3;
            let error = field.volume(0.5) / truth - 1.0;
            assert!(error.abs() < 0.02, "{spacing}: {error}");
        }
    }
}
