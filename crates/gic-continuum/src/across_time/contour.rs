//! Where a surface makes the edge of its silhouette, and how far the mask's outline lies from there.

use glam::DVec3;

use super::tracked::MovedSurface;
use super::{Moment, MomentView, robust_deviation};
use crate::fill::SilhouetteWindow;
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

/// The outlines of all masks of a moment.
pub(super) struct MomentOutlines<'a> {
    views: Vec<(&'a MomentView, Outline, SilhouetteWindow)>,
}

impl MomentOutlines<'_> {
    pub(super) fn new(moment: &Moment) -> MomentOutlines<'_> {
        let views = moment.views.iter().filter_map(|view| {
            let window = SilhouetteWindow::around(&view.mask.coverage, view.mask.width)?;
            Some((view, Outline::new(&view.camera, &view.mask.coverage), window))
        });
        MomentOutlines { views: views.collect() }
    }

    /// Width of a pixel at the surface, mean of the views [m].
    pub(super) fn pixel(&self, surface: &MovedSurface) -> f64 {
        let pixel = |(view, ..): &(&MomentView, Outline, SilhouetteWindow)| {
            view.camera.to_camera(surface.centre).z / view.camera.focal.min_element()
        };
        self.views.iter().map(pixel).sum::<f64>() / self.views.len().max(1) as f64
    }

    /// The surface's contours in all views.
    pub(super) fn contour(&self, surface: &MovedSurface) -> Vec<ContourPoint> {
        self.views.iter().flat_map(|(view, outline, window)| contour_in(view, outline, window, surface)).collect()
    }
}

/// Vertices between triangles that face the camera and triangles that do not, at the edge of the silhouette.
fn contour_in(
    view: &MomentView,
    outline: &Outline,
    window: &SilhouetteWindow,
    surface: &MovedSurface,
) -> Vec<ContourPoint> {
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
        // Vertices lie a little within the edge that the triangles around them make.
        let edge = silhouette.outward_px(pixel);
        if edge < -1.0 {
            return None;
        }
        let direction = towards.x * right + towards.y * down;
        let alignment = direction.dot(mesh.normals[vertex]);
        let deformation = surface.deformation[vertex];
        let gap = (within + edge) * depth / focal;
        // Where the mask's outline looks another way than the surface, it is another part's.
        (alignment > 0.0).then_some(ContourPoint { vertex, point, direction, gap, deformation, alignment })
    };
    (0..sides.len()).filter(|vertex| sides[*vertex] == [true; 2]).filter_map(point).collect()
}
