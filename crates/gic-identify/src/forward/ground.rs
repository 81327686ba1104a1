//! The ground as a hypothesis: a plane that is higher or lower than it was given, and tilted.

use gic_mpm::{Collider, ColliderPath, Primitive};
use glam::DVec3;

use crate::Input;
use crate::unknowns::state::State;

/// The obstacles of a state.
pub(crate) fn colliders(input: &Input, state: &State) -> Vec<Collider> {
    let mut colliders = input.colliders.clone();
    if let Some(ground) = input.ground.filter(|_| state.ground != DVec3::ZERO) {
        let plane = &mut colliders[ground.collider];
        *plane = moved(plane, input.centre(), state.ground);
    }
    colliders
}

/// The plane through the foot of `above` [m], raised by `by[0]` [m] there and with its normal n turned to
/// `n + by[1] s + by[2] t`, s and t along the plane. Others stay as they are.
fn moved(plane: &Collider, above: DVec3, by: DVec3) -> Collider {
    let (Primitive::HalfSpace { normal }, ColliderPath::Uniform { rotation, .. }) = (&plane.primitive, &plane.path)
    else {
        return plane.clone();
    };
    let normal = *rotation * *normal;
    let (s, t) = normal.any_orthonormal_pair();
    let foot = above - plane.signed_distance(above, 0.0) * normal;
    let turned = (normal + by.y * s + by.z * t).normalize();
    Collider::plane(foot + by.x * normal, turned, plane.contact)
}

#[cfg(test)]
mod tests {
    use gic_mpm::Contact;
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// A plane that is raised and tilted is so far below the point above which it is tilted as it was raised.
        #[test]
        fn a_plane_is_raised_and_tilted_below_the_body(
            normal in prop::array::uniform3(-1.0..1.0f64), above in prop::array::uniform3(-1.0..1.0f64),
            rise in -0.02..0.02f64, tilts in prop::array::uniform2(-0.05..0.05f64),
        ) {
            let normal = DVec3::from_array(normal);
            prop_assume!(normal.length() > 0.1);
            let (normal, above) = (normal.normalize(), DVec3::from_array(above));
            let plane = Collider::plane(DVec3::new(0.1, -0.3, 0.2), normal, Contact::Sticky);
            let was = plane.signed_distance(above, 0.0);
            let raised = moved(&plane, above, DVec3::new(rise, 0.0, 0.0));
            prop_assert!((raised.signed_distance(above, 0.0) - (was - rise)).abs() < 1e-12);
            let tilted = moved(&plane, above, DVec3::new(0.0, tilts[0], tilts[1]));
            let foot = above - was * normal;
            prop_assert!(tilted.signed_distance(foot, 0.0).abs() < 1e-12);
            let slope = tilts[0].hypot(tilts[1]);
            let Primitive::HalfSpace { normal: turned } = tilted.primitive else { unreachable!("a plane stays one") };
            prop_assert!((turned.angle_between(normal).tan() - slope).abs() < 1e-6);
        }
    }
}
