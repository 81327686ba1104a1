//! Measuring on pictures that were not trained on.

use gic_metrics::{Rectangle, mask_iou, psnr, ssim};
use gic_scene::Scene;
use gic_splat::{Gaussians, RenderSettings, render};
use rayon::prelude::*;
use serde::Serialize;

use crate::pictures::{self, Target};
use crate::{DynamicGaussians, MotionError};

/// How well one picture is reproduced.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ViewScore {
    /// Camera (index into the scene's list).
    pub camera: usize,
    /// Frame.
    pub frame: usize,
    /// PSNR [dB] over black inside the mask's bounding box.
    pub psnr: f64,
    /// SSIM over black inside the mask's bounding box.
    pub ssim: f64,
    /// PSNR [dB] over white of the whole picture, the custom of the benchmarks of static and monocular scenes.
    pub psnr_white: f64,
    /// PSNR [dB] over black of the whole picture, the custom of the paper's release.
    pub psnr_black: f64,
    /// Intersection over union of alpha and mask, both cut at one half.
    pub iou: f64,
}

impl ViewScore {
    /// Mean over views.
    pub fn mean(scores: &[ViewScore]) -> ViewScore {
        let mean = |f: fn(&ViewScore) -> f64| scores.iter().map(f).sum::<f64>() / scores.len().max(1) as f64;
        ViewScore {
            camera: 0,
            frame: 0,
            psnr: mean(|s| s.psnr),
            ssim: mean(|s| s.ssim),
            psnr_white: mean(|s| s.psnr_white),
            psnr_black: mean(|s| s.psnr_black),
            iou: mean(|s| s.iou),
        }
    }
}

/// Scores of every picture of the cameras `held_out`, or of the scene's own test pictures when that is empty; views
/// without the object are left out.
///
/// # Errors
/// When a picture cannot be read or compared.
pub fn evaluate(model: &DynamicGaussians, scene: &Scene, held_out: &[usize]) -> Result<Vec<ViewScore>, MotionError> {
    score_targets(&pictures::held_out(scene, held_out)?, |time| model.at(time))
}

pub(crate) fn score_targets(
    targets: &[Target],
    gaussians_at: impl Fn(f64) -> Gaussians + Sync,
) -> Result<Vec<ViewScore>, MotionError> {
    let wanted: Vec<&Target> = targets.iter().filter(|t| !t.bounds.is_empty()).collect();
    let same_time: Vec<&[&Target]> = wanted.chunk_by(|a, b| a.frame == b.frame).collect();
    let scores: Result<Vec<Vec<ViewScore>>, MotionError> = same_time
        .par_iter()
        .map(|group| {
            let gaussians = gaussians_at(group[0].time);
            group.iter().map(|target| score(target, &gaussians)).collect()
        })
        .collect();
    Ok(scores?.concat())
}

fn score(target: &Target, gaussians: &Gaussians) -> Result<ViewScore, MotionError> {
    let (width, height) = (target.camera.width, target.camera.height);
    let picture = render(gaussians, &target.camera, &RenderSettings::pictures());
    let (color, mask) = target.crop(target.whole());
    let b = target.bounds;
    let region = Some(Rectangle { left: b.x0, top: b.y0, right: b.x1, bottom: b.y1 });
    let over_white = |color: &[[f32; 3]], alpha: &[f32]| -> Vec<[f32; 3]> {
        color.iter().zip(alpha).map(|(c, a)| c.map(|c| (c + 1.0 - a).clamp(0.0, 1.0))).collect()
    };
    let clamped: Vec<[f32; 3]> = picture.color.iter().map(|c| c.map(|c| c.clamp(0.0, 1.0))).collect();
    let white = (over_white(&picture.color, &picture.alpha), over_white(&color, &mask));
    Ok(ViewScore {
        camera: target.camera_index,
        frame: target.frame,
        psnr: psnr(&clamped, &color, width, height, region)?,
        ssim: ssim(&clamped, &color, width, height, region)?,
        psnr_white: psnr(&white.0, &white.1, width, height, None)?,
        psnr_black: psnr(&clamped, &color, width, height, None)?,
        iou: mask_iou(&picture.alpha, &mask)?,
    })
}
