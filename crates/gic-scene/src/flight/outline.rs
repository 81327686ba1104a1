//! The outline of a body in one picture.

use glam::{DVec2, DVec3};

use super::calibration_error::CalibrationError;
use crate::{Camera, Mask};

/// The convex hull of an outline: all that a tangent plane can touch.
#[derive(Clone, Debug)]
pub(super) struct Outline {
    /// The camera that saw it.
    pub(super) camera: Camera,
    /// The corners of the hull, in image coordinates [pixels].
    corners: Vec<DVec2>,
}

/// An outline as a cone of rays.
#[derive(Clone, Debug)]
pub(super) struct Cone {
    /// The camera's centre [m].
    pub(super) centre: DVec3,
    /// Unit vectors from there along the corners of the outline's hull.
    pub(super) rays: Vec<DVec3>,
    /// Focal length [pixels].
    pub(super) focal_px: f64,
}

impl Outline {
    /// `None` of a body that is not in the picture as a whole.
    pub(super) fn new(camera: &Camera, mask: &Mask) -> Option<Outline> {
        if mask.touches_border() {
            return None;
        }
        let corners = convex_hull(crossings(mask));
        (corners.len() > 2).then(|| Outline { camera: camera.clone(), corners })
    }

    /// Its cone where the camera is off by `error`.
    pub(super) fn cone(&self, error: &CalibrationError) -> Cone {
        let camera = error.mended(&self.camera);
        let ray = |pixel: &DVec2| {
            let seen = error.straightened((*pixel - camera.principal) / camera.focal);
            camera.world_from_camera * seen.extend(1.0).normalize()
        };
        Cone {
            centre: camera.centre,
            rays: self.corners.iter().map(ray).collect(),
            focal_px: 0.5 * (camera.focal.x + camera.focal.y),
        }
    }
}

/// Where coverage crosses one half between the centres of neighbouring pixels, in image coordinates.
fn crossings(mask: &Mask) -> Vec<DVec2> {
    let (width, height) = (mask.width, mask.height);
    let at = |x: usize, y: usize| f64::from(mask.coverage[y * width + x]);
    let mut found = Vec::new();
    for y in 0..height {
        for x in 0..width {
            let centre = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
            let here = at(x, y);
            let right = (x + 1 < width).then(|| (at(x + 1, y), DVec2::X));
            let below = (y + 1 < height).then(|| (at(x, y + 1), DVec2::Y));
            let crossed = right.into_iter().chain(below).filter(|(there, _)| (here >= 0.5) != (*there >= 0.5));
            found.extend(crossed.map(|(there, step)| centre + (0.5 - here) / (there - here) * step));
        }
    }
    found
}

/// The corners of the smallest convex polygon around points (Andrew 1979).
fn convex_hull(mut points: Vec<DVec2>) -> Vec<DVec2> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let mut hull = half_hull(points.iter().copied());
    hull.extend(half_hull(points.iter().rev().copied()));
    hull
}

/// One side of the hull of sorted points, without its last corner, which is the first of the other side.
fn half_hull(points: impl Iterator<Item = DVec2>) -> Vec<DVec2> {
    let mut side: Vec<DVec2> = Vec::new();
    for point in points {
        while let [.., a, b] = side[..]
            && (b - a).perp_dot(point - a) <= 0.0
        {
            side.pop();
        }
        side.push(point);
    }
    side.pop();
    side
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn the_hull_holds_all_points_and_turns_one_way(
            points in prop::collection::vec(prop::array::uniform2(-9.0f64..9.0), 3..40),
        ) {
            let points: Vec<DVec2> = points.into_iter().map(DVec2::from_array).collect();
            let hull = convex_hull(points.clone());
            prop_assume!(hull.len() > 2);
            for (k, a) in hull.iter().enumerate() {
                let b = hull[(k + 1) % hull.len()];
                prop_assert!(points.iter().all(|p| (b - *a).perp_dot(*p - *a) > -1e-9));
            }
        }
    }

    /// A disc with antialiased edges.
    #[test]
    fn the_outline_is_finer_than_pixels() {
        let (size, centre, radius) = (40, DVec2::new(19.3, 20.8), 11.4);
        let coverage = |i: usize| {
            let pixel = DVec2::new((i % size) as f64 + 0.5, (i / size) as f64 + 0.5);
            (radius - pixel.distance(centre) + 0.5).clamp(0.0, 1.0) as f32
        };
        let mask = Mask { width: size, height: size, coverage: (0..size * size).map(coverage).collect() };
        let off = convex_hull(crossings(&mask)).into_iter().map(|p| (p.distance(centre) - radius).abs());
        let off = off.fold(0.0, f64::max);
        assert!(off < 0.1, "{off} pixels");
    }
}
