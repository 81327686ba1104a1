//! The ground as a hypothesis: a plane that is higher or lower than it was given.

use gic_mpm::{Collider, ColliderPath};

use crate::Input;
use crate::unknowns::state::State;

/// The obstacles of a state.
pub(crate) fn colliders(input: &Input, state: &State) -> Vec<Collider> {
    let mut colliders = input.colliders.clone();
    if let Some(ground) = input.ground {
        raise(&mut colliders[ground.collider], state.ground);
    }
    colliders
}

/// Raises a plane at rest by `height` [m] along its normal.
fn raise(plane: &mut Collider, height: f64) {
    let normal = plane.normal();
    if let (Some(normal), ColliderPath::Uniform { position_m, .. }) = (normal, &mut plane.path) {
        *position_m += height * normal;
    }
}

#[cfg(test)]
mod tests {
    use gic_mpm::Contact;
    use glam::DVec3;

    use super::*;

    #[test]
    fn a_raised_plane_is_nearer_by_as_much() {
        let normal = DVec3::new(0.3, 0.9, -0.2).normalize();
        let mut plane = Collider::plane(DVec3::new(0.1, -0.3, 0.2), normal, Contact::Sticky);
        let above = DVec3::new(0.4, 0.5, -0.1);
        let was = plane.signed_distance(above, 0.0);
        raise(&mut plane, 0.013);
        assert!((was - plane.signed_distance(above, 0.0) - 0.013).abs() < 1e-12);
    }
}
