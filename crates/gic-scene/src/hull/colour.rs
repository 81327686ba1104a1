//! Colours of a hull's surface from the pictures that see it.

use gic_geometry::SurfacePoint;
use rayon::prelude::*;

use super::Hull;
use crate::camera::Camera;
use crate::picture::Picture;

impl Hull {
    /// Colours of surface points: the average over the pictures in which a point is in front, weighted by how squarely
    /// the surface faces the camera. Grey (0.5) where no picture shows the point.
    pub fn colours(&self, points: &[SurfacePoint], views: &[(&Camera, &Picture)]) -> Vec<[f32; 3]> {
        points.par_iter().map(|point| self.colour(point, views)).collect()
    }

    fn colour(&self, point: &SurfacePoint, views: &[(&Camera, &Picture)]) -> [f32; 3] {
        let (mut sum, mut total) = ([0.0; 3], 0.0);
        for (camera, picture) in views {
            let towards = (camera.centre - point.position).normalize_or_zero();
            let facing = point.normal.dot(towards).max(0.0);
            // Start outside of the cell's own neighbourhood, so that a rough surface does not hide itself.
            let start = point.position + (point.normal + towards) * self.cell;
            if facing < 0.1 || self.first_hit(start, towards).is_some() {
                continue;
            }
            let Some((pixel, _)) = camera.project(point.position) else { continue };
            let Some(colour) = picture.sample(pixel.x, pixel.y) else { continue };
            let weight = (facing * facing) as f32;
            for channel in 0..3 {
                sum[channel] += weight * colour[channel];
            }
            total += weight;
        }
        if total > 0.0 { sum.map(|value| value / total) } else { [0.5; 3] }
    }
}
