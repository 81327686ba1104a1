//! The world as a hypothesis: a ground that is higher or lower than it was given, tilted, more or less slippery or one
//! that holds what touches it, and gravity that is stronger or weaker than it should be in the lengths that the cameras
//! see, or not straight down.

use gic_mpm::{Collider, ColliderPath, Contact};
use glam::{DQuat, DVec3};

use crate::Input;
use crate::unknowns::state::State;

/// The obstacles of a state.
pub(crate) fn colliders(input: &Input, state: &State) -> Vec<Collider> {
    let mut colliders = input.colliders.clone();
    if let Some(doubt) = input.world_doubt {
        let [height, tilt_x, tilt_y, log_friction, ..] = state.world;
        let plane = &mut colliders[doubt.collider];
        if doubt.tilt_rad > 0.0 {
            turn(plane, input.centre(), [tilt_x, tilt_y]);
        }
        raise(plane, height);
        scale_friction(&mut plane.contact, log_friction.exp());
        if state.sticks {
            plane.contact = Contact::Sticky;
        }
    }
    colliders
}

/// Gravity of a state [m/s^2].
pub(crate) fn gravity(input: &Input, state: &State) -> DVec3 {
    let [.., log_gravity, tilt_x, tilt_y] = state.world;
    let given = input.gravity_m_s2;
    tilt(down(given), [tilt_x, tilt_y]) * given * log_gravity.exp()
}

/// The direction of gravity [m/s^2].
pub(crate) fn down(gravity: DVec3) -> DVec3 {
    gravity.try_normalize().unwrap_or(DVec3::NEG_Y)
}

/// The turn by these angles [rad] about two axes at right angles to `normal`.
fn tilt(normal: DVec3, [about_x, about_y]: [f64; 2]) -> DQuat {
    let (x, y) = normal.any_orthonormal_pair();
    DQuat::from_scaled_axis(about_x * x + about_y * y)
}

/// Raises a plane at rest by `height` [m] along its normal.
fn raise(plane: &mut Collider, height: f64) {
    let normal = plane.normal();
    if let (Some(normal), ColliderPath::Uniform { position_m, .. }) = (normal, &mut plane.path) {
        *position_m += height * normal;
    }
}

/// Turns a plane at rest about two axes in it [rad], at the place below the point `above` [m]: there its height means
/// most and its tilt least.
fn turn(plane: &mut Collider, above: DVec3, angles: [f64; 2]) {
    let normal = plane.normal();
    if let (Some(normal), ColliderPath::Uniform { position_m, world_from_collider, .. }) = (normal, &mut plane.path) {
        *position_m = above - (above - *position_m).dot(normal) * normal;
        *world_from_collider = tilt(normal, angles) * *world_from_collider;
    }
}

fn scale_friction(contact: &mut Contact, factor: f64) {
    match contact {
        Contact::Slip { friction } | Contact::Separating { friction } => *friction *= factor,
        Contact::Sticky => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ABOVE: DVec3 = DVec3::new(0.4, 0.5, -0.1);

    fn plane() -> Collider {
        let normal = DVec3::new(0.3, 0.9, -0.2).normalize();
        Collider::plane(DVec3::new(0.1, -0.3, 0.2), normal, Contact::Separating { friction: 0.5 })
    }

    #[test]
    fn a_raised_plane_is_nearer_by_as_much() {
        let (was, mut raised) = (plane(), plane());
        raise(&mut raised, 0.013);
        let nearer = was.signed_distance(ABOVE, 0.0) - raised.signed_distance(ABOVE, 0.0);
        assert!((nearer - 0.013).abs() < 1e-12);
    }

    #[test]
    fn a_tilted_plane_turns_below_the_body() {
        let (was, mut tilted) = (plane(), plane());
        turn(&mut tilted, ABOVE, [0.02, -0.01]);
        let foot = ABOVE - was.signed_distance(ABOVE, 0.0) * was.normal().expect("a plane");
        assert!(tilted.signed_distance(foot, 0.0).abs() < 1e-12);
        let angle = was.normal().expect("a plane").angle_between(tilted.normal().expect("a plane"));
        assert!((angle - 0.02f64.hypot(0.01)).abs() < 1e-9, "{angle}");
    }

    #[test]
    fn friction_is_scaled() {
        let mut plane = plane();
        scale_friction(&mut plane.contact, 2.0);
        assert_eq!(plane.contact, Contact::Separating { friction: 1.0 });
    }
}
