//! Every setting of a run: one tree, stored as `config.toml`, changed by flags and `--set`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use gic_appearance::{AppearanceFitSettings, RegisterSettings};
use gic_motion::TrainSettings;
use gic_twin::atomic;
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use crate::error::{Error, Result};

/// The settings of all stages; [`Default`] is right for every scene that several cameras filmed, see [`TrainSettings::for_scene`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Seed of everything random.
    pub seed: u64,
    /// How the scene is read.
    pub scene: SceneConfig,
    /// From pictures to moving Gaussians.
    pub reconstruct: TrainSettings,
    /// From a scan's frame to the video's, for scenes with photographs of the object at rest.
    pub register: RegisterSettings,
    /// From Gaussians to matter.
    pub fill: FillConfig,
    /// From matter to material.
    pub identify: IdentifyConfig,
    /// The colours of the twin.
    pub appearance: AppearanceConfig,
}

/// How the scene is read.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SceneConfig {
    /// The scene's folder.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub path: Option<PathBuf>,
    /// Which masks: those of the scene, or made by background difference.
    pub masks: MaskChoice,
    /// An ONNX matting network that makes the masks.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub matting: Option<PathBuf>,
    /// Frames per second, in place of what the format says.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame_rate_hz: Option<f64>,
    /// Which of several sets in the folder; the first by name by default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub set: Option<String>,
    /// Only these cameras (numbers from 0) are looked at; they become cameras 0, 1, ... in this order. All by default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cameras: Option<Vec<usize>>,
    /// Everything is fitted to this many frames, from the first; the twin predicts the others. All frames by default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fit_frames: Option<usize>,
}

/// Where masks come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum MaskChoice {
    /// The scene's own masks where it has them, else background difference.
    #[default]
    Auto,
    /// Background difference, even where the scene has masks.
    Difference,
}

/// Filling.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FillConfig {
    /// Side of the voxels of the first level [m]; by default from the object's size.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub voxel_spacing_m: Option<f64>,
    /// Distance of neighbouring particles [m]; by default 1/35 of the object's largest side, or less for at least 5,500 particles.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub particle_spacing_m: Option<f64>,
    /// Number of levels, the paper's n_u.
    pub levels: usize,
    /// Density from which a voxel belongs to the body.
    pub th_min: f64,
    /// Density up to which a voxel of the body belongs to its surface.
    pub th_max: f64,
    /// Gaussians with less opacity do not count.
    pub min_opacity: f32,
    /// What to do where no view sees the boundary.
    pub unseen: UnseenChoice,
    /// Whether a body that is its own mirror image is completed by it, so that what no view sees is what its image shows.
    pub symmetry: bool,
}

impl Default for FillConfig {
    fn default() -> Self {
        let defaults = gic_continuum::FillSettings::for_size(1.0);
        Self {
            voxel_spacing_m: None,
            particle_spacing_m: None,
            levels: defaults.levels,
            th_min: defaults.th_min,
            th_max: defaults.th_max,
            min_opacity: defaults.min_opacity,
            unseen: UnseenChoice::default(),
            symmetry: true,
        }
    }
}

/// The body's boundary where no view sees it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum UnseenChoice {
    /// Smooth, and at every frame such that the body keeps its volume.
    #[default]
    #[serde(alias = "midway")] // what runs before 2026-11-22 call it
    Smooth,
    /// The largest body, as in the paper.
    Fill,
}

/// Identification.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct IdentifyConfig {
    /// The material's model, or `auto`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub material: Option<MaterialChoice>,
    /// Density [kg/m^3]: a video shows only the ratio of stress to density.
    pub density_kg_m3: f64,
    /// Gravity [m/s^2]; by default the scene's, else (0, -9.8, 0).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gravity_m_s2: Option<[f64; 3]>,
    /// A JSON file with a list of colliders as in a twin; by default the scene's ground.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub colliders: Option<PathBuf>,
    /// Side of a cell of the simulation grid [m]; by default twice the particle spacing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub grid_spacing_m: Option<f64>,
    /// Substeps per frame; by default 200 on a grid of 0.02 m, and in proportion.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub substeps_per_frame: Option<usize>,
    /// Which observations take part.
    pub target: TargetChoice,
    /// How the loss is minimised.
    pub optimizer: OptimizerChoice,
    /// Gradient steps of Adam.
    pub adam_iterations: usize,
    /// Parameters that are known.
    pub fix: BTreeMap<String, f64>,
    /// Starting values of the parameters, in the model's order; by default a grid is searched.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub start: Option<Vec<f64>>,
    /// Initial velocity [m/s], where it is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub velocity_m_s: Option<[f64; 3]>,
    /// Whether an initial rotation may be estimated.
    pub rotation: bool,
    /// Most Jacobians of the last stage.
    pub iterations: usize,
    /// Frames used, from the first; all by default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frames: Option<usize>,
    /// The grid is refined by this factor to see how far the estimate moves; 0 skips the check.
    pub resolution_check: f64,
}

impl Default for IdentifyConfig {
    fn default() -> Self {
        let defaults = gic_identify::Settings::default();
        Self {
            material: None,
            density_kg_m3: 1000.0,
            gravity_m_s2: None,
            colliders: None,
            grid_spacing_m: None,
            substeps_per_frame: None,
            target: TargetChoice::default(),
            optimizer: OptimizerChoice::default(),
            adam_iterations: 200,
            fix: BTreeMap::new(),
            start: None,
            velocity_m_s: None,
            rotation: defaults.rotation,
            iterations: defaults.iterations,
            frames: None,
            resolution_check: defaults.resolution_check.unwrap_or(0.0),
        }
    }
}

/// The colours of the twin.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AppearanceConfig {
    /// Whether `gic run` makes them.
    pub enabled: bool,
    /// How they are trained.
    pub train: AppearanceFitSettings,
}

impl Default for AppearanceConfig {
    fn default() -> Self {
        Self { enabled: true, train: AppearanceFitSettings::default() }
    }
}

/// The material models, by the names of `twin.json`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Model {
    /// Neo-Hookean solid.
    Elastic,
    /// Hencky elasticity with von Mises yield.
    Plasticine,
    /// Drucker-Prager.
    Sand,
    /// Weakly compressible viscous fluid.
    Newtonian,
    /// Viscoplastic fluid.
    NonNewtonian,
}

/// A model, or the search for one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum MaterialChoice {
    /// The model that, fitted to the earlier frames, predicts the later ones best.
    Auto,
    /// [`Model::Elastic`].
    Elastic,
    /// [`Model::Plasticine`].
    Plasticine,
    /// [`Model::Sand`].
    Sand,
    /// [`Model::Newtonian`].
    Newtonian,
    /// [`Model::NonNewtonian`].
    NonNewtonian,
}

impl MaterialChoice {
    /// The model; `None` for [`MaterialChoice::Auto`].
    pub fn model(self) -> Option<Model> {
        match self {
            Self::Auto => None,
            Self::Elastic => Some(Model::Elastic),
            Self::Plasticine => Some(Model::Plasticine),
            Self::Sand => Some(Model::Sand),
            Self::Newtonian => Some(Model::Newtonian),
            Self::NonNewtonian => Some(Model::NonNewtonian),
        }
    }
}

impl Model {
    /// Every model, the fewest unknowns first.
    pub const ALL: [Self; 5] = [Self::Sand, Self::Elastic, Self::Newtonian, Self::Plasticine, Self::NonNewtonian];

    /// Its name in `twin.json`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Elastic => "elastic",
            Self::Plasticine => "plasticine",
            Self::Sand => "sand",
            Self::Newtonian => "newtonian",
            Self::NonNewtonian => "non-newtonian",
        }
    }

    /// What identification calls it.
    pub fn kind(self) -> gic_identify::MaterialKind {
        use gic_identify::MaterialKind as Kind;
        match self {
            Self::Elastic => Kind::Elastic,
            Self::Plasticine => Kind::Plasticine,
            Self::Sand => Kind::Sand,
            Self::Newtonian => Kind::Newtonian,
            Self::NonNewtonian => Kind::NonNewtonian,
        }
    }
}

/// Observations that take part.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum TargetChoice {
    /// Surfaces and masks.
    #[default]
    Both,
    /// Extracted surfaces only.
    Surfaces,
    /// Masks only.
    Masks,
}

/// Optimisers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum OptimizerChoice {
    /// Levenberg-Marquardt on Jacobians from parallel rollouts.
    #[default]
    LevenbergMarquardt,
    /// The paper's Adam on the adjoint.
    Adam,
}

/// Part of a configuration, and where it comes from.
#[derive(Clone)]
pub struct Layer {
    /// Where it comes from, for messages.
    pub origin: PathBuf,
    /// The settings given there.
    pub table: Table,
}

impl Layer {
    /// All settings of the reconstruction.
    pub fn reconstruct(origin: &str, settings: &TrainSettings) -> Result<Self> {
        let syntax = |source: toml::ser::Error| Error::Syntax {
            path: origin.into(),
            format: "a configuration",
            source: source.into(),
        };
        let settings = Table::try_from(settings).map_err(syntax)?;
        let table = Table::from_iter([("reconstruct".to_owned(), Value::Table(settings))]);
        Ok(Self { origin: origin.into(), table })
    }

    /// The settings of a TOML file.
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(Error::read(path))?;
        let syntax =
            |source: toml::de::Error| Error::Syntax { path: path.to_owned(), format: "TOML", source: source.into() };
        Ok(Self { origin: path.to_owned(), table: text.parse::<Table>().map_err(syntax)? })
    }

    /// Settings from `KEY=VALUE` texts, KEY being a path such as `reconstruct.loss.scale` and VALUE TOML or a bare word.
    pub fn from_assignments<'a>(assignments: impl IntoIterator<Item = &'a str>) -> Result<Self> {
        let mut table = Table::new();
        for text in assignments {
            let wrong = |problem: &str| Error::Usage {
                problem: format!("--set {text}: {problem}"),
                hint: Some("write --set section.key=value, with the keys of the run's config.toml".into()),
            };
            let (path, value) = text.split_once('=').ok_or_else(|| wrong("has no `=`"))?;
            let value = format!("v={value}").parse::<Table>().ok().and_then(|mut t| t.remove("v"));
            let value = value.unwrap_or_else(|| Value::String(text[path.len() + 1..].to_owned()));
            let mut single = value;
            for key in path.rsplit('.') {
                single = Value::Table(Table::from_iter([(key.trim().to_owned(), single)]));
            }
            let Value::Table(single) = single else { return Err(wrong("has no key")) };
            merge(&mut table, single);
        }
        Ok(Self { origin: PathBuf::from("--set"), table })
    }
}

impl Config {
    /// The defaults, changed by each layer in turn.
    ///
    /// # Errors
    /// An unknown key or a value of the wrong kind, with the layer's name.
    pub fn resolve(layers: Vec<Layer>) -> Result<Self> {
        let mut config = Self::default();
        for layer in layers {
            let mut table = Table::try_from(&config).map_err(|source| Error::Syntax {
                path: layer.origin.clone(),
                format: "a configuration",
                source: source.into(),
            })?;
            merge(&mut table, layer.table);
            config = Value::Table(table).try_into().map_err(|source: toml::de::Error| Error::Syntax {
                path: layer.origin,
                format: "a configuration",
                source: source.into(),
            })?;
        }
        Ok(config)
    }

    /// Writes all settings, defaults included, atomically.
    pub fn write(&self, path: &Path) -> Result<()> {
        let text = toml::to_string(self).map_err(|source| Error::Syntax {
            path: path.to_owned(),
            format: "a configuration",
            source: source.into(),
        })?;
        let head = "# Every setting of this run. Feed it back with --config, or change single ones with --set section.key=value.\n\n";
        Ok(atomic::write(path, (head.to_owned() + &text).as_bytes())?)
    }
}

/// Puts the values of `other` over those of `table`, table by table.
fn merge(table: &mut Table, other: Table) {
    for (key, value) in other {
        match (table.get_mut(&key), value) {
            (Some(Value::Table(inner)), Value::Table(value)) => merge(inner, value),
            (_, value) => {
                table.insert(key, value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(assignments: &[&str]) -> Result<Config> {
        Config::resolve(vec![Layer::from_assignments(assignments.iter().copied())?])
    }

    #[test]
    fn settings_reach_every_depth() {
        let config =
            set(&["seed=7", "reconstruct.loss.scale=0.5", "identify.material=sand", "fill.unseen=fill"]).unwrap();
        assert_eq!((config.seed, config.reconstruct.loss.scale), (7, 0.5));
        assert_eq!(config.identify.material.and_then(MaterialChoice::model), Some(Model::Sand));
        assert_eq!(config.fill.unseen, UnseenChoice::Fill);
        assert_eq!(config.reconstruct.steps, Config::default().reconstruct.steps);
    }

    #[test]
    fn later_layers_win() {
        let layer = |text| Layer::from_assignments([text]).unwrap();
        let config = Config::resolve(vec![layer("reconstruct.steps=10"), layer("reconstruct.steps=20")]).unwrap();
        assert_eq!(config.reconstruct.steps, 20);
    }

    #[test]
    fn unknown_settings_are_named() {
        let error = set(&["reconstruct.stepz=5"]).unwrap_err();
        let cause = std::error::Error::source(&error).unwrap().to_string();
        assert!(cause.contains("stepz") && cause.contains("steps"), "{cause}");
    }

    #[test]
    fn what_is_written_is_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("config.toml");
        let config = set(&["identify.fix.poisson_ratio=0.3", "identify.velocity_m_s=[0, -1.0, 0]"]).unwrap();
        config.write(&path).unwrap();
        assert_eq!(Config::resolve(vec![Layer::read(&path).unwrap()]).unwrap(), config);
    }
}
