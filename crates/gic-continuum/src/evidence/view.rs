//! What one view says about a point: is it inside the mask, and is it in front of the rendered surface?

use std::sync::Arc;

use gic_scene::Camera;
use gic_splat::sh::C0;
use gic_splat::{Gaussians, RenderSettings, render};
use glam::{DVec2, DVec3};

use crate::ContinuumError;
use crate::fill::scale;

/// Pixels with less accumulated alpha than this have no rendered surface.
const SOLID: f32 = 0.5;
/// Ranges of obliqueness (the sine between ray and normal) in which the bias of the depth is measured.
const BINS: usize = 5;
/// Fewer samples than this say nothing about a range.
const MIN_SAMPLES: usize = 30;
/// Centres further than this from the rendered surface, in median standard deviations, are hidden or stray: no samples.
const VISIBLE_WITHIN: f32 = 2.5;

/// Half of the width of a hole that may be a gap between Gaussians, in median standard deviations.
const HOLE_SCALES: f64 = 3.0;

/// Gaussians of so many median standard deviations are large: flat faces that cameras look at from the front are drawn by them.
const LARGE: f32 = 1.3;
/// How much deeper below the surface a large Gaussian's centre lies, per standard deviation: on flat faces of four bodies centres lie 1.7 to 2
/// standard deviations deep, whichever way they look, of which the part that does not grow with them is a millimetre or two.
const DEEPER: f32 = 1.4;
/// Surfaces seen more obliquely than this are brought as near as at this cosine between ray and normal.
const LEAST_COSINE: f32 = 0.3;

/// A camera and the mask of the object in its image.
#[derive(Clone, Copy, Debug)]
pub struct MaskedView<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// Antialiased coverage of the object in [0, 1], row-major, shape [height * width]; `None` where this view has no mask in
    /// this frame: the view then says nothing.
    pub mask: Option<&'a [f32]>,
}

/// A view with its mask, its rendered depth map and how obliquely it sees the surface. Its mirror images share the pixels.
#[derive(Clone)]
pub(crate) struct Evidence<'a> {
    pub(crate) camera: &'a Camera,
    pub(crate) mask: &'a [f32],
    /// D(u) / A(u) [m]; infinite where nothing solid is drawn or no depth is asked for.
    pub(crate) depth: Arc<Vec<f32>>,
    /// Cosine between the ray and the normal of the rendered surface; 1 where there is no depth.
    pub(crate) cosine: Arc<Vec<f32>>,
    /// Where the rendered surface has a hole no wider than a few Gaussians, through which something behind it is drawn.
    pub(crate) hole: Arc<Vec<bool>>,
    pub(crate) bias: DepthBias,
}

/// Median distance of the Gaussians' centres behind the rendered depth, perpendicular to the surface [m], by obliqueness.
///
/// Accumulated depth is not that of the centres: seen at an angle, the Gaussians that lie nearer to the camera along the slope
/// are composited first and draw it towards the camera, by a good part of a standard deviation.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct DepthBias([f32; BINS]);

impl DepthBias {
    /// Measured on all visible centres in all views; ranges without enough samples take the nearest that has them.
    fn measure(gaussians: &Gaussians, views: &[Evidence], scale: f64) -> DepthBias {
        let window = VISIBLE_WITHIN * scale as f32;
        let mut samples: [Vec<f32>; BINS] = Default::default();
        for view in views {
            for p in &gaussians.positions {
                let Some((pixel, z)) = view.camera.project(DVec3::from(p.map(f64::from))) else { continue };
                let Some(i) = view.pixel_index(pixel) else { continue };
                let behind = (z as f32 - view.depth[i]) * view.cosine[i];
                if behind.abs() <= window {
                    samples[DepthBias::bin(view.cosine[i])].push(behind);
                }
            }
        }
        let mut medians = samples.map(|mut s| {
            s.sort_by(f32::total_cmp);
            (s.len() >= MIN_SAMPLES).then(|| s[s.len() / 2])
        });
        for i in 1..BINS {
            medians[i] = medians[i].or(medians[i - 1]);
        }
        for i in (0..BINS - 1).rev() {
            medians[i] = medians[i].or(medians[i + 1]);
        }
        DepthBias(medians.map(|m| m.unwrap_or(0.0)))
    }

    /// Least and largest of the biases [m].
    pub(crate) fn range(&self) -> [f32; 2] {
        self.0.iter().fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], &b| [low.min(b), high.max(b)])
    }

    fn bin(cosine: f32) -> usize {
        ((DepthBias::sine(cosine) * BINS as f32) as usize).min(BINS - 1)
    }

    fn sine(cosine: f32) -> f32 {
        (1.0 - cosine * cosine).max(0.0).sqrt()
    }

    /// The bias at an obliqueness, linear between the middles of the ranges.
    fn at(&self, cosine: f32) -> f32 {
        let t = (DepthBias::sine(cosine) * BINS as f32 - 0.5).clamp(0.0, (BINS - 1) as f32);
        let low = (t as usize).min(BINS - 2);
        self.0[low] + (t - low as f32) * (self.0[low + 1] - self.0[low])
    }
}

/// What a view says about a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Seen {
    /// Coverage of the mask at the point's projection.
    pub(crate) coverage: f32,
    /// Distance behind the surface on which the centres of the rendered Gaussians lie, about perpendicular to it [m]; negative
    /// in front of it; infinite where the view renders no surface there.
    pub(crate) behind: f32,
    /// Whether that surface is seen through a small hole in another one.
    pub(crate) through_hole: bool,
}

impl<'a> Evidence<'a> {
    /// Views that have a mask, with depth maps rendered from the Gaussians of a median scale [m] (Algorithm 1, lines 2 and 3).
    pub(crate) fn gather(
        views: &[MaskedView<'a>],
        gaussians: Option<(&Gaussians, f64)>,
    ) -> Result<Vec<Evidence<'a>>, ContinuumError> {
        let tinted = gaussians.map(|(gaussians, _)| tinted_by_scale(gaussians));
        let (mut gathered, mut sizes) = (Vec::new(), Vec::new());
        for (view, &MaskedView { camera, mask }) in views.iter().enumerate() {
            let Some(mask) = mask else { continue };
            let (width, height) = (camera.width, camera.height);
            if mask.len() != width * height {
                return Err(ContinuumError::MaskSize { view, found: mask.len(), width, height });
            }
            let (depth, size) = match &tinted {
                Some((gaussians, unit)) => depth_and_scale(gaussians, *unit, camera, mask),
                None => (vec![f32::INFINITY; mask.len()], Vec::new()),
            };
            sizes.push(size);
            let mut view = Evidence::with_depth(camera, mask, depth);
            if let Some((_, scale)) = gaussians {
                view.hole = Arc::new(small_holes(&view.depth, camera, scale));
            }
            gathered.push(view);
        }
        if gathered.is_empty() {
            return Err(ContinuumError::NoMasks { views: views.len() });
        }
        if let Some((gaussians, scale)) = gaussians {
            let bias = DepthBias::measure(gaussians, &gathered, scale);
            gathered.iter_mut().for_each(|view| view.bias = bias);
            gathered.iter_mut().zip(&sizes).for_each(|(view, sizes)| view.raise(sizes, scale as f32));
        }
        Ok(gathered)
    }

    /// A view with a depth map [m], infinite where there is no surface; its bias is not measured yet.
    pub(crate) fn with_depth(camera: &'a Camera, mask: &'a [f32], depth: Vec<f32>) -> Evidence<'a> {
        let cosine = Arc::new(cosines(&depth, camera));
        let hole = Arc::new(vec![false; depth.len()]);
        Evidence { camera, mask, depth: Arc::new(depth), cosine, hole, bias: DepthBias::default() }
    }

    /// Brings the surface nearer where it is drawn by Gaussians that are larger than most, with the standard deviations `sizes` [m] of each
    /// pixel's: their centres lie deeper (see [`DEEPER`]).
    fn raise(&mut self, sizes: &[f32], median: f32) {
        for ((depth, cosine), size) in Arc::make_mut(&mut self.depth).iter_mut().zip(self.cosine.iter()).zip(sizes) {
            if depth.is_finite() {
                *depth -= DEEPER * (size - LARGE * median).max(0.0) / cosine.max(LEAST_COSINE);
            }
        }
    }

    /// The pixel that holds image coordinates; `None` outside the image.
    fn pixel_index(&self, pixel: DVec2) -> Option<usize> {
        let (w, h) = (self.camera.width, self.camera.height);
        let inside = pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < w as f64 && pixel.y < h as f64;
        inside.then(|| pixel.y as usize * w + pixel.x as usize)
    }

    /// Unit vector from a point [m] to the camera.
    pub(crate) fn direction_from(&self, point: DVec3) -> DVec3 {
        (self.camera.centre - point).normalize_or_zero()
    }

    /// What this view says about a point [m]; `None` where it does not see it: behind the camera or outside the image.
    pub(crate) fn look(&self, point: DVec3) -> Option<Seen> {
        let (pixel, z) = self.camera.project(point)?;
        let p = pixel - 0.5;
        let (w, h) = (self.camera.width, self.camera.height);
        if !(p.x >= -0.5 && p.y >= -0.5 && p.x < w as f64 - 0.5 && p.y < h as f64 - 0.5) {
            return None;
        }
        // One more than the floor: both coordinates are at least -1/2, and casting truncates towards zero.
        let (x, y) = ((p.x + 1.0) as usize, (p.y + 1.0) as usize);
        let t = DVec2::new(p.x + 1.0 - x as f64, p.y + 1.0 - y as f64).as_vec2();
        let (left, right) = (x.max(1) - 1, x.min(w - 1));
        let (top, bottom) = (w * (y.max(1) - 1), w * y.min(h - 1));
        let corners = [top + left, top + right, bottom + left, bottom + right];
        let weights = [(1.0 - t.x) * (1.0 - t.y), t.x * (1.0 - t.y), (1.0 - t.x) * t.y, t.x * t.y];
        let coverage = corners.iter().zip(weights).map(|(&i, w)| self.mask[i] * w).sum();
        // The front-most of the four pixels: interpolating across an occluding edge would invent a surface between.
        let (mut depth, mut cosine) = (f32::INFINITY, 1.0);
        for &i in &corners {
            if self.depth[i] < depth {
                (depth, cosine) = (self.depth[i], self.cosine[i]);
            }
        }
        // Where the surface is continuous, interpolate after all.
        let spread = corners.iter().map(|&i| self.depth[i] - depth).fold(0.0, f32::max);
        if spread.is_finite() && spread * self.camera.focal.x as f32 <= 4.0 * depth {
            depth = corners.iter().zip(weights).map(|(&i, w)| self.depth[i] * w).sum();
        }
        let behind = if depth.is_finite() { (z as f32 - depth) * cosine - self.bias.at(cosine) } else { f32::INFINITY };
        let through_hole = corners.iter().any(|&i| self.hole[i]);
        Some(Seen { coverage, behind, through_hole })
    }
}

/// The Gaussians with their standard deviations as colours, in units of the largest, which comes with them [m].
fn tinted_by_scale(gaussians: &Gaussians) -> (Gaussians, f32) {
    let scales: Vec<f32> = (0..gaussians.positions.len()).map(|i| scale(gaussians, i)).collect();
    let unit = scales.iter().copied().fold(f32::MIN_POSITIVE, f32::max);
    let constant = |colour: f32| [((f64::from(colour) - 0.5) / C0) as f32; 3];
    let sh = scales.iter().map(|scale| constant(scale / unit)).collect();
    (Gaussians { sh_degree: 0, sh, ..gaussians.clone() }, unit)
}

/// D / A [m] where the Gaussians are solid and the mask covers, else infinite, and the mean standard deviation of what is drawn there [m]; of
/// Gaussians that are tinted by it in this unit.
fn depth_and_scale(tinted: &Gaussians, unit: f32, camera: &Camera, mask: &[f32]) -> (Vec<f32>, Vec<f32>) {
    let rendered = render(tinted, camera, &RenderSettings::default());
    let pixel = |i: usize| {
        let alpha = rendered.alpha[i];
        if alpha >= SOLID && mask[i] > 0.0 {
            (rendered.depth[i] / alpha, unit * rendered.color[i][0] / alpha)
        } else {
            (f32::INFINITY, 0.0)
        }
    };
    (0..mask.len()).map(pixel).unzip()
}

/// Pixels where the surface [m] lies more than the Gaussians' median scale [m] behind its morphological opening: that fills every hole
/// narrower than its window, and leaves slopes and steps as they are.
fn small_holes(depth: &[f32], camera: &Camera, scale: f64) -> Vec<bool> {
    let solid = depth.iter().filter(|d| d.is_finite());
    let mean = solid.clone().map(|&d| f64::from(d)).sum::<f64>() / solid.count().max(1) as f64;
    let reach =
        (HOLE_SCALES * scale * camera.focal.x / mean.max(f64::MIN_POSITIVE)).ceil().min(camera.width as f64) as usize;
    let nearest = window(depth, camera.width, reach, |a, b| if b < a { b } else { a });
    let opened = window(&nearest, camera.width, reach, |a, b| if b > a { b } else { a });
    depth.iter().zip(&opened).map(|(&d, &o)| d - o > scale as f32).collect()
}

/// The least or largest value in a square of `reach` pixels around each pixel.
fn window(values: &[f32], width: usize, reach: usize, of: impl Fn(f32, f32) -> f32) -> Vec<f32> {
    let join = |joined: &mut [f32], others: &[f32]| {
        joined.iter_mut().zip(others).for_each(|(j, &other)| *j = of(*j, other));
    };
    let widen = |values: &[f32], stride: usize| {
        let (mut joined, count) = (values.to_vec(), values.len());
        for shift in (1..=reach).map(|k| k * stride).filter(|&shift| shift < count) {
            join(&mut joined[shift..], &values[..count - shift]);
            join(&mut joined[..count - shift], &values[shift..]);
        }
        joined
    };
    let rows: Vec<f32> = values.chunks_exact(width).flat_map(|row| widen(row, 1)).collect();
    widen(&rows, width)
}

/// Cosine between ray and surface normal from the slope of the depth map: a pixel is z / f wide at depth z.
fn cosines(depth: &[f32], camera: &Camera) -> Vec<f32> {
    let (w, h) = (camera.width, camera.height);
    let slope = |a: f32, b: f32, z: f32, focal: f64| -> f32 {
        let s = (a - b) * 0.5 * focal as f32 / z;
        if s.is_finite() { s } else { 0.0 }
    };
    (0..w * h)
        .map(|i| {
            let z = depth[i];
            if !z.is_finite() {
                return 1.0;
            }
            let (x, y) = (i % w, i / w);
            let sx = if x > 0 && x + 1 < w { slope(depth[i + 1], depth[i - 1], z, camera.focal.x) } else { 0.0 };
            let sy = if y > 0 && y + 1 < h { slope(depth[i + w], depth[i - w], z, camera.focal.y) } else { 0.0 };
            1.0 / (1.0 + sx * sx + sy * sy).sqrt()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use gic_splat::Shape;

    const SIZE: usize = 60;

    fn camera() -> Camera {
        Camera {
            width: SIZE,
            height: SIZE,
            focal: DVec2::splat(60.0),
            principal: DVec2::splat(0.5 * SIZE as f64),
            rotation: DMat3::IDENTITY,
            centre: DVec3::ZERO,
        }
    }

    /// A wall of Gaussians a metre in front of the camera, 20 mm apart; those on the right are larger.
    fn wall(left: f32, right: f32) -> Gaussians {
        let place = |i: usize| [0.02 * (i % 60) as f32 - 0.59, 0.02 * (i / 60) as f32 - 0.59, 1.0];
        let positions: Vec<[f32; 3]> = (0..3600).map(place).collect();
        let scales = positions.iter().map(|p| if p[0] < 0.0 { left } else { right }).collect();
        let n = positions.len();
        Gaussians {
            positions,
            opacities: vec![0.9; n],
            shape: Shape::Isotropic { scales },
            sh_degree: 0,
            sh: vec![[0.0; 3]; n],
        }
    }

    #[test]
    fn faces_of_large_gaussians_are_brought_nearer_and_others_stay() {
        let (camera, mask) = (camera(), vec![1.0; SIZE * SIZE]);
        let (small, large) = (0.012, 0.03);
        let (tinted, unit) = tinted_by_scale(&wall(small, large));
        let (depth, sizes) = depth_and_scale(&tinted, unit, &camera, &mask);
        let mut view = Evidence::with_depth(&camera, &mask, depth);
        let before = view.depth.clone();
        view.raise(&sizes, small);
        let row = SIZE / 2 * SIZE;
        let [left, right] = [row + 10, row + SIZE - 10];
        assert!((sizes[left] / small - 1.0).abs() < 0.01 && (sizes[right] / large - 1.0).abs() < 0.01);
        assert_eq!(view.depth[left], before[left]);
        let raised = before[right] - view.depth[right];
        assert!((raised / (DEEPER * (large - LARGE * small)) - 1.0).abs() < 0.02, "{raised}");
    }
}
