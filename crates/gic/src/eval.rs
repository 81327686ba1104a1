//! `gic eval`: a run against ground truth, in the paper's units. Nothing that estimates reads any of this.

use std::path::Path;

use gic_metrics::{compare_clouds, noise_floor};
use gic_mpm::Material;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::atomic;
use crate::error::{Error, Result};
use crate::events::Events;
use crate::interrupt::Interrupt;
use crate::matter::read_particles;
use crate::pipeline::{FillSummary, FrameFilling, IdentifyRecord, filling_file};

const STAGE: &str = "eval";
/// Seed of the random points that clouds are compared with: the same for every run, so that runs can be compared.
const SEED: u64 = 0;

/// Ground truth of a scene in PAC-NeRF's layout: `params.json` and `particles_{frame}.npz`.
pub struct Truth {
    folder: std::path::PathBuf,
    /// The material.
    pub material: Material,
    /// Initial velocity [m/s].
    pub velocity_m_s: [f64; 3],
    /// Rest volume of the object [m^3], where given.
    pub volume_m3: Option<f64>,
    /// Distance of neighbouring particles [m].
    pub particle_spacing_m: f64,
}

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

/// Distances of particle clouds in one frame: chamfer [1e3 mm^2] and earth mover's [m].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameError {
    /// Number of the frame.
    pub frame: usize,
    /// The continuum filled from this frame's Gaussians against the truth.
    pub filling: [f64; 2],
    /// The simulated twin against the truth, where it was simulated.
    pub prediction: Option<[f64; 2]>,
    /// Volume of the filled body over that of the truth, less one.
    pub volume_error: Option<f64>,
    /// Mean overlap of the re-rendered filled body with the masks.
    pub mask_iou: Option<f64>,
    /// Two samplings of the truth against each other: what a perfect answer would score.
    pub floor: [f64; 2],
}

impl Truth {
    /// Reads a `gt` folder.
    ///
    /// # Errors
    /// Missing or damaged files, an unknown material.
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join("params.json");
        let text = std::fs::read_to_string(&path).map_err(Error::read(&path))?;
        let json: Value = serde_json::from_str(&text).map_err(|source| Error::Syntax {
            path: path.clone(),
            format: "JSON",
            source: source.into(),
        })?;
        let missing = |field: &str| Error::Field {
            path: path.clone(),
            field: field.into(),
            problem: "is missing or of the wrong kind".into(),
            hint: Some("truth is a folder with params.json in the layout of the PAC-NeRF scenes".into()),
        };
        let number = |pointer: &str| json.pointer(pointer).and_then(Value::as_f64);
        let parameter = |name: &str| {
            let pointer = format!("/params/{name}");
            number(&pointer).ok_or_else(|| missing(&format!("params.{name}")))
        };
        let model = json["material"].as_str().ok_or_else(|| missing("material"))?.replace('_', "-");
        let material = match model.as_str() {
            "elastic" => Material::Elastic { youngs_modulus_pa: parameter("E")?, poisson_ratio: parameter("nu")? },
            "plasticine" => Material::Plasticine {
                youngs_modulus_pa: parameter("E")?,
                poisson_ratio: parameter("nu")?,
                yield_stress_pa: parameter("yield_stress")?,
            },
            "sand" => Material::Sand {
                friction_angle_deg: parameter("friction_angle")?,
                youngs_modulus_pa: number("/params/E").unwrap_or(1.0e6),
                poisson_ratio: number("/params/nu").unwrap_or(0.3),
            },
            "newtonian" => {
                Material::Newtonian { viscosity_pa_s: parameter("mu")?, bulk_modulus_pa: parameter("kappa")? }
            }
            "non-newtonian" => Material::NonNewtonian {
                shear_modulus_pa: parameter("mu")?,
                bulk_modulus_pa: parameter("kappa")?,
                yield_stress_pa: parameter("yield_stress")?,
                plastic_viscosity_pa_s: parameter("plastic_viscosity")?,
            },
            _ => return Err(missing("material")),
        };
        let velocity = |axis: usize| number(&format!("/initial_velocity/{axis}"));
        let velocity_m_s = match (velocity(0), velocity(1), velocity(2)) {
            (Some(x), Some(y), Some(z)) => [x, y, z],
            _ => return Err(missing("initial_velocity")),
        };
        let volume_m3 = number("/n_particles").zip(number("/particle_volume")).map(|(n, volume)| n * volume);
        let particle_spacing_m = number("/particle_spacing").unwrap_or(0.01);
        Ok(Self { folder: folder.to_owned(), material, velocity_m_s, volume_m3, particle_spacing_m })
    }

    /// True particles of a frame [m]; `None` where the truth has none.
    ///
    /// # Errors
    /// A damaged file.
    pub fn particles(&self, frame: usize) -> Result<Option<Vec<[f32; 3]>>> {
        let path = self.folder.join(format!("particles_{frame}.npz"));
        if !path.exists() {
            return Ok(None);
        }
        let content = |problem: String| Error::Content { path: path.clone(), problem, hint: None };
        let read = || -> std::io::Result<Option<Vec<f32>>> {
            let mut archive = npyz::npz::NpzArchive::open(&path)?;
            archive.by_name("x")?.map(|array| array.into_vec::<f32>()).transpose()
        };
        let numbers = read().map_err(Error::read(&path))?.ok_or_else(|| content("has no array `x`".into()))?;
        if numbers.is_empty() || numbers.len() % 3 != 0 {
            return Err(content(format!("`x` holds {} numbers, not three per particle", numbers.len())));
        }
        Ok(Some(numbers.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect()))
    }
}

/// Compares a run with the truth.
///
/// # Errors
/// A run that is not finished, a truth of another material, damaged files.
pub fn evaluate(run: &Path, truth: &Truth, events: &Events, interrupt: &Interrupt) -> Result<Evaluation> {
    let found: IdentifyRecord = atomic::read_json(&run.join("identify.json"))?;
    let summary: FillSummary = atomic::read_json(&run.join("fill.json"))?;
    if found.model != truth.material.model() {
        return Err(Error::Usage {
            problem: format!("the run assumed {}, the truth is {}", found.model, truth.material.model()),
            hint: Some(format!("run again with --material {}", truth.material.model())),
        });
    }
    let mut frames = Vec::new();
    for filled in &summary.frames {
        if interrupt.requested() {
            return Err(Error::Interrupted { after: String::new(), resume: "run the same command again".into() });
        }
        if let Some(particles) = truth.particles(filled.frame)? {
            frames.push(frame_error(run, filled, &particles, truth)?);
            let of = Some(summary.frames.len() as u64);
            events.step(STAGE, "", filled.frame as u64 + 1, of, &[]);
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
    })
}

/// Mean of some numbers; NaN of none.
pub fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0), |(sum, n), v| (sum + v, n + 1));
    sum / f64::from(n)
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
        _ => "log10(eta)",
    }
}

fn velocity_error(found: &IdentifyRecord, truth: &Truth) -> VelocityError {
    let error = |axis: usize| (found.velocity_m_s[axis] - truth.velocity_m_s[axis]).abs();
    VelocityError {
        estimate_m_s: found.velocity_m_s,
        truth_m_s: truth.velocity_m_s,
        error_x100: 100.0 * mean((0..3).map(error)),
        inside: (0..3).filter(|&axis| error(axis) <= found.velocity_interval_95_m_s[axis]).count(),
    }
}

fn frame_error(run: &Path, filled: &FrameFilling, particles: &[[f32; 3]], truth: &Truth) -> Result<FrameError> {
    let frame = filled.frame;
    let against = |path: &Path| -> Result<[f64; 2]> {
        let cloud: Vec<[f32; 3]> = read_particles(path)?.positions.iter().map(|p| p.as_vec3().to_array()).collect();
        let metrics = compare_clouds(&cloud, particles, SEED).map_err(Error::stage("comparing particles"))?;
        Ok([metrics.chamfer, metrics.emd])
    };
    let prediction = run.join(format!("prediction/particles_{frame:04}.ply"));
    let floor =
        noise_floor(particles, truth.particle_spacing_m as f32, SEED).map_err(Error::stage("comparing particles"))?;
    Ok(FrameError {
        frame,
        filling: against(&run.join(filling_file(frame)))?,
        prediction: prediction.exists().then(|| against(&prediction)).transpose()?,
        floor: [floor.chamfer, floor.emd],
        volume_error: truth.volume_m3.map(|volume| filled.volume_m3 / volume - 1.0),
        mask_iou: filled.mask_iou,
    })
}

impl Evaluation {
    /// The evaluation as a table for people.
    pub fn table(&self) -> String {
        let mut text = format!(
            "{:<28} {:>12} {:>25} {:>12} {:>11}\n",
            self.model, "estimate", "95 % interval", "truth", "error x100"
        );
        for p in &self.parameters {
            let interval = format!("{:.4e} .. {:.4e}", p.interval_95[0], p.interval_95[1]);
            let verdict = match (p.identifiable, p.inside) {
                (false, _) => "  not determined",
                (true, true) => "",
                (true, false) => "  outside its interval",
            };
            text += &format!(
                "{:<28} {:>12.5e} {interval:>25} {:>12.5e} {:>11.2}  {}{verdict}\n",
                p.name, p.estimate, p.truth, p.error_x100, p.paper_name
            );
        }
        let v = &self.velocity;
        let vector = |v: [f64; 3]| format!("({:.4}, {:.4}, {:.4})", v[0], v[1], v[2]);
        text += &format!(
            "{:<28} {} m/s, truth {}, error x100 {:.2}, {} of 3 inside\n",
            "initial_velocity_m_s",
            vector(v.estimate_m_s),
            vector(v.truth_m_s),
            v.error_x100,
            v.inside
        );
        text += &self.frame_table();
        if let Some(error) = self.volume_error {
            text += &format!("volume {:+.2} %, ", 100.0 * error);
        }
        text + &format!("masks re-rendered at the first frame: IoU {:.4}\n", self.mask_iou)
    }
}

impl Evaluation {
    /// A line for each frame and one of the means.
    fn frame_table(&self) -> String {
        if self.frames.is_empty() {
            return String::new();
        }
        let mut text = format!(
            "\n{:<5} {:>11} {:>10} {:>10} {:>12} {:>10} {:>10} {:>9} {:>9}   (CD 1e3 mm^2, EMD m; volume and IoU of the filling)\n",
            "frame", "CD filled", "predicted", "floor", "EMD filled", "predicted", "floor", "volume %", "mask IoU"
        );
        let line = |name: String, f: &FrameError| {
            let p = |i: usize| f.prediction.map_or("-".to_owned(), |p| format!("{:.4}", p[i]));
            let volume = f.volume_error.map_or("-".to_owned(), |v| format!("{:+.2}", 100.0 * v));
            let iou = f.mask_iou.map_or("-".to_owned(), |iou| format!("{iou:.4}"));
            let ([cd, emd], [cd_floor, emd_floor]) = (f.filling, f.floor);
            format!(
                "{name:<5} {cd:>11.4} {:>10} {cd_floor:>10.4} {emd:>12.4} {:>10} {emd_floor:>10.4} {volume:>9} {iou:>9}\n",
                p(0),
                p(1)
            )
        };
        for f in &self.frames {
            text += &line(f.frame.to_string(), f);
        }
        if self.frames.len() > 1 {
            let over = |pick: &dyn Fn(&FrameError) -> f64| mean(self.frames.iter().map(pick));
            // The mean of some frames only would not be comparable.
            let all = |pick: &dyn Fn(&FrameError) -> Option<f64>| {
                self.frames.iter().map(pick).collect::<Option<Vec<f64>>>().map(|v| mean(v.into_iter()))
            };
            let prediction = |i: usize| all(&move |f| f.prediction.map(|p| p[i]));
            let means = FrameError {
                frame: 0,
                filling: [over(&|f| f.filling[0]), over(&|f| f.filling[1])],
                prediction: prediction(0).zip(prediction(1)).map(|(cd, emd)| [cd, emd]),
                floor: [over(&|f| f.floor[0]), over(&|f| f.floor[1])],
                volume_error: all(&|f| f.volume_error.map(f64::abs)),
                mask_iou: all(&|f| f.mask_iou),
            };
            text += &line("mean".into(), &means);
        }
        text
    }
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
