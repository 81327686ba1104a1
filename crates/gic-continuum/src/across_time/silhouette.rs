//! What a mesh covers of a picture.

use gic_geometry::TriangleMesh;
use gic_scene::Camera;
use glam::{DVec2, DVec3};

/// Pixels of a silhouette along each side of one of the mask. Derived: outlines are told to a quarter of a pixel each.
const FINENESS: usize = 2;
/// Fine pixels within which an edge is looked for: a place that is within a pixel of the edge lies between fine pixels
/// that are within two. Derived.
const REACH: usize = 2 * FINENESS;
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
        let beside = inside.chunks_exact(width).flat_map(other_beside).collect();
        Some(Silhouette { width, inside, beside, window: *self })
    }
}

/// What a mesh covers of a picture.
pub(super) struct Silhouette {
    window: SilhouetteWindow,
    /// Fine pixels in a row.
    width: usize,
    /// The fine pixels that are covered, row-major.
    inside: Vec<bool>,
    /// How far beside each fine pixel the nearest of its row is that is not as it is, at most [`REACH`], row-major.
    beside: Vec<u8>,
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

    /// Whether a fine pixel is inside, and how far it is from the nearest that is not as it is, at most [`REACH`].
    fn edge_distance(&self, x: usize, y: usize) -> (bool, f32) {
        let height = self.inside.len() / self.width;
        let (x, y) = (x.min(self.width - 1), y.min(height - 1));
        let is_inside = self.inside[y * self.width + x];
        let mut least = REACH * REACH;
        for row in y.saturating_sub(REACH)..(y + REACH + 1).min(height) {
            let at = row * self.width + x;
            let beside = if self.inside[at] == is_inside { usize::from(self.beside[at]) } else { 0 };
            least = least.min(row.abs_diff(y).pow(2) + beside.pow(2));
        }
        (is_inside, (least as f32).sqrt())
    }
}

/// How far beside each pixel of a row the nearest is that is not as it is, at most [`REACH`].
fn other_beside(row: &[bool]) -> Vec<u8> {
    let mut beside = vec![REACH as u8; row.len()];
    for distance in (1..REACH.min(row.len())).rev() {
        let others = || row.iter().zip(&row[distance..]).map(|(left, right)| left != right);
        let mark = |(to, is_other): (&mut u8, bool)| *to = if is_other { distance as u8 } else { *to };
        beside.iter_mut().zip(others()).for_each(mark);
        beside[distance..].iter_mut().zip(others()).for_each(mark);
    }
    beside
}

/// Marks the pixels whose centres lie in a triangle that runs around them one way, pixel centres being at whole
/// numbers: the sides of a closed surface that face the camera cover as much as those that do not.
fn cover(inside: &mut [bool], width: usize, [a, b, c]: [DVec2; 3]) {
    let runs_around = (b - a).perp_dot(c - a) > 0.0;
    if !runs_around {
        return;
    }
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    let end = |high: f64, size: usize| if high < 0.0 { 0 } else { (high as usize).saturating_add(1).min(size) };
    for y in whole_from(low.y)..end(high.y, inside.len() / width) {
        // Each side cuts the row: what is inside lies to the right of those that run up and to the left of the others.
        let (mut left, mut right) = (low.x, high.x);
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let side = to - from;
            let cut = from.x + side.x * (y as f64 - from.y) / side.y;
            if side.y < 0.0 {
                left = left.max(cut);
            } else if side.y > 0.0 {
                right = right.min(cut);
            }
        }
        let columns = whole_from(left)..end(right, width);
        if !columns.is_empty() {
            inside[y * width..][columns].fill(true);
        }
    }
}

/// The first whole number that is neither below zero nor below `low`.
fn whole_from(low: f64) -> usize {
    let below = low.max(0.0) as usize;
    below + usize::from((below as f64) < low)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_triangle_covers_the_centres_within_its_sides(
            corners in prop::array::uniform3(prop::array::uniform2(-8.0f64..40.0)),
            whole in prop::bool::ANY,
        ) {
            let round = |at: f64| if whole { at.round() } else { at };
            let [a, b, c] = corners.map(|[x, y]| DVec2::new(round(x), round(y)));
            let mut inside = vec![false; 32 * 24];
            cover(&mut inside, 32, [a, b, c]);
            let runs_around = (b - a).perp_dot(c - a) > 0.0;
            for (at, is_inside) in inside.iter().enumerate() {
                let p = DVec2::new((at % 32) as f64, (at / 32) as f64);
                let sides = [(a, b), (b, c), (c, a)].map(|(from, to)| (to - from).perp_dot(p - from));
                let least = sides.into_iter().fold(f64::INFINITY, f64::min);
                // On a side itself rounding decides.
                prop_assert!(*is_inside == (runs_around && least >= 0.0) || least.abs() < 1e-9, "{p}: {least}");
            }
        }

        #[test]
        fn an_edge_is_as_far_as_the_nearest_pixel_that_is_otherwise(
            covered in prop::collection::vec(prop::bool::weighted(0.9), 14 * 11),
            (x, y) in (0usize..16, 0usize..13),
        ) {
            let beside = covered.chunks_exact(14).flat_map(other_beside).collect();
            let window = SilhouetteWindow { x: 0, y: 0, width: 7, height: 5 };
            let silhouette = Silhouette { window, width: 14, inside: covered.clone(), beside };
            let (x, y) = (x.min(13), y.min(10));
            let other = (0..14 * 11).filter(|at| covered[*at] != covered[y * 14 + x]);
            let squared = other.map(|at| (at % 14).abs_diff(x).pow(2) + (at / 14).abs_diff(y).pow(2));
            let nearest = squared.fold(REACH * REACH, usize::min);
            prop_assert_eq!(silhouette.edge_distance(x, y), (covered[y * 14 + x], (nearest as f32).sqrt()));
        }
    }
}
