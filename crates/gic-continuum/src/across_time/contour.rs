//! Where a surface makes the edge of its silhouette, and how far the mask's outline lies from there.

use gic_geometry::Neighbours;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::silhouette::SilhouetteWindow;
use super::tracked::MovedSurface;
use super::{Moment, MomentView, robust_deviation};
use crate::evidence::pixel_index;
use crate::symmetry::Outline;

/// How well a mask tells an outline, as a standard deviation [pixels]. Derived: distances from the centres of whole
/// pixels err by up to half a pixel to both sides.
pub(super) const OUTLINE_ERROR_PX: f64 = 0.3;

/// A place of the surface that makes an edge of a silhouette.
#[derive(Clone, Copy, Debug)]
pub(super) struct ContourPoint {
    pub(super) vertex: usize,
    /// Where it is [m].
    pub(super) point: DVec3,
    /// Which way the mask's outline lies further out, parallel to the picture.
    pub(super) direction: DVec3,
    /// How far [m].
    pub(super) gap: f64,
    /// How far the body's deformation has moved it [m].
    pub(super) deformation: f64,
    /// Cosine between that direction and the surface's normal.
    pub(super) alignment: f64,
    /// The number of the view.
    view: usize,
    /// Where it appears there.
    pixel: DVec2,
    /// How far from the camera [m].
    depth: f64,
}

impl ContourPoint {
    /// How much it counts where gaps have a standard deviation: what lies further off is explained by something else
    /// (Cauchy's weight).
    pub(super) fn weight(&self, deviation: f64) -> f64 {
        1.0 / (1.0 + (self.gap / deviation).powi(2))
    }
}

/// Standard deviation of gaps, robustly, and at least a part of a pixel [m].
pub(super) fn deviation(contour: &[ContourPoint], pixel: f64) -> f64 {
    let robust = robust_deviation(contour.iter().map(|point| point.gap.abs()).collect());
    robust.unwrap_or(f64::INFINITY).max(OUTLINE_ERROR_PX * pixel)
}

/// How far those points of a contour reach along the ray that appear within `reach` [pixels] of each [m]. The body
/// touches the ray somewhere there: where that is far, an outline does not tell a place.
pub(super) fn extents(contour: &[ContourPoint], reach: f64) -> Vec<f64> {
    // Each view in a plane of its own, out of reach of the others.
    let seen: Vec<DVec3> = contour.iter().map(|point| point.pixel.extend(2.0 * reach * point.view as f64)).collect();
    let points = Neighbours::new(&seen, reach);
    let extent = |at: &DVec3| {
        let (mut near, mut far) = (f64::INFINITY, 0.0f64);
        points.within(*at, reach, |_, other, _| {
            (near, far) = (near.min(contour[other].depth), far.max(contour[other].depth));
        });
        far - near
    };
    seen.iter().map(extent).collect()
}

/// The outlines of all masks of a moment.
pub(super) struct MomentOutlines<'a> {
    views: Vec<ViewOutline<'a>>,
}

struct ViewOutline<'a> {
    view: &'a MomentView,
    outline: Outline,
    window: SilhouetteWindow,
    /// Whether the mask lies in the picture as a whole.
    is_whole: bool,
}

impl MomentOutlines<'_> {
    pub(super) fn new(moment: &Moment) -> MomentOutlines<'_> {
        let views = moment.views.iter().filter_map(|view| {
            let window = SilhouetteWindow::around(&view.mask.coverage, view.mask.width)?;
            let outline = Outline::new(&view.camera, &view.mask.coverage);
            Some(ViewOutline { view, outline, window, is_whole: !view.mask.touches_border() })
        });
        MomentOutlines { views: views.collect() }
    }

    /// Width of a pixel at the surface, mean of the views [m].
    pub(super) fn pixel(&self, surface: &MovedSurface) -> f64 {
        let pixel = |seen: &ViewOutline| {
            let camera = &seen.view.camera;
            camera.to_camera(surface.centre).z / camera.focal.min_element()
        };
        self.views.iter().map(pixel).sum::<f64>() / self.views.len().max(1) as f64
    }

    /// How far within the outlines of all views a point [m] appears [m]; infinitely where none can tell.
    pub(super) fn depth(&self, point: DVec3) -> f64 {
        self.views.iter().map(|seen| seen.depth(point)).fold(f64::INFINITY, f64::min)
    }

    /// Which of the voxels around `points` [m], of side `spacing` [m], cover a part of a mask that those which are kept
    /// leave uncovered.
    pub(super) fn uncovered(&self, points: &[DVec3], is_kept: &[bool], spacing: f64) -> Vec<usize> {
        self.views.par_iter().flat_map(|seen| seen.uncovered(points, is_kept, spacing)).collect()
    }

    /// The surface's contours in all views.
    pub(super) fn contour(&self, surface: &MovedSurface) -> Vec<ContourPoint> {
        let views = self.views.par_iter().enumerate();
        views.flat_map_iter(|(view, seen)| seen.contour(view, surface)).collect()
    }
}

impl ViewOutline<'_> {
    /// How far within the outline a point [m] appears [m]; infinitely where the picture does not tell. It is cut around
    /// the mask: what lies outside of it lies outside of the mask, by more than to the picture's edge and from there to
    /// the mask, at right angles.
    fn depth(&self, point: DVec3) -> f64 {
        let depth = self.outline.depth(point);
        let camera = &self.view.camera;
        let outside = camera.project(point).filter(|_| depth.is_infinite() && self.is_whole);
        outside.map_or(depth, |(pixel, along)| {
            let size = DVec2::new(camera.width as f64, camera.height as f64);
            let edge = pixel.clamp(DVec2::splat(0.5), size - 1.5);
            let within = self.outline.at_pixel(edge).map_or(0.0, f64::from);
            -within.hypot(pixel.distance(edge)) * along / (0.5 * (camera.focal.x + camera.focal.y))
        })
    }

    fn uncovered(&self, points: &[DVec3], is_kept: &[bool], spacing: f64) -> Vec<usize> {
        let MomentView { camera, mask, .. } = self.view;
        let mut covered: Vec<bool> = mask.coverage.iter().map(|coverage| *coverage < 0.5).collect();
        let pixels: Vec<Option<(DVec2, f64)>> = points.par_iter().map(|point| camera.project(*point)).collect();
        for (pixel, depth) in pixels.iter().zip(is_kept).filter_map(|(pixel, is_kept)| pixel.filter(|_| *is_kept)) {
            // A voxel to each side, so that what is kept has no gaps.
            let reach = spacing * camera.focal / depth;
            let size = DVec2::new(camera.width as f64, camera.height as f64);
            let low = (pixel - reach).clamp(DVec2::ZERO, size).as_usizevec2();
            let high = (pixel + reach).clamp(DVec2::ZERO, size).as_usizevec2();
            (low.y..high.y).for_each(|y| covered[y * camera.width + low.x..y * camera.width + high.x].fill(true));
        }
        let is_uncovered = |(pixel, _)| pixel_index(camera, pixel).is_some_and(|i| !covered[i]);
        (0..points.len()).filter(|i| !is_kept[*i] && pixels[*i].is_some_and(is_uncovered)).collect()
    }

    /// Vertices between triangles that face the camera, the view of this `number`, and triangles that do not, at the
    /// edge of the silhouette.
    fn contour(&self, number: usize, surface: &MovedSurface) -> Vec<ContourPoint> {
        let ViewOutline { view, outline, window, .. } = self;
        let (camera, mesh) = (&view.camera, &surface.mesh);
        let Some(silhouette) = window.silhouette(mesh, camera) else { return Vec::new() };
        let mut sides = vec![[false; 2]; mesh.vertices.len()];
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(|i| mesh.vertices[i as usize]);
            let faces = (b - a).cross(c - a).dot(camera.centre - a) > 0.0;
            triangle.iter().for_each(|i| sides[*i as usize][usize::from(faces)] = true);
        }
        let [right, down] = [camera.world_from_camera.x_axis, camera.world_from_camera.y_axis];
        let focal = 0.5 * (camera.focal.x + camera.focal.y);
        let point = |vertex: usize| {
            let point = mesh.vertices[vertex];
            let (pixel, depth) = camera.project(point)?;
            let (within, towards) = outline.gap_px(pixel)?;
            let direction = towards.x * right + towards.y * down;
            let alignment = direction.dot(mesh.normals[vertex]);
            // Where the mask's outline looks another way than the surface, it is another part's.
            if alignment <= 0.0 {
                return None;
            }
            // Vertices lie a little within the edge that the triangles around them make.
            let edge = silhouette.outward_px(pixel);
            let deformation = surface.deformation[vertex];
            let gap = (within + edge) * depth / focal;
            let seen =
                ContourPoint { vertex, point, direction, gap, deformation, alignment, view: number, pixel, depth };
            (edge >= -1.0).then_some(seen)
        };
        (0..sides.len()).filter(|vertex| sides[*vertex] == [true; 2]).filter_map(point).collect()
    }
}
