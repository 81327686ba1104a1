//! Rotation, translation and scale between two world frames.

use gic_geometry::Plane;
use glam::{DMat3, DVec3};

use crate::camera::Camera;
use crate::scene::Scene;
use crate::world::{ColouredPoint, World};

/// x' = scale * rotation * x + translation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    /// Length in the new frame of a unit of the old one, above 0.
    pub scale: f64,
    /// The rotation, determinant +1.
    pub rotation: DMat3,
    /// Where the origin goes, in units of the new frame.
    pub translation: DVec3,
}

impl Similarity {
    /// Where a point goes.
    pub fn point(&self, x: DVec3) -> DVec3 {
        self.scale * (self.rotation * x) + self.translation
    }

    /// The camera that sees moved things as `camera` sees them unmoved.
    pub fn camera(&self, camera: &Camera) -> Camera {
        Camera {
            world_from_camera: self.rotation * camera.world_from_camera,
            centre: self.point(camera.centre),
            ..camera.clone()
        }
    }

    /// The 4x4 matrix, row by row.
    pub fn matrix(&self) -> [[f64; 4]; 4] {
        let rows = (self.scale * self.rotation).transpose();
        let t = self.translation;
        [
            [rows.x_axis.x, rows.x_axis.y, rows.x_axis.z, t.x],
            [rows.y_axis.x, rows.y_axis.y, rows.y_axis.z, t.y],
            [rows.z_axis.x, rows.z_axis.y, rows.z_axis.z, t.z],
            [0.0, 0.0, 0.0, 1.0],
        ]
    }
}

impl Scene {
    /// The same pictures in another world frame: cameras, points and what is known of the world are moved along.
    #[must_use]
    pub fn moved(&self, to: &Similarity) -> Scene {
        let turned = |v: DVec3| to.rotation * v;
        let World { up, gravity, ground, ground_deviation_m, metric } = self.world;
        let plane = |p: Plane| Plane { point: to.point(p.point), normal: turned(p.normal) };
        let point = |p: &ColouredPoint| ColouredPoint { position: to.point(p.position), ..*p };
        Scene {
            cameras: self.cameras.iter().map(|camera| to.camera(camera)).collect(),
            points: self.points.iter().map(point).collect(),
            world: World {
                up: up.map(turned),
                gravity: gravity.map(|g| to.scale * turned(g)),
                ground: ground.map(plane),
                ground_deviation_m: to.scale * ground_deviation_m,
                metric,
            },
            ..self.clone()
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;

    #[test]
    fn a_moved_camera_sees_moved_points_as_before() {
        let similarity = Similarity {
            scale: 0.3,
            rotation: DMat3::from_euler(glam::EulerRot::XYZ, 0.4, -1.1, 2.0),
            translation: DVec3::new(0.5, -0.2, 1.5),
        };
        let camera = Camera {
            width: 40,
            height: 30,
            focal: DVec2::new(50.0, 55.0),
            principal: DVec2::new(19.0, 16.0),
            world_from_camera: DMat3::from_rotation_y(0.3),
            centre: DVec3::new(0.1, 0.2, -3.0),
        };
        let x = DVec3::new(0.3, -0.4, 0.7);
        let moved = similarity.camera(&camera);
        let ((before, near), (after, far)) = (camera.project(x).unwrap(), moved.project(similarity.point(x)).unwrap());
        assert!((before - after).length() < 1e-10, "{before} {after}");
        assert!((far / near - similarity.scale).abs() < 1e-12, "depths scale");
        let m = similarity.matrix();
        let row = |r: [f64; 4]| r[0] * x.x + r[1] * x.y + r[2] * x.z + r[3];
        let by_matrix = DVec3::new(row(m[0]), row(m[1]), row(m[2]));
        assert!((by_matrix - similarity.point(x)).length() < 1e-12);
    }
}
