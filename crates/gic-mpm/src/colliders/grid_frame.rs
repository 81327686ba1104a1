//! Where the grid's nodes lie: on the ground.
//!
//! An obstacle holds the nodes that are inside of it, so a plane between two layers of nodes acts as if it lay on the
//! lower one, and a tilted one as a staircase. The grid is therefore laid on the ground: an axis is the ground's
//! normal, and the first resting plane across each axis passes through nodes at the point it is given by. Then matter
//! meets the ground where it is, and a ground that is raised by a tenth of a cell, or tilted by a degree, moves matter
//! by as much.

use glam::{DMat3, DQuat, DVec3};

use super::collider::Collider;
use crate::math::mat3::Mat3;

/// Planes nearer to a node than this are on it [cells]. Derived: what rounding leaves of heights in tenths of a metre.
const ON_NODE_CELLS: f64 = 1e-6;
/// A normal that differs by less from an axis is that axis. Derived: what rounding leaves of a unit vector.
const ALONG_AXIS: f64 = 1e-9;

/// The frame of the grid, in which everything within a rollout is measured.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GridFrame {
    /// The grid's axes in the world and the point of the ground that stays where it is [m]; `None` where the axes are
    /// the world's.
    world_from_grid: Option<(DQuat, DVec3)>,
    /// A node within half a cell of the world's origin [m], in the grid's axes.
    origin: DVec3,
}

impl GridFrame {
    /// The frame of a grid with cells of `spacing` [m] among obstacles, of which the ground is the one that faces
    /// gravity.
    pub(crate) fn new(colliders: &[Collider], gravity: DVec3, spacing: f64) -> GridFrame {
        let turned = GridFrame { world_from_grid: axes_of_ground(colliders, gravity), origin: DVec3::ZERO };
        let colliders: Vec<Collider> = colliders.iter().map(|collider| turned.collider(collider)).collect();
        GridFrame { origin: node(&colliders, spacing), ..turned }
    }

    /// A vector of the world in the grid's axes.
    pub(crate) fn vector(&self, world: DVec3) -> DVec3 {
        self.world_from_grid.map_or(world, |(axes, _)| axes.inverse() * world)
    }

    /// A vector in the grid's axes in the world.
    pub(crate) fn vector_in_world(&self, own: DVec3) -> DVec3 {
        self.world_from_grid.map_or(own, |(axes, _)| axes * own)
    }

    /// A point of the world [m] as the grid has it.
    pub(crate) fn point(&self, world: DVec3) -> DVec3 {
        self.turned(world) - self.origin
    }

    /// A point of the world [m] in the grid's axes.
    fn turned(&self, world: DVec3) -> DVec3 {
        self.world_from_grid.map_or(world, |(axes, pivot)| pivot + axes.inverse() * (world - pivot))
    }

    /// A point of the grid [m] in the world.
    pub(crate) fn point_in_world(&self, own: DVec3) -> DVec3 {
        let own = own + self.origin;
        self.world_from_grid.map_or(own, |(axes, pivot)| pivot + axes * (own - pivot))
    }

    /// A tensor in the grid's axes in the world: `R T R^T`.
    pub(crate) fn tensor_in_world(&self, own: Mat3<f64>) -> Mat3<f64> {
        let Some((axes, _)) = self.world_from_grid else { return own };
        let axes = DMat3::from_quat(axes);
        let own = DMat3::from_cols_array(&own.0).transpose();
        Mat3((axes * own * axes.transpose()).transpose().to_cols_array())
    }

    /// An obstacle of the world as the grid has it.
    pub(crate) fn collider(&self, world: &Collider) -> Collider {
        let turned = |rotation: DQuat| self.world_from_grid.map_or(rotation, |(axes, _)| axes.inverse() * rotation);
        let path = world.path.map(&|point| self.point(point), &|vector| self.vector(vector), &turned);
        Collider { path, ..world.clone() }
    }
}

/// The turn that takes the nearest axis to the normal of the ground, and a point of the ground [m]. It is the one of
/// the planes at rest that faces gravity.
fn axes_of_ground(colliders: &[Collider], gravity: DVec3) -> Option<(DQuat, DVec3)> {
    let resting = colliders.iter().filter(|collider| collider.path.is_at_rest());
    let planes = resting.filter_map(|collider| Some((collider.normal()?, collider.path.pose(0.0).position)));
    let (ground, point) = planes.reduce(|a, b| if b.0.dot(gravity) < a.0.dot(gravity) { b } else { a })?;
    let axis = DVec3::AXES[ground.abs().max_position()];
    let axis = axis * ground.dot(axis).signum();
    (ground.distance(axis) > ALONG_AXIS).then(|| (DQuat::from_rotation_arc(axis, ground), point))
}

/// A node of the grid within half a cell of the origin [m], so that planes across its axes lie on nodes.
fn node(colliders: &[Collider], spacing: f64) -> DVec3 {
    let mut origin = [None; 3];
    for collider in colliders.iter().filter(|collider| collider.path.is_at_rest()) {
        let Some(normal) = collider.normal() else { continue };
        let axis = normal.abs().max_position();
        let height = collider.path.pose(0.0).position[axis];
        let off = height - (height / spacing).round() * spacing;
        origin[axis].get_or_insert(if off.abs() > ON_NODE_CELLS * spacing { off } else { 0.0 });
    }
    DVec3::from_array(origin.map(Option::unwrap_or_default))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::Contact;

    const GRAVITY: DVec3 = DVec3::new(0.0, -9.8, 0.0);

    proptest! {
        #[test]
        fn the_ground_is_a_layer_of_nodes(
            point in prop::array::uniform3(-1.0..1.0f64), way in prop::array::uniform3(-1.0..1.0f64),
            spacing in 0.005..0.05f64,
        ) {
            let normal = DVec3::from_array(way).normalize_or(DVec3::Y);
            let point = DVec3::from_array(point);
            let wall = Collider::plane(DVec3::ZERO, normal.any_orthonormal_vector(), Contact::Sticky);
            let ground = Collider::plane(point, normal, Contact::Sticky);
            let frame = GridFrame::new(&[wall, ground.clone()], -9.8 * normal, spacing);
            prop_assert!(frame.origin.abs().max_element() <= 0.5 * spacing + 1e-12);
            // The ground's points differ from its own point along two axes only, and that point is on a node's layer.
            let axis = frame.collider(&ground).normal().expect("a plane").abs().max_position();
            let beside = frame.point(point + 0.3 * normal.any_orthonormal_vector());
            prop_assert!((beside[axis] - frame.point(point)[axis]).abs() < 1e-12);
            let cells = beside[axis] / spacing;
            prop_assert!((cells - cells.round()).abs() < 1e-5, "{}", cells);
            prop_assert!(frame.point_in_world(frame.point(point)).distance(point) < 1e-12);
        }
    }

    #[test]
    fn a_ground_across_an_axis_turns_nothing_and_one_at_a_round_height_moves_no_node() {
        let ground = |height: f64| Collider::plane(DVec3::new(0.0, height, 0.0), DVec3::Y, Contact::Sticky);
        for height in [0.0, 0.3, -0.02] {
            let frame = GridFrame::new(&[ground(height)], GRAVITY, 0.02);
            assert!(frame.world_from_grid.is_none() && frame.origin == DVec3::ZERO, "{height}");
        }
        assert!(GridFrame::new(&[], GRAVITY, 0.02).world_from_grid.is_none());
    }

    #[test]
    fn tensors_turn_as_what_they_map() {
        let normal = DVec3::new(0.2, 0.9, -0.1).normalize();
        let frame = GridFrame::new(&[Collider::plane(DVec3::ZERO, normal, Contact::Sticky)], GRAVITY, 0.02);
        let own = Mat3([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0]);
        let apply = |m: &Mat3<f64>, v: DVec3| {
            DVec3::from_array([0, 1, 2].map(|i| DVec3::new(m.at(i, 0), m.at(i, 1), m.at(i, 2)).dot(v)))
        };
        let v = DVec3::new(0.3, -0.7, 0.4);
        let through_grid = frame.vector_in_world(apply(&own, frame.vector(v)));
        assert!(apply(&frame.tensor_in_world(own), v).distance(through_grid) < 1e-12);
    }
}
