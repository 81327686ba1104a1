//! The density field F: values at the centres of the voxels of a regular grid, and the operations of Algorithm 1 on it.

use glam::DVec3;
use rayon::prelude::*;

use crate::error::GeometryError;

/// More voxels than this are refused: 4 bytes each, and filling needs a few fields.
pub const MAX_VOXELS: f64 = 4e7;

/// Values in [0, 1] at voxel centres; outside the grid the field is zero.
#[derive(Clone, Debug, PartialEq)]
pub struct DensityField {
    /// Lower corner of the first voxel [m].
    pub origin: DVec3,
    /// Side of a voxel [m].
    pub spacing: f64,
    /// Number of voxels along x, y, z.
    pub size: [usize; 3],
    /// Densities, x fastest, then y, then z, shape [nz, ny, nx].
    pub values: Vec<f32>,
}

impl DensityField {
    /// A field of zeros that covers the box `low`..`high` [m] with voxels of side `spacing` [m], the number of voxels
    /// along each axis being a multiple of `multiple`.
    pub fn covering(low: DVec3, high: DVec3, spacing: f64, multiple: usize) -> Result<DensityField, GeometryError> {
        let count = (high - low) / spacing;
        let voxels = count.to_array().iter().map(|c| c.max(1.0)).product::<f64>();
        if !(count.is_finite() && voxels <= MAX_VOXELS) {
            return Err(GeometryError::TooManyVoxels { voxels, limit: MAX_VOXELS });
        }
        let size = count.to_array().map(|c| (c - 1e-9).ceil().max(1.0) as usize).map(|c| c.next_multiple_of(multiple));
        let extent = DVec3::from_array(size.map(|n| n as f64)) * spacing;
        Ok(DensityField {
            origin: 0.5 * (low + high) - 0.5 * extent,
            spacing,
            size,
            values: vec![0.0; size[0] * size[1] * size[2]],
        })
    }

    /// Number of voxels.
    #[inline]
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// Whether there are no voxels.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// Index into `values` of voxel (x, y, z).
    #[inline]
    pub fn index(&self, x: usize, y: usize, z: usize) -> usize {
        x + self.size[0] * (y + self.size[1] * z)
    }

    /// The voxel of an index.
    #[inline]
    pub fn voxel(&self, index: usize) -> [usize; 3] {
        [index % self.size[0], index / self.size[0] % self.size[1], index / (self.size[0] * self.size[1])]
    }

    /// Centre of voxel (x, y, z) [m].
    #[inline]
    pub fn centre(&self, [x, y, z]: [usize; 3]) -> DVec3 {
        self.origin + self.spacing * (DVec3::new(x as f64, y as f64, z as f64) + 0.5)
    }

    /// The voxel that holds a point [m] (the paper's Discretize); `None` outside the grid.
    #[inline]
    pub fn discretize(&self, point: DVec3) -> Option<usize> {
        let p = ((point - self.origin) / self.spacing).floor();
        let inside = |c: f64, n: usize| c >= 0.0 && c < n as f64;
        (inside(p.x, self.size[0]) && inside(p.y, self.size[1]) && inside(p.z, self.size[2]))
            .then(|| self.index(p.x as usize, p.y as usize, p.z as usize))
    }

    /// Indices of the 3x3x3 voxels around one, those in the grid.
    #[inline]
    pub fn around(&self, index: usize) -> impl Iterator<Item = usize> + '_ {
        self.within(index, 1)
    }

    /// Indices of the voxels no more than `reach` voxels from one along each axis, those in the grid.
    #[inline]
    pub fn within(&self, index: usize, reach: usize) -> impl Iterator<Item = usize> + '_ {
        let [x, y, z] = self.voxel(index);
        let range = |c: usize, n: usize| c.saturating_sub(reach)..(c + reach + 1).min(n);
        let [xs, ys, zs] = [range(x, self.size[0]), range(y, self.size[1]), range(z, self.size[2])];
        zs.flat_map(move |z| {
            let (xs, ys) = (xs.clone(), ys.clone());
            ys.flat_map(move |y| xs.clone().map(move |x| self.index(x, y, z)))
        })
    }

    /// The value of voxel (x, y, z); zero outside the grid.
    #[inline]
    fn at(&self, x: i64, y: i64, z: i64) -> f32 {
        let [nx, ny, nz] = self.size.map(|n| n as i64);
        if x < 0 || y < 0 || z < 0 || x >= nx || y >= ny || z >= nz {
            0.0
        } else {
            self.values[(x + nx * (y + ny * z)) as usize]
        }
    }

    /// Trilinear interpolation of the field at a point [m]; falls to zero outside the grid.
    #[inline]
    pub fn sample(&self, point: DVec3) -> f64 {
        let p = (point - self.origin) / self.spacing - 0.5;
        let cell = p.floor();
        let t = p - cell;
        let (x, y, z) = (cell.x as i64, cell.y as i64, cell.z as i64);
        let along_x = |y, z| f64::from(self.at(x, y, z)) * (1.0 - t.x) + f64::from(self.at(x + 1, y, z)) * t.x;
        let along_y = |z| along_x(y, z) * (1.0 - t.y) + along_x(y + 1, z) * t.y;
        along_y(z) * (1.0 - t.z) + along_y(z + 1) * t.z
    }

    /// Gradient of the interpolated field at a point [1/m], by central differences over one voxel.
    #[inline]
    pub fn gradient(&self, point: DVec3) -> DVec3 {
        let h = 0.5 * self.spacing;
        let along = |axis: DVec3| (self.sample(point + h * axis) - self.sample(point - h * axis)) / (2.0 * h);
        DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z))
    }

    /// Twice as many voxels along each axis, trilinearly interpolated (Algorithm 1, line 10); constant beyond the
    /// outermost centres.
    pub fn upsample(&self) -> DensityField {
        let size = self.size.map(|n| 2 * n);
        let clamp = |c: i64, n: usize| c.clamp(0, n as i64 - 1) as usize;
        // The centre of fine voxel i lies a quarter of a coarse voxel from the centre of its parent i / 2.
        let parents = |i: usize, n: usize| {
            let parent = (i / 2) as i64;
            (clamp(parent, n), clamp(if i.is_multiple_of(2) { parent - 1 } else { parent + 1 }, n))
        };
        let mut values = vec![0.0; size[0] * size[1] * size[2]];
        values.par_chunks_exact_mut(size[0] * size[1]).enumerate().for_each(|(z, slice)| {
            let (z0, z1) = parents(z, self.size[2]);
            for (y, row) in slice.chunks_exact_mut(size[0]).enumerate() {
                let (y0, y1) = parents(y, self.size[1]);
                for (x, value) in row.iter_mut().enumerate() {
                    let (x0, x1) = parents(x, self.size[0]);
                    let along_x =
                        |y, z| 0.75 * self.values[self.index(x0, y, z)] + 0.25 * self.values[self.index(x1, y, z)];
                    let along_y = |z| 0.75 * along_x(y0, z) + 0.25 * along_x(y1, z);
                    *value = 0.75 * along_y(z0) + 0.25 * along_y(z1);
                }
            }
        });
        DensityField { origin: self.origin, spacing: 0.5 * self.spacing, size, values }
    }

    /// Half as many voxels along each axis, each the mean of eight; the sizes must be even.
    pub fn pool(&self) -> DensityField {
        let size = self.size.map(|n| n / 2);
        let mut values = vec![0.0; size[0] * size[1] * size[2]];
        values.par_chunks_exact_mut(size[0] * size[1]).enumerate().for_each(|(z, slice)| {
            for (i, value) in slice.iter_mut().enumerate() {
                let (x, y) = (i % size[0], i / size[0]);
                let mut sum = 0.0;
                for k in 0..8 {
                    sum += self.values[self.index(2 * x + k % 2, 2 * y + k / 2 % 2, 2 * z + k / 4)];
                }
                *value = sum / 8.0;
            }
        });
        DensityField { origin: self.origin, spacing: 2.0 * self.spacing, size, values }
    }

    /// Weighted mean over the 3x3x3 neighbourhood, the weights along each axis being (side, 1 - 2 side, side): one
    /// third is the mean filter of Algorithm 1, line 13; one quarter is gentler. Zero outside the grid.
    pub fn mean_filter(&mut self, side: f32) {
        let [nx, ny, nz] = self.size;
        let middle = 1.0 - 2.0 * side;
        self.values.par_chunks_exact_mut(nx * ny).for_each(|slice| {
            let mut line = vec![0.0f32; nx.max(ny) + 2];
            for row in slice.chunks_exact_mut(nx) {
                line[1..=nx].copy_from_slice(row);
                line[nx + 1] = 0.0;
                for (x, v) in row.iter_mut().enumerate() {
                    *v = side * (line[x] + line[x + 2]) + middle * line[x + 1];
                }
            }
            for x in 0..nx {
                for y in 0..ny {
                    line[y + 1] = slice[y * nx + x];
                }
                line[ny + 1] = 0.0;
                for y in 0..ny {
                    slice[y * nx + x] = side * (line[y] + line[y + 2]) + middle * line[y + 1];
                }
            }
        });
        let old = self.values.clone();
        let plane = nx * ny;
        self.values.par_chunks_exact_mut(plane).enumerate().for_each(|(z, slice)| {
            let below = (z > 0).then(|| &old[(z - 1) * plane..z * plane]);
            let above = (z + 1 < nz).then(|| &old[(z + 1) * plane..(z + 2) * plane]);
            for (i, v) in slice.iter_mut().enumerate() {
                *v = side * (below.map_or(0.0, |b| b[i]) + above.map_or(0.0, |a| a[i])) + middle * *v;
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn sampling_and_upsampling_reproduce_a_linear_field_inside() {
        let mut field = DensityField::covering(DVec3::ZERO, DVec3::new(0.8, 0.6, 1.0), 0.1, 1).unwrap();
        let linear = |p: DVec3| 0.1 + 0.3 * p.x - 0.2 * p.y + 0.4 * p.z;
        for i in 0..field.len() {
            field.values[i] = linear(field.centre(field.voxel(i))) as f32;
        }
        let p = DVec3::new(0.33, 0.27, 0.61);
        assert!((field.sample(p) - linear(p)).abs() < 1e-6);
        assert!((field.gradient(p) - DVec3::new(0.3, -0.2, 0.4)).length() < 1e-4);
        let fine = field.upsample();
        let voxel = [7, 5, 9];
        let value = fine.values[fine.index(voxel[0], voxel[1], voxel[2])];
        assert!((f64::from(value) - linear(fine.centre(voxel))).abs() < 1e-6);
    }

    #[test]
    fn too_fine_a_grid_is_refused() {
        let refused = DensityField::covering(DVec3::ZERO, DVec3::ONE, 1e-3, 8);
        assert!(matches!(refused, Err(GeometryError::TooManyVoxels { .. })));
        assert!(DensityField::covering(DVec3::ZERO, DVec3::splat(f64::NAN), 0.1, 8).is_err());
    }

    proptest! {
        #[test]
        fn mean_filter_keeps_bounds_and_away_from_the_border_the_sum(
            seed in prop::collection::vec(0.0f32..1.0, 64),
        ) {
            let mut field = DensityField::covering(DVec3::ZERO, DVec3::splat(0.6), 0.1, 1).unwrap();
            prop_assert_eq!(field.size, [6, 6, 6]);
            for (i, &v) in seed.iter().enumerate() {
                let index = field.index(1 + i % 4, 1 + i / 4 % 4, 1 + i / 16);
                field.values[index] = v;
            }
            let before: f32 = field.values.iter().sum();
            field.mean_filter(1.0 / 3.0);
            let after: f32 = field.values.iter().sum();
            prop_assert!((before - after).abs() < 1e-3 * before.max(1.0));
            prop_assert!(field.values.iter().all(|&v| (-1e-6..=1.0 + 1e-6).contains(&v)));
        }

        #[test]
        fn pooling_keeps_the_mean(seed in prop::collection::vec(0.0f32..1.0, 64)) {
            let field = DensityField { origin: DVec3::ZERO, spacing: 0.1, size: [4, 4, 4], values: seed.clone() };
            let pooled = field.pool();
            let mean = |v: &[f32]| v.iter().sum::<f32>() / v.len() as f32;
            prop_assert!((mean(&seed) - mean(&pooled.values)).abs() < 1e-5);
        }
    }
}
