//! The one camera convention of gic: x right, y down, z forward (OpenCV); pixel centres at +0.5; world frame = the
//! dataset's.

use glam::{DMat3, DVec2, DVec3};

/// A pinhole camera in the world frame of its dataset, in metres and pixels.
///
/// A world point `x` has camera coordinates `world_from_camera^T (x - centre)` with z forward, and image coordinates
/// `(fx X/Z + cx, fy Y/Z + cy)`, where the centre of the pixel in column i, row j is `(i + 0.5, j + 0.5)`.
/// Images with lens distortion are undistorted when they are read, so that everything downstream is a pinhole.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Image width [pixels].
    pub width: usize,
    /// Image height [pixels].
    pub height: usize,
    /// Focal lengths (fx, fy) [pixels].
    pub focal: DVec2,
    /// Principal point (cx, cy) [pixels].
    pub principal: DVec2,
    /// Camera-to-world rotation: its columns are the camera's x (right), y (down) and z (forward) axes in the world.
    pub world_from_camera: DMat3,
    /// Camera centre in the world [m].
    pub centre: DVec3,
}

impl Camera {
    /// Camera coordinates (x right, y down, z forward) [m] of a world point [m].
    pub fn to_camera(&self, world: DVec3) -> DVec3 {
        self.world_from_camera.transpose() * (world - self.centre)
    }

    /// Image coordinates [pixels] and depth along the optical axis [m] of a world point; `None` behind the camera.
    pub fn project(&self, world: DVec3) -> Option<(DVec2, f64)> {
        let c = self.to_camera(world);
        (c.z > 1e-9).then(|| (self.focal * DVec2::new(c.x, c.y) / c.z + self.principal, c.z))
    }

    /// World point [m] seen at image coordinates `pixel` [pixels] at `depth` along the optical axis [m].
    pub fn unproject(&self, pixel: DVec2, depth: f64) -> DVec3 {
        let c = (pixel - self.principal) / self.focal * depth;
        self.world_from_camera * DVec3::new(c.x, c.y, depth) + self.centre
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn camera(axis: [f64; 3], angle: f64, centre: [f64; 3]) -> Camera {
        let axis = DVec3::from_array(axis).normalize_or(DVec3::X);
        Camera {
            width: 64,
            height: 48,
            focal: DVec2::new(70.0, 80.0),
            principal: DVec2::new(30.0, 25.0),
            world_from_camera: DMat3::from_axis_angle(axis, angle),
            centre: DVec3::from_array(centre),
        }
    }

    proptest! {
        #[test]
        fn projecting_undoes_unprojecting(
            axis in prop::array::uniform3(-1.0..1.0_f64),
            angle in -3.0..3.0_f64,
            centre in prop::array::uniform3(-2.0..2.0_f64),
            pixel in prop::array::uniform2(-10.0..70.0_f64),
            depth in 0.1..5.0_f64,
        ) {
            let camera = camera(axis, angle, centre);
            let pixel = DVec2::from_array(pixel);
            let world = camera.unproject(pixel, depth);
            let (back, z) = camera.project(world).expect("in front");
            prop_assert!((back - pixel).length() < 1e-8 && (z - depth).abs() < 1e-10);
            prop_assert!((camera.to_camera(world).z - depth).abs() < 1e-10);
            prop_assert_eq!(camera.project(camera.unproject(pixel, -depth)), None);
        }
    }
}
