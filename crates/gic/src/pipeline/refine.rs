//! The stage `refine`: the body of the first frame, by the pictures of all frames.
//!
//! A motion carries the body to other moments of the video, and what the cameras saw there settles its surface
//! ([`Filling::settle_across_time`]). The first motion is the free flight, which hangs on no material. The second is
//! that of a material that is searched for with the body so found, by how it deforms: it shows the body at every
//! moment. Where that moves the surface, the next fits are of everything together, for an error of the shape that is
//! left is taken for one of the material else. Each fit goes on from the one before, and so does `identify`: the range
//! is searched once.

use std::path::{Path, PathBuf};

use gic_continuum::{AcrossTime, Filling, Symmetry, calibrate, compare_with_masks, sample_particles};
use gic_files::FileError;
use gic_identify::{Estimates, Settings, Stage as IdentifyStage, Start};
use gic_twin::atomic;
use serde::{Deserialize, Serialize};

use super::field::{FIELD_FILE, FieldGrid, write_field};
use super::fill::{mean_overlap, overlaps, thin_share, write_body};
use super::identify::of_everything;
use super::stage::REFINED;
use super::stamp::Recipe;
use super::surroundings::Surroundings;
use super::{Continuum, FillSummary, Run, Stage};
use crate::config::Config;
use crate::error::{Error, Result};

/// At most so many fits of the material, each with the surface that its motion settles. Budget: a thin body that three
/// cameras see is settled after five.
const ALTERNATIONS: usize = 8;

/// `refined/refine.json`: how the body was settled.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct RefineRecord {
    /// The minima that the last fit found, the best first.
    pub(super) minima: Vec<Start>,
    /// How its surface was settled.
    #[serde(flatten)]
    pub(super) settled: AcrossTime,
    /// What filling found, of the refined body.
    pub(super) summary: FillSummary,
}

/// What filling found of the body, as refined where it is.
///
/// # Errors
/// A missing or damaged file.
pub(crate) fn summary_of_body(run: &Path, config: &Config) -> Result<FillSummary> {
    let refined = run.join(REFINED).join("refine.json");
    if config.fill.refine && refined.exists() {
        return Ok(atomic::read_json::<RefineRecord>(&refined)?.summary);
    }
    Ok(atomic::read_json(&run.join("fill.json"))?)
}

impl Run<'_> {
    /// Whether the body is refined: not that of a scan, which photographs of all sides tell.
    pub(super) fn refines(&self) -> bool {
        self.config.fill.refine && self.scan().is_none()
    }

    /// What filling found of the body, as refined where it is.
    ///
    /// # Errors
    /// A missing or damaged file.
    pub fn body_summary(&self) -> Result<FillSummary> {
        summary_of_body(&self.folder, &self.config)
    }

    pub(super) fn refine(&self, recipe: &Recipe) -> Result<()> {
        let begun = self.path("stamps/refine.begun.json");
        let checkpoints: Vec<PathBuf> =
            (0..=ALTERNATIONS).map(|pass| self.path(format!("refine.{pass}.checkpoint.json"))).collect();
        if !recipe.goes_on(&begun)? {
            remove(&checkpoints)?;
        }
        recipe.write(&begun)?;
        atomic::create_folder(&self.path(REFINED))?;
        let (mut filling, surroundings) = (self.filling()?, self.surroundings()?);
        let identify = &self.config.identify;
        let stages = IdentifyStage::Search..=IdentifyStage::Material;
        let mut settings = Settings { stages, free_poses: true, ..identify.clone() };
        let flight = Settings { stages: IdentifyStage::Velocity..=IdentifyStage::Velocity, ..settings.clone() };
        let mut off_m = f64::INFINITY;
        self.refine_once((&self.filled(self.model()?)?, &mut filling, off_m), &surroundings, &flight, &checkpoints[0])?;
        let mut continuum = self.continuum()?;
        for checkpoint in &checkpoints[1..] {
            let body = (&continuum, &mut filling, off_m);
            let record = self.refine_once(body, &surroundings, &settings, checkpoint)?;
            if record.settled.is_settled() {
                break;
            }
            // The surface was off by as much, and is not by more.
            off_m = record.settled.moved_m;
            settings.starts = record.minima;
            settings.stages = of_everything(identify.optimizer, IdentifyStage::Joint);
            continuum = self.continuum()?;
        }
        Ok(remove(&checkpoints)?)
    }

    /// Fits a motion to a body and settles this, which is some `off_m` off, by what it explains of the video.
    fn refine_once(
        &self,
        (continuum, filling, off_m): (&Continuum, &mut Filling, f64),
        surroundings: &Surroundings,
        settings: &Settings,
        checkpoint: &Path,
    ) -> Result<RefineRecord> {
        self.note_resolution(continuum);
        let input = self.identify_input(continuum, surroundings)?;
        let model = self.model()?;
        let frames = self.identify_settings(&input).frames;
        let settings = Settings { frames, ..settings.among_laws(model) };
        let found = self.fit(&input, model, &settings, (Stage::Refine, checkpoint))?;
        let explained = if *settings.stages.end() == IdentifyStage::Velocity { found.free_frames } else { usize::MAX };
        let moments = self.moments(&input, &found, explained)?;
        let (tuning, particles) = (&self.config.fill.tuning, &continuum.particles);
        let stop = || self.interrupt.requested();
        let planes = continuum.summary.mirror_planes.clone();
        let symmetry = Symmetry { planes, interchangeable_planes: Vec::new() };
        let body = (found.positions.as_slice(), particles.spacing);
        let settled = filling.settle_across_time(body, (&moments, off_m), &symmetry, tuning, &stop);
        self.stop_if_asked("a fit of refinement")?;
        self.write_refined(continuum, filling, &found, (settled.unwrap_or_default(), moments.len()))
    }

    fn write_refined(
        &self,
        continuum: &Continuum,
        filling: &Filling,
        found: &Estimates,
        (settled, moments): (AcrossTime, usize),
    ) -> Result<RefineRecord> {
        let tuning = &self.config.fill.tuning;
        let particles = sample_particles(filling, continuum.particles.spacing, &tuning.particles);
        let particles = particles.map_err(Error::filling(0))?;
        let input = self.fill_input()?;
        let masks = input.masks(0)?;
        let views = input.masked_views(0, &masks);
        let appearance = calibrate(&particles, &views, tuning).map_err(Error::filling(0))?;
        let spacing = tuning.particles.drawing_spacing * particles.spacing;
        let points = sample_particles(filling, spacing, &tuning.particles).map_err(Error::filling(0))?;
        let drawn = calibrate(&points, &views, tuning).map_err(Error::filling(0))?;
        let mask_iou = overlaps(&compare_with_masks(&points, &drawn, &views));
        let before = &continuum.summary;
        let mut frames = before.frames.clone();
        if let Some(first) = frames.first_mut() {
            first.volume_m3 = filling.volume();
            first.mask_iou = mean_overlap(&mask_iou);
        }
        self.events.note(
            Stage::Refine.name(),
            format!(
                "the surface moved by {:.1} mm; outlines of {moments} moments {:.1} mm off, {:.1} mm before, after {} \
                 rounds; volume {:+.1} %; {} particles",
                1e3 * settled.moved_m,
                1e3 * settled.gap_after_m,
                1e3 * settled.gap_before_m,
                settled.rounds,
                1e2 * (filling.volume() / before.frames.first().map_or(f64::NAN, |frame| frame.volume_m3) - 1.0),
                particles.positions.len()
            ),
        );
        let record = RefineRecord {
            minima: found.minima.clone(),
            settled,
            summary: FillSummary {
                particle_volume_m3: particles.volume,
                particles: particles.positions.len(),
                thin_share: Some(thin_share(filling, &particles, tuning)),
                told_share: Some(settled.seen),
                splat_scale: appearance.scale,
                splat_opacity: appearance.opacity,
                drawing_scale: drawn.scale,
                mask_iou,
                field: FieldGrid::of(&filling.field),
                frames,
                ..before.clone()
            },
        };
        let folder = self.path(REFINED);
        write_body(&folder.join("continuum.ply"), &particles)?;
        write_field(&folder.join(FIELD_FILE), filling)?;
        atomic::write_json(&folder.join("refine.json"), &record)?;
        Ok(record)
    }

    /// The result of refinement.
    ///
    /// # Errors
    /// A missing or damaged file.
    pub(super) fn refined(&self) -> Result<RefineRecord> {
        Ok(atomic::read_json(&self.path(REFINED).join("refine.json"))?)
    }
}

/// Removes those of the files that are there.
fn remove(files: &[PathBuf]) -> std::result::Result<(), FileError> {
    files
        .iter()
        .filter(|file| file.exists())
        .try_for_each(|file| std::fs::remove_file(file).map_err(FileError::write(file)))
}
