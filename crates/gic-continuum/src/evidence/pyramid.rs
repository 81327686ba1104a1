//! What one view says about all points of a box: bounds, so that matter far from every surface is decided in whole
//! boxes instead of voxel by voxel.
//!
//! Each view keeps least and largest values of its mask and depth map over squares of 1, 2, 4 ... pixels, as a mipmap
//! does (Greene, Kass & Miller 1993 test boxes against depths by it). A box projects into few such squares, whose
//! bounds hold for all its points.

use std::sync::Arc;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::view::Evidence;

/// Share by which distances are rounded, with room to spare: bounds hold for evidence in single precision.
const ROUNDING: f64 = 1e-6;

/// Least and largest of what a view holds in a square of pixels.
#[derive(Clone, Copy)]
struct Texel {
    /// Coverage of the mask.
    coverage: [f32; 2],
    /// Rendered depths where there are any [m]; `[inf, -inf]` where there are none.
    depth: [f32; 2],
    /// Least cosine between ray and normal.
    cosine: f32,
    /// Whether there is a pixel without depth.
    hole: bool,
    /// Whether something is seen through a small hole.
    through: bool,
}

impl Texel {
    /// Of no pixels at all.
    const NONE: Texel = Texel {
        coverage: [f32::INFINITY, f32::NEG_INFINITY],
        depth: [f32::INFINITY, f32::NEG_INFINITY],
        cosine: 1.0,
        hole: false,
        through: false,
    };

    fn pixel(view: &Evidence, i: usize) -> Texel {
        let (mask, depth) = (view.mask[i], view.depth[i]);
        let solid = depth.is_finite();
        Texel {
            coverage: [mask; 2],
            depth: if solid { [depth; 2] } else { Texel::NONE.depth },
            cosine: view.cosine[i],
            hole: !solid,
            through: view.hole[i],
        }
    }

    fn join(self, other: Texel) -> Texel {
        let widen = |a: [f32; 2], b: [f32; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        Texel {
            coverage: widen(self.coverage, other.coverage),
            depth: widen(self.depth, other.depth),
            cosine: self.cosine.min(other.cosine),
            hole: self.hole || other.hole,
            through: self.through || other.through,
        }
    }
}

/// A grid of texels, row-major.
struct Level {
    width: usize,
    height: usize,
    texels: Vec<Texel>,
}

impl Level {
    /// Half as many texels along both axes, rounded up.
    fn halved(&self) -> Level {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let texels = (0..width * height)
            .map(|i| {
                let (x, y) = (2 * (i % width), 2 * (i / width));
                self.join([x, y], [(x + 1).min(self.width - 1), (y + 1).min(self.height - 1)])
            })
            .collect();
        Level { width, height, texels }
    }

    /// The texels from `low` to `high`, both included, joined.
    fn join(&self, low: [usize; 2], high: [usize; 2]) -> Texel {
        let mut joined = Texel::NONE;
        for y in low[1]..=high[1] {
            for texel in &self.texels[y * self.width + low[0]..=y * self.width + high[0]] {
                joined = joined.join(*texel);
            }
        }
        joined
    }
}

/// A view's pixels in squares of side 1, 2, 4, ... up to all in one.
fn levels(view: &Evidence) -> Vec<Level> {
    let (width, height) = (view.camera.width, view.camera.height);
    let texels = (0..width * height).map(|i| Texel::pixel(view, i)).collect();
    let mut levels = vec![Level { width, height, texels }];
    while let Some(level) = levels.last().filter(|l| l.width > 1 || l.height > 1) {
        levels.push(level.halved());
    }
    levels
}

/// What [`Evidence::evidence_at`] says at any point of a box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum BoxBounds {
    /// Nothing: the view sees no part of the box.
    Unseen,
    /// The view sees all of the box: least and largest coverage, and distance behind the surface [m]; whether parts of
    /// that surface may be seen through small holes.
    Seen { coverage: [f32; 2], behind: [f64; 2], through_hole: bool },
    /// The box reaches out of the image.
    Partly,
}

/// A view with its pixels in squares of side 1, 2, 4, ...
pub(crate) struct EvidencePyramid<'a> {
    pub(crate) view: &'a Evidence<'a>,
    levels: Arc<Vec<Level>>,
    /// Rotation from world to camera axes.
    camera_from_world: DMat3,
    /// The same without signs: half the sides of a box along the world's axes to those of the box around it along the
    /// camera's.
    widen: DMat3,
}

impl<'a> EvidencePyramid<'a> {
    /// Of all views; those that share their pixels, as mirror images do, share their levels, too.
    pub(crate) fn all(views: &'a [Evidence<'a>]) -> Vec<EvidencePyramid<'a>> {
        let same = |a: &Evidence, b: &Evidence| Arc::ptr_eq(&a.depth, &b.depth);
        let first = |view: &Evidence| views.iter().position(|other| same(other, view));
        let originals: Vec<usize> =
            views.iter().enumerate().filter(|(k, v)| first(v) == Some(*k)).map(|(k, _)| k).collect();
        let known: Vec<Arc<Vec<Level>>> = originals.par_iter().map(|k| Arc::new(levels(&views[*k]))).collect();
        let shared = |view: &Evidence| originals.iter().position(|k| same(&views[*k], view)).map(|k| known[k].clone());
        views.iter().filter_map(|view| Some(EvidencePyramid::with(view, shared(view)?))).collect()
    }

    fn with(view: &'a Evidence<'a>, levels: Arc<Vec<Level>>) -> EvidencePyramid<'a> {
        let camera_from_world = view.camera.world_from_camera.transpose();
        let [x, y, z] = [camera_from_world.x_axis, camera_from_world.y_axis, camera_from_world.z_axis];
        let widen = DMat3::from_cols(x.abs(), y.abs(), z.abs());
        EvidencePyramid { view, levels, camera_from_world, widen }
    }

    /// What the view says about the points of a box, given by its centre and half of its side [m].
    pub(crate) fn bounds(&self, centre: DVec3, half: f64) -> BoxBounds {
        let camera = self.view.camera;
        let middle = self.camera_from_world * (centre - camera.centre);
        let half = self.widen * DVec3::splat(half);
        let (near, far) = (middle.z - half.z, middle.z + half.z);
        if near <= 1e-9 {
            return if far <= 1e-9 { BoxBounds::Unseen } else { BoxBounds::Partly };
        }
        let range = |axis: usize| {
            let (low, high) = (middle[axis] - half[axis], middle[axis] + half[axis]);
            let focal = camera.focal[axis];
            let shift = camera.principal[axis] - 0.5;
            let low = focal * low / if low > 0.0 { far } else { near } + shift;
            let high = focal * high / if high > 0.0 { near } else { far } + shift;
            (low - ROUNDING, high + ROUNDING)
        };
        let ((left, right), (top, bottom)) = (range(0), range(1));
        let (width, height) = (camera.width as f64 - 0.5, camera.height as f64 - 0.5);
        if right < -0.5 || bottom < -0.5 || left >= width || top >= height {
            return BoxBounds::Unseen;
        }
        if !(left >= -0.5 && top >= -0.5 && right < width && bottom < height) {
            return BoxBounds::Partly;
        }
        // Half a pixel outside the outermost centres counts as these; casting truncates towards them.
        let first = |c: f64| c.max(0.0) as usize;
        let last = |c: f64, n: usize| ((c + 1.0) as usize).min(n - 1);
        let texel = self.texel([first(left), first(top)], [last(right, camera.width), last(bottom, camera.height)]);
        BoxBounds::Seen {
            coverage: texel.coverage,
            behind: self.behind(&texel, near, far),
            through_hole: texel.through,
        }
    }

    /// The pixels from `low` to `high`, both included, and perhaps a few around them.
    fn texel(&self, low: [usize; 2], high: [usize; 2]) -> Texel {
        let span = (high[0] - low[0]).max(high[1] - low[1]);
        // Squares of at least this side: two along an axis are enough.
        let k = (usize::BITS - span.saturating_sub(1).leading_zeros()) as usize;
        let k = k.min(self.levels.len() - 1);
        self.levels[k].join(low.map(|c| c >> k), high.map(|c| c >> k))
    }

    /// Bounds of the distance behind the surface between two depths [m].
    fn behind(&self, texel: &Texel, near: f64, far: f64) -> [f64; 2] {
        let [front, back] = texel.depth.map(f64::from);
        if front.is_infinite() {
            return [f64::INFINITY; 2];
        }
        let slack = ROUNDING * far;
        let cosine = f64::from(texel.cosine);
        let bias = f64::from(self.view.bias);
        let scaled =
            |distance: f64, (ahead, behind): (f64, f64)| distance * if distance > 0.0 { behind } else { ahead };
        let low = scaled(near - back, (1.0, cosine)) - bias - slack;
        let high = scaled(far - front, (cosine, 1.0)) - bias + slack;
        [low, if texel.hole { f64::INFINITY } else { high }]
    }
}

#[cfg(test)]
mod tests {
    use gic_scene::Camera;
    use glam::DVec2;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::tuning::Tuning;

    #[test]
    fn bounds_hold_at_every_point_of_a_box() {
        let camera = Camera {
            width: 61,
            height: 47,
            focal: DVec2::new(70.0, 66.0),
            principal: DVec2::new(30.0, 25.0),
            world_from_camera: DMat3::from_axis_angle(DVec3::new(0.3, -0.5, 0.8).normalize(), 0.7),
            centre: DVec3::new(0.1, -0.2, 0.3),
        };
        // A tilted disc before nothing, with a step in it.
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let pixels = camera.width * camera.height;
        let (mut mask, mut depth) = (vec![0.0; pixels], vec![f32::INFINITY; pixels]);
        for i in 0..pixels {
            let (x, y) = ((i % camera.width) as f32 - 30.0, (i / camera.width) as f32 - 22.0);
            mask[i] = ((18.0 - (x * x + y * y).sqrt()) / 2.0).clamp(0.0, 1.0);
            if mask[i] > 0.5 {
                depth[i] = 1.0 + 0.004 * x + if y > 5.0 { 0.1 } else { 0.0 };
            }
        }
        let view = Evidence::with_depth(&camera, &mask, depth, &Tuning::default());
        let pyramid = EvidencePyramid::with(&view, Arc::new(levels(&view)));
        let (mut seen, mut tight) = (0, 0);
        for _ in 0..3000 {
            let mut uniform = |low: f64, high: f64| low + (high - low) * random.random::<f64>();
            let pixel = DVec2::new(uniform(-8.0, 69.0), uniform(-8.0, 55.0));
            let centre = camera.unproject(pixel, uniform(-0.05, 1.4));
            let half = uniform(0.001, 0.02);
            let bounds = pyramid.bounds(centre, half);
            for _ in 0..20 {
                let point = centre + half * DVec3::new(uniform(-1.0, 1.0), uniform(-1.0, 1.0), uniform(-1.0, 1.0));
                let Some(here) = view.evidence_at(point) else {
                    assert!(!matches!(bounds, BoxBounds::Seen { .. }));
                    continue;
                };
                match bounds {
                    BoxBounds::Unseen => panic!("{point} is seen"),
                    BoxBounds::Partly => {}
                    BoxBounds::Seen { coverage, behind, .. } => {
                        let within = here.coverage >= coverage[0] - 1e-6 && here.coverage <= coverage[1] + 1e-6;
                        let depth = f64::from(here.behind);
                        assert!(within && depth >= behind[0] && depth <= behind[1], "{here:?} in {bounds:?}");
                        seen += 1;
                        tight += u32::from(coverage[0] == 1.0 && behind[1] - behind[0] < 0.06);
                    }
                }
            }
        }
        assert!(seen > 15_000 && tight > 1_000, "{seen} {tight}");
    }
}
