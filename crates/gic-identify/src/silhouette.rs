//! The re-rendered Gaussian-informed continuum: the alpha of isotropic Gaussians (paper eq. 2), compared with masks.
//!
//! Alpha alone does not depend on the order of the Gaussians, A(u) = 1 - prod_i (1 - o_i exp(-|u - mu_i|^2 / 2 sigma_i^2)), and an
//! isotropic Gaussian separates into a row and a column. So neither sorting nor tiles are needed, and a view of 8,000 particles
//! costs a fraction of a millisecond, which matters when every Jacobian re-renders every view once per unknown.

use gic_scene::Camera;
use glam::DVec2;

/// Gaussians end where they fall below exp(-8), at four standard deviations: an earlier end is a step that finite differences see.
const CUTOFF_SIGMAS: f32 = 4.0;

/// Blur of the pixel itself, in pixels^2, added to the projected variance (a box of one pixel has variance 1/12).
const PIXEL_VARIANCE: f32 = 1.0 / 12.0;

/// Pixels around what is drawn, for hypotheses that differ by a small step.
const MARGIN: usize = 4;

/// One view at the resolution at which it is compared.
#[derive(Clone, Debug)]
pub(crate) struct MaskView {
    /// Index of the camera in the input.
    pub camera_index: usize,
    /// The camera at the working resolution.
    pub camera: Camera,
    /// Observed coverage, row-major.
    pub mask: Vec<f32>,
    /// Where the mask is not empty.
    covered: Window,
}

/// A rectangle of pixels: columns and rows from the first up to, not including, the second.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Window {
    columns: (usize, usize),
    rows: (usize, usize),
}

impl Window {
    const EMPTY: Window = Window { columns: (usize::MAX, 0), rows: (usize::MAX, 0) };

    fn join(&mut self, columns: (usize, usize), rows: (usize, usize)) {
        self.columns = (self.columns.0.min(columns.0), self.columns.1.max(columns.1));
        self.rows = (self.rows.0.min(rows.0), self.rows.1.max(rows.1));
    }

    /// The window grown by `margin` and to whole blocks of `block` pixels, inside a picture of `size`.
    fn aligned(self, margin: usize, block: usize, size: (usize, usize)) -> Window {
        let grow = |(low, high): (usize, usize), length: usize| {
            if low >= high {
                return (0, 0);
            }
            let last = length / block * block;
            (low.saturating_sub(margin) / block * block, ((high + margin).div_ceil(block) * block).min(last))
        };
        Window { columns: grow(self.columns, size.0), rows: grow(self.rows, size.1) }
    }

    /// The camera that sees the window only.
    pub(crate) fn camera(&self, camera: &Camera) -> Camera {
        Camera {
            width: self.columns.1.saturating_sub(self.columns.0),
            height: self.rows.1.saturating_sub(self.rows.0),
            principal: camera.principal - DVec2::new(self.columns.0 as f64, self.rows.0 as f64),
            ..camera.clone()
        }
    }

    /// The window's pixels of a picture that is `width` wide.
    pub(crate) fn cut(&self, image: &[f32], width: usize) -> Vec<f32> {
        let row = |j: usize| image[j * width + self.columns.0..j * width + self.columns.1.max(self.columns.0)].iter();
        (self.rows.0..self.rows.1).flat_map(row).copied().collect()
    }
}

impl MaskView {
    /// Averages a picture over blocks of `factor` x `factor` pixels; an incomplete last row or column is dropped.
    pub(crate) fn new(camera_index: usize, camera: &Camera, mask: &[f32], factor: usize) -> MaskView {
        let (camera, mask) = (pooled_camera(camera, factor), pool(mask, camera.width, camera.height, factor));
        let mut covered = Window::EMPTY;
        for (i, _) in mask.iter().enumerate().filter(|(_, m)| **m > 0.0) {
            let (x, y) = (i % camera.width, i / camera.width);
            covered.join((x, x + 1), (y, y + 1));
        }
        MaskView { camera_index, camera, mask, covered }
    }

    /// The pixels that the particles or the mask cover, with a margin for small moves, in whole blocks of `block` pixels.
    pub(crate) fn window(&self, positions: &[[f32; 3]], splats: Splats, block: usize) -> Window {
        let eye = Eye::new(&self.camera);
        let mut window = self.covered;
        for (i, position) in positions.iter().enumerate() {
            if let Some(f) = eye.footprint(*position, splats.opacities[i], splats.scales[i] * splats.factor) {
                window.join(f.columns, f.rows);
            }
        }
        window.aligned(MARGIN, block, (self.camera.width, self.camera.height))
    }
}

fn pooled_camera(camera: &Camera, factor: usize) -> Camera {
    let f = factor as f64;
    Camera {
        width: camera.width / factor,
        height: camera.height / factor,
        focal: camera.focal / f,
        principal: camera.principal / f,
        ..camera.clone()
    }
}

/// Mean over blocks of `factor` x `factor` pixels.
pub(crate) fn pool(image: &[f32], width: usize, height: usize, factor: usize) -> Vec<f32> {
    if factor == 1 {
        return image.to_vec();
    }
    let (w, h) = (width / factor, height / factor);
    let share = 1.0 / (factor * factor) as f32;
    let mut out = vec![0.0f32; w * h];
    for y in 0..h {
        let row = &mut out[y * w..(y + 1) * w];
        for line in 0..factor {
            let source = &image[(y * factor + line) * width..][..w * factor];
            for (value, block) in row.iter_mut().zip(source.chunks_exact(factor)) {
                *value += block.iter().sum::<f32>() * share;
            }
        }
    }
    out
}

/// Attributes of the continuum's Gaussians that stay the same over time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Splats<'a> {
    /// Opacity at the centre, shape [n].
    pub opacities: &'a [f32],
    /// Standard deviation [m], shape [n].
    pub scales: &'a [f32],
    /// Factor on every standard deviation.
    pub factor: f32,
}

/// One Gaussian as a camera sees it: what both passes over the pixels need.
struct Footprint {
    /// Camera coordinates [m].
    camera: glam::Vec3,
    /// Centre [pixels].
    centre: (f32, f32),
    /// Projected variance [pixels^2].
    variance: f32,
    /// Of the [`Falloff`] along rows and columns.
    growth: f32,
    /// Alpha at the centre.
    peak: f32,
    columns: (usize, usize),
    rows: (usize, usize),
}

/// World-to-camera in single precision.
struct Eye {
    turn: glam::Mat3,
    centre: glam::Vec3,
    focal: glam::Vec2,
    /// Geometric mean of the focal lengths [pixels].
    mean_focal: f32,
    principal: glam::Vec2,
    size: (usize, usize),
}

impl Eye {
    fn new(camera: &Camera) -> Eye {
        let focal = camera.focal.as_vec2();
        Eye {
            turn: camera.rotation.as_mat3().transpose(),
            centre: camera.centre.as_vec3(),
            focal,
            mean_focal: (focal.x * focal.y).sqrt(),
            principal: camera.principal.as_vec2(),
            size: (camera.width, camera.height),
        }
    }

    /// `None` where the Gaussian is not in the picture. A NaN position is not drawn; a Gaussian around the camera itself has no
    /// silhouette.
    fn footprint(&self, position: [f32; 3], opacity: f32, sigma_m: f32) -> Option<Footprint> {
        let c = self.turn * (glam::Vec3::from_array(position) - self.centre);
        if !(c.z > CUTOFF_SIGMAS * sigma_m && c.z > 1e-3) {
            return None;
        }
        let (x, y) = (self.focal.x * c.x / c.z + self.principal.x, self.focal.y * c.y / c.z + self.principal.y);
        let sigma = self.mean_focal * sigma_m / c.z;
        let variance = sigma * sigma + PIXEL_VARIANCE;
        let radius = CUTOFF_SIGMAS * variance.sqrt();
        Some(Footprint {
            camera: c,
            centre: (x, y),
            variance,
            growth: (-1.0 / variance).exp(),
            // The low pass widens the Gaussian; its peak falls so that its integral stays.
            peak: opacity * sigma * sigma / variance,
            columns: span(x, radius, self.size.0)?,
            rows: span(y, radius, self.size.1)?,
        })
    }
}

impl Footprint {
    /// Writes the falloff of each column to the beginning of `row`, and returns it.
    fn falloff<'a>(&self, row: &'a mut [f32]) -> &'a [f32] {
        let columns = &mut row[..self.columns.1 - self.columns.0];
        let mut falloff = Falloff::new(self.columns.0, self.centre.0, self.variance, self.growth);
        for column in &mut *columns {
            *column = falloff.value;
            falloff.advance();
        }
        columns
    }

    /// Each row with its alpha at the centre column.
    fn rows(&self) -> impl Iterator<Item = (usize, f32)> {
        let mut falloff = Falloff::new(self.rows.0, self.centre.1, self.variance, self.growth);
        let peak = self.peak;
        (self.rows.0..self.rows.1).map(move |j| {
            let value = falloff.value;
            falloff.advance();
            (j, peak * value)
        })
    }
}

/// exp(-d^2 / 2 variance) at one pixel's centre after the other, d being its distance from the Gaussian's: the ratio of neighbours grows
/// by a constant factor, so that a whole row costs three exponentials.
struct Falloff {
    value: f32,
    ratio: f32,
    growth: f32,
}

impl Falloff {
    /// `growth` is exp(-1 / variance).
    fn new(first: usize, centre: f32, variance: f32, growth: f32) -> Falloff {
        let (d, half) = (first as f32 + 0.5 - centre, -0.5 / variance);
        Falloff { value: (half * d * d).exp(), ratio: (half * (2.0 * d + 1.0)).exp(), growth }
    }

    /// To the next pixel.
    fn advance(&mut self) {
        self.value *= self.ratio;
        self.ratio *= self.growth;
    }
}

/// Accumulated alpha of the particles at `positions` [m] in `camera`, row-major, shape [height * width].
pub(crate) fn alpha(positions: &[[f32; 3]], splats: Splats, camera: &Camera) -> Vec<f32> {
    let width = camera.width;
    let mut transmittance = vec![1.0f32; width * camera.height];
    let eye = Eye::new(camera);
    let mut row = vec![0.0f32; width];
    for (i, position) in positions.iter().enumerate() {
        let Some(footprint) = eye.footprint(*position, splats.opacities[i], splats.scales[i] * splats.factor) else {
            continue;
        };
        let columns = footprint.falloff(&mut row);
        let (x0, x1) = footprint.columns;
        for (j, weight) in footprint.rows() {
            for (t, column) in transmittance[j * width + x0..j * width + x1].iter_mut().zip(columns) {
                *t *= 1.0 - weight * column;
            }
        }
    }
    for t in &mut transmittance {
        *t = 1.0 - *t;
    }
    transmittance
}

/// Adds d loss / d position [per m] to `gradient`, given the rendered alpha and d loss / d alpha.
///
/// dA/d alpha_i = (1 - A) / (1 - alpha_i). The change of a Gaussian's width with its depth is small against the motion of its
/// centre across the outline, but it is included, so that finite differences agree.
pub(crate) fn alpha_backward(
    positions: &[[f32; 3]],
    splats: Splats,
    camera: &Camera,
    rendered: &[f32],
    bar: &[f32],
    gradient: &mut [glam::DVec3],
) {
    let width = camera.width;
    let eye = Eye::new(camera);
    let mut row = vec![0.0f32; width];
    for (i, position) in positions.iter().enumerate() {
        let sigma_m = splats.scales[i] * splats.factor;
        let Some(footprint) = eye.footprint(*position, splats.opacities[i], sigma_m) else { continue };
        let columns = footprint.falloff(&mut row);
        let (x0, x1) = footprint.columns;
        // d loss / d centre and d loss / d log(sigma in pixels).
        let (mut dx, mut dy, mut spread) = (0.0f32, 0.0f32, 0.0f32);
        let sigma_squared = footprint.variance - PIXEL_VARIANCE;
        for (j, weight) in footprint.rows() {
            let v = j as f32 + 0.5 - footprint.centre.1;
            for (k, column) in columns.iter().enumerate() {
                let at = j * width + x0 + k;
                if bar[at] == 0.0 {
                    continue;
                }
                let own = weight * column;
                let pull = bar[at] * (1.0 - rendered[at]) / (1.0 - own).max(1e-6) * own;
                let u = (x0 + k) as f32 + 0.5 - footprint.centre.0;
                dx += pull * u / footprint.variance;
                dy += pull * v / footprint.variance;
                // own = o s2/(s2 + b) exp(-d2 / 2(s2 + b)); by log sigma: 2 b/(s2 + b) + d2 s2/(s2 + b)^2.
                let d2 = u * u + v * v;
                spread += pull
                    * (2.0 * PIXEL_VARIANCE / footprint.variance + d2 * sigma_squared / footprint.variance.powi(2));
            }
        }
        debug_assert!(x1 >= x0);
        let c = footprint.camera;
        let across = glam::Vec3::new(
            dx * eye.focal.x / c.z,
            dy * eye.focal.y / c.z,
            -(dx * eye.focal.x * c.x + dy * eye.focal.y * c.y) / (c.z * c.z) - spread / c.z,
        );
        gradient[i] += (eye.turn.transpose() * across).as_dvec3();
    }
}

/// Pixels whose centres lie within `radius` of `at`, clipped to the picture; `None` where there are none.
fn span(at: f32, radius: f32, length: usize) -> Option<(usize, usize)> {
    let (low, high) = (at - radius - 0.5, at + radius - 0.5);
    if !(high >= 0.0 && low <= length as f32 - 1.0) {
        return None;
    }
    // Rounding up and down by casts, which are instructions where `ceil` and `floor` may be calls.
    let below = low.max(0.0) as usize;
    let first = if (below as f32) < low { below + 1 } else { below };
    let end = (high as usize + 1).min(length);
    (first < end).then_some((first, end))
}

/// Side of a pixel of `camera` at the distance of `point` [m].
pub(crate) fn pixel_size(camera: &Camera, point: glam::DVec3) -> Option<f64> {
    let focal: DVec2 = camera.focal;
    camera.project(point).map(|(_, depth)| depth / (focal.x * focal.y).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec3};
    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng};

    fn camera() -> Camera {
        Camera {
            width: 48,
            height: 40,
            focal: DVec2::splat(60.0),
            principal: DVec2::new(24.0, 20.0),
            rotation: DMat3::from_rotation_y(0.3) * DMat3::from_rotation_x(0.2),
            centre: DVec3::new(-0.3, 0.2, -1.0),
        }
    }

    fn cloud(n: usize) -> Vec<[f32; 3]> {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        (0..n).map(|_| [0; 3].map(|_: i32| 0.3 * random.random::<f32>() - 0.15)).collect()
    }

    #[test]
    fn agrees_with_the_rasteriser() {
        let positions = cloud(60);
        let (opacities, scales) = (vec![0.6; 60], vec![0.03; 60]);
        let splats = Splats { opacities: &opacities, scales: &scales, factor: 1.0 };
        let own = alpha(&positions, splats, &camera());
        let gaussians = gic_splat::Gaussians {
            positions,
            opacities,
            shape: gic_splat::Shape::Isotropic { scales },
            sh_degree: 0,
            sh: vec![[0.0; 3]; 60],
        };
        let reference = gic_splat::render(&gaussians, &camera(), &gic_splat::RenderSettings::default());
        // The rasteriser keeps the perspective's shear of each Gaussian and a wider low pass.
        let (mut difference, mut covered) = (0.0, 0.0);
        for (a, b) in own.iter().zip(&reference.alpha) {
            difference += (a - b).abs();
            covered += b;
        }
        assert!(covered > 100.0 && difference < 0.05 * covered, "{difference} of {covered}");
    }

    proptest! {
        #[test]
        fn falloff_is_the_gaussian(first in 0usize..400, off in 0.0f32..4.0, variance in 0.0834f32..60.0) {
            let centre = first as f32 + off * variance.sqrt();
            let count = (8.0 * variance.sqrt()).ceil() as usize;
            let mut falloff = Falloff::new(first, centre, variance, (-1.0 / variance).exp());
            for k in 0..count {
                let found = falloff.value;
                falloff.advance();
                let d = f64::from((first + k) as f32 + 0.5 - centre);
                let exact = (-0.5 * d * d / f64::from(variance)).exp();
                prop_assert!((f64::from(found) - exact).abs() < 2e-5, "{k}: {found} instead of {exact}");
            }
        }
    }

    #[test]
    fn gradient_agrees_with_finite_differences() {
        let positions = cloud(25);
        let (opacities, scales) = (vec![0.7; 25], vec![0.02; 25]);
        let splats = Splats { opacities: &opacities, scales: &scales, factor: 1.1 };
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(6);
        let bar: Vec<f32> = (0..48 * 40).map(|_| random.random::<f32>() - 0.5).collect();
        let loss = |positions: &[[f32; 3]]| -> f64 {
            alpha(positions, splats, &camera()).iter().zip(&bar).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
        };
        let rendered = alpha(&positions, splats, &camera());
        let mut gradient = vec![DVec3::ZERO; 25];
        alpha_backward(&positions, splats, &camera(), &rendered, &bar, &mut gradient);
        let largest = gradient.iter().map(|g| g.abs().max_element()).fold(0.0, f64::max);
        for i in 0..25 {
            for axis in 0..3 {
                let step = 1e-3f32;
                let moved = |by: f32| {
                    let mut p = positions.clone();
                    p[i][axis] += by;
                    loss(&p)
                };
                let numeric = (moved(step) - moved(-step)) / f64::from(2.0 * step);
                assert!((numeric - gradient[i][axis]).abs() < 0.02 * largest, "{i} {axis}: {numeric} {}", gradient[i]);
            }
        }
    }

    #[test]
    fn pooling_keeps_the_mean() {
        let image: Vec<f32> = (0..12 * 8).map(|i| i as f32).collect();
        let pooled = pool(&image, 12, 8, 4);
        assert_eq!(pooled.len(), 6);
        let mean = |v: &[f32]| v.iter().sum::<f32>() / v.len() as f32;
        assert!((mean(&pooled) - mean(&image)).abs() < 1e-4);
    }
}
