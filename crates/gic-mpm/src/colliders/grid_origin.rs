//! Where the grid's nodes lie: grounds lie on them.
//!
//! An obstacle holds the nodes that are inside of it, so a ground between two layers of nodes acts as if it lay on the
//! lower one. The grid is therefore laid so that the first resting plane across each axis passes through nodes at the
//! point it is given by: then matter meets it where it is, and a ground that is raised by a tenth of a cell raises
//! matter by as much.

use glam::DVec3;

use super::collider::Collider;

/// Planes nearer to a node than this are on it [cells]. Derived: what rounding leaves of heights in tenths of a metre.
const ON_NODE_CELLS: f64 = 1e-6;

/// A node of the grid within half a cell of the world's origin [m].
pub(crate) fn grid_origin(colliders: &[Collider], spacing: f64) -> DVec3 {
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

    proptest! {
        #[test]
        fn planes_pass_through_nodes(height in -1.0..1.0f64, tilt in -0.1..0.1f64, axis in 0usize..3, spacing in 0.005..0.05f64) {
            let mut normal = DVec3::AXES[axis];
            normal[(axis + 1) % 3] = tilt;
            let plane = Collider::plane(height * DVec3::AXES[axis], normal.normalize(), Contact::Sticky);
            let origin = grid_origin(std::slice::from_ref(&plane), spacing);
            prop_assert!(origin.abs().max_element() <= 0.5 * spacing + 1e-12);
            let cells = (height - origin[axis]) / spacing;
            prop_assert!((cells - cells.round()).abs() < 1e-5, "{}", cells);
        }
    }

    #[test]
    fn a_ground_at_a_round_height_moves_no_node() {
        let ground = |height: f64| Collider::plane(DVec3::new(0.0, height, 0.0), DVec3::Y, Contact::Sticky);
        for height in [0.0, 0.3, -0.02] {
            assert_eq!(grid_origin(&[ground(height)], 0.02), DVec3::ZERO, "{height}");
        }
        assert_eq!(grid_origin(&[], 0.02), DVec3::ZERO);
    }
}
