//! `gic eval`: a run against ground truth, in the paper's units. Nothing that estimates reads any of this.

mod pictures;
mod registration;
mod table;
mod truth;
mod volume;

use std::path::Path;

use gic_metrics::{compare_clouds, noise_floor};
use gic_twin::Interrupt;
use gic_twin::atomic;
use gic_twin::events::Events;
use gic_twin::matter::read_particles;
use serde::{Deserialize, Serialize};

use crate::config::{Config, Layer};
use crate::error::{Error, Result};
use crate::pipeline::{
    FrameFilling, IdentifyRecord, Stage, check_results, filling_file, prediction_file, summary_of_body,
};
use crate::statistics::mean;
pub use pictures::PictureError;
use pictures::Pictures;
pub use registration::RegistrationError;
use registration::registration_error;
pub(crate) use table::mean_of;
pub use truth::Truth;

const STAGE: &str = "eval";
/// Seed of the random points that clouds are compared with: the same for every run, so that runs can be compared.
const SEED: u64 = 0;

/// A run against the truth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// Model of the material.
    pub model: String,
    /// Every parameter that was sought.
    pub parameters: Vec<ParameterError>,
    /// Initial velocity.
    pub velocity: VelocityError,
    /// Frames with true particles.
    pub frames: Vec<FrameError>,
    /// Volume of the continuum over that of the truth, less one.
    pub volume_error: Option<f64>,
    /// Mean overlap of re-rendered masks at the first frame.
    pub mask_iou: f64,
    /// Where a scan was registered and the truth tells where it lies.
    #[serde(default)]
    pub registration: Option<RegistrationError>,
}

/// Error of a parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParameterError {
    /// Its key in `twin.json`.
    pub name: String,
    /// What the paper's table calls it.
    pub paper_name: String,
    /// The estimate.
    pub estimate: f64,
    /// Its 95 % interval.
    pub interval_95: [f64; 2],
    /// Whether the run says that the video determines it.
    pub identifiable: bool,
    /// The truth.
    pub truth: f64,
    /// Absolute error in the paper's unit: log10 (nu: as is; friction angle: radians), times 100.
    pub error_x100: f64,
    /// Whether the interval holds the truth.
    pub inside: bool,
}

/// Error of the initial velocity.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct VelocityError {
    /// The estimate [m/s].
    pub estimate_m_s: [f64; 3],
    /// The truth [m/s].
    pub truth_m_s: [f64; 3],
    /// Mean absolute error of its components, times 100.
    pub error_x100: f64,
    /// How many components lie in their interval.
    pub inside: usize,
}

/// One frame: distances of particle clouds, chamfer [1e3 mm^2] and earth mover's [m], and pictures.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameError {
    /// Number of the frame.
    pub frame: usize,
    /// Whether the run was fitted to this frame; otherwise it is a prediction.
    pub observed: bool,
    /// The continuum filled from this frame's Gaussians against the truth; `None` for frames that were not fitted to.
    pub filling: Option<[f64; 2]>,
    /// The simulated twin against the truth, where it was simulated.
    pub prediction: Option<[f64; 2]>,
    /// Volume of the filled body over that of the truth in this frame, less one.
    pub volume_error: Option<f64>,
    /// Mean overlap of the re-rendered filled body with the masks.
    pub mask_iou: Option<f64>,
    /// Two samplings of the truth against each other: what a perfect answer would score.
    pub floor: [f64; 2],
    /// The twin's pictures, where it was simulated and has colours.
    pub pictures: Option<PictureError>,
}

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
    let volume = summary.particle_volume_m3 * summary.particles as f64;
    Ok(Evaluation {
        model: found.model.clone(),
        parameters: parameter_errors(&found, truth),
        velocity: velocity_error(&found, truth),
        frames,
        volume_error: truth.volume_m3.map(|true_volume| volume / true_volume - 1.0),
        mask_iou: mean(summary.mask_iou.iter().copied()),
        registration: registration_error(run, truth)?,
    })
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

/// A parameter's value on the scale of the paper's table.
fn paper_value(name: &str, value: f64) -> f64 {
    match name {
        "poisson_ratio" => value,
        "friction_angle_deg" => value.to_radians(),
        _ => value.log10(),
    }
}

/// What the paper's table calls a parameter.
fn paper_name(model: &str, name: &str) -> &'static str {
    match (model, name) {
        (_, "youngs_modulus_pa") => "log10(E)",
        (_, "poisson_ratio") => "nu",
        (_, "yield_stress_pa") => "log10(tau_Y)",
        (_, "friction_angle_deg") => "theta_fric",
        (_, "viscosity_pa_s" | "shear_modulus_pa") => "log10(mu)",
        (_, "bulk_modulus_pa") => "log10(kappa)",
        (_, "retardation_time_s") => "t_r",
        _ => "log10(eta)",
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_in_the_papers_units() {
        let error = |name: &str, a: f64, b: f64| 100.0 * (paper_value(name, a) - paper_value(name, b)).abs();
        assert!((error("youngs_modulus_pa", 1.1e5, 1.0e5) - 4.139).abs() < 1e-3);
        assert!((error("poisson_ratio", 0.31, 0.30) - 1.0).abs() < 1e-9);
        assert!((error("friction_angle_deg", 32.4, 30.0) - 4.189).abs() < 1e-3);
    }
}
