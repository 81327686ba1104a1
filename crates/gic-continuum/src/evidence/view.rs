//! What one view says about a point: is it inside the mask, and is it in front of the rendered surface?

use std::sync::Arc;

use gic_scene::Camera;
use gic_splat::Gaussians;
use glam::{DVec2, DVec3};

use super::depth_map::{cosines, depth_map, small_holes};
use crate::ContinuumError;
use crate::tuning::Tuning;

/// A camera and the mask of the object in its image.
#[derive(Clone, Copy, Debug)]
pub struct MaskedView<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// Antialiased coverage of the object in [0, 1], row-major, shape [height * width]; `None` where this view has no
    /// mask in this frame: the view then says nothing.
    pub mask: Option<&'a [f32]>,
}

/// A view with its mask, its rendered depth map and how obliquely it sees the surface. Its mirror images share the
/// pixels.
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
    /// How far the Gaussians' centres lie behind the rendered surface [m].
    pub(super) bias: f32,
    continuous_within: f32,
}

/// What a view says about a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Seen {
    /// Coverage of the mask at the point's projection.
    pub(crate) coverage: f32,
    /// Distance behind the surface on which the centres of the rendered Gaussians lie, about perpendicular to it [m];
    /// negative in front of it; infinite where the view renders no surface there.
    pub(crate) behind: f32,
    /// Whether that surface is seen through a small hole in another one.
    pub(crate) through_hole: bool,
}

impl<'a> Evidence<'a> {
    /// Views that have a mask, with depth maps rendered from the Gaussians of a median scale [m] (Algorithm 1, lines 2
    /// and 3).
    ///
    /// # Errors
    /// No view has a mask, or one has not the size of its camera's image.
    pub(crate) fn gather(
        views: &[MaskedView<'a>],
        gaussians: Option<(&Gaussians, f64)>,
        tuning: &Tuning,
    ) -> Result<Vec<Evidence<'a>>, ContinuumError> {
        let mut gathered = Vec::new();
        for (view, &MaskedView { camera, mask }) in views.iter().enumerate() {
            let Some(mask) = mask else { continue };
            let (width, height) = (camera.width, camera.height);
            if mask.len() != width * height {
                return Err(ContinuumError::MaskSize { view, found: mask.len(), width, height });
            }
            let depth = match gaussians {
                Some((gaussians, _)) => depth_map(gaussians, camera, mask),
                None => vec![f32::INFINITY; mask.len()],
            };
            let mut view = Evidence::with_depth(camera, mask, depth, tuning);
            if let Some((_, scale)) = gaussians {
                view.hole = Arc::new(small_holes(&view.depth, camera, scale, tuning.gaussians.extent));
            }
            gathered.push(view);
        }
        if gathered.is_empty() {
            return Err(ContinuumError::NoMasks { views: views.len() });
        }
        if let Some((gaussians, scale)) = gaussians {
            let centres = gathered.iter().flat_map(|view| view.centres_behind(gaussians));
            let bias = depth_bias(centres, tuning.gaussians.extent * scale);
            gathered.iter_mut().for_each(|view| view.bias = bias);
        }
        Ok(gathered)
    }

    /// A view with a depth map [m], infinite where there is no surface; its bias is not measured yet.
    pub(crate) fn with_depth(camera: &'a Camera, mask: &'a [f32], depth: Vec<f32>, tuning: &Tuning) -> Evidence<'a> {
        let cosine = Arc::new(cosines(&depth, camera));
        let hole = Arc::new(vec![false; depth.len()]);
        let continuous_within = tuning.depth.continuous_within;
        Evidence { camera, mask, depth: Arc::new(depth), cosine, hole, bias: 0.0, continuous_within }
    }

    /// What another camera sees in the same pixels.
    pub(crate) fn seen_from(&self, camera: &'a Camera) -> Evidence<'a> {
        Evidence { camera, ..self.clone() }
    }

    /// How far the Gaussians' centres that are in the image lie behind the surface that is seen there [m].
    fn centres_behind<'b>(&'b self, gaussians: &'b Gaussians) -> impl Iterator<Item = f32> + 'b {
        gaussians.positions.iter().filter_map(|p| {
            let (pixel, z) = self.camera.project(DVec3::from(p.map(f64::from)))?;
            let i = pixel_index(self.camera, pixel)?;
            Some((z as f32 - self.depth[i]) * self.cosine[i])
        })
    }

    /// Unit vector from a point [m] to the camera.
    pub(crate) fn direction_from(&self, point: DVec3) -> DVec3 {
        (self.camera.centre - point).normalize_or_zero()
    }

    /// What this view says about a point [m]; `None` where it does not see it: behind the camera or outside the image.
    pub(crate) fn evidence_at(&self, point: DVec3) -> Option<Seen> {
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
        if spread.is_finite() && spread * self.camera.focal.x as f32 <= self.continuous_within * depth {
            depth = corners.iter().zip(weights).map(|(&i, w)| self.depth[i] * w).sum();
        }
        let behind = if depth.is_finite() { (z as f32 - depth) * cosine - self.bias } else { f32::INFINITY };
        let through_hole = corners.iter().any(|&i| self.hole[i]);
        Some(Seen { coverage, behind, through_hole })
    }
}

/// How far the Gaussians' centres lie behind the rendered surface [m]: the median of those that are `behind` it by less
/// than Gaussians reach [m]; the others are hidden or stray.
///
/// Accumulated depth is not that of the centres: of the Gaussians along a ray those that lie nearer to the camera are
/// composited first and draw it towards the camera.
fn depth_bias(behind: impl Iterator<Item = f32>, reach: f64) -> f32 {
    let mut near: Vec<f32> = behind.filter(|distance| distance.abs() <= reach as f32).collect();
    near.sort_by(f32::total_cmp);
    near.get(near.len() / 2).copied().unwrap_or(0.0)
}

/// The pixel that holds image coordinates; `None` outside the image.
pub(crate) fn pixel_index(camera: &Camera, pixel: DVec2) -> Option<usize> {
    let (w, h) = (camera.width, camera.height);
    let inside = pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < w as f64 && pixel.y < h as f64;
    inside.then(|| pixel.y as usize * w + pixel.x as usize)
}
