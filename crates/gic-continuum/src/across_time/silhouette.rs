//! What a mesh covers of a picture.

use gic_geometry::{TriangleMesh, distance_transform};
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
        let outside: Vec<bool> = inside.iter().map(|inside| !inside).collect();
        let (to_outside, to_inside) = (distance_transform(&outside, width), distance_transform(&inside, width));
        Some(Silhouette { window: *self, to_outside, to_inside })
    }
}

/// What a mesh covers of a picture.
pub(super) struct Silhouette {
    window: SilhouetteWindow,
    /// Distances from what is outside and from what is inside [fine pixels], row-major.
    to_outside: Vec<f32>,
    to_inside: Vec<f32>,
}

impl Silhouette {
    /// How far outside of it image coordinates are, negative inside [pixels].
    pub(super) fn outward_px(&self, pixel: DVec2) -> f64 {
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
