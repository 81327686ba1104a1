//! `fill.json`: what filling found.

use gic_continuum::MirrorPlane;
use serde::{Deserialize, Serialize};

use super::FieldGrid;

/// What filling found of a video.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FillSummary {
    /// Largest side of the object's box at the first frame [m].
    pub object_size_m: f64,
    /// Side of the finest voxels [m].
    pub voxel_spacing_m: f64,
    /// Distance of neighbouring particles [m].
    pub particle_spacing_m: f64,
    /// Rest volume of a particle [m^3].
    pub particle_volume_m3: f64,
    /// Number of particles.
    pub particles: usize,
    /// Share of them in parts of the body that are thinner than two cells of the simulation's grid, which does not
    /// resolve how they bend; `None` in runs that were filled without that figure.
    #[serde(default)]
    pub thin_share: Option<f64>,
    /// Share of the surface that pictures of any frame tell, by outlines or by colours that agree; `None` of a body
    /// that was not refined.
    #[serde(default)]
    pub told_share: Option<f64>,
    /// Standard deviation of a particle's Gaussian, in units of the particle spacing.
    pub splat_scale: f64,
    /// Opacity of a particle of density 1.
    pub splat_opacity: f32,
    /// Standard deviation of the Gaussians of the finer drawing, in units of its own spacing.
    pub drawing_scale: f64,
    /// Agreement of the re-rendered continuum with the mask of each camera at the first frame, intersection over union.
    pub mask_iou: Vec<f64>,
    /// Mirror planes of the body at the first frame.
    #[serde(default)]
    pub mirror_planes: Vec<MirrorPlane>,
    /// Whether outlines alone made the body of the first frame, because the surface shows less symmetry than they do:
    /// then the surfaces of other frames are poorly known.
    #[serde(default)]
    pub is_by_outlines: bool,
    /// The voxels of the body at the first frame.
    pub field: FieldGrid,
    /// Every frame.
    pub frames: Vec<FrameFilling>,
}

impl FillSummary {
    /// What to know of the body before its parameters are believed, in words: which part of its surface is a guess, and
    /// which the simulation's grid does not resolve. Shares below a hundredth are not mentioned.
    pub fn remarks(&self) -> Vec<String> {
        let percent = |share: f64| Some(100.0 * share).filter(|percent| *percent >= 1.0);
        let untold = self.told_share.and_then(|told| percent(1.0 - told));
        let thin = self.thin_share.and_then(percent);
        let guess = |percent| format!("no picture tells where {percent:.0} % of the surface lies");
        let unresolved = |percent| {
            format!(
                "{percent:.0} % of the body is thinner than two cells of the grid, which does not resolve its bending"
            )
        };
        untold.map(guess).into_iter().chain(thin.map(unresolved)).collect()
    }
}

/// The filling of one frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameFilling {
    /// Number of the frame.
    pub frame: usize,
    /// Its time [s].
    pub time_s: f64,
    /// Volume of the body [m^3].
    pub volume_m3: f64,
    /// Gaussians that counted.
    pub gaussians: usize,
    /// Views that had a mask.
    pub views: usize,
    /// Points on the surface.
    pub surface_points: usize,
    /// Mean overlap of the re-rendered body with the frame's masks, intersection over union; `None` where no view
    /// has a mask.
    #[serde(default)]
    pub mask_iou: Option<f64>,
}
