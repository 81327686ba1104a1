//! How fast obstacles move towards matter: no substep takes a wall past more than a cell.

use gic_simd::Scalar;
use glam::DVec3;

use super::timing::Timing;
use crate::Collider;
use crate::substep::prepared_world::PreparedWorld;
use crate::substep::state::State;
use crate::substep::stencil::STENCIL_REACH_CELLS;

/// Share of a frame over which an obstacle is seen to go away.
const RECEDING_SHARE: f64 = 1e-6;

/// The box around all particles, and how fast the fastest is.
struct Matter {
    centre: DVec3,
    /// Half of the box's diagonal [m].
    radius: f64,
    /// Speed of the fastest particle [m/s], with what gravity may add in the frame.
    speed: f64,
}

/// The obstacle whose surface is the fastest [m/s] in the coming frame of those that may meet a particle in it; `None`
/// where all of these are at rest.
pub(super) fn fastest_wall<R: Scalar>(
    world: &PreparedWorld,
    timing: Timing,
    frame: usize,
    state: &State<R>,
) -> Option<(usize, f64)> {
    if world.colliders.iter().all(|collider| collider.path.is_at_rest()) {
        return None;
    }
    let matter = Matter::of(world, timing, state);
    let speeds = world.colliders.iter().enumerate().map(|(i, c)| (i, speed_towards(c, world, timing, frame, &matter)));
    speeds.filter(|(_, speed)| *speed > 0.0).max_by(|a, b| a.1.total_cmp(&b.1))
}

impl Matter {
    fn of<R: Scalar>(world: &PreparedWorld, timing: Timing, state: &State<R>) -> Self {
        let (mut low, mut high, mut speed) = (DVec3::INFINITY, DVec3::NEG_INFINITY, 0.0f64);
        for p in 0..state.len() {
            low = low.min(state.position_of(p));
            high = high.max(state.position_of(p));
            speed = speed.max(state.velocity_of(p).length());
        }
        let speed = speed + world.gravity.length() * timing.frame_seconds;
        Self { centre: (low + high) / 2.0, radius: (high - low).length() / 2.0, speed }
    }
}

/// Speed of an obstacle's surface [m/s] in the coming frame; 0 where it cannot meet the matter in it.
fn speed_towards(collider: &Collider, world: &PreparedWorld, timing: Timing, frame: usize, matter: &Matter) -> f64 {
    let (start, end) = (timing.frame_seconds * (frame - 1) as f64, timing.frame_seconds * frame as f64);
    let pose = collider.path.pose(start);
    let speed = collider.path.highest_speed(start, end);
    let travel = (speed + matter.speed) * timing.frame_seconds;
    let arm = (matter.centre - pose.position).length() + matter.radius + travel;
    let speed = speed + pose.angular_velocity.length() * collider.primitive.reach().min(arm);
    let distance = |time: f64| collider.signed_distance(matter.centre, time);
    // The distance from a shape that moves straight on, all shapes being convex, does not shrink once it grows.
    let recedes =
        collider.path.is_straight() && distance(start + RECEDING_SHARE * timing.frame_seconds) > distance(start);
    let closing = matter.speed + if recedes { 0.0 } else { speed };
    let reach = matter.radius + closing * timing.frame_seconds + STENCIL_REACH_CELLS * world.spacing;
    if distance(start) > reach { 0.0 } else { speed }
}
