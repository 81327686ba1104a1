//! Every setting of a run: one tree, stored as `config.toml`, changed by flags and `--set`.
//!
//! The settings of a stage are one structure in the library that does the stage. Its fields are the keys of the stage's
//! table, their documents the help, its [`Default`] the defaults; a field with a flag has one of its own name, with
//! dashes for underscores (but for `--density` and `--scene-set`). A run's settings are made of layers, each of which
//! changes only the keys that it names:
//! 1. the defaults, and of the reconstruction those for how the scene was filmed; where the run folder has a
//!    `config.toml`, that file takes their place;
//! 2. `--schedule`, then the file of `--config`;
//! 3. the flags that the command line gives (a default that clap fills in is none of them);
//! 4. `--set key=value`.
//!
//! What follows from the body, such as the particle spacing, is an `Option` and stays out of the file: the stage's
//! structure resolves it once the body is known.

use std::path::{Path, PathBuf};

use gic_appearance::{AppearanceFitSettings, RegisterSettings};
use gic_files::{FileError, relative_path, resolved};
use gic_motion::TrainSettings;
use gic_scene::{Scene, SceneSettings};
use gic_twin::atomic;
use gic_twin::twin::Twin;
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use crate::error::{Error, Result};

/// The settings of all stages; [`Default`] is right for every scene that several cameras filmed, see
/// [`TrainSettings::for_scene`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Seed of everything random.
    pub seed: u64,
    /// How the scene is read.
    pub scene: SceneSettings,
    /// From pictures to moving Gaussians.
    pub reconstruct: TrainSettings,
    /// From a scan's frame to the video's, for scenes with photographs of the object at rest.
    pub register: RegisterSettings,
    /// From Gaussians to matter.
    pub fill: gic_continuum::Settings,
    /// From matter to material.
    pub identify: gic_identify::Settings,
    /// The colours of the twin.
    pub appearance: AppearanceConfig,
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
        let settings = Table::try_from(settings).map_err(unwritable(Path::new(origin)))?;
        let table = Table::from_iter([("reconstruct".to_owned(), Value::Table(settings))]);
        Ok(Self { origin: origin.into(), table })
    }

    /// The settings of a TOML file; relative paths start at its folder.
    pub fn read(path: &Path) -> Result<Self> {
        let text = gic_files::input::read_to_string(path).map_err(FileError::read(path))?;
        let mut table = text.parse::<Table>().map_err(FileError::syntax(path, "TOML"))?;
        let folder = path.parent().unwrap_or(Path::new(""));
        change_paths(&mut table, |way| folder.join(way));
        Ok(Self { origin: path.to_owned(), table })
    }

    /// Settings from `KEY=VALUE` texts, KEY being a path such as `reconstruct.loss.scale` and VALUE TOML or a bare
    /// word.
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

/// Settings of `origin` that no file of settings can hold.
fn unwritable<E>(origin: &Path) -> impl Fn(E) -> FileError
where
    E: Into<Box<dyn std::error::Error + Send + Sync>>,
{
    FileError::syntax(origin, "a configuration")
}

impl Config {
    /// The defaults, changed by each layer in turn.
    ///
    /// # Errors
    /// An unknown key or a value of the wrong kind, with the layer's name.
    pub fn resolve(layers: Vec<Layer>) -> Result<Self> {
        let mut config = Self::default();
        for layer in layers {
            let mut table = Table::try_from(&config).map_err(unwritable(&layer.origin))?;
            merge(&mut table, layer.table);
            config =
                Value::Table(table).try_into().map_err(|source| Error::Settings { origin: layer.origin, source })?;
        }
        Ok(config)
    }

    /// Checks every setting before any work starts, for the scene of all the video's frames.
    ///
    /// # Errors
    /// [`Error::Setting`] for the first one that cannot be used; a file of obstacles that cannot be read.
    pub(crate) fn validate(&self, video: &Scene) -> Result<()> {
        // Photographs of the object at rest are what a scan is trained on.
        let filmed = video.rest.as_deref().unwrap_or(video);
        self.reconstruct.validate(filmed.cameras.len()).map_err(Error::setting("reconstruct"))?;
        self.register.validate().map_err(Error::setting("register"))?;
        self.fill.validate().map_err(Error::setting("fill"))?;
        self.identify.validate().map_err(Error::setting("identify"))?;
        self.appearance.train.validate().map_err(Error::setting("appearance.train"))?;
        let frames = video.times.len();
        if let Some(asked) = self.identify.frames.filter(|asked| *asked > frames) {
            let problem = format!("frames is {asked}, and the video has {frames}");
            return Err(Error::setting("identify")(problem));
        }
        if let Some(path) = &self.identify.colliders {
            Twin::read_obstacles(path)?;
        }
        Ok(())
    }

    /// Takes the file of obstacles into the run folder, which then can be moved without it.
    pub(crate) fn keep_colliders(&mut self, run: &Path) -> Result<()> {
        let Some(given) = &self.identify.colliders else { return Ok(()) };
        let kept = run.join("colliders").with_extension(given.extension().unwrap_or_default());
        if resolved(given) != resolved(&kept) {
            atomic::write(&kept, &gic_files::input::read(given).map_err(FileError::read(given))?)?;
        }
        self.identify.colliders = Some(kept);
        Ok(())
    }

    /// Writes all settings, defaults included, atomically. Paths inside the file's folder start there, others at the
    /// root, so that the folder can be moved.
    pub fn write(&self, path: &Path) -> Result<()> {
        gic_twin::json::require_finite(self).map_err(unwritable(path))?;
        let mut table = Table::try_from(self).map_err(unwritable(path))?;
        let folder = resolved(path.parent().unwrap_or(Path::new("")));
        change_paths(&mut table, |place| match resolved(place) {
            inside if inside.starts_with(&folder) => relative_path(&folder, &inside),
            outside => outside,
        });
        let text = toml::to_string(&table).map_err(unwritable(path))?;
        let head = "# Every setting of this run. Feed it back with --config, or change single ones with \
                    --set section.key=value.\n\n";
        Ok(atomic::write(path, (head.to_owned() + &text).as_bytes())?)
    }
}

/// Changes every setting that is a path.
fn change_paths(table: &mut Table, change: impl Fn(&Path) -> PathBuf) {
    for (stage, key) in [("scene", "path"), ("scene", "matting"), ("identify", "colliders")] {
        if let Some(Value::String(path)) = table.get_mut(stage).and_then(|stage| stage.get_mut(key)) {
            *path = change(Path::new(path)).to_string_lossy().into_owned();
        }
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
    use gic_continuum::Unseen;
    use gic_identify::MaterialChoice;
    use gic_mpm::MaterialKind;

    use super::*;

    fn set(assignments: &[&str]) -> Result<Config> {
        Config::resolve(vec![Layer::from_assignments(assignments.iter().copied())?])
    }

    #[test]
    fn settings_reach_every_depth() {
        let config =
            set(&["seed=7", "reconstruct.loss.scale=0.5", "identify.material=sand", "fill.unseen=fill"]).unwrap();
        assert_eq!((config.seed, config.reconstruct.loss.scale), (7, 0.5));
        assert_eq!(config.identify.material, Some(MaterialChoice::Law(MaterialKind::Sand)));
        assert_eq!(config.fill.unseen, Unseen::Fill);
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
