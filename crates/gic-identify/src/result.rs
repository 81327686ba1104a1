//! What identification returns.

use gic_mpm::Material;
use gic_scene::CameraOffset;
use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::{Parameter, Start};

/// One estimated parameter.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// Which one.
    pub parameter: Parameter,
    /// Its value, in the unit of its name.
    pub value: f64,
    /// 95 % interval, finite; the whole range that is searched where the video does not narrow it.
    pub interval_95: (f64, f64),
    /// Whether the video determines it: its interval is narrow and the model explains the video.
    pub identifiable: bool,
    /// Whether it was given rather than estimated.
    pub fixed: bool,
}

/// Loss of paper eq. 8.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Loss {
    /// Mean over frames of the chamfer distance (unsquared, both directions, points near obstacles ignored) [m]; `None`
    /// without surfaces.
    pub chamfer_m: Option<f64>,
    /// Mean over frames, views and pixels of |alpha - mask|; 0 without masks.
    pub mask_l1: f64,
    /// Pixels that differ, as a share of the object's pixels.
    pub mask_error: f64,
}

/// A stage of identification.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Stage {
    /// Initial velocity from free flight.
    Velocity,
    /// Material from a coarse search.
    Search,
    /// Material on all frames.
    Material,
    /// Material and velocity together.
    Joint,
    /// Intervals and checks.
    Intervals,
}

/// One step of a stage, for progress, logs and curves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// The stage.
    pub stage: Stage,
    /// Count within the stage.
    pub iteration: usize,
    /// Value of the stage's own objective (half the weighted sum of squares).
    pub objective: f64,
    /// Material parameters, in the order of [`crate::sought`].
    pub values: Vec<f64>,
    /// Initial velocity [m/s].
    #[serde(with = "crate::vector")]
    pub velocity_m_s: DVec3,
    /// Rollouts so far.
    pub rollouts: usize,
    /// Seconds so far.
    pub seconds: f64,
}

/// How the world differs from the given one, with half-widths of 95 % intervals; absent where one could not be
/// measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WorldEstimate {
    /// How much higher the ground is [m].
    pub height_m: f64,
    /// Half-width of that [m].
    pub height_half_width_m: Option<f64>,
    /// Tilts about two axes in it [rad].
    pub tilt_rad: [f64; 2],
    /// Half-widths of these [rad].
    pub tilt_half_width_rad: [Option<f64>; 2],
    /// Logarithm of the factor on its friction.
    pub log_friction: f64,
    /// Half-width of that.
    pub log_friction_half_width: Option<f64>,
    /// Whether it holds what touches it, where that was in doubt.
    pub sticks: bool,
    /// Logarithm of the factor on gravity: where it is above zero, lengths are by as much too long as cameras see them.
    pub log_gravity: f64,
    /// Half-width of that.
    pub log_gravity_half_width: Option<f64>,
    /// Gravity's tilts about two axes at right angles to it [rad].
    pub gravity_tilt_rad: [f64; 2],
    /// Half-widths of these [rad].
    pub gravity_tilt_half_width_rad: [Option<f64>; 2],
}

/// The identified twin.
#[derive(Clone, Debug)]
pub struct Estimates {
    /// The material at the estimate.
    pub material: Material,
    /// Its parameters with intervals.
    pub estimates: Vec<Estimate>,
    /// The minima that were found, that of the fit first: where another fit may start.
    pub minima: Vec<Start>,
    /// Initial velocity of the centre of mass [m/s].
    pub velocity_m_s: DVec3,
    /// Half-width of its 95 % interval [m/s], finite; `None` where it could not be measured.
    pub velocity_interval_95: Option<DVec3>,
    /// Initial angular velocity [rad/s]; zero where the data show none.
    pub angular_velocity_rad_s: DVec3,
    /// Leading frames in which nothing is touched.
    pub free_frames: usize,
    /// Loss of eq. 8 at the estimate.
    pub loss: Loss,
    /// All steps of all stages.
    pub trace: Vec<Step>,
    /// Rollouts of the simulator on the full grid.
    pub rollouts: usize,
    /// Rollouts on the coarse grid of the search.
    pub coarse_rollouts: usize,
    /// Seconds of each stage.
    pub seconds: Vec<(Stage, f64)>,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// Factor on the Gaussians' standard deviations that fits the first masks.
    pub splat_factor: f64,
    /// Side of a cell of the simulation grid [m]: the input's, or the one with which the model explains the video best
    /// where it was sought.
    pub grid_spacing_m: f64,
    /// Its 95 % interval [m]; `None` where it was not sought or could not be measured.
    pub grid_spacing_interval_95_m: Option<(f64, f64)>,
    /// Substeps per frame, at least.
    pub substeps_per_frame: usize,
    /// The obstacles as fitted: those of the input, with the ground where it was sought where it was found.
    pub colliders: Vec<gic_mpm::Collider>,
    /// Gravity in the lengths that the cameras see [m/s^2]: the given one where it is in no doubt.
    pub gravity_m_s2: DVec3,
    /// How the world differs from the given one; `None` where it was in no doubt.
    pub world: Option<WorldEstimate>,
    /// By what each device differs from the input's, shape [devices]; empty where none was in doubt.
    pub devices: Vec<CameraOffset>,
    /// The body at time 0 as fitted, shifted and reshaped by what the pictures say against the input's: positions of
    /// the input's particles [m], shape [n].
    pub positions: Vec<DVec3>,
    /// Rest volume of one of them [m^3].
    pub particle_volume_m3: f64,
    /// Rest volume of each in units of that, shape [n].
    pub volume_factors: Vec<f64>,
}
