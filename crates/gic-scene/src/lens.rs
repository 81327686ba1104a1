//! Lens distortion, and its removal when a picture is read.

use glam::DVec2;
use rayon::prelude::*;

use crate::camera::Camera;
use crate::flight::CalibrationError;
use crate::picture::{Mask, Picture};

/// A lens that bends rays: maps undistorted normalised image coordinates (X/Z, Y/Z) to distorted ones.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Lens {
    /// Brown-Conrady with the rational radial factor of OpenCV:
    /// `(1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)` and tangential p1, p2.
    Perspective { k: [f64; 6], p: [f64; 2] },
    /// Equidistant fisheye: `theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)` along the direction.
    Fisheye { k: [f64; 4] },
    /// The field-of-view model of Devernay and Faugeras with angle omega [rad].
    FieldOfView { omega: f64 },
    /// A lens whose camera was mended: its focal length changed, and what remained of distortion was found.
    Mended { stated: Option<Box<Lens>>, error: CalibrationError },
}

impl Lens {
    /// The lens of OpenCV's coefficients k1 k2 p1 p2 k3 k4 k5 k6, of which the last may be left out; `None` of more.
    pub(crate) fn of_opencv(coefficients: &[f64]) -> Option<Lens> {
        let c = |index: usize| coefficients.get(index).copied().unwrap_or(0.0);
        (coefficients.len() <= 8)
            .then(|| Lens::Perspective { k: [c(0), c(1), c(4), c(5), c(6), c(7)], p: [c(2), c(3)] })
    }

    /// `None` when the lens does nothing: an ordinary pinhole.
    pub(crate) fn unless_trivial(self) -> Option<Lens> {
        let trivial = match &self {
            Lens::Perspective { k, p } => k.iter().chain(p).all(|&c| c == 0.0),
            Lens::FieldOfView { omega } => *omega == 0.0,
            // Without coefficients the equidistant projection is still no pinhole.
            Lens::Fisheye { .. } | Lens::Mended { .. } => false,
        };
        (!trivial).then_some(self)
    }

    /// Distorted normalised coordinates of undistorted ones.
    pub(crate) fn distort(&self, u: DVec2) -> DVec2 {
        let r2 = u.length_squared();
        match self {
            Lens::Perspective { k, p } => {
                let radial =
                    (1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[2]))) / (1.0 + r2 * (k[3] + r2 * (k[4] + r2 * k[5])));
                let (x, y) = (u.x, u.y);
                let tangential = DVec2::new(
                    2.0 * p[0] * x * y + p[1] * (r2 + 2.0 * x * x),
                    2.0 * p[1] * x * y + p[0] * (r2 + 2.0 * y * y),
                );
                u * radial + tangential
            }
            Lens::Fisheye { k } => {
                let r = r2.sqrt();
                if r < 1e-9 {
                    return u;
                }
                let theta = r.atan();
                let t2 = theta * theta;
                u * (theta * (1.0 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3])))) / r)
            }
            Lens::FieldOfView { omega } => {
                let r = r2.sqrt();
                if r < 1e-9 {
                    return u * (2.0 * (omega / 2.0).tan() / omega);
                }
                u * ((2.0 * r * (omega / 2.0).tan()).atan() / (omega * r))
            }
            Lens::Mended { stated, error } => match stated {
                None => error.bent(u),
                // The stated lens counts in units of the stated focal length.
                Some(lens) => lens.distort(error.bent(u) * error.focal.exp()) * (-error.focal).exp(),
            },
        }
    }

    /// Picture and mask as the pinhole `camera` would see them: same size, same focal lengths. What lies outside the
    /// distorted picture becomes black and uncovered.
    pub(crate) fn undistort(&self, camera: &Camera, picture: &Picture, mask: &Mask) -> (Picture, Mask) {
        let (width, height) = (camera.width, camera.height);
        let mut rgb = vec![0.0; 3 * width * height];
        let mut coverage = vec![0.0; width * height];
        rgb.par_chunks_mut(3 * width).zip(coverage.par_chunks_mut(width)).enumerate().for_each(
            |(row, (rgb, coverage))| {
                for column in 0..width {
                    let pixel = DVec2::new(column as f64 + 0.5, row as f64 + 0.5);
                    let source =
                        self.distort((pixel - camera.principal) / camera.focal) * camera.focal + camera.principal;
                    if let Some(colour) = picture.sample(source.x, source.y) {
                        rgb[3 * column..3 * column + 3].copy_from_slice(&colour);
                        coverage[column] = mask.sample(source.x, source.y);
                    }
                }
            },
        );
        (Picture { width, height, rgb }, Mask { width, height, coverage })
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;

    #[test]
    fn lenses_bend_as_their_formulas_say() {
        let close = |a: DVec2, b: DVec2| assert!((a - b).length() < 1e-12, "{a} for {b}");
        // OpenCV's documentation, worked out for (0.3, -0.4): r^2 = 0.25.
        let lens = Lens::Perspective { k: [0.2, -0.4, 0.8, 0.0, 0.0, 0.0], p: [0.01, -0.02] };
        let radial = 1.0 + 0.05 - 0.025 + 0.0125;
        close(
            lens.distort(DVec2::new(0.3, -0.4)),
            DVec2::new(
                0.3 * radial + 2.0 * 0.01 * 0.3 * -0.4 - 0.02 * (0.25 + 2.0 * 0.09),
                -0.4 * radial + 0.01 * (0.25 + 2.0 * 0.16) + 2.0 * -0.02 * 0.3 * -0.4,
            ),
        );
        let rational = Lens::Perspective { k: [0.0, 0.0, 0.0, 1.0, 0.0, 4.0], p: [0.0; 2] };
        close(rational.distort(DVec2::new(0.5, 0.0)), DVec2::new(0.5 / (1.0 + 0.25 + 0.0625), 0.0));
        // A ray at 45 degrees: theta = pi/4 in an equidistant fisheye.
        let fisheye = Lens::Fisheye { k: [0.0; 4] };
        close(fisheye.distort(DVec2::new(0.0, 1.0)), DVec2::new(0.0, std::f64::consts::FRAC_PI_4));
        close(fisheye.distort(DVec2::ZERO), DVec2::ZERO);
        let bent = Lens::Fisheye { k: [0.1, 0.0, 0.0, 0.0] };
        let theta = std::f64::consts::FRAC_PI_4;
        close(bent.distort(DVec2::new(-1.0, 0.0)), DVec2::new(-theta * (1.0 + 0.1 * theta * theta), 0.0));
        // r_d = atan(2 r tan(omega/2)) / omega.
        let fov = Lens::FieldOfView { omega: 0.9 };
        close(fov.distort(DVec2::new(0.0, 0.6)), DVec2::new(0.0, (1.2 * 0.45_f64.tan()).atan() / 0.9));
        let (near, centre) = (fov.distort(DVec2::new(1e-8, 0.0)).x, fov.distort(DVec2::new(1e-10, 0.0)).x);
        assert!((near / 1e-8 - centre / 1e-10).abs() < 1e-6, "continuous at the centre");
    }

    #[test]
    fn a_lens_without_coefficients_is_none() {
        assert_eq!(Lens::Perspective { k: [0.0; 6], p: [0.0; 2] }.unless_trivial(), None);
        assert!(Lens::Perspective { k: [0.0; 6], p: [0.0, 1e-3] }.unless_trivial().is_some());
        assert!(Lens::Fisheye { k: [0.0; 4] }.unless_trivial().is_some(), "equidistant is no pinhole");
    }

    #[test]
    fn undistorting_looks_up_the_distorted_place_and_is_empty_beyond() {
        let camera = Camera {
            width: 20,
            height: 10,
            focal: DVec2::splat(10.0),
            principal: DVec2::new(10.0, 5.0),
            world_from_camera: DMat3::IDENTITY,
            centre: DVec3::ZERO,
        };
        let rgb =
            (0..200).flat_map(|i| [((i % 20) as f32 + 0.5) / 20.0, ((i / 20) as f32 + 0.5) / 20.0, 0.0]).collect();
        let picture = Picture { width: 20, height: 10, rgb };
        let mask = Mask { width: 20, height: 10, coverage: vec![1.0; 200] };
        let lens = Lens::Perspective { k: [0.3, 0.0, 0.0, 0.0, 0.0, 0.0], p: [0.0; 2] };
        let (straight, covered) = lens.undistort(&camera, &picture, &mask);
        // Column 14, row 5: (0.45, 0.05), r^2 = 0.205, scaled by 1.0615.
        let expected = [(10.0 + 4.5 * 1.0615) / 20.0, (5.0 + 0.5 * 1.0615) / 20.0, 0.0];
        straight.at(14, 5).iter().zip(expected).for_each(|(a, b)| assert!((a - b as f32).abs() < 1e-5, "{a} for {b}"));
        // The corner moves out of the picture.
        assert_eq!((covered.at(0, 0), straight.at(0, 0)), (0.0, [0.0; 3]));
        assert_eq!(covered.at(14, 5), 1.0);
    }
}
