//! One view at the resolution at which it is compared, and which part of it matters.

use gic_scene::Camera;
use glam::DVec2;

/// One view at the resolution at which it is compared.
#[derive(Clone, Debug)]
pub(crate) struct MaskView {
    /// Which device took it, by its place in the input.
    pub device: usize,
    /// The camera at the working resolution.
    pub camera: Camera,
    /// Observed coverage, row-major.
    pub mask: Vec<f32>,
    /// Where the mask is not empty.
    pub covered: Window,
}

/// A rectangle of pixels: columns and rows from the first up to, not including, the second.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Window {
    columns: (usize, usize),
    rows: (usize, usize),
}

impl Window {
    const EMPTY: Window = Window { columns: (usize::MAX, 0), rows: (usize::MAX, 0) };

    pub(crate) fn join(&mut self, columns: (usize, usize), rows: (usize, usize)) {
        self.columns = (self.columns.0.min(columns.0), self.columns.1.max(columns.1));
        self.rows = (self.rows.0.min(rows.0), self.rows.1.max(rows.1));
    }

    /// The window grown to whole blocks of `block` pixels, inside a picture of `size`.
    pub(crate) fn aligned(self, block: usize, size: (usize, usize)) -> Window {
        let grow = |(low, high): (usize, usize), length: usize| {
            if low >= high {
                return (0, 0);
            }
            let last = length / block * block;
            (low / block * block, (high.div_ceil(block) * block).min(last))
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
    pub(crate) fn new(device: usize, camera: &Camera, mask: &[f32], factor: usize) -> MaskView {
        let (camera, mask) = (pooled_camera(camera, factor), pool(mask, camera.width, camera.height, factor));
        let mut covered = Window::EMPTY;
        for (i, _) in mask.iter().enumerate().filter(|(_, m)| **m > 0.0) {
            let (x, y) = (i % camera.width, i / camera.width);
            covered.join((x, x + 1), (y, y + 1));
        }
        MaskView { device, camera, mask, covered }
    }
}

/// Length of the outlines in a picture of coverage [pixels]: its total variation, which does not depend on how soft an
/// edge is. What the picture's border cuts is no outline.
pub(crate) fn outline_length(coverage: &[f32], width: usize, height: usize) -> f64 {
    let slope = |ahead: usize, behind: usize| 0.5 * f64::from(coverage[ahead] - coverage[behind]);
    let inner = (1..height.max(1) - 1).flat_map(|y| (1..width.max(1) - 1).map(move |x| y * width + x));
    inner.map(|i| slope(i + 1, i - 1).hypot(slope(i + width, i - width))).sum()
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

/// Side of a pixel of `camera` at the distance of `point` [m].
pub(crate) fn pixel_size(camera: &Camera, point: glam::DVec3) -> Option<f64> {
    let focal: DVec2 = camera.focal;
    camera.project(point).map(|(_, depth)| depth / (focal.x * focal.y).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_discs_outline_is_its_perimeter() {
        let (size, radius) = (64, 20.0);
        let distance = |i: usize| ((i % size) as f64 - 31.3).hypot((i / size) as f64 - 30.8);
        let disc: Vec<f32> = (0..size * size).map(|i| (radius + 0.5 - distance(i)).clamp(0.0, 1.0) as f32).collect();
        let length = outline_length(&disc, size, size);
        let perimeter = std::f64::consts::TAU * radius;
        assert!((length / perimeter - 1.0).abs() < 0.02, "{length} instead of {perimeter}");
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
