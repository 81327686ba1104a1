//! What to grasp, and how.

use std::path::PathBuf;

use gic_mpm::Budget;
use gic_twin::twin::Setting;

use crate::gripper::Gripper;
use crate::gripper_frame::AxisChoice;

/// Name of this stage in events.
pub(crate) const STAGE: &str = "grasp";

/// What to grasp, and how.
#[derive(Clone, Debug)]
pub struct GraspRequest {
    /// The twin's file.
    pub twin: PathBuf,
    /// Changes to the twin.
    pub settings: Vec<Setting>,
    /// Widths to close to [m], in any order.
    pub widths_m: Vec<f64>,
    /// Which way to close.
    pub axis: AxisChoice,
    /// The gripper.
    pub gripper: Gripper,
    /// Each particle is cut into this number cubed, on a grid as many times finer; `None` takes the least that lets the
    /// grid feel the pads.
    pub refine: Option<usize>,
    /// Folder for grasp.json and the pictures.
    pub out: PathBuf,
    /// Whether to make pictures.
    pub pictures: bool,
    /// Width and height of the pictures [pixels].
    pub size: [usize; 2],
    /// What it may take; what is forecast to take more is refused.
    pub budget: Budget,
    /// The film: .gif or .mp4.
    pub film: PathBuf,
}
