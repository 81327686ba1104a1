//! A camera's lens: from a point before it to a pixel, with derivatives.
//!
//! ```text
//! x = X / Z,  y = Y / Z,  r^2 = x^2 + y^2,  d = 1 + k1 r^2 + k2 r^4
//! x' = x d + 2 p1 x y + p2 (r^2 + 2 x^2)          y' = y d + p1 (r^2 + 2 y^2) + 2 p2 x y
//! u = fx x' + cx,  v = fy y' + cy,  fx = e^l,  fy = e^(l + a)
//! ```
//!
//! Brown's model in OpenCV's order; the focal lengths as logarithms stay positive.

use nalgebra::{Matrix2, Matrix2x3, SMatrix, Vector2, Vector3};

/// Number of a lens's unknowns.
pub(crate) const LENS_UNKNOWNS: usize = 8;

/// Derivatives of a pixel by a lens's unknowns.
pub(crate) type LensJacobian = SMatrix<f64, 2, LENS_UNKNOWNS>;

/// A lens, in the order of its unknowns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// l, a, cx, cy [pixels], k1, k2, p1, p2.
    pub(crate) unknowns: [f64; LENS_UNKNOWNS],
}

impl Lens {
    /// A lens without distortion that looks along the middle of its pictures, with a focal length [pixels].
    pub(crate) fn simple(focal_px: f64, size: [usize; 2]) -> Lens {
        let [cx, cy] = size.map(|n| n as f64 / 2.0);
        Lens { unknowns: [focal_px.ln(), 0.0, cx, cy, 0.0, 0.0, 0.0, 0.0] }
    }

    /// A lens of focal lengths and principal point [pixels] and distortion k1, k2, p1, p2.
    pub fn new([fx, fy]: [f64; 2], [cx, cy]: [f64; 2], [k1, k2, p1, p2]: [f64; 4]) -> Lens {
        Lens { unknowns: [fx.ln(), (fy / fx).ln(), cx, cy, k1, k2, p1, p2] }
    }

    /// Focal lengths along x and y [pixels].
    pub fn focal_px(&self) -> [f64; 2] {
        [self.unknowns[0].exp(), (self.unknowns[0] + self.unknowns[1]).exp()]
    }

    /// The principal point [pixels].
    pub fn principal_px(&self) -> [f64; 2] {
        [self.unknowns[2], self.unknowns[3]]
    }

    /// k1, k2, p1, p2.
    pub fn distortion(&self) -> [f64; 4] {
        [self.unknowns[4], self.unknowns[5], self.unknowns[6], self.unknowns[7]]
    }

    /// The pixel of a point in the camera's frame [m]; `None` for one that is not before the camera.
    pub fn project(&self, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        self.project_with_derivatives(point).map(|(pixel, _, _)| pixel)
    }

    /// The pixel of a point in the camera's frame, and its derivatives by the point [pixels/m] and by the unknowns.
    pub(crate) fn project_with_derivatives(
        &self,
        point: &Vector3<f64>,
    ) -> Option<(Vector2<f64>, Matrix2x3<f64>, LensJacobian)> {
        let is_before = point.z > 0.0;
        if !is_before {
            return None;
        }
        let [k1, k2, p1, p2] = self.distortion();
        let [fx, fy] = self.focal_px();
        let (x, y) = (point.x / point.z, point.y / point.z);
        let r2 = x * x + y * y;
        let d = 1.0 + k1 * r2 + k2 * r2 * r2;
        let bent = Vector2::new(
            x * d + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * d + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        );
        let slope = 2.0 * k1 + 4.0 * k2 * r2;
        let cross = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y;
        let bent_by_flat = Matrix2::new(
            d + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x,
            cross,
            cross,
            d + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x,
        );
        let flat_by_point = Matrix2x3::new(1.0, 0.0, -x, 0.0, 1.0, -y) / point.z;
        let scale = Matrix2::new(fx, 0.0, 0.0, fy);
        let pixel = scale * bent + Vector2::new(self.unknowns[2], self.unknowns[3]);
        #[rustfmt::skip]
        let by_unknowns = LensJacobian::from_row_slice(&[
            fx * bent.x, 0.0, 1.0, 0.0, fx * x * r2, fx * x * r2 * r2, fx * 2.0 * x * y, fx * (r2 + 2.0 * x * x),
            fy * bent.y, fy * bent.y, 0.0, 1.0, fy * y * r2, fy * y * r2 * r2, fy * (r2 + 2.0 * y * y), fy * 2.0 * x * y,
        ]);
        Some((pixel, scale * bent_by_flat * flat_by_point, by_unknowns))
    }

    /// The direction (x, y, 1) in the camera's frame that a pixel shows, by fixed-point iteration.
    pub(crate) fn direction(&self, [u, v]: [f64; 2]) -> Vector3<f64> {
        let [fx, fy] = self.focal_px();
        let [k1, k2, p1, p2] = self.distortion();
        let (bx, by) = ((u - self.unknowns[2]) / fx, (v - self.unknowns[3]) / fy);
        let (mut x, mut y) = (bx, by);
        for _ in 0..20 {
            let r2 = x * x + y * y;
            let d = 1.0 + k1 * r2 + k2 * r2 * r2;
            let (tx, ty) = (2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y);
            (x, y) = ((bx - tx) / d, (by - ty) / d);
        }
        Vector3::new(x, y, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lens() -> Lens {
        Lens::new([500.0, 505.0], [322.0, 238.0], [-0.25, 0.08, 0.002, -0.001])
    }

    #[test]
    fn derivatives_of_a_lens_are_those_of_differences() {
        let (lens, point, h) = (lens(), Vector3::new(0.3, -0.2, 0.9), 1e-6);
        let (_, by_point, by_unknowns) = lens.project_with_derivatives(&point).unwrap();
        for k in 0..3 {
            let mut step = Vector3::zeros();
            step[k] = h;
            let difference =
                (lens.project(&(point + step)).unwrap() - lens.project(&(point - step)).unwrap()) / (2.0 * h);
            assert!((difference - by_point.column(k)).norm() < 1e-6 * by_point.norm(), "point {k}");
        }
        for k in 0..LENS_UNKNOWNS {
            let moved = |by: f64| {
                let mut moved = lens;
                moved.unknowns[k] += by;
                moved.project(&point).unwrap()
            };
            let difference = (moved(h) - moved(-h)) / (2.0 * h);
            assert!((difference - by_unknowns.column(k)).norm() < 1e-6 * by_unknowns.norm(), "unknown {k}");
        }
    }

    #[test]
    fn a_pixels_direction_is_seen_there() {
        for pixel in [[10.0, 20.0], [322.0, 238.0], [600.0, 400.0]] {
            let seen = lens().project(&lens().direction(pixel)).unwrap();
            assert!((seen - Vector2::from(pixel)).norm() < 1e-6, "{seen}");
        }
        assert_eq!(lens().project(&Vector3::new(0.0, 0.0, -1.0)), None);
    }
}
