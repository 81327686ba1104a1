//! From the command line to layers of settings. The flags of a stage are the fields of its settings.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use clap::parser::ValueSource;
use clap::{ArgMatches, Args};
use gic_motion::TrainSettings;
use gic_scene::SceneSettings;
use serde::Serialize;
use toml::{Table, Value};

use crate::config::{Config, Layer};
use crate::pipeline::open_scene;

/// Reconstruction
#[derive(Debug, Args)]
#[command(next_help_heading = "Reconstruction")]
pub(crate) struct ReconstructFlags {
    /// Start from these settings: gic's own, or the schedule that the paper prints (slow)
    #[arg(long, value_enum)]
    schedule: Option<Schedule>,
    #[command(flatten)]
    settings: TrainSettings,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Schedule {
    Gic,
    Paper,
}

/// The twin's colours
#[derive(Debug, Args)]
#[command(next_help_heading = "Appearance")]
pub(crate) struct AppearanceFlags {
    /// Do not train the twin's colours
    #[arg(long)]
    no_appearance: bool,
}

/// Settings from elsewhere
#[derive(Debug, Args)]
#[command(next_help_heading = "All settings")]
pub(crate) struct SettingsFlags {
    /// Take settings from a config.toml
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Change any setting by its path in config.toml: reconstruct.loss.scale=0; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    assignments: Vec<String>,
    /// Seed of everything random
    #[arg(long, value_name = "N", default_value_t = Config::default().seed)]
    seed: u64,
}

/// The arguments that the command line itself gives, by clap's ids: not those that clap filled in with defaults.
#[derive(Default)]
pub(crate) struct Given(BTreeSet<String>);

impl Given {
    /// What the command line gives to a command.
    pub(crate) fn to(command: &ArgMatches) -> Self {
        let is_given = |id: &&clap::Id| command.value_source(id.as_str()) == Some(ValueSource::CommandLine);
        Self(command.ids().filter(is_given).map(ToString::to_string).collect())
    }

    /// Those keys of a stage's settings that are given; a flag's id is its key.
    fn keys_of(&self, settings: &impl Serialize) -> anyhow::Result<Table> {
        let mut table = Table::try_from(settings)?;
        table.retain(|key, _| self.0.contains(key));
        Ok(table)
    }
}

/// The settings among a command's arguments.
#[derive(Default)]
pub(crate) struct Flags<'a> {
    pub(crate) scene_path: Option<&'a Path>,
    pub(crate) scene: Option<&'a SceneSettings>,
    pub(crate) reconstruct: Option<&'a ReconstructFlags>,
    pub(crate) fill: Option<&'a gic_continuum::Settings>,
    pub(crate) identify: Option<&'a gic_identify::Settings>,
    pub(crate) appearance: Option<&'a AppearanceFlags>,
    pub(crate) any: Option<&'a SettingsFlags>,
}

impl Flags<'_> {
    /// Layers of settings in ascending precedence: a schedule, `--config`, flags, `--set`.
    pub(crate) fn layers(&self, given: &Given) -> anyhow::Result<Vec<Layer>> {
        let mut layers = Vec::new();
        let flags = Layer { origin: "the command line".into(), table: self.table(given)? };
        if let Some(schedule) = self.reconstruct.and_then(|flags| flags.schedule) {
            let train = match schedule {
                Schedule::Gic => TrainSettings::for_scene(&open_scene(&Config::resolve(vec![flags.clone()])?)?),
                Schedule::Paper => TrainSettings::paper(),
            };
            layers.push(Layer::reconstruct("--schedule", &train)?);
        }
        if let Some(file) = self.any.and_then(|any| any.config.as_ref()) {
            layers.push(Layer::read(file)?);
        }
        layers.push(flags);
        let assignments = self.any.map(|any| any.assignments.as_slice()).unwrap_or_default();
        layers.push(Layer::from_assignments(assignments.iter().map(String::as_str))?);
        Ok(layers)
    }

    fn table(&self, given: &Given) -> anyhow::Result<Table> {
        let mut table = match self.any {
            Some(any) => {
                given.keys_of(&Table::from_iter([("seed".to_owned(), Value::Integer(any.seed.try_into()?))]))?
            }
            None => Table::new(),
        };
        let mut scene = self.scene.map(|scene| given.keys_of(scene)).transpose()?.unwrap_or_default();
        if let Some(path) = self.scene_path {
            // A run goes on from any current folder.
            let path = std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
            scene.insert("path".into(), Value::try_from(path)?);
        }
        // The flag has to be given each time, unlike other settings, which the run folder remembers.
        let enabled = self.appearance.map(|flags| ("enabled".to_owned(), Value::Boolean(!flags.no_appearance)));
        let stages = [
            ("scene", scene),
            ("reconstruct", self.reconstruct.map(|f| given.keys_of(&f.settings)).transpose()?.unwrap_or_default()),
            ("fill", self.fill.map(|settings| given.keys_of(settings)).transpose()?.unwrap_or_default()),
            ("identify", self.identify.map(|settings| given.keys_of(settings)).transpose()?.unwrap_or_default()),
            ("appearance", enabled.into_iter().collect()),
        ];
        let named = stages.into_iter().filter(|(_, keys)| !keys.is_empty());
        table.extend(named.map(|(stage, keys)| (stage.to_owned(), Value::Table(keys))));
        Ok(table)
    }
}
