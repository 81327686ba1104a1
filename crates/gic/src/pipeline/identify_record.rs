//! `identify.json`: the estimate and how it was found.

use gic_identify::{Estimates, Stage as IdentifyStage, Step, WorldEstimate};
use gic_scene::{CalibrationError, CameraOffset, Scene};
use serde::{Deserialize, Serialize};

/// `identify.json`: the estimate and how it was found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct IdentifyRecord {
    /// The material's model.
    pub model: String,
    /// The parameters.
    pub estimates: Vec<EstimateRecord>,
    /// Initial velocity [m/s].
    pub velocity_m_s: [f64; 3],
    /// Half-width of its 95 % interval [m/s]; absent where it could not be measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub velocity_interval_95_m_s: Option<[f64; 3]>,
    /// Initial angular velocity [rad/s].
    pub angular_velocity_rad_s: [f64; 3],
    /// Side of a cell of the simulation grid [m].
    pub grid_spacing_m: f64,
    /// Its 95 % interval [m]; absent where it was not sought or could not be measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub grid_spacing_interval_95_m: Option<[f64; 2]>,
    /// The ground; absent where it was known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ground: Option<GroundRecord>,
    /// Factor on gravity in the lengths that the cameras see, which are by this factor longer than the true ones.
    /// Absent where it is 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gravity_factor: Option<f64>,
    /// The factor that its 95 % interval reaches to either side; absent where it was in no doubt.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gravity_interval_95_factor: Option<f64>,
    /// How far gravity is tilted against what the scene says, about two axes at right angles to it [degrees]; absent
    /// where it was in no doubt.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gravity_tilt_deg: Option<[f64; 2]>,
    /// Half-widths of their 95 % intervals [degrees].
    #[serde(default)]
    pub gravity_tilt_interval_95_deg: [Option<f64>; 2],
    /// By what each camera differs from what the free flight shows of it; absent where none was in doubt.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cameras: Vec<CameraRecord>,
    /// Leading frames in which nothing is touched.
    pub free_frames: usize,
    /// Mean chamfer distance of the surfaces [m]; absent where none are fitted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub chamfer_m: Option<f64>,
    /// Mean absolute difference of re-rendered and observed masks.
    pub mask_l1: f64,
    /// Pixels that differ, as a share of the object's.
    pub mask_error: f64,
    /// Rollouts on the full grid.
    pub rollouts: usize,
    /// Rollouts on the coarse grid of the search.
    pub coarse_rollouts: usize,
    /// Seconds of each stage of identification.
    pub seconds: Vec<(String, f64)>,
    /// Factor on the Gaussians' standard deviations that fits the first masks.
    pub splat_factor: f64,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// Every step.
    pub trace: Vec<StepRecord>,
}

/// One estimated parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EstimateRecord {
    /// Its key in `twin.json`.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// 95 % interval.
    pub interval_95: [f64; 2],
    /// Whether the video determines it.
    pub identifiable: bool,
    /// Whether it was given.
    pub fixed: bool,
}

/// Where the ground was found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GroundRecord {
    /// How much higher it is below the body than it was taken to be [m].
    pub height_m: f64,
    /// Half-width of its 95 % interval [m]; absent where it could not be measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height_interval_95_m: Option<f64>,
    /// Tilts about two axes in it [degrees].
    #[serde(default)]
    pub tilt_deg: [f64; 2],
    /// Half-widths of their 95 % intervals [degrees].
    #[serde(default)]
    pub tilt_interval_95_deg: [Option<f64>; 2],
    /// Factor on its friction.
    #[serde(default = "one")]
    pub friction_factor: f64,
    /// The factor that the 95 % interval of that reaches to either side.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction_interval_95_factor: Option<f64>,
    /// Whether it holds what touches it.
    #[serde(default)]
    pub sticks: bool,
}

/// By what a camera differs from what the free flight shows of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraRecord {
    /// Its turn, a rotation vector in its own axes [rad].
    pub turn_rad: [f64; 3],
    /// Its shift along its own axes [m].
    pub shift_m: [f64; 3],
    /// Logarithm of the factor on its focal length.
    pub log_focal: f64,
    /// How much later its pictures were taken [s].
    pub delay_s: f64,
}

impl From<&CameraOffset> for CameraRecord {
    fn from(found: &CameraOffset) -> Self {
        let CalibrationError { turn_rad, shift_m, focal, .. } = found.error;
        CameraRecord { turn_rad: turn_rad.into(), shift_m: shift_m.into(), log_focal: focal, delay_s: found.late_s }
    }
}

impl From<&CameraRecord> for CameraOffset {
    fn from(found: &CameraRecord) -> Self {
        let (turn_rad, shift_m) = (found.turn_rad.into(), found.shift_m.into());
        let error = CalibrationError { turn_rad, shift_m, focal: found.log_focal, radial: 0.0 };
        CameraOffset { error, late_s: found.delay_s }
    }
}

fn one() -> f64 {
    1.0
}

impl From<WorldEstimate> for GroundRecord {
    fn from(found: WorldEstimate) -> Self {
        GroundRecord {
            height_m: found.height_m,
            height_interval_95_m: found.height_half_width_m,
            tilt_deg: found.tilt_rad.map(f64::to_degrees),
            tilt_interval_95_deg: found.tilt_half_width_rad.map(|half| half.map(f64::to_degrees)),
            friction_factor: found.log_friction.exp(),
            friction_interval_95_factor: found.log_friction_half_width.map(f64::exp),
            sticks: found.sticks,
        }
    }
}

/// One step of identification.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepRecord {
    /// Stage of identification.
    pub stage: String,
    /// Count within the stage.
    pub iteration: usize,
    /// The stage's own objective.
    pub objective: f64,
    /// Parameters, in the order of the estimates.
    pub values: Vec<f64>,
    /// Initial velocity [m/s].
    pub velocity_m_s: [f64; 3],
    /// Rollouts so far.
    pub rollouts: usize,
}

impl IdentifyRecord {
    /// A scene with the cameras as they were found.
    pub(crate) fn as_fitted(&self, scene: &Scene) -> Scene {
        scene.as_fitted(&self.cameras.iter().map(CameraOffset::from).collect::<Vec<_>>())
    }

    /// Each component of the initial velocity: its letter, its value and its 95 % interval [m/s], if that is known.
    pub fn velocity_components(&self) -> [(&'static str, f64, Option<[f64; 2]>); 3] {
        [("x", 0), ("y", 1), ("z", 2)].map(|(letter, axis)| {
            let v = self.velocity_m_s[axis];
            (letter, v, self.velocity_interval_95_m_s.map(|half| [v - half[axis], v + half[axis]]))
        })
    }
}

/// What a fit found, as it is kept.
pub(super) fn record(model: &str, found: &Estimates) -> IdentifyRecord {
    let step = |step: &Step| StepRecord {
        stage: stage_name(step.stage).into(),
        iteration: step.iteration,
        objective: step.objective,
        values: step.values.clone(),
        velocity_m_s: step.velocity_m_s.into(),
        rollouts: step.rollouts,
    };
    let estimate = |e: &gic_identify::Estimate| EstimateRecord {
        name: e.parameter.name.into(),
        value: e.value,
        interval_95: e.interval_95.into(),
        identifiable: e.identifiable,
        fixed: e.fixed,
    };
    IdentifyRecord {
        model: model.into(),
        estimates: found.estimates.iter().map(estimate).collect(),
        velocity_m_s: found.velocity_m_s.into(),
        velocity_interval_95_m_s: found.velocity_interval_95.map(Into::into),
        angular_velocity_rad_s: found.angular_velocity_rad_s.into(),
        ground: found.world.map(GroundRecord::from),
        gravity_factor: found.world.map(|world| world.log_gravity.exp()).filter(|factor| *factor != 1.0),
        gravity_interval_95_factor: found.world.and_then(|world| world.log_gravity_half_width).map(f64::exp),
        gravity_tilt_deg: found
            .world
            .map(|world| world.gravity_tilt_rad.map(f64::to_degrees))
            .filter(|tilt| *tilt != [0.0; 2]),
        gravity_tilt_interval_95_deg: found
            .world
            .map_or([None; 2], |world| world.gravity_tilt_half_width_rad.map(|half| half.map(f64::to_degrees))),
        grid_spacing_m: found.grid_spacing_m,
        grid_spacing_interval_95_m: found.grid_spacing_interval_95_m.map(Into::into),
        cameras: found.devices.iter().map(CameraRecord::from).collect(),
        free_frames: found.free_frames,
        chamfer_m: found.loss.chamfer_m,
        mask_l1: found.loss.mask_l1,
        mask_error: found.loss.mask_error,
        rollouts: found.rollouts,
        coarse_rollouts: found.coarse_rollouts,
        seconds: found.seconds.iter().map(|(stage, s)| (stage_name(*stage).to_owned(), *s)).collect(),
        splat_factor: found.splat_factor,
        warnings: found.warnings.clone(),
        trace: found.trace.iter().map(step).collect(),
    }
}

/// What a stage of identification is called in files and events.
pub(super) fn stage_name(stage: IdentifyStage) -> &'static str {
    match stage {
        IdentifyStage::Velocity => "velocity",
        IdentifyStage::Search => "search",
        IdentifyStage::Material => "material",
        IdentifyStage::Joint => "joint",
        IdentifyStage::Intervals => "intervals",
    }
}
