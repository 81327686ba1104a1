//! The settings of both stages, with their defaults.

use gic_motion::LossWeights;
use serde::{Deserialize, Serialize};

use crate::AppearanceError;

/// How to train the colours of a twin.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AppearanceFitSettings {
    /// Steps; each draws one frame.
    pub steps: usize,
    /// Views drawn per step.
    pub views_per_step: usize,
    /// Learning rate of the albedo, from the first step to the last.
    pub albedo: (f64, f64),
    /// Learning rate of the opacities' logits.
    pub opacity: (f64, f64),
    /// Learning rate of the scales' logarithms.
    pub scale: (f64, f64),
    /// Learning rate of the light.
    pub light: (f64, f64),
    /// A scale may grow or shrink by this factor.
    pub scale_bound: f64,
    /// Weights of the losses; those of motion are not used.
    pub loss: LossWeights,
}

impl Default for AppearanceFitSettings {
    fn default() -> Self {
        AppearanceFitSettings {
            steps: 300,
            views_per_step: 4,
            albedo: (3.0e-2, 3.0e-3),
            opacity: (3.0e-2, 3.0e-3),
            scale: (1.0e-2, 1.0e-3),
            light: (1.0e-2, 1.0e-3),
            scale_bound: 1.5,
            loss: LossWeights::default(),
        }
    }
}

impl AppearanceFitSettings {
    /// Checks every value.
    ///
    /// # Errors
    /// [`AppearanceError::Setting`] names the first one that cannot be used.
    pub fn validate(&self) -> Result<(), AppearanceError> {
        require("steps", self.steps > 0, "must be at least 1")?;
        require("views_per_step", self.views_per_step > 0, "must be at least 1")?;
        let rates = [("albedo", self.albedo), ("opacity", self.opacity), ("scale", self.scale), ("light", self.light)];
        for (setting, (first, last)) in rates {
            let are_rates = [first, last].iter().all(|rate| *rate > 0.0 && rate.is_finite());
            require(setting, are_rates, "must be two learning rates above 0")?;
        }
        let is_factor = self.scale_bound >= 1.0 && self.scale_bound.is_finite();
        require("scale_bound", is_factor, "must be a factor of at least 1")
    }
}

fn require(setting: &'static str, is_good: bool, reason: &str) -> Result<(), AppearanceError> {
    if is_good { Ok(()) } else { Err(AppearanceError::Setting { setting, reason: reason.to_owned() }) }
}

/// How to register.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RegisterSettings {
    /// Starting rotations.
    pub starts: usize,
    /// Starts that are fitted to the pictures.
    pub candidates: usize,
    /// Steps of the first fit of each.
    pub steps: usize,
    /// Steps of the second fit, of the best.
    pub final_steps: usize,
    /// Weight of the colours beside that of the masks, which is 1.
    pub color: f64,
    /// Below this overlap of the registered scan with the mask of any camera, registration has failed.
    pub least_iou: f64,
}

impl Default for RegisterSettings {
    fn default() -> Self {
        RegisterSettings { starts: 6_000, candidates: 10, steps: 60, final_steps: 150, color: 0.5, least_iou: 0.9 }
    }
}

impl RegisterSettings {
    /// Checks every value.
    ///
    /// # Errors
    /// [`AppearanceError::Setting`] names the first one that cannot be used.
    pub fn validate(&self) -> Result<(), AppearanceError> {
        let counts = [
            ("starts", self.starts),
            ("candidates", self.candidates),
            ("steps", self.steps),
            ("final_steps", self.final_steps),
        ];
        for (setting, count) in counts {
            require(setting, count > 0, "must be at least 1")?;
        }
        require("color", self.color >= 0.0 && self.color.is_finite(), "must be a weight of at least 0")?;
        require("least_iou", (0.0..=1.0).contains(&self.least_iou), "must be from 0 to 1")
    }
}
