//! Settings of filling, derived from the object's size.

use gic_geometry::Plane;
use serde::{Deserialize, Serialize};

use crate::{ContinuumError, Tuning};

/// What to do where the body's boundary is one that no view sees (undersides).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Unseen {
    /// A smooth surface inside the largest body that agrees with all views, at which the body keeps its volume.
    #[default]
    Smooth,
    /// The boundary of the largest body that agrees with all views, as in the paper.
    Fill,
}

/// How Gaussians are filled; make one with [`FillSettings::for_size`].
#[derive(Clone, Debug, PartialEq)]
pub struct FillSettings {
    /// Largest side of the object at the first frame [m].
    pub size: f64,
    /// Side of the voxels of the first level, the paper's delta x [m].
    pub grid_spacing: f64,
    /// Number of levels, the paper's n_u: each but the first halves the voxels.
    pub levels: usize,
    /// Density from which a voxel belongs to the body, the paper's th_min.
    pub th_min: f64,
    /// Gaussians with less opacity do not count.
    pub min_opacity: f32,
    /// What to do where no view sees the boundary.
    pub unseen: Unseen,
    /// Volume that the body is known to have [m^3], for example from frames in which more of it was seen.
    pub volume: Option<f64>,
    /// Ground that the body cannot cross, if it is known; it counts as seen.
    pub ground: Option<Plane>,
    /// The tuned numbers.
    pub tuning: Tuning,
}

impl FillSettings {
    /// Settings for an object whose largest side at t0 is `size` [m]: four levels, the finest with voxels of 1/80 of
    /// the size (4.4 mm for 0.35 m): half of a simulated particle's spacing, so that corners are not rounded off.
    pub fn for_size(size: f64) -> FillSettings {
        FillSettings::tuned(size, Tuning::default())
    }

    /// The same with other tuned numbers.
    pub fn tuned(size: f64, tuning: Tuning) -> FillSettings {
        FillSettings {
            size,
            grid_spacing: size / tuning.filling.first_level_divisor,
            levels: 4,
            th_min: 0.5,
            min_opacity: 0.02,
            unseen: Unseen::Smooth,
            volume: None,
            ground: None,
            tuning,
        }
    }

    /// Side of the voxels of the last level [m].
    pub fn finest_spacing(&self) -> f64 {
        self.grid_spacing / (1u64 << (self.levels.max(1) - 1)) as f64
    }

    /// Fails on the first setting out of its range.
    pub(crate) fn validate(&self) -> Result<(), ContinuumError> {
        let check = |setting, value: f64, good: bool, must| {
            if good { Ok(()) } else { Err(ContinuumError::Setting { setting, value, must }) }
        };
        check(
            "grid_spacing",
            self.grid_spacing,
            self.grid_spacing > 0.0 && self.grid_spacing.is_finite(),
            "above 0 m",
        )?;
        check("levels", self.levels as f64, (1..=10).contains(&self.levels), "from 1 to 10")?;
        check("th_min", self.th_min, self.th_min > 0.0 && self.th_min < 1.0, "between 0 and 1")?;
        let opacity = f64::from(self.min_opacity);
        check("min_opacity", opacity, (0.0..1.0).contains(&opacity), "from 0 to below 1")
    }
}
