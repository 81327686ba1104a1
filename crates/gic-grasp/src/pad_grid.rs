//! Whether a grid feels the pads.

use gic_twin::events::Events;

use crate::error::{GraspError, Result};
use crate::gripper::Gripper;
use crate::request::STAGE;

/// Fewest grid cells along a side of the pad.
const MIN_PAD_CELLS: f64 = 2.0;
/// Grid cells along a side of the pad below which forces are coarse.
const GOOD_PAD_CELLS: f64 = 4.0;
/// The finest grid that is worth its time, relative to the twin's.
pub const MAX_REFINEMENT: usize = 8;

/// Grid cells across a pad.
fn cells_across(gripper: &Gripper, grid: f64) -> f64 {
    gripper.pad_m[0].min(gripper.pad_m[1]) / grid
}

/// How many times finer than `grid` a grid must be to feel the pads, within reason.
pub(crate) fn least_refinement(gripper: &Gripper, grid: f64) -> usize {
    ((MIN_PAD_CELLS / cells_across(gripper, grid)).ceil() as usize).clamp(1, MAX_REFINEMENT)
}

pub(crate) fn check_pads(gripper: &Gripper, grid: f64, events: &Events) -> Result<()> {
    let cells = cells_across(gripper, grid);
    if cells < MIN_PAD_CELLS {
        return Err(GraspError::Usage {
            problem: format!(
                "a pad of {} x {} m is {cells:.1} grid cells of {grid} m across, too few to press with",
                gripper.pad_m[0], gripper.pad_m[1]
            ),
            hint: Some(format!(
                "simulate a finer twin with --refine {} or give a larger --pad",
                (GOOD_PAD_CELLS / cells).ceil()
            )),
        });
    }
    if cells < GOOD_PAD_CELLS {
        let text = format!("a pad is only {cells:.1} grid cells across, so forces are coarse: give a higher --refine");
        events.warn(STAGE, text);
    }
    Ok(())
}
