//! Settings of filling, derived from the object's size.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::ContinuumError;

/// A plane that the body cannot cross: ground that is known. It counts as seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundPlane {
    /// A point of the plane [m].
    pub point: DVec3,
    /// Unit normal towards the free side.
    pub normal: DVec3,
}

impl GroundPlane {
    /// Height of a point above the plane [m].
    pub fn height(&self, point: DVec3) -> f64 {
        (point - self.point).dot(self.normal)
    }
}

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
    /// Side of the voxels of the first level, the paper's delta x [m].
    pub grid_spacing: f64,
    /// Number of levels, the paper's n_u: each but the first halves the voxels.
    pub levels: usize,
    /// Density from which a voxel belongs to the body, the paper's th_min.
    pub th_min: f64,
    /// Density up to which a voxel of the body belongs to its surface, the paper's th_max.
    pub th_max: f64,
    /// Gaussians with less opacity do not count.
    pub min_opacity: f32,
    /// How far the centres of the Gaussians lie below the true surface, in units of the lower quartile of their standard deviations, and see
    /// `depth_offset`. The alpha of overlapping Gaussians at an outline falls to one half 1.3 to 1.5 standard deviations above their
    /// centres, and the emptiest of several noisy depth maps takes away more. Small Gaussians decide where edges are, so the lower quartile
    /// tells more than the median; flat faces that are drawn by large ones are brought nearer besides. A constant, because
    /// silhouettes cannot tell it better: the inset at which the re-rendered area equals the masks' depends on the scale the
    /// particles are drawn with, and errs in volume by as much, in opposite directions for solid bodies and rings.
    pub depth_inset: f64,
    /// The part of that distance which does not depend on the Gaussians [m]: pictures of particles are drawn a little smaller than the
    /// room that the particles take up.
    pub depth_offset: f64,
    /// How many views must see in front of the surface at a point before it counts as empty for certain although another view sees
    /// matter there. A point that fewer views (but at least one) call empty is then left to the density field: a hole between Gaussians
    /// in one view does not dig a tunnel. Where no view sees matter, one is enough: of surfaces that only one or two cameras face, no more
    /// can be had.
    pub depth_votes: usize,
    /// Mean filtering and reassigning is repeated so often on each level.
    pub filter_rounds: usize,
    /// What to do where no view sees the boundary.
    pub unseen: Unseen,
    /// How far above the smoothest surface [`Unseen::Smooth`] expects undersides [m]: notches that no camera sees into make them
    /// higher, round bellies lower.
    pub unseen_lift: f64,
    /// Volume that the body is known to have [m^3], for example from frames in which more of it was seen.
    pub volume: Option<f64>,
    /// A plane below which there is nothing, if known.
    pub ground: Option<GroundPlane>,
}

impl FillSettings {
    /// Settings for an object whose largest side at t0 is `size` [m]: four levels, the finest with voxels of 1/80 of the size
    /// (4.4 mm for 0.35 m): half of a simulated particle's spacing, so that corners are not rounded off.
    pub fn for_size(size: f64) -> FillSettings {
        FillSettings {
            grid_spacing: size / 10.0,
            levels: 4,
            th_min: 0.5,
            th_max: 0.8,
            min_opacity: 0.02,
            depth_inset: 2.45,
            depth_offset: size / 200.0,
            depth_votes: 3,
            filter_rounds: 2,
            unseen: Unseen::Smooth,
            unseen_lift: size / 80.0,
            volume: None,
            ground: None,
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
        check("th_max", self.th_max, self.th_max > self.th_min && self.th_max <= 1.0, "above th_min and at most 1")?;
        check("depth_inset", self.depth_inset, self.depth_inset.is_finite(), "a finite number")?;
        check("depth_votes", self.depth_votes as f64, self.depth_votes >= 1, "at least 1")
    }
}
