//! What other methods found.

use std::path::{Path, PathBuf};

use gic_files::FileError;
use gic_twin::atomic;
use serde::{Deserialize, Serialize};

use crate::error::{BenchError, Result};
use crate::paper::{paper_name, paper_value};
use crate::plan::Plan;
use crate::truth::Truth;

/// What another method found in a scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OtherResult {
    /// Name of the method.
    pub method: String,
    /// The scene.
    pub scene: String,
    /// Model of the material.
    pub model: String,
    /// The file that says so, from its folder.
    pub file: String,
    /// Absolute errors in the units of the paper's table, times 100, by the paper's names; the velocity is `v`.
    pub errors_x100: Vec<(String, f64)>,
}

/// `*-pred.json` of GIC, `projo4d_pred*.json` and `gic_pred.json` of ProJo4D: the part that is read.
#[derive(Deserialize)]
struct Prediction {
    /// Initial velocity [m/s].
    vel: [f64; 3],
    mat_params: MaterialPrediction,
}

/// Moduli and stresses in Pa, viscosities in Pa s, the angle of friction in degrees.
#[derive(Default, Deserialize)]
#[serde(default)]
struct MaterialPrediction {
    #[serde(rename = "E")]
    youngs_modulus: Option<f64>,
    nu: Option<f64>,
    mu: Option<f64>,
    kappa: Option<f64>,
    yield_stress: Option<f64>,
    plastic_viscosity: Option<f64>,
    friction_alpha: Option<f64>,
}

impl MaterialPrediction {
    /// The value of a parameter of a twin's material.
    fn value(&self, name: &str) -> Option<f64> {
        match name {
            "youngs_modulus_pa" => self.youngs_modulus,
            "poisson_ratio" => self.nu,
            "viscosity_pa_s" | "shear_modulus_pa" => self.mu,
            "bulk_modulus_pa" => self.kappa,
            "yield_stress_pa" => self.yield_stress,
            "plastic_viscosity_pa_s" => self.plastic_viscosity,
            "friction_angle_deg" => self.friction_alpha,
            _ => None,
        }
    }
}

/// What the files in some folders say, each of which holds a folder for each scene of a plan. A folder without a file
/// of another method is passed over: its scene has not been run.
///
/// # Errors
/// A folder that cannot be read, a damaged file, no file at all.
pub fn read_others(plan: &Plan, folders: &[PathBuf]) -> Result<Vec<OtherResult>> {
    let mut scenes: Vec<(&str, &Path)> =
        plan.tasks.iter().map(|t| (t.scene.as_str(), t.scene_path.as_path())).collect();
    scenes.dedup();
    let mut found = Vec::new();
    for folder in folders {
        let before = found.len();
        for (scene, path) in &scenes {
            for file in predictions(&folder.join(scene))? {
                let truth = Truth::read(&path.join("gt"))?;
                found.push(other_result(scene, &file, &truth)?);
            }
        }
        if found.len() == before {
            return Err(BenchError::File(FileError::Content {
                path: folder.clone(),
                problem: "has no file *pred*.json in a folder with the name of a scene".into(),
                hint: Some("give the folder that holds the folders of -m, which are called as the scenes are".into()),
            }));
        }
    }
    Ok(found)
}

/// The files of other methods in a scene's folder, by name.
fn predictions(folder: &Path) -> Result<Vec<PathBuf>> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let entries = std::fs::read_dir(folder).map_err(FileError::read(folder))?;
    let mut files: Vec<PathBuf> =
        entries.flatten().map(|entry| entry.path()).filter(|path| method_of(path).is_some()).collect();
    files.sort();
    Ok(files)
}

/// The method that writes files of such a name; a postfix tells its variants apart.
fn method_of(path: &Path) -> Option<String> {
    let stem = path.file_name()?.to_str()?.strip_suffix(".json")?;
    match stem.strip_prefix("projo4d_pred") {
        Some("") => Some("ProJo4D".into()),
        Some(postfix) => Some(format!("ProJo4D {}", postfix.trim_start_matches('_'))),
        None if stem == "gic_pred" || stem.strip_suffix("-pred").is_some_and(|id| id.parse::<u64>().is_ok()) => {
            Some("GIC, released code".into())
        }
        None => None,
    }
}

fn other_result(scene: &str, path: &Path, truth: &Truth) -> Result<OtherResult> {
    let prediction: Prediction = atomic::read_json(path)?;
    let model = truth.material.model();
    let mut errors = Vec::new();
    for (name, truth) in truth.material.parameter_names().iter().zip(truth.material.parameters()) {
        // Of sand, the methods are given the moduli.
        if model == "sand" && *name != "friction_angle_deg" {
            continue;
        }
        let value = prediction.mat_params.value(name).ok_or_else(|| {
            BenchError::File(FileError::Field {
                path: path.to_owned(),
                field: "mat_params".into(),
                problem: format!("has no {name}, which the law {model} has"),
                hint: Some("the scene may have been run with the configuration of another law".into()),
            })
        })?;
        let error = 100.0 * (paper_value(name, value) - paper_value(name, truth)).abs();
        if !error.is_finite() {
            return Err(BenchError::File(FileError::Field {
                path: path.to_owned(),
                field: "mat_params".into(),
                problem: format!("gives {value} for {name}"),
                hint: Some("run the scene again, or take its folder out".into()),
            }));
        }
        errors.push((paper_name(model, name).to_owned(), error));
    }
    let velocity: f64 = (0..3).map(|axis| (prediction.vel[axis] - truth.velocity_m_s[axis]).abs()).sum();
    errors.push(("v".into(), 100.0 * velocity / 3.0));
    Ok(OtherResult {
        method: method_of(path).unwrap_or_default(),
        scene: scene.into(),
        model: model.into(),
        file: format!("{scene}/{}", path.file_name().unwrap_or_default().to_string_lossy()),
        errors_x100: errors,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::tests::task;

    /// A plan of one scene with its truth, and a folder for results beside it.
    fn suite(folder: &Path, law: &str, params: &str) -> Plan {
        let truth = folder.join("scene/gt");
        std::fs::create_dir_all(&truth).unwrap();
        std::fs::create_dir_all(folder.join("output/scene")).unwrap();
        let text = format!(r#"{{"material": "{law}", "params": {params}, "initial_velocity": [0.1, -1.0, 0.2]}}"#);
        std::fs::write(truth.join("params.json"), text).unwrap();
        let task = crate::plan::Task { scene_path: folder.join("scene"), ..task("scene") };
        Plan::extend(&folder.join("out"), &[task]).unwrap()
    }

    fn read(plan: &Plan, folder: &Path, file: &str, text: &str) -> Result<Vec<OtherResult>> {
        std::fs::write(folder.join("output/scene").join(file), text).unwrap();
        read_others(plan, &[folder.join("output")])
    }

    #[test]
    fn results_of_both_methods_are_read_in_the_papers_units() {
        let folder = tempfile::tempdir().unwrap();
        let plan = suite(folder.path(), "elastic", r#"{"E": 1e5, "nu": 0.3}"#);
        let gic =
            r#"{"config_id": 0, "vel": [0.1, -1.03, 0.2], "mat_params": {"material": 10, "E": 1.1e5, "nu": 0.28}}"#;
        let found = read(&plan, folder.path(), "0-pred.json", gic).unwrap();
        assert_eq!((found[0].method.as_str(), found[0].model.as_str()), ("GIC, released code", "elastic"));
        for ((name, error), (wanted, value)) in
            found[0].errors_x100.iter().zip([("log10(E)", 4.139), ("nu", 2.0), ("v", 1.0)])
        {
            assert!(name == wanted && (error - value).abs() < 1e-3, "{name} {error}");
        }
        let projo4d = gic.replace("0.28", "0.29");
        let found = read(&plan, folder.path(), "projo4d_pred_three.json", &projo4d).unwrap();
        assert_eq!(
            found.iter().map(|f| f.method.as_str()).collect::<Vec<_>>(),
            ["GIC, released code", "ProJo4D three"]
        );
    }

    #[test]
    fn sand_has_an_angle_in_degrees() {
        let folder = tempfile::tempdir().unwrap();
        let plan = suite(folder.path(), "sand", r#"{"E": 1e6, "nu": 0.3, "friction_angle": 30.0}"#);
        let text = r#"{"vel": [0.1, -1.0, 0.2], "mat_params": {"E": 1e6, "nu": 0.3, "friction_alpha": 33.0}}"#;
        let found = read(&plan, folder.path(), "gic_pred.json", text).unwrap();
        assert_eq!(found[0].errors_x100[0].0, "theta_fric");
        assert!((found[0].errors_x100[0].1 - 300f64.to_radians()).abs() < 1e-9);
    }

    #[test]
    fn files_of_other_laws_and_empty_folders_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let plan = suite(folder.path(), "newtonian", r#"{"mu": 100.0, "kappa": 1e5}"#);
        let empty = read_others(&plan, &[folder.path().join("output")]).unwrap_err();
        assert!(empty.to_string().contains("output"), "{empty}");
        let text = r#"{"vel": [0, 0, 0], "mat_params": {"E": 1e6, "nu": 0.3}}"#;
        let refused = read(&plan, folder.path(), "0-pred.json", text).unwrap_err();
        assert!(refused.to_string().contains("viscosity_pa_s") && refused.hint().is_some(), "{refused}");
        let dead = r#"{"vel": [0, 0, 0], "mat_params": {"mu": -1.0, "kappa": 1e5}}"#;
        assert!(read(&plan, folder.path(), "0-pred.json", dead).unwrap_err().to_string().contains("-1"));
    }
}
