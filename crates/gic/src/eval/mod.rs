//! `gic eval`: a run against ground truth, in the paper's units. Nothing that estimates reads any of this.

mod pictures;
mod registration;
mod volume;

use std::path::Path;

use gic_bench::{Evaluation, FrameError, ParameterError, Truth, VelocityError, paper_name, paper_value};
use gic_metrics::{compare_clouds, mean, noise_floor};
use gic_twin::Interrupt;
use gic_twin::atomic;
use gic_twin::events::Events;
use gic_twin::matter::read_particles;
use gic_twin::twin::Twin;

use crate::config::{Config, Layer};
use crate::error::{Error, Result};
use crate::pipeline::{
    FrameFilling, IdentifyRecord, Stage, check_results, filling_file, prediction_file, summary_of_body,
};
use pictures::Pictures;
use registration::registration_error;

const STAGE: &str = "eval";
/// Seed of the random points that clouds are compared with: the same for every run, so that runs can be compared.
const SEED: u64 = 0;

/// Compares a run with the truth; its scene lies at `scene`, or where the run says.
///
/// # Errors
/// A run that is not finished, a truth of another material, another scene than the run's, damaged files.
pub fn evaluate(
    run: &Path,
    scene: Option<&Path>,
    truth: &Truth,
    events: &Events,
    interrupt: &Interrupt,
) -> Result<Evaluation> {
    check_results(run, &Stage::ALL)?;
    let found: IdentifyRecord = atomic::read_json(&run.join("identify.json"))?;
    if found.model != truth.material.model() {
        return Err(Error::Usage {
            problem: format!("the run assumed {}, the truth is {}", found.model, truth.material.model()),
            hint: Some(format!("run again with --material {}", truth.material.model())),
        });
    }
    let config = Config::resolve(vec![Layer::read(&run.join("config.toml"))?])?;
    let summary = summary_of_body(run, &config)?;
    let fitted = config.scene.fit_frames.unwrap_or(usize::MAX);
    let pictures = Pictures::open(run, scene, config)?;
    let mut frames = Vec::new();
    // True volume over what the particles of the same frame take up.
    let mut share = None;
    // The frames that were fitted to come first in the video.
    for frame in 0.. {
        if interrupt.requested() {
            return Err(Error::Interrupted { after: String::new(), resume: "run the same command again".into() });
        }
        let filled = summary.frames.get(frame);
        let particles = truth.particles(frame)?;
        if particles.is_none() && filled.is_none() {
            break;
        }
        if let Some(particles) = particles {
            let drawn = pictures.as_ref().map(|pictures| pictures.frame(frame)).transpose()?.flatten();
            let volume = match (truth.volume_m3, filled) {
                (Some(at_rest), Some(_)) => {
                    let occupied = volume::occupied(&particles, truth.particle_spacing_m)?;
                    Some(occupied * *share.get_or_insert(at_rest / occupied))
                }
                // Nothing is compared with it.
                _ => None,
            };
            let error = frame_error(run, (frame, filled), (&particles, volume), truth)?;
            frames.push(FrameError { observed: frame < fitted, pictures: drawn, ..error });
            events.step(STAGE, "", frame as u64 + 1, None, &[]);
        }
    }
    let reconstructed_m3 = summary.particle_volume_m3 * summary.particles as f64;
    let twin_m3 = truth.volume_m3.map(|_| twin_volume_m3(run)).transpose()?;
    let error_of = |(volume_m3, true_m3): (f64, f64)| volume_m3 / true_m3 - 1.0;
    Ok(Evaluation {
        model: found.model.clone(),
        parameters: parameter_errors(&found, truth),
        velocity: velocity_error(&found, truth),
        frames,
        volume_error: Some(reconstructed_m3).zip(truth.volume_m3).map(error_of),
        twin_volume_error: twin_m3.zip(truth.volume_m3).map(error_of),
        mask_iou: mean(summary.mask_iou.iter().copied()),
        registration: registration_error(run, truth)?,
    })
}

/// Volume of the run's twin [m^3].
fn twin_volume_m3(run: &Path) -> Result<f64> {
    let (_, world) = Twin::read(&run.join("twin.json"), &[])?.to_world()?;
    Ok(world.bodies.iter().map(|body| body.masses_kg().iter().sum::<f64>() / body.density_kg_m3).sum())
}

fn parameter_errors(found: &IdentifyRecord, truth: &Truth) -> Vec<ParameterError> {
    let names = truth.material.parameter_names().iter().copied();
    let all: Vec<(&str, f64)> = names.zip(truth.material.parameters()).collect();
    let sought = found.estimates.iter().filter(|e| !e.fixed);
    sought
        .filter_map(|e| {
            let (_, value) = *all.iter().find(|(name, _)| *name == e.name)?;
            Some(ParameterError {
                name: e.name.clone(),
                paper_name: paper_name(&found.model, &e.name).into(),
                estimate: e.value,
                interval_95: e.interval_95,
                identifiable: e.identifiable,
                truth: value,
                error_x100: 100.0 * (paper_value(&e.name, e.value) - paper_value(&e.name, value)).abs(),
                inside: e.interval_95[0] <= value && value <= e.interval_95[1],
            })
        })
        .collect()
}

fn velocity_error(found: &IdentifyRecord, truth: &Truth) -> VelocityError {
    let error = |axis: usize| (found.velocity_m_s[axis] - truth.velocity_m_s[axis]).abs();
    VelocityError {
        estimate_m_s: found.velocity_m_s,
        truth_m_s: truth.velocity_m_s,
        error_x100: 100.0 * mean((0..3).map(error)),
        inside: found
            .velocity_interval_95_m_s
            .map_or(0, |half| (0..3).filter(|&axis| error(axis) <= half[axis]).count()),
    }
}

fn frame_error(
    run: &Path,
    (frame, filled): (usize, Option<&FrameFilling>),
    (particles, volume_m3): (&[[f32; 3]], Option<f64>),
    truth: &Truth,
) -> Result<FrameError> {
    let against = |path: &Path| -> Result<[f64; 2]> {
        let cloud: Vec<[f32; 3]> = read_particles(path)?.positions.iter().map(|p| p.as_vec3().to_array()).collect();
        let metrics = compare_clouds(&cloud, particles, SEED).map_err(Error::stage("comparing particles"))?;
        Ok([metrics.chamfer, metrics.emd])
    };
    let prediction = run.join(prediction_file(frame));
    let floor =
        noise_floor(particles, truth.particle_spacing_m as f32, SEED).map_err(Error::stage("comparing particles"))?;
    Ok(FrameError {
        frame,
        observed: filled.is_some(),
        filling: filled.map(|_| against(&run.join(filling_file(frame)))).transpose()?,
        prediction: prediction.exists().then(|| against(&prediction)).transpose()?,
        floor: [floor.chamfer, floor.emd],
        volume_error: volume_m3.zip(filled).map(|(volume, filled)| filled.volume_m3 / volume - 1.0),
        mask_iou: filled.and_then(|filled| filled.mask_iou),
        pictures: None,
    })
}
