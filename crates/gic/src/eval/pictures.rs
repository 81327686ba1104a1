//! Pictures of the twin against the video.

use std::collections::BTreeMap;
use std::path::Path;

use gic_bench::PictureError;
use gic_files::FileError;
use gic_metrics::{MetricError, Rectangle, mask_iou, mean, psnr, ssim};
use gic_scene::{Camera, Mask, Picture, Scene, View};
use gic_splat::{Gaussians, RenderSettings, render};
use gic_twin::matter::read_particles;
use gic_view::skinned_gaussians::SkinnedGaussians;
use rayon::prelude::*;

use crate::config::Config;
use crate::error::{Error, Result};
use crate::pipeline::{TWIN_MATTER, moment_file, scene_of_run};

/// The twin of a run in its colours, and the scene to compare with.
pub(super) struct Pictures<'a> {
    run: &'a Path,
    scene: Scene,
    /// The scene with a frame for each time at which a picture was taken.
    moments: Scene,
    skin: SkinnedGaussians,
    /// How many particles the twin has.
    particles: usize,
    held_out: Vec<usize>,
}

impl<'a> Pictures<'a> {
    /// `None` where the twin has no colours; the scene lies at `elsewhere`, or where the run says.
    pub(super) fn open(run: &'a Path, elsewhere: Option<&Path>, config: Config) -> Result<Option<Self>> {
        let rest = read_particles(&run.join(TWIN_MATTER))?.positions;
        let Some(skin) = SkinnedGaussians::load(run, &rest)? else { return Ok(None) };
        let (scene, held_out) = (scene_of_run(run, elsewhere)?, config.reconstruct.held_out);
        let moments = scene.moments();
        Ok(Some(Self { run, scene, moments, skin, particles: rest.len(), held_out }))
    }

    /// Compares a frame of the video; `None` where it was not simulated or no camera sees the object.
    pub(super) fn frame(&self, frame: usize) -> Result<Option<PictureError>> {
        if frame >= self.scene.times.len() {
            return Ok(None);
        }
        let views = self.scene.views_at(frame);
        let mut twins = BTreeMap::new();
        for view in views {
            let moment = self.scene.moment_of(&self.moments, view);
            if let (None, Some(twin)) = (twins.get(&moment), self.twin(moment)?) {
                twins.insert(moment, twin);
            }
        }
        let seen = |view: &View| twins.get(&self.scene.moment_of(&self.moments, view));
        if twins.is_empty() {
            return Ok(None);
        }
        let loaded = self.scene.load_all(views).map_err(Error::stage("reading pictures"))?;
        let scores: Vec<Option<Score>> = views
            .par_iter()
            .zip(&loaded)
            .map(|(view, (picture, mask))| {
                seen(view).map_or(Ok(None), |twin| score(twin, self.scene.camera_of(view), picture, mask))
            })
            .collect::<std::result::Result<_, MetricError>>()
            .map_err(Error::stage("comparing pictures"))?;
        let seen: Vec<(bool, Score)> = views
            .iter()
            .zip(scores)
            .filter_map(|(view, score)| Some((self.held_out.contains(&view.camera), score?)))
            .collect();
        if seen.is_empty() {
            return Ok(None);
        }
        let over = |pick: fn(&Score) -> f64| mean(seen.iter().map(|(_, score)| pick(score)));
        let held_out = |pick: fn(&Score) -> f64| {
            let scores: Vec<f64> = seen.iter().filter(|(held_out, _)| *held_out).map(|(_, s)| pick(s)).collect();
            (!scores.is_empty()).then(|| mean(scores.into_iter()))
        };
        Ok(Some(PictureError {
            psnr_db: over(|s| s.psnr),
            ssim: over(|s| s.ssim),
            box_psnr_db: over(|s| s.box_psnr),
            box_ssim: over(|s| s.box_ssim),
            mask_iou: over(|s| s.iou),
            held_out_psnr_db: held_out(|s| s.psnr),
            held_out_box_psnr_db: held_out(|s| s.box_psnr),
        }))
    }

    /// The twin as it looks at a time at which pictures were taken; `None` where it was not simulated.
    fn twin(&self, moment: usize) -> Result<Option<Gaussians>> {
        let particles = self.run.join(moment_file(&self.scene, moment));
        if !particles.exists() {
            return Ok(None);
        }
        let moved = read_particles(&particles)?.positions;
        if moved.len() != self.particles {
            return Err(Error::File(FileError::Content {
                path: particles,
                problem: format!(
                    "holds {} particles, and the twin {}: an earlier twin's motion",
                    moved.len(),
                    self.particles
                ),
                hint: Some("run `gic run` on the folder again".into()),
            }));
        }
        Ok(Some(self.skin.visible(&moved)))
    }
}

struct Score {
    psnr: f64,
    ssim: f64,
    box_psnr: f64,
    box_ssim: f64,
    iou: f64,
}

/// One view; `None` where the object is out of sight.
fn score(
    gaussians: &Gaussians,
    camera: &Camera,
    picture: &Picture,
    mask: &Mask,
) -> std::result::Result<Option<Score>, MetricError> {
    let (width, height) = (mask.width, mask.height);
    let Some(region) = Rectangle::around_mask(&mask.coverage, width, height, 0) else { return Ok(None) };
    let rendered = render(gaussians, camera, &RenderSettings::pictures());
    let drawn: Vec<[f32; 3]> = rendered.color.iter().map(|c| c.map(|c| c.clamp(0.0, 1.0))).collect();
    let pixels = picture.rgb.chunks_exact(3).zip(&mask.coverage);
    let wanted: Vec<[f32; 3]> = pixels.map(|(rgb, a)| [a * rgb[0], a * rgb[1], a * rgb[2]]).collect();
    Ok(Some(Score {
        psnr: psnr(&drawn, &wanted, width, height, None)?,
        ssim: ssim(&drawn, &wanted, width, height, None)?,
        box_psnr: psnr(&drawn, &wanted, width, height, Some(region))?,
        box_ssim: ssim(&drawn, &wanted, width, height, Some(region))?,
        iou: mask_iou(&rendered.alpha, &mask.coverage)?,
    }))
}
