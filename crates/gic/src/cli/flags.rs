//! Flags of the stages. A flag's name is its key in the stage's table of `config.toml`, with dashes for underscores.

use std::path::PathBuf;

use clap::Args;
use gic::config::{Config, Layer, MaskChoice, MaterialChoice, OptimizerChoice, TargetChoice, UnseenChoice};
use gic::pipeline::open_scene;
use gic_motion::TrainSettings;
use serde::Serialize;
use toml::{Table, Value};

/// Reading the scene
#[derive(Debug, Default, Args, Serialize)]
#[command(next_help_heading = "Scene")]
pub(crate) struct SceneFlags {
    /// Which masks to use
    #[arg(long, value_enum)]
    #[serde(skip_serializing_if = "Option::is_none")]
    masks: Option<MaskChoice>,
    /// Make the masks with this matting network
    #[arg(long, value_name = "MODEL.onnx")]
    #[serde(skip_serializing_if = "Option::is_none")]
    matting: Option<PathBuf>,
    /// Frames per second, in place of what the scene says
    #[arg(long, value_name = "HZ")]
    #[serde(skip_serializing_if = "Option::is_none")]
    frame_rate_hz: Option<f64>,
    /// Which of several sets in the folder
    #[arg(id = "scene_set", long = "scene-set", value_name = "NAME")]
    #[serde(skip_serializing_if = "Option::is_none")]
    set: Option<String>,
    /// Look at these cameras only, by number from 0; they become cameras 0, 1, ... [default: all]
    #[arg(long, value_name = "CAMERA", value_delimiter = ',')]
    #[serde(skip_serializing_if = "Option::is_none")]
    cameras: Option<Vec<usize>>,
    /// Fit everything to the first N frames only, and predict the others [default: all]
    #[arg(long, value_name = "N")]
    #[serde(skip_serializing_if = "Option::is_none")]
    fit_frames: Option<usize>,
}

/// Reconstruction
#[derive(Debug, Default, Args, Serialize)]
#[command(next_help_heading = "Reconstruction")]
pub(crate) struct ReconstructFlags {
    /// Start from these settings: gic's own, or the schedule that the paper prints (slow)
    #[arg(long, value_enum)]
    #[serde(skip)]
    schedule: Option<Schedule>,
    /// Steps in all
    #[arg(long, value_name = "N")]
    #[serde(skip_serializing_if = "Option::is_none")]
    steps: Option<usize>,
    /// Cameras kept for measuring, never trained on
    #[arg(long, value_name = "CAMERA", value_delimiter = ',')]
    #[serde(skip_serializing_if = "Option::is_none")]
    held_out: Option<Vec<usize>>,
    /// Never more Gaussians than this
    #[arg(long, value_name = "N")]
    #[serde(skip_serializing_if = "Option::is_none")]
    max_gaussians: Option<usize>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Schedule {
    Gic,
    Paper,
}

/// Filling
#[derive(Debug, Default, Args, Serialize)]
#[command(next_help_heading = "Filling")]
pub(crate) struct FillFlags {
    /// Distance of neighbouring particles [m] [default: from the object's size and volume]
    #[arg(long, value_name = "M")]
    #[serde(skip_serializing_if = "Option::is_none")]
    particle_spacing_m: Option<f64>,
    /// Side of the voxels of the first level [m] [default: from the object's size]
    #[arg(long, value_name = "M")]
    #[serde(skip_serializing_if = "Option::is_none")]
    voxel_spacing_m: Option<f64>,
    /// Levels of refinement, the paper's n_u [default: 4]
    #[arg(long, value_name = "N")]
    #[serde(skip_serializing_if = "Option::is_none")]
    levels: Option<usize>,
    /// The boundary where no view sees it [default: smooth]
    #[arg(long, value_enum)]
    #[serde(skip_serializing_if = "Option::is_none")]
    unseen: Option<UnseenChoice>,
    /// Whether a body that is its own mirror image is completed by it [default: true]
    #[arg(long, value_name = "BOOL")]
    #[serde(skip_serializing_if = "Option::is_none")]
    symmetry: Option<bool>,
}

/// Identification
#[derive(Debug, Default, Args, Serialize)]
#[command(next_help_heading = "Identification")]
pub(crate) struct IdentifyFlags {
    /// The material's model; auto fits every model to the earlier frames and takes the one that predicts the later ones best
    #[arg(long, value_enum)]
    #[serde(skip_serializing_if = "Option::is_none")]
    material: Option<MaterialChoice>,
    /// A parameter that is known: poisson_ratio=0.3; may be repeated
    #[arg(long = "fix", value_name = "NAME=VALUE", value_parser = known_parameter)]
    #[serde(skip)]
    fix: Vec<(String, f64)>,
    /// Density: a video shows only the ratio of stress to density [default: 1000]
    #[arg(long = "density", value_name = "KG_M3")]
    #[serde(skip_serializing_if = "Option::is_none")]
    density_kg_m3: Option<f64>,
    /// A JSON file with a list of colliders, as in twin.json [default: the scene's ground]
    #[arg(long, value_name = "FILE")]
    #[serde(skip_serializing_if = "Option::is_none")]
    colliders: Option<PathBuf>,
    /// Which observations take part [default: both]
    #[arg(long, value_enum)]
    #[serde(skip_serializing_if = "Option::is_none")]
    target: Option<TargetChoice>,
    /// How the loss is minimised [default: levenberg-marquardt]
    #[arg(long, value_enum)]
    #[serde(skip_serializing_if = "Option::is_none")]
    optimizer: Option<OptimizerChoice>,
    /// Gradient steps of Adam [default: 200]
    #[arg(long, value_name = "N")]
    #[serde(skip_serializing_if = "Option::is_none")]
    adam_iterations: Option<usize>,
    /// Frames used, from the first [default: all]
    #[arg(long, value_name = "N")]
    #[serde(skip_serializing_if = "Option::is_none")]
    frames: Option<usize>,
    /// Side of a cell of the simulation grid [m] [default: twice the particle spacing]
    #[arg(long, value_name = "M")]
    #[serde(skip_serializing_if = "Option::is_none")]
    grid_spacing_m: Option<f64>,
    /// Substeps per frame [default: 200 on a grid of 0.02 m, and in proportion]
    #[arg(long, value_name = "N")]
    #[serde(skip_serializing_if = "Option::is_none")]
    substeps_per_frame: Option<usize>,
}

/// The twin's colours
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Appearance")]
pub(crate) struct AppearanceFlags {
    /// Do not train the twin's colours
    #[arg(long)]
    no_appearance: bool,
}

/// Settings from elsewhere
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "All settings")]
pub(crate) struct SettingsFlags {
    /// Take settings from a config.toml
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Change any setting by its path in config.toml: reconstruct.loss.scale=0; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Seed of everything random [default: 0]
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
}

fn known_parameter(text: &str) -> Result<(String, f64), String> {
    let (name, value) = text.split_once('=').ok_or("write NAME=VALUE, for example poisson_ratio=0.3")?;
    let value = value.trim().parse::<f64>().ok().filter(|v| v.is_finite());
    Ok((name.trim().to_owned(), value.ok_or("the value is not a number")?))
}

/// The flags given on the command line, as settings.
#[derive(Default)]
pub(crate) struct Flags<'a> {
    pub(crate) scene_path: Option<&'a PathBuf>,
    pub(crate) scene: Option<&'a SceneFlags>,
    pub(crate) reconstruct: Option<&'a ReconstructFlags>,
    pub(crate) fill: Option<&'a FillFlags>,
    pub(crate) identify: Option<&'a IdentifyFlags>,
    pub(crate) appearance: Option<&'a AppearanceFlags>,
}

impl Flags<'_> {
    /// Layers of settings in ascending precedence: a schedule, `--config`, flags, `--set`.
    pub(crate) fn layers(&self, settings: &SettingsFlags) -> anyhow::Result<Vec<Layer>> {
        let mut layers = Vec::new();
        let given = Layer { origin: "the command line".into(), table: self.table(settings)? };
        if let Some(schedule) = self.reconstruct.and_then(|flags| flags.schedule) {
            let train = match schedule {
                Schedule::Gic => TrainSettings::for_scene(&open_scene(&Config::resolve(vec![given.clone()])?)?),
                Schedule::Paper => TrainSettings::paper(),
            };
            layers.push(Layer::reconstruct("--schedule", &train)?);
        }
        if let Some(file) = &settings.config {
            layers.push(Layer::read(file)?);
        }
        layers.push(given);
        layers.push(Layer::from_assignments(settings.set.iter().map(String::as_str))?);
        Ok(layers)
    }

    fn table(&self, settings: &SettingsFlags) -> anyhow::Result<Table> {
        let mut table = Table::new();
        if let Some(seed) = settings.seed {
            table.insert("seed".into(), Value::Integer(i64::try_from(seed)?));
        }
        let mut scene = self.scene.map(Table::try_from).transpose()?.unwrap_or_default();
        if let Some(path) = self.scene_path {
            // A run goes on from any current folder.
            let path = std::fs::canonicalize(path).unwrap_or_else(|_| path.clone());
            scene.insert("path".into(), Value::try_from(path)?);
        }
        let mut identify = self.identify.map(Table::try_from).transpose()?.unwrap_or_default();
        let fix = self.identify.map(|flags| flags.fix.as_slice()).unwrap_or_default();
        if !fix.is_empty() {
            let fix = fix.iter().map(|(name, value)| (name.clone(), Value::Float(*value))).collect();
            identify.insert("fix".into(), Value::Table(fix));
        }
        let mut appearance = Table::new();
        if let Some(flags) = self.appearance {
            // The flag has to be given each time, unlike other settings, which the run folder remembers.
            appearance.insert("enabled".into(), Value::Boolean(!flags.no_appearance));
        }
        let sections = [
            ("scene", scene),
            ("reconstruct", self.reconstruct.map(Table::try_from).transpose()?.unwrap_or_default()),
            ("fill", self.fill.map(Table::try_from).transpose()?.unwrap_or_default()),
            ("identify", identify),
            ("appearance", appearance),
        ];
        table.extend(
            sections.into_iter().filter(|(_, t)| !t.is_empty()).map(|(name, t)| (name.to_owned(), Value::Table(t))),
        );
        Ok(table)
    }
}
