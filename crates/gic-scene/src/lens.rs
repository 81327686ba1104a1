//! Lens distortion, and its removal when a picture is read.

use glam::DVec2;
use rayon::prelude::*;

use crate::camera::Camera;
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
}

impl Lens {
    /// `None` when the lens does nothing: an ordinary pinhole.
    pub(crate) fn unless_trivial(self) -> Option<Lens> {
        let trivial = match &self {
            Lens::Perspective { k, p } => k.iter().chain(p).all(|&c| c == 0.0),
            Lens::FieldOfView { omega } => *omega == 0.0,
            // Without coefficients the equidistant projection is still no pinhole.
            Lens::Fisheye { .. } => false,
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
