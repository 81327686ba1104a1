//! What every frame obeys, whatever the matter: momentum changes by gravity and obstacles alone, positions follow
//! velocities, and nothing is inside an obstacle farther than the grid can explain. A frame that does not is an error,
//! not a result.

use gic_simd::Scalar;
use glam::DVec3;

use super::timing::Timing;
use crate::error::SimulationError;
use crate::substep::grid_update::Impulse;
use crate::substep::prepared_world::PreparedWorld;
use crate::substep::state::State;

/// Largest share of the momentum at work in a frame that may come from nowhere. Derived: a thousandth of a motion is
/// less than what the grid resolves of it, and more than f32 loses in a sound frame.
const MAX_MOMENTUM_ERROR: f64 = 1e-3;
/// Farthest that rounding may move a particle in a frame [cells]. Derived: a tenth of a cell is less than the grid
/// resolves.
const MAX_ROUNDING_CELLS: f64 = 0.1;
/// Deepest that a particle may be in an obstacle [cells]. Derived: from one and a half cells on its stencil lies within
/// the obstacle, which then carries it; in the substep before, it and the obstacle may each have moved a cell.
const MAX_DEPTH_CELLS: f64 = 3.5;

/// Momentum of all particles [kg m/s].
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Momentum {
    sum: DVec3,
    /// Sum of the particles' own, without their directions.
    size: f64,
}

impl Momentum {
    pub(super) fn of<R: Scalar>(world: &PreparedWorld, state: &State<R>) -> Self {
        let mut all = Self::default();
        for body in &world.bodies {
            let mass = body.mass * world.mass_unit;
            let (mut sum, mut size) = (DVec3::ZERO, 0.0);
            for (p, factor) in body.range.clone().zip(&body.factors) {
                let carried = state.velocity_of(p) * *factor;
                sum += carried;
                size += carried.length();
            }
            all.sum += sum * mass;
            all.size += size * mass;
        }
        all
    }
}

/// Checks the state at the end of frame `frame`, which began with the momentum `before`.
///
/// # Errors
/// [`SimulationError::MomentumLost`], [`SimulationError::Rounded`] and [`SimulationError::ThroughCollider`].
pub(super) fn check<R: Scalar>(
    world: &PreparedWorld,
    timing: Timing,
    frame: usize,
    (before, impulses, substeps): (Momentum, &[Impulse], usize),
    state: &State<R>,
) -> Result<(), SimulationError> {
    check_momentum(world, timing, frame, (before, impulses, substeps), Momentum::of(world, state))?;
    check_rounding(world, frame, substeps, state)?;
    check_depth(world, frame, timing.frame_seconds * frame as f64, state)
}

fn check_momentum(
    world: &PreparedWorld,
    timing: Timing,
    frame: usize,
    (before, impulses, substeps): (Momentum, &[Impulse], usize),
    after: Momentum,
) -> Result<(), SimulationError> {
    let mass: f64 =
        world.bodies.iter().map(|body| body.mass * world.mass_unit * body.factors.iter().sum::<f64>()).sum();
    let weight = world.gravity * (mass * timing.frame_seconds);
    let taken: DVec3 = impulses.iter().map(|impulse| impulse.linear).sum();
    let error = (after.sum - before.sum - weight + taken).length();
    // Where nothing moves: what would move all by a cell in a frame.
    let crossing = mass * world.spacing / timing.frame_seconds;
    let impulse: f64 = impulses.iter().map(|impulse| impulse.linear.length()).sum();
    let at_work = before.size + after.size + weight.length() + impulse + crossing;
    // Phrased so that NaN is lost.
    let is_kept = error <= MAX_MOMENTUM_ERROR * at_work;
    if is_kept { Ok(()) } else { Err(SimulationError::MomentumLost { frame, share: error / at_work, substeps }) }
}

/// Each substep rounds positions, by half of the resolution at their distance from the origin and, where the velocity
/// is steady, always to the same side.
fn check_rounding<R: Scalar>(
    world: &PreparedWorld,
    frame: usize,
    substeps: usize,
    state: &State<R>,
) -> Result<(), SimulationError> {
    let epsilon = if size_of::<R>() == size_of::<f32>() { f64::from(f32::EPSILON) } else { f64::EPSILON };
    let per_metre = 0.5 * epsilon * substeps as f64;
    let farthest = MAX_ROUNDING_CELLS * world.spacing / per_metre;
    // Phrased so that NaN is too far.
    let is_near = |p: usize| state.position_of(p).abs().max_element() <= farthest;
    match (0..state.len()).find(|p| !is_near(*p)) {
        None => Ok(()),
        Some(particle) => {
            let own = state.position_of(particle);
            let (drift_m, position) = (per_metre * own.abs().max_element(), world.frame.point_in_world(own));
            Err(SimulationError::Rounded { frame, particle, position, substeps, drift_m })
        }
    }
}

fn check_depth<R: Scalar>(
    world: &PreparedWorld,
    frame: usize,
    time: f64,
    state: &State<R>,
) -> Result<(), SimulationError> {
    let limit = MAX_DEPTH_CELLS * world.spacing;
    for (collider, posed) in world.posed_colliders(time).iter().enumerate() {
        let depth = |p: usize| posed.depth(state.position_of(p));
        if let Some(particle) = (0..state.len()).find(|p| depth(*p) > limit) {
            return Err(SimulationError::ThroughCollider {
                frame,
                particle,
                position: world.frame.point_in_world(state.position_of(particle)),
                collider,
                depth_m: depth(particle),
            });
        }
    }
    Ok(())
}
