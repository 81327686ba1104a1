//! Ground truth of a scene, for evaluation only.

use std::path::Path;

use gic_files::FileError;
use gic_mpm::Material;
use serde_json::Value;

use crate::error::{BenchError, Result};

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

impl Truth {
    /// Reads a `gt` folder.
    ///
    /// # Errors
    /// Missing or damaged files, an unknown material.
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join("params.json");
        let text = gic_files::input::read_to_string(&path).map_err(FileError::read(&path))?;
        let json: Value = serde_json::from_str(&text).map_err(FileError::syntax(&path, "JSON"))?;
        let missing = |field: &str| {
            BenchError::File(FileError::Field {
                path: path.clone(),
                field: field.into(),
                problem: "is missing or of the wrong kind".into(),
                hint: Some("truth is a folder with params.json in the layout of the PAC-NeRF scenes".into()),
            })
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
            "viscoelastic" => Material::Viscoelastic {
                youngs_modulus_pa: parameter("E")?,
                poisson_ratio: parameter("nu")?,
                retardation_time_s: parameter("retardation_time")?,
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

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
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
        let content =
            |problem: String| BenchError::File(FileError::Content { path: path.clone(), problem, hint: None });
        let read = || -> std::io::Result<Option<Vec<f32>>> {
            let mut archive = npyz::npz::NpzArchive::open(&path)?;
            archive.by_name("x")?.map(|array| array.into_vec::<f32>()).transpose()
        };
        let numbers = read().map_err(FileError::read(&path))?.ok_or_else(|| content("has no array `x`".into()))?;
        if numbers.is_empty() || numbers.len() % 3 != 0 {
            return Err(content(format!("`x` holds {} numbers, not three per particle", numbers.len())));
        }
        Ok(Some(numbers.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect()))
    }
}
