//! Mirror planes at right angles, and the maps of a body onto itself that they make.

use gic_optimize::least_squares;
use gic_scene::Camera;
use glam::{DAffine3, DMat3, DQuat, DVec3};
use nalgebra::DVector;
use serde::{Deserialize, Serialize};

/// Mirror planes at right angles to each other.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Symmetry {
    /// The planes, at most three.
    pub planes: Vec<MirrorPlane>,
    /// Which of three planes may change places: the body is the same along their normals, as a bar with a square
    /// section is along two. Looked for in outlines only.
    pub interchangeable_planes: Vec<[usize; 2]>,
}

/// A plane whose two sides are mirror images: the points x with normal . x = offset.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MirrorPlane {
    /// Unit normal.
    pub normal: DVec3,
    /// Distance of the plane from the origin along its normal [m].
    #[serde(rename = "offset_m")]
    pub offset: f64,
    /// How far mirrored points of the surface lie from it, in the mean [m]; where the plane was found by outlines, by
    /// how much rays along them miss their mirror images.
    #[serde(rename = "misfit_m")]
    pub misfit: f64,
}

impl MirrorPlane {
    /// The mirror image of a point [m].
    pub fn mirror(&self, point: DVec3) -> DVec3 {
        point - 2.0 * (self.normal.dot(point) - self.offset) * self.normal
    }

    /// The plane with another normal, as far from a point [m] as before.
    fn turned(&self, normal: DVec3, point: DVec3) -> MirrorPlane {
        MirrorPlane { normal, offset: self.offset + (normal - self.normal).dot(point), ..*self }
    }
}

impl Symmetry {
    /// How far mirrored points of the surface lie from it, the mean of the planes [m].
    pub fn misfit(&self) -> f64 {
        self.planes.iter().map(|plane| plane.misfit).sum::<f64>() / self.planes.len().max(1) as f64
    }

    /// Whether a body that had the symmetry `rest` before has kept its shape: it has as many planes, which fit at most
    /// `same_misfit` times worse.
    pub(super) fn is_still(&self, rest: &Symmetry, same_misfit: f64) -> bool {
        self.planes.len() == rest.planes.len() && self.misfit() <= same_misfit * rest.misfit()
    }

    /// The planes turned together about a point and shifted each, so that `residuals` are least, and these, root mean
    /// square. `difference` is a turn [rad], and a shift in units of `size` [m], that changes little.
    pub(super) fn fitted(
        &self,
        (middle, size): (DVec3, f64),
        difference: f64,
        residuals: impl Fn(&Symmetry) -> DVector<f64>,
    ) -> (f64, Symmetry) {
        let unknowns = 3 + self.planes.len();
        let moved = |by: &DVector<f64>| self.moved(by, middle, size);
        let fit = least_squares(|by| residuals(&moved(by)), DVector::zeros(unknowns), &vec![difference; unknowns]);
        (fit.rms(), moved(&fit.unknowns))
    }

    /// The planes turned together about `middle` by the first three unknowns [rad], and each shifted by its own in
    /// units of `size` [m].
    fn moved(&self, by: &DVector<f64>, middle: DVec3, size: f64) -> Symmetry {
        let rotation = DQuat::from_scaled_axis(DVec3::new(by[0], by[1], by[2]));
        let planes = self.planes.iter().enumerate().map(|(k, plane)| {
            let turned = plane.turned(rotation * plane.normal, middle);
            MirrorPlane { offset: turned.offset + size * by[3 + k], ..turned }
        });
        Symmetry { planes: planes.collect(), interchangeable_planes: self.interchangeable_planes.clone() }
    }

    /// The maps of the body onto itself.
    pub(crate) fn images(&self) -> Images<'_> {
        Images { planes: &self.planes, turns: self.turns() }
    }

    /// Where three planes meet [m]; `None` of fewer.
    pub(crate) fn centre(&self) -> Option<DVec3> {
        let [a, b, c] = self.planes.as_slice() else { return None };
        Some(a.offset * a.normal + b.offset * b.normal + c.offset * c.normal)
    }

    /// The maps that let interchangeable planes change places, other than the identity.
    fn turns(&self) -> Vec<DAffine3> {
        let Some(centre) = self.centre() else { return Vec::new() };
        let mut orders = vec![[0, 1, 2]];
        let mut k = 0;
        while k < orders.len() {
            for &[a, b] in &self.interchangeable_planes {
                let mut order = orders[k];
                order.swap(a, b);
                if !orders.contains(&order) {
                    orders.push(order);
                }
            }
            k += 1;
        }
        let axes = |order: [usize; 3]| {
            let [a, b, c] = order.map(|i| self.planes[i].normal);
            DMat3::from_cols(a, b, c)
        };
        let turn = |order: &[usize; 3]| {
            let turn = axes(*order) * axes(orders[0]).transpose();
            DAffine3::from_mat3_translation(turn, centre - turn * centre)
        };
        orders[1..].iter().map(turn).collect()
    }

    /// The mirror images of a camera: to them, the body looks as it does to the camera. Their axes are left-handed
    /// where a single mirror made them.
    pub(crate) fn mirrored_cameras(&self, camera: &Camera) -> Vec<Camera> {
        let (images, axes) = (self.images(), camera.world_from_camera);
        let origins: Vec<DVec3> = images.of(DVec3::ZERO).skip(1).collect();
        let columns = [axes.x_axis, axes.y_axis, axes.z_axis].map(|a| images.of(a).skip(1).collect::<Vec<_>>());
        let centres = images.of(camera.centre).skip(1);
        (centres.enumerate())
            .map(|(k, centre)| {
                let [x, y, z] = [0, 1, 2].map(|c: usize| columns[c][k] - origins[k]);
                Camera { world_from_camera: DMat3::from_cols(x, y, z), centre, ..camera.clone() }
            })
            .collect()
    }
}

/// The maps of a body onto itself.
pub(crate) struct Images<'a> {
    planes: &'a [MirrorPlane],
    turns: Vec<DAffine3>,
}

impl Images<'_> {
    /// All images of a point [m]: first itself, then its mirror images and their mirror images, then those of where it
    /// is turned to.
    pub(crate) fn of(&self, point: DVec3) -> impl Iterator<Item = DVec3> + '_ {
        let turned = self.turns.iter().map(move |turn| turn.transform_point3(point));
        std::iter::once(point).chain(turned).flat_map(move |start| {
            (0..1usize << self.planes.len()).map(move |subset| {
                let chosen = self.planes.iter().enumerate().filter(|(k, _)| subset >> k & 1 == 1);
                chosen.fold(start, |image, (_, plane)| plane.mirror(image))
            })
        })
    }
}

/// Unit vectors at right angles to planes: of no plane `count` of them evenly over a half sphere, of one plane as close
/// together on a half circle, of two the one that is left.
pub(super) fn normals_beside(planes: &[MirrorPlane], count: usize) -> Vec<DVec3> {
    match planes {
        [] => (0..count).map(|k| direction(k, count)).collect(),
        [one] => {
            let (a, b) = one.normal.any_orthonormal_pair();
            let steps = (std::f64::consts::PI / angle_between(count)).ceil();
            let angle = |k: usize| std::f64::consts::PI * k as f64 / steps;
            (0..steps as usize).map(|k| angle(k).cos() * a + angle(k).sin() * b).collect()
        }
        [one, other, ..] => vec![one.normal.cross(other.normal).normalize_or(DVec3::Y)],
    }
}

/// About the angle between neighbours of `count` directions [rad]: each has its part of a half sphere.
pub(super) fn angle_between(count: usize) -> f64 {
    (2.0 * std::f64::consts::PI / count as f64).sqrt()
}

/// The k-th of `count` directions, evenly over a half sphere (a Fibonacci spiral).
pub(crate) fn direction(k: usize, count: usize) -> DVec3 {
    let golden = std::f64::consts::PI * (1.0 + 5f64.sqrt());
    let z = (k as f64 + 0.5) / count as f64;
    let (sin, cos) = (golden * (k as f64 + 0.5)).sin_cos();
    let radius = (1.0 - z * z).sqrt();
    DVec3::new(radius * cos, radius * sin, z)
}
