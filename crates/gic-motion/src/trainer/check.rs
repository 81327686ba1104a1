//! Settings that have no meaning are refused before training.

use crate::tuning::MIN_GAUSSIANS;
use crate::{MotionError, TrainSettings};

impl TrainSettings {
    /// Checks every value, for a scene with so many cameras.
    ///
    /// # Errors
    /// [`MotionError::Setting`] names the first setting without meaning.
    pub fn validate(&self, cameras: usize) -> Result<(), MotionError> {
        let positive = |setting, value: f64| match value > 0.0 && value.is_finite() {
            true => Ok(()),
            false => Err(MotionError::Setting { setting, reason: format!("{value} must be above zero") }),
        };
        if !(0.0..=1.0).contains(&self.half_size) {
            let reason = format!("{} is no share of the steps, 0 to 1", self.half_size);
            return Err(MotionError::Setting { setting: "half_size", reason });
        }
        let averages_one_set = self.averaged > 0.0 && self.averaged + self.density.until <= 1.0;
        if self.averaged != 0.0 && !averages_one_set {
            let reason =
                format!("{} is no share of the steps after density.until, {}", self.averaged, self.density.until);
            return Err(MotionError::Setting { setting: "averaged", reason });
        }
        let spacing = self.network.node_spacing;
        if !(spacing >= 0.0 && spacing.is_finite()) {
            let reason = format!("{spacing} must be above zero, or 0 to ask the network at each point");
            return Err(MotionError::Setting { setting: "network.node_spacing", reason });
        }
        positive("initial_spacing_px", self.initial_spacing_px)?;
        positive("views_per_step", self.views_per_step as f64)?;
        positive("steps", self.steps as f64)?;
        positive("gaussians_per_pixel", self.gaussians_per_pixel)?;
        if let Some(count) = self.max_gaussians.filter(|count| *count < MIN_GAUSSIANS) {
            let reason = format!("{count} Gaussians are too few, give at least {MIN_GAUSSIANS}");
            return Err(MotionError::Setting { setting: "max_gaussians", reason });
        }
        let r = &self.rates;
        for (name, ends) in [
            ("rates.position", r.position),
            ("rates.feature", r.feature),
            ("rates.opacity", r.opacity),
            ("rates.scale", r.scale),
            ("rates.network", r.network),
        ] {
            positive(name, ends.0)?;
            positive(name, ends.1)?;
        }
        if let Some(degree) = self.sh_degree.filter(|&degree| degree > 3) {
            let reason = format!("{degree} is above 3, the highest degree supported");
            return Err(MotionError::Setting { setting: "sh_degree", reason });
        }
        if let Some(camera) = self.held_out.iter().find(|&&c| c >= cameras) {
            let reason = format!("there is no camera {camera}; the scene's are 0 to {}", cameras.saturating_sub(1));
            return Err(MotionError::Setting { setting: "held_out", reason });
        }
        Ok(())
    }
}
