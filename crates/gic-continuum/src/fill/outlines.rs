//! What many outlines take away together that each of them would leave.
//!
//! Every outline errs a little, and what is inside of all of them is too small by the worst error at every place. But
//! errors cancel along an outline: so the body is grown by as much as the outlines of what they all leave lie inside of
//! themselves.

use gic_geometry::{DensityField, TriangleMesh, distance_transform, marching_cubes};
use gic_scene::{Camera, touches_border};
use glam::DVec2;
use rayon::prelude::*;

use super::Filling;
use crate::MaskedView;
use crate::symmetry::{Outline, Symmetry};

/// Pixels of a silhouette along each side of one of the mask. Derived: outlines are told to a quarter of a pixel each.
const FINENESS: usize = 2;
/// Pixels around a mask's box in which a silhouette's edge is looked for. Derived: a turn of ten degrees moves the ends
/// of a body that is 250 pixels long by so much.
pub(crate) const MARGIN_PX: usize = 24;
/// Voxels over which the field of the hull ramps. Derived: trilinear interpolation needs both sides of the surface.
const HULL_RAMP_VOXELS: f64 = 4.0;

impl Filling {
    /// Grows a body that is what the outlines of `views` and their mirror images leave by what their errors took away.
    pub(super) fn grow_by_outlines(&mut self, views: &[MaskedView], symmetry: &Symmetry) {
        let hull = marching_cubes(&self.hull(views, symmetry), 0.5);
        let Some(gap) = outline_gap(&hull, views) else { return };
        let (spacing, mut left) = (self.field.spacing, gap);
        while left != 0.0 {
            // Further than a voxel from its ramp the field does not tell which way is outward.
            let step = left.clamp(-spacing, spacing);
            self.grow(step);
            left -= step;
        }
    }

    /// What is inside of all outlines and of their mirror images: one half at its surface.
    fn hull(&self, views: &[MaskedView], symmetry: &Symmetry) -> DensityField {
        let outlines: Vec<Outline> =
            views.par_iter().filter_map(|view| Some(Outline::new(view.camera, view.mask?))).collect();
        let (field, images) = (&self.field, symmetry.images());
        let value = |i: usize| {
            let depths = images.of(field.centre(field.voxel(i))).flat_map(|p| outlines.iter().map(move |o| o.depth(p)));
            let depth = depths.fold(f64::INFINITY, f64::min);
            (0.5 + depth / (HULL_RAMP_VOXELS * field.spacing)).clamp(0.0, 1.0) as f32
        };
        DensityField { values: (0..field.len()).into_par_iter().map(value).collect(), ..*field }
    }

    /// Moves the surface outward by `distance` [m], the field with it.
    fn grow(&mut self, distance: f64) {
        let field = &self.field;
        let moved = |i: usize| {
            let centre = field.centre(field.voxel(i));
            let inward = field.gradient(centre).normalize_or_zero();
            if inward == glam::DVec3::ZERO { field.values[i] } else { field.sample(centre + distance * inward) as f32 }
        };
        let values = (0..field.len()).into_par_iter().map(moved).collect();
        self.field = DensityField { values, ..*field };
    }
}

/// How far the masks' outlines lie outside of those of a body [m]: the median over all places along the outlines that
/// lie in their pictures as a whole. `None` where there are none.
fn outline_gap(body: &TriangleMesh, views: &[MaskedView]) -> Option<f64> {
    let whole = |view: &&MaskedView| view.mask.is_some_and(|mask| !touches_border(mask, view.camera.width));
    let mut gaps: Vec<f64> = views.par_iter().filter(whole).flat_map_iter(|view| gaps_of(body, view)).collect();
    let middle = gaps.len() / 2;
    (!gaps.is_empty()).then(|| *gaps.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// How far places along the outline of a mask lie outside of that of a body [m].
fn gaps_of(mesh: &TriangleMesh, view: &MaskedView) -> Vec<f64> {
    let Some((mask, window)) =
        view.mask.and_then(|mask| Some((mask, SilhouetteWindow::around(mask, view.camera.width)?)))
    else {
        return Vec::new();
    };
    let Some(silhouette) = window.silhouette(mesh, view.camera) else { return Vec::new() };
    let metres = silhouette.depth / (0.5 * (view.camera.focal.x + view.camera.focal.y));
    crossings(mask, view.camera.width).into_iter().map(|place| silhouette.outward_px(place) * metres).collect()
}

/// Where coverage crosses one half between neighbouring pixels, in image coordinates.
fn crossings(mask: &[f32], width: usize) -> Vec<DVec2> {
    let at = |x: usize, y: usize| f64::from(mask[y * width + x]);
    let mut found = Vec::new();
    for (y, x) in (0..mask.len()).map(|i| (i / width, i % width)) {
        let right = (x + 1 < width).then(|| (at(x + 1, y), DVec2::X));
        let below = ((y + 1) * width < mask.len()).then(|| (at(x, y + 1), DVec2::Y));
        let here = at(x, y);
        let crossed = right.into_iter().chain(below).filter(|(there, _)| (here >= 0.5) != (*there >= 0.5));
        let centre = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
        found.extend(crossed.map(|(there, step)| centre + (0.5 - here) / (there - here) * step));
    }
    found
}

/// A rectangle of pixels.
#[derive(Clone, Copy)]
pub(crate) struct SilhouetteWindow {
    x: usize,
    y: usize,
    width: usize,
    height: usize,
}

impl SilhouetteWindow {
    /// Around the covered pixels, with a margin of [`MARGIN_PX`]; `None` of an empty mask.
    pub(crate) fn around(mask: &[f32], width: usize) -> Option<SilhouetteWindow> {
        let covered = || mask.iter().enumerate().filter(|(_, m)| **m > 0.0).map(|(i, _)| (i % width, i / width));
        let (x0, y0) = covered().fold((usize::MAX, usize::MAX), |(a, b), (x, y)| (a.min(x), b.min(y)));
        let (x1, y1) = covered().fold((0, 0), |(a, b), (x, y)| (a.max(x + 1), b.max(y + 1)));
        let (x, y) = (x0.saturating_sub(MARGIN_PX), y0.saturating_sub(MARGIN_PX));
        (x1 > x0).then(|| SilhouetteWindow { x, y, width: x1 + MARGIN_PX - x, height: y1 + MARGIN_PX - y })
    }

    /// Image coordinates on the grid of fine pixels, whose centres are at whole numbers.
    fn fine(&self, pixel: DVec2) -> DVec2 {
        (pixel - DVec2::new(self.x as f64, self.y as f64)) * FINENESS as f64 - 0.5
    }

    /// What the triangles of a mesh cover; `None` of one that is not in front of the camera as a whole.
    pub(crate) fn silhouette(&self, mesh: &TriangleMesh, camera: &Camera) -> Option<Silhouette> {
        let seen: Option<Vec<(DVec2, f64)>> = mesh.vertices.iter().map(|vertex| camera.project(*vertex)).collect();
        let seen = seen.filter(|seen| !seen.is_empty())?;
        let depth = seen.iter().map(|(_, depth)| depth).sum::<f64>() / seen.len() as f64;
        let places: Vec<DVec2> = seen.iter().map(|(pixel, _)| self.fine(*pixel)).collect();
        let (width, height) = (FINENESS * self.width, FINENESS * self.height);
        let mut inside = vec![false; width * height];
        for triangle in &mesh.triangles {
            cover(&mut inside, width, triangle.map(|corner| places[corner as usize]));
        }
        let outside: Vec<bool> = inside.iter().map(|inside| !inside).collect();
        let (to_outside, to_inside) = (distance_transform(&outside, width), distance_transform(&inside, width));
        Some(Silhouette { window: *self, to_outside, to_inside, depth })
    }
}

/// What a mesh covers of a picture.
pub(crate) struct Silhouette {
    window: SilhouetteWindow,
    /// Distances from what is outside and from what is inside [fine pixels], row-major.
    to_outside: Vec<f32>,
    to_inside: Vec<f32>,
    /// Mean depth of the mesh's vertices [m].
    depth: f64,
}

impl Silhouette {
    /// How far outside of it image coordinates are, negative inside [pixels].
    pub(crate) fn outward_px(&self, pixel: DVec2) -> f64 {
        let width = FINENESS * self.window.width;
        let signed = |x: usize, y: usize| {
            let i = y.min(self.to_inside.len() / width - 1) * width + x.min(width - 1);
            let (inside, outside) = (self.to_inside[i], self.to_outside[i]);
            f64::from(if inside > 0.0 { inside - 0.5 } else { 0.5 - outside }) / FINENESS as f64
        };
        let fine = self.window.fine(pixel).max(DVec2::ZERO);
        let ([x, y], [s, t]) = (fine.floor().as_usizevec2().to_array(), fine.fract().to_array());
        let row = |y: usize| signed(x, y) + s * (signed(x + 1, y) - signed(x, y));
        row(y) + t * (row(y + 1) - row(y))
    }
}

/// Marks the pixels whose centres lie in a triangle that runs around them one way, pixel centres being at whole
/// numbers: the sides of a closed surface that face the camera cover as much as those that do not.
fn cover(inside: &mut [bool], width: usize, [a, b, c]: [DVec2; 3]) {
    if (b - a).perp_dot(c - a) <= 0.0 {
        return;
    }
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    let last = |end: f64, size: usize| end.floor().min(size as f64 - 1.0) as i64;
    for y in low.y.ceil().max(0.0) as i64..=last(high.y, inside.len() / width) {
        for x in low.x.ceil().max(0.0) as i64..=last(high.x, width) {
            let p = DVec2::new(x as f64, y as f64);
            if [(a, b), (b, c), (c, a)].iter().all(|(from, to)| (*to - *from).perp_dot(p - *from) >= 0.0) {
                inside[y as usize * width + x as usize] = true;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::symmetry::direction;
    use crate::test_cross::{CENTRE, cameras, gaussians, mask, views};
    use crate::{FillSettings, MirrorPlane, fill_outlines};
    use glam::DVec3;

    /// A ball by outlines that are shifted to all sides, each by `error` [m]: its volume over the true one.
    fn volume(error: f64) -> f64 {
        const RADIUS: f64 = 0.1;
        let cameras = cameras();
        let shift = |k: usize| error * direction(k, cameras.len()) * if k.is_multiple_of(2) { 1.0 } else { -1.0 };
        let seen = |(k, camera): (usize, &Camera)| mask(camera, &|p| p.distance(CENTRE + shift(k)) - RADIUS);
        let masks: Vec<Vec<f32>> = cameras.iter().enumerate().map(seen).collect();
        let planes =
            DVec3::AXES.iter().map(|axis| MirrorPlane { normal: *axis, offset: axis.dot(CENTRE), misfit: 0.0 });
        let symmetry = Symmetry { planes: planes.collect(), interchangeable_planes: Vec::new() };
        let settings = FillSettings::for_size(0.3);
        let inside = |p: &[f32; 3]| DVec3::from(p.map(f64::from)).distance(CENTRE) < RADIUS;
        let mut gaussians = gaussians();
        let kept: Vec<usize> = (0..gaussians.len()).filter(|i| inside(&gaussians.positions[*i])).collect();
        gaussians = gaussians.select(&kept);
        let filling = fill_outlines(&gaussians, &views(&cameras, &masks), &symmetry, &settings).expect("a body");
        filling.volume() / (4.0 / 3.0 * std::f64::consts::PI * RADIUS.powi(3))
    }

    /// Outlines that err leave as much as outlines that do not.
    #[test]
    fn errors_of_outlines_take_nothing_away() {
        let (exact, erring) = (volume(0.0), volume(0.004));
        println!("{exact:.4} by exact outlines, {erring:.4} by others");
        assert!((exact - 1.0).abs() < 0.04 && (erring - exact).abs() < 0.04, "{exact} {erring}");
    }
}
