//! The stages in order. Each takes what those before it found. [`Settings::stages`] says where the material's fit
//! begins and ends.
//!
//! 1. [`free_flight`]: initial velocity, position and the Gaussians' size from the frames before contact.
//! 2. [`search`]: starting points of the material, from a grid on a coarse simulation grid.
//! 3. [`material`]: minima of the material with that motion, from the best starts and from neighbours of the best fit.
//! 4. [`joint`]: material, motion, the world and the body's shape together, from the best of them.
//! 5. [`intervals`], [`middle`] and [`estimates`]: how sure they are, the middle of what the video leaves open, whether
//!    they explain it, and everything into one result.

mod adam;
mod basin;
mod candidates;
mod estimates;
mod free_flight;
mod identification;
mod intervals;
mod joint;
mod material;
mod middle;
mod minima;
mod neighbours;
mod outline_flight;
mod search;

use gic_mpm::MaterialKind;

use crate::checkpoint::Checkpoint;
use crate::forward::simulation::RolloutCounts;
use crate::result::{Estimates, Stage};
use crate::session::{Listener, Session};
use crate::stages::free_flight::clearance;
use crate::stages::identification::Identification;
use crate::{IdentifyError, Input, Settings};

/// Identifies material and initial velocity.
///
/// `listener` hears of every accepted step and of every checkpoint, and stops the work by [`ControlFlow::Break`]: the
/// error is then [`IdentifyError::Interrupted`]. `resume` is the last checkpoint of an earlier call with the same
/// arguments, or the default one; the answer is the same. A rollout that fails is a rejected step; only where no start
/// at all can be simulated is that an error.
///
/// [`ControlFlow::Break`]: std::ops::ControlFlow::Break
///
/// # Errors
/// Input or settings that cannot be used, no start that can be simulated, and interruption.
pub fn identify(
    input: &Input,
    kind: MaterialKind,
    settings: &Settings,
    resume: Checkpoint,
    listener: &mut Listener,
) -> Result<Estimates, IdentifyError> {
    let mut input = input.clone();
    input.validate()?;
    settings.validate_numbers()?;
    settings.validate_for(kind)?;
    if let Some(frames) = settings.frames {
        input.observations.truncate(frames.max(2));
    }
    require_clearance(&input)?;
    let rollouts = RolloutCounts::new(resume.rollouts);
    let mut session = Session::new(resume, listener, &rollouts);
    let identification = Identification::new(&input, kind, settings, &rollouts, &mut session)?;
    run(&identification, &mut session)
}

fn run(identification: &Identification, session: &mut Session) -> Result<Estimates, IdentifyError> {
    let reached = session.checkpoint().clone();
    if reached.seconds.is_empty() {
        session.reach(Some(Stage::Velocity), |_| ()).map_err(|error| error.of_stage(1))?;
    }
    if !identification.has_contact() {
        let never = "the object never touches anything: only its velocity is determined, not its material";
        session.warn([never.to_owned()]);
        return Ok(estimates::of_free_flight(identification, session));
    }
    let stages = &identification.settings.stages;
    if *stages.end() == Stage::Velocity {
        return Ok(estimates::of_free_flight(identification, session));
    }
    let starts = match reached.starts {
        Some(starts) => starts,
        None => search::find_starts(identification, session)?,
    };
    let material = match reached.material {
        Some(minima) => minima,
        None if stages.contains(&Stage::Material) => material::fit_material(identification, session, starts)?,
        None => starts,
    };
    if !stages.contains(&Stage::Joint) {
        return estimates::without_intervals(identification, session, &material[0]);
    }
    let (joint, linearisation) = match reached.joint {
        Some(state) => (state, None),
        None => joint::fit_jointly(identification, session, material)?,
    };
    if !stages.contains(&Stage::Intervals) {
        return estimates::without_intervals(identification, session, &joint);
    }
    estimates::with_intervals(identification, session, &joint, linearisation)
}

fn require_clearance(input: &Input) -> Result<(), IdentifyError> {
    // Phrased so that what is no number is refused.
    let is_outside = clearance(input, &input.positions, 0) > 0.0;
    if is_outside {
        return Ok(());
    }
    Err(IdentifyError::input(
        "colliders",
        "particles are inside an obstacle at time 0",
        "check the obstacles against the scene, or drop the one that contradicts it",
    ))
}
