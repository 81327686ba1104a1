//! The Gaussian-informed continuum, as filling or refinement left it in the run folder.

use std::path::{Path, PathBuf};

use gic_continuum::{AcrossTime, Appearance, Drawing, Particles};
use gic_mpm::MaterialKind;
use gic_twin::atomic;
use gic_twin::matter::read_particles;
use glam::DVec3;

use super::Run;
use super::fill_summary::FillSummary;
use super::stage::REFINED;
use crate::error::{Error, Result};

/// The Gaussian-informed continuum at the first frame, and the surface in every frame.
pub struct Continuum {
    /// What filling found.
    pub summary: FillSummary,
    /// The particles.
    pub particles: Particles,
    /// How they are drawn.
    pub appearance: Appearance,
    /// The surface in every frame.
    pub surfaces: Vec<Surface>,
    /// How the stage `refine` settled the body; `None` of one that filling made.
    refined: Option<AcrossTime>,
}

impl Continuum {
    /// Side of a cell of the grid to simulate it on [m]: twice the distance of the particles.
    pub(super) fn grid_spacing_m(&self) -> f64 {
        2.0 * self.particles.spacing
    }

    /// How far the surface is off where it is not in doubt, as a standard deviation [m]: as refinement measured it, or
    /// half the distance of particles, which is what filling resolves.
    pub(super) fn surface_error_m(&self) -> f64 {
        let measured = self.refined.map(|settled| settled.gap_after_m).filter(|gap_m| *gap_m > 0.0);
        measured.unwrap_or(0.5 * self.particles.spacing)
    }
}

/// Points on the surface of a body.
#[derive(Clone, Debug, Default)]
pub struct Surface {
    /// Positions [m], shape [n].
    pub points: Vec<DVec3>,
    /// How much each is in doubt, in [0, 1], shape [n]: 1 where no view sees the surface.
    pub doubts: Vec<f32>,
}

/// Name of the file of a frame's surface, inside the run folder.
pub(crate) fn surface_file(frame: usize) -> PathBuf {
    format!("surface/{frame:04}.ply").into()
}

/// Name of the file of a frame's matter, inside the run folder.
pub(crate) fn filling_file(frame: usize) -> PathBuf {
    format!("filling/{frame:04}.ply").into()
}

impl Run<'_> {
    /// The body as well as it is known: as refined, where it is; of the scene's law.
    ///
    /// # Errors
    /// Missing or damaged files; a law that is not known yet.
    pub fn continuum(&self) -> Result<Continuum> {
        if !self.refines() {
            return self.filled(self.model()?);
        }
        let record = self.refined()?;
        let continuum = self.continuum_of(record.summary, &self.path(REFINED), self.model()?)?;
        Ok(Continuum { refined: Some(record.settled), ..continuum })
    }

    /// The result of filling, of a law.
    ///
    /// # Errors
    /// Missing or damaged files.
    pub(super) fn filled(&self, law: MaterialKind) -> Result<Continuum> {
        self.continuum_of(self.fill_summary()?, &self.folder, law)
    }

    /// What filling found.
    ///
    /// # Errors
    /// A missing or damaged file.
    pub(crate) fn fill_summary(&self) -> Result<FillSummary> {
        Ok(atomic::read_json(&self.path("fill.json"))?)
    }

    /// The body in a folder. Its particles lie in order, but grains do not.
    fn continuum_of(&self, summary: FillSummary, folder: &Path, law: MaterialKind) -> Result<Continuum> {
        let ply = read_particles(&folder.join("continuum.ply"))?;
        let particles = Particles {
            positions: ply.positions,
            volume: summary.particle_volume_m3,
            volume_factors: ply.volume_factors.iter().map(|f| if f.is_nan() { 1.0 } else { *f as f32 }).collect(),
            densities: ply.densities,
            surface: ply.surface.iter().map(|s| *s > 0.5).collect(),
            doubts: known_doubts(&ply.doubts),
            spacing: summary.particle_spacing_m,
        };
        let particles = if law == MaterialKind::Sand { particles.without_order(self.config.seed) } else { particles };
        let appearance = Appearance { scale: summary.splat_scale, opacity: summary.splat_opacity };
        let surfaces = summary
            .frames
            .iter()
            .map(|frame| {
                let ply = read_particles(&self.path(surface_file(frame.frame)))?;
                Ok(Surface { doubts: known_doubts(&ply.doubts), points: ply.positions })
            })
            .collect::<Result<_>>()?;
        Ok(Continuum { summary, particles, appearance, surfaces, refined: None })
    }

    /// The finer points to draw the continuum with, and how they are drawn.
    ///
    /// # Errors
    /// A missing or damaged file, and a body that cannot be sampled.
    pub fn drawing(&self, continuum: &Continuum) -> Result<(Drawing, Appearance)> {
        let filling = if continuum.refined.is_some() { self.refined_filling()? } else { self.filling()? };
        let tuning = &self.config.fill.tuning.particles;
        let spacing = tuning.drawing_spacing * continuum.particles.spacing;
        let drawing = Drawing::new(&filling, &continuum.particles, spacing, tuning).map_err(Error::filling(0))?;
        Ok((drawing, Appearance { scale: continuum.summary.drawing_scale, ..continuum.appearance }))
    }
}

/// Doubts as read from a file; 0 where the file has none.
fn known_doubts(read: &[f32]) -> Vec<f32> {
    read.iter().map(|d| if d.is_nan() { 0.0 } else { *d }).collect()
}
