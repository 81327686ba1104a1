//! How many substeps a frame takes, and what is done when they turn out too few.
//!
//! With wave speed c, largest particle speed v, viscous diffusivity D and Courant number C, a substep dt obeys
//!
//! ```text
//! r dt <= C        r = d + sqrt(d^2 + ((c + v) / dx)^2)        d = D / dx^2        w dt <= C dx
//! ```
//!
//! where w is the speed of the fastest obstacle that may meet the matter. r is the rate at which a mode that oscillates
//! with 2 (c + v) / dx and is damped by 4 d becomes unstable under symplectic Euler with explicit damping. No mode of
//! the grid is damped faster: with quadratic splines |C|^2 <= 4 / dx^2 sum_i w_i |v_i|^2 of every particle (Cauchy and
//! Schwarz), so that viscosity takes at most the share 4 D / dx^2 of the kinetic energy's double a second.

use gic_simd::Scalar;

use super::timing::Timing;
use super::wall_speed::fastest_wall;
use crate::error::SimulationError;
use crate::substep::prepared_world::{PreparedBody, PreparedWorld};
use crate::substep::state::State;
use crate::substep::violation::{Violation, ViolationKind};
use crate::{Rules, Stepping, World};

/// Most substeps per frame that are tried: a thousand times what the published simulations take.
pub(crate) const MAX_SUBSTEPS: usize = 200_000;
/// A frame is redone with at most this many times the planned substeps: if that does not help, the cause is another.
const MAX_REFINEMENT: usize = 64;

/// Substeps of frame `frame`, which begins with `state`, the more of those wanted and those that stability asks for.
///
/// # Errors
/// [`SimulationError::TooStiff`] and [`SimulationError::ColliderTooFast`] beyond [`MAX_SUBSTEPS`].
pub(super) fn substeps_of_frame<R: Scalar>(
    world: &PreparedWorld,
    timing: Timing,
    frame: usize,
    state: &State<R>,
) -> Result<usize, SimulationError> {
    let Stepping { least_substeps_per_frame: mut substeps, courant } = timing.stepping;
    for (index, body) in world.bodies.iter().enumerate() {
        let speed = highest_speed(world, timing, body, state);
        let wanted = timing.frame_seconds * highest_rate(world, body, speed) / courant;
        let possible = wanted <= MAX_SUBSTEPS as f64;
        if !possible {
            return Err(SimulationError::TooStiff {
                body: index,
                substeps: wanted,
                wave_speed_m_s: wave_speed(body),
                speed_m_s: speed,
                grid_spacing_m: world.spacing,
                limit: MAX_SUBSTEPS,
            });
        }
        substeps = substeps.max(wanted.ceil() as usize);
    }
    if let Some((collider, speed)) = fastest_wall(world, timing, frame, state) {
        let wanted = timing.frame_seconds * speed / (courant * world.spacing);
        let possible = wanted <= MAX_SUBSTEPS as f64;
        if !possible {
            return Err(SimulationError::ColliderTooFast { frame, collider, speed_m_s: speed, limit: MAX_SUBSTEPS });
        }
        substeps = substeps.max(wanted.ceil() as usize);
    }
    Ok(substeps)
}

/// Substeps of the first frame of a world.
///
/// # Errors
/// As [`PreparedWorld::new`] and [`substeps_of_frame`].
pub(crate) fn planned_substeps(world: &World) -> Result<usize, SimulationError> {
    let prepared = PreparedWorld::new(world, Rules::default())?;
    substeps_of_frame(&prepared, Timing::of(world), 1, &prepared.initial_state::<f64>())
}

/// The highest speed [m/s] of a body's particles in the coming frame, to which gravity adds.
fn highest_speed<R: Scalar>(world: &PreparedWorld, timing: Timing, body: &PreparedBody, state: &State<R>) -> f64 {
    let speed = body.range.clone().map(|p| state.velocity_of(p).length_squared()).fold(0.0, f64::max).sqrt();
    speed + world.gravity.length() * timing.frame_seconds
}

/// The rate [1/s] that bounds the substep: of waves and motion across a cell, and of viscous diffusion.
fn highest_rate(world: &PreparedWorld, body: &PreparedBody, speed: f64) -> f64 {
    let diffusivity = body.material.viscous_diffusivity_m2_s(body.mass / body.volume);
    let dx = world.spacing;
    let (crossing, damping) = ((wave_speed(body) + speed) / dx, diffusivity / (dx * dx));
    damping + damping.hypot(crossing)
}

/// Speed of the fastest elastic wave in a body at rest [m/s].
fn wave_speed(body: &PreparedBody) -> f64 {
    body.material.wave_speed_m_s(body.mass / body.volume)
}

/// The substeps of the next attempt at a frame, or the error if there is none.
pub(super) fn more_substeps(
    violation: Violation,
    frame: usize,
    planned: usize,
    substeps: usize,
) -> Result<usize, SimulationError> {
    let Violation { kind, particle, position, velocity } = violation;
    match kind {
        ViolationKind::LeftDomain(reason) => {
            Err(SimulationError::LeftDomain { frame, particle, position, velocity, reason })
        }
        ViolationKind::TooFast if substeps >= planned * MAX_REFINEMENT || substeps * 2 > MAX_SUBSTEPS => {
            Err(SimulationError::Unstable { frame, substeps, particle, velocity })
        }
        ViolationKind::TooFast => Ok(substeps * 2),
    }
}
