//! What a mesh covers of a picture.

use gic_geometry::TriangleMesh;
use gic_scene::Camera;
use glam::{DVec2, DVec3};

/// Pixels of a silhouette along each side of one of the mask. Derived: outlines are told to a quarter of a pixel each.
const FINENESS: usize = 2;
/// Pixels around a mask's box in which a silhouette's edge is looked for. Derived: a turn of ten degrees moves the ends
/// of a body that is 250 pixels long by so much.
pub(super) const MARGIN_PX: usize = 24;

/// A rectangle of pixels.
#[derive(Clone, Copy)]
pub(super) struct SilhouetteWindow {
    x: usize,
    y: usize,
    width: usize,
    height: usize,
}

impl SilhouetteWindow {
    /// Around the covered pixels, with a margin of [`MARGIN_PX`]; `None` of an empty mask.
    pub(super) fn around(mask: &[f32], width: usize) -> Option<SilhouetteWindow> {
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
    pub(super) fn silhouette(&self, mesh: &TriangleMesh, camera: &Camera) -> Option<Silhouette> {
        let place = |vertex: &DVec3| Some(self.fine(camera.project(*vertex)?.0));
        let places: Option<Vec<DVec2>> = mesh.vertices.iter().map(place).collect();
        let places = places.filter(|places| !places.is_empty())?;
        let (width, height) = (FINENESS * self.width, FINENESS * self.height);
        let mut inside = vec![false; width * height];
        for triangle in &mesh.triangles {
            cover(&mut inside, width, triangle.map(|corner| places[corner as usize]));
        }
        Some(Silhouette { width, inside, window: *self })
    }
}

/// What a mesh covers of a picture.
pub(super) struct Silhouette {
    window: SilhouetteWindow,
    /// Fine pixels in a row.
    width: usize,
    /// The fine pixels that are covered, row-major.
    inside: Vec<bool>,
}

impl Silhouette {
    /// How far outside of it image coordinates are, negative inside [pixels]. What is further from its edge than a
    /// pixel is at least as far.
    pub(super) fn outward_px(&self, pixel: DVec2) -> f64 {
        let signed = |x: usize, y: usize| {
            let (is_inside, distance) = self.edge_distance(x, y);
            f64::from(if is_inside { 0.5 - distance } else { distance - 0.5 }) / FINENESS as f64
        };
        let fine = self.window.fine(pixel).max(DVec2::ZERO);
        let ([x, y], [s, t]) = (fine.floor().as_usizevec2().to_array(), fine.fract().to_array());
        let row = |y: usize| signed(x, y) + s * (signed(x + 1, y) - signed(x, y));
        row(y) + t * (row(y + 1) - row(y))
    }

    /// Whether a fine pixel is inside, and how far it is from the nearest that is not as it is, or two pixels: a place
    /// that is within a pixel of the edge lies between fine pixels that are within two.
    fn edge_distance(&self, x: usize, y: usize) -> (bool, f32) {
        let height = self.inside.len() / self.width;
        let (x, y) = (x.min(self.width - 1), y.min(height - 1));
        let is_inside = self.inside[y * self.width + x];
        let reach = 2 * FINENESS;
        let near = |at: usize, size: usize| at.saturating_sub(reach)..(at + reach + 1).min(size);
        let mut least = reach * reach;
        for row in near(y, height) {
            for column in near(x, self.width).filter(|column| self.inside[row * self.width + column] != is_inside) {
                least = least.min(row.abs_diff(y).pow(2) + column.abs_diff(x).pow(2));
            }
        }
        (is_inside, (least as f32).sqrt())
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
