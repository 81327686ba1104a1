//! What the user chooses; [`FillSettings`] is the same for one body, with all lengths in metres.

use gic_geometry::Plane;
use serde::{Deserialize, Serialize};

use crate::{ContinuumError, FillSettings, Tuning, Unseen};

/// Settings of filling; lengths that are left out follow from the body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::Args), group(skip), command(next_help_heading = "Filling"))]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Distance of neighbouring particles [m]; by default half a grid cell, which is a round number (1, 1.5, 2, 3, 5 or
    /// 7 x 10^k) near a tenth of the cube root of the body's volume.
    #[cfg_attr(feature = "cli", arg(long, value_name = "M"))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub particle_spacing_m: Option<f64>,
    /// Side of the voxels of the first level [m]; by default a tenth of the body's largest side.
    #[cfg_attr(feature = "cli", arg(long, value_name = "M"))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub voxel_spacing_m: Option<f64>,
    /// Levels of refinement, the paper's n_u: each but the first halves the voxels. By default four, and fewer where
    /// the finest voxels would be much smaller than a pixel.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N"))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub levels: Option<usize>,
    /// Density from which a voxel belongs to the body, the paper's th_min.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub th_min: f64,
    /// Gaussians with less opacity do not count.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub min_opacity: f32,
    /// The boundary where no view sees it.
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t))]
    pub unseen: Unseen,
    /// Whether a body that is its own mirror image is completed by it: what no view sees is what its image shows.
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "BOOL", action = clap::ArgAction::Set, default_value_t = Settings::default().symmetry)
    )]
    pub symmetry: bool,
    /// Whether the body is refined by the pictures of all frames, through the flight and a first fit of the material.
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "BOOL", action = clap::ArgAction::Set, default_value_t = Settings::default().refine)
    )]
    pub refine: bool,
    /// Tuned numbers, written only where they are not the defaults.
    #[cfg_attr(feature = "cli", arg(skip))]
    #[serde(skip_serializing_if = "Tuning::is_default")]
    pub tuning: Tuning,
}

impl Default for Settings {
    fn default() -> Settings {
        let FillSettings { th_min, min_opacity, unseen, tuning, .. } = FillSettings::for_size(1.0);
        Settings {
            particle_spacing_m: None,
            voxel_spacing_m: None,
            levels: None,
            th_min,
            min_opacity,
            unseen,
            symmetry: true,
            refine: true,
            tuning,
        }
    }
}

impl Settings {
    /// Checks every value.
    ///
    /// # Errors
    /// [`ContinuumError::Setting`] names the first one out of its range.
    pub fn validate(&self) -> Result<(), ContinuumError> {
        let spacings = [("particle_spacing_m", self.particle_spacing_m), ("voxel_spacing_m", self.voxel_spacing_m)];
        for (setting, spacing) in spacings {
            if let Some(value) = spacing.filter(|value| !(*value > 0.0 && value.is_finite())) {
                return Err(ContinuumError::Setting { setting, value, must: "above 0 m" });
            }
        }
        self.for_body((1.0, 0.0), None).validate()
    }

    /// The same for a body whose largest side at the first frame is `size` [m] in pictures whose pixels
    /// are `pixel` wide there [m], on `ground`, if that is known.
    pub fn for_body(&self, (size, pixel): (f64, f64), ground: Option<Plane>) -> FillSettings {
        let defaults = FillSettings::tuned(size, self.tuning.clone());
        let grid_spacing = self.voxel_spacing_m.unwrap_or(defaults.grid_spacing);
        let finest = |levels| FillSettings { grid_spacing, levels, ..defaults.clone() }.finest_spacing();
        // As wide as a pixel, by ratio: levels halve voxels.
        let told = |levels: &usize| finest(*levels) >= std::f64::consts::FRAC_1_SQRT_2 * pixel;
        let levels = self.levels.unwrap_or_else(|| (1..=defaults.levels).rev().find(told).unwrap_or(1));
        FillSettings {
            grid_spacing,
            levels,
            th_min: self.th_min,
            min_opacity: self.min_opacity,
            unseen: self.unseen,
            ground,
            ..defaults
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn voxels_are_no_finer_than_pixels_tell() {
        let levels = |pixel: f64| Settings::default().for_body((0.4, pixel), None).levels;
        // Four levels make voxels of 5 mm.
        assert_eq!([0.0, 0.003, 0.007, 0.0072, 0.02, 1.0].map(levels), [4, 4, 4, 3, 2, 1]);
        let asked = Settings { levels: Some(4), ..Settings::default() };
        assert_eq!(asked.for_body((0.4, 0.02), None).levels, 4);
    }
}
