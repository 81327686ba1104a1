//! A run: a folder, its settings, and the stages from video to twin.
//!
//! Every stage writes its results into the folder, and a stamp of what they were made from and what they are.
//! [`Run::bring_up_to_date`] runs the stages whose results are missing or whose stamp no longer fits, and says why. A
//! result that is not what its stage wrote is refused: it is damage, or somebody's work.
//!
//! One process at a time writes into a folder, see [`gic_files::FolderLock`]; those that read never wait.

mod appearance;
mod clock;
mod continuum;
mod field;
mod fill;
mod fill_input;
mod fill_summary;
mod frame_filler;
mod identify;
mod identify_input;
mod identify_record;
mod log;
mod moments;
mod predict;
mod reconstruct;
mod refine;
mod register;
mod results;
mod scene;
mod select;
pub(crate) mod stage;
mod stamp;
mod surroundings;

use std::path::{Path, PathBuf};

use gic_files::{FileError, FolderLock};
use gic_identify::MaterialChoice;
use gic_motion::TrainSettings;
use gic_scene::Scene;
use gic_twin::Interrupt;
use gic_twin::ResourceMeter;
use gic_twin::atomic;
use gic_twin::events::{Event, Events};

use crate::config::{Config, Layer};
use crate::error::{Error, Result};
use crate::outputs;
pub(crate) use continuum::filling_file;
#[cfg(feature = "rerun")]
pub(crate) use continuum::surface_file;
pub use continuum::{Continuum, Surface};
pub use field::FieldGrid;
pub use fill_summary::{FillSummary, FrameFilling};
pub use identify_record::{CameraRecord, EstimateRecord, GroundRecord, IdentifyRecord, StepRecord};
pub(crate) use predict::{moment_file, prediction_file};
pub(crate) use refine::summary_of_body;
pub use register::{PlacementRecord, RegistrationRecord};
pub use results::{check_results, twin_file};
pub(crate) use scene::config_of_run;
pub use scene::{open_scene, scene_of_run};
pub use select::{LawRecord, Selection};
pub use stage::Stage;
pub(crate) use stage::TWIN_MATTER;
use stamp::{Hashes, Recipe, Stamp};

/// What a command does with a run folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Makes it, or makes it anew from another scene.
    Make,
    /// Goes on with it: its scene must be the one that it was made from.
    GoOn,
    /// Reads its results, which must be those that its stages wrote.
    Read,
}

/// A run folder, open.
pub struct Run<'a> {
    folder: PathBuf,
    /// The settings.
    pub config: Config,
    /// All of the video.
    video: Scene,
    /// The part of it that everything is fitted to.
    scene: Scene,
    scene_hash: String,
    events: &'a Events,
    interrupt: &'a Interrupt,
    /// Keeps other writers out; readers have none.
    _lock: Option<FolderLock>,
}

impl<'a> Run<'a> {
    /// Opens or makes a run folder: settings are what the folder holds, or else the defaults for the scene, changed by
    /// `layers`.
    ///
    /// # Errors
    /// Unusable settings, an unreadable scene or another than the run's, an unwritable folder, one that another process
    /// writes into, results that no stage wrote.
    pub fn open(
        folder: &Path,
        access: Access,
        layers: Vec<Layer>,
        events: &'a Events,
        interrupt: &'a Interrupt,
    ) -> Result<Self> {
        let writes = access != Access::Read;
        let mut lock = (writes && folder.is_dir()).then(|| FolderLock::take(folder)).transpose()?;
        let file = folder.join("config.toml");
        let begun = file.exists();
        let mut all = Vec::new();
        if begun {
            all.push(Layer::read(&file)?);
        }
        all.extend(layers);
        let mut config = Config::resolve(all.clone())?;
        let video = open_scene(&config)?;
        if !begun {
            // How to train depends on how the scene was filmed, which is only known now.
            let settings = match video.rest {
                Some(_) => TrainSettings::scan(),
                None => TrainSettings::for_scene(&video),
            };
            all.insert(0, Layer::reconstruct("the scene's defaults", &settings)?);
            config = Config::resolve(all)?;
        }
        config.validate(&video)?;
        outputs::allow_run(folder, &video.root)?;
        let scene = scene::fitted_part(&video, &config)?;
        let scene_hash = scene::hash_scene(&scene, &config)?;
        if access != Access::Make {
            scene::check_origin(folder, &video.root, &scene_hash)?;
        }
        if writes {
            atomic::create_folder(&folder.join("stamps"))?;
            if lock.is_none() {
                lock = Some(FolderLock::take(folder)?);
            }
            config.keep_colliders(folder)?;
            config.write(&file)?;
            events.add(log::Log::open(&folder.join("log.jsonl"))?);
        } else {
            results::check_results(folder, &Stage::ALL)?;
        }
        let command = std::env::args().collect::<Vec<_>>().join(" ");
        events.send(&Event::Started { command, gic_version: gic_twin::VERSION.into() });
        for problem in &video.warnings {
            events.warn("scene", problem.to_string());
        }
        Ok(Self { folder: folder.to_owned(), config, video, scene, scene_hash, events, interrupt, _lock: lock })
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The scene, with all frames of the video.
    pub fn video(&self) -> &Scene {
        &self.video
    }

    /// How many of the video's frames everything is fitted to: the first ones.
    pub fn fitted_frames(&self) -> usize {
        self.scene.times.len()
    }

    /// Where the events go.
    pub fn events(&self) -> &Events {
        self.events
    }

    fn path(&self, name: impl AsRef<Path>) -> PathBuf {
        self.folder.join(name)
    }

    /// Runs every stage up to `last` whose result is missing or outdated.
    ///
    /// # Errors
    /// Those of the stages; what was finished before is kept.
    pub fn bring_up_to_date(&self, last: Stage) -> Result<()> {
        if last >= Stage::Select {
            // An unknown material is an error before the first stage starts.
            self.material()?;
        }
        if last == Stage::Register {
            self.require_scan()?;
        }
        if last >= Stage::Register && self.scan().is_some() {
            self.check_scan()?;
        }
        let mut made = Hashes::new();
        for stage in Stage::ALL.into_iter().filter(|stage| *stage <= last) {
            let wanted = match stage {
                Stage::Register => self.scan().is_some(),
                Stage::Select => self.selects(),
                Stage::Refine => self.refines(),
                _ => true,
            };
            if wanted {
                made.extend(self.bring(stage, made.clone())?);
            }
        }
        Ok(())
    }

    /// Runs a stage if its result is missing or outdated; returns the files of its result. `made` are those of the
    /// stages before it.
    fn bring(&self, stage: Stage, made: Hashes) -> Result<Hashes> {
        let recipe = self.recipe(stage)?.reading(made);
        let file = results::stamp_file(&self.folder, stage);
        let reason = match Stamp::read(&file)? {
            None => "starts".into(),
            Some(found) => match found.recipe.outdated_for(&recipe) {
                Some(difference) => format!("runs again: {difference}"),
                None => match results::missing_result(&self.folder, stage, &found)? {
                    Some(missing) => format!("runs again: {missing} is missing"),
                    None => {
                        let reason = "up to date".into();
                        self.events.send(&Event::StageSkipped { stage: stage.name().into(), reason });
                        return Ok(found.written);
                    }
                },
            },
        };
        self.check_interrupt(stage)?;
        self.events.send(&Event::StageStarted { stage: stage.name().into(), reason });
        // From here on the old result is no longer whole.
        if file.exists() {
            std::fs::remove_file(&file).map_err(FileError::write(&file))?;
        }
        let meter = ResourceMeter::start();
        match stage {
            Stage::Reconstruct => self.reconstruct(&recipe)?,
            Stage::Register => self.register()?,
            Stage::Fill => self.fill()?,
            Stage::Select => self.select(&recipe)?,
            Stage::Refine => self.refine(&recipe)?,
            Stage::Identify => self.identify(&recipe)?,
            Stage::Predict => self.predict()?,
            Stage::Appearance => self.appearance()?,
        }
        let written = results::hash_results(&self.folder, stage)?;
        Stamp { recipe, written: written.clone(), seconds: meter.seconds() }.write(&file)?;
        self.events.send(&meter.done(stage.name()));
        Ok(written)
    }

    /// Whether the law is to be found.
    fn selects(&self) -> bool {
        self.config.identify.material == Some(MaterialChoice::Auto)
    }

    fn recipe(&self, stage: Stage) -> Result<Recipe> {
        let before = |stage: Stage| Ok::<_, Error>((stage.name(), self.recipe(stage)?.hash()));
        match stage {
            Stage::Reconstruct => {
                let settings = serde_json::json!({ "seed": self.config.seed, "reconstruct": self.config.reconstruct });
                Recipe::new(("scene", self.scene_hash.clone()), &settings)
            }
            Stage::Register => {
                let settings = serde_json::json!({ "register": self.config.register });
                Recipe::new(before(Stage::Reconstruct)?, &settings)
            }
            Stage::Fill => {
                let input = if self.scan().is_some() { Stage::Register } else { Stage::Reconstruct };
                Recipe::new(before(input)?, &serde_json::json!({ "seed": self.config.seed, "fill": self.config.fill }))
            }
            Stage::Select | Stage::Refine | Stage::Identify => {
                let colliders = match &self.config.identify.colliders {
                    Some(path) => results::hash_file(path)?,
                    None => String::new(),
                };
                // What the file holds decides, not where it lies.
                let identify = gic_identify::Settings { colliders: None, ..self.config.identify.clone() };
                let settings = serde_json::json!({ "identify": identify, "colliders": colliders });
                let input = match stage {
                    Stage::Identify if self.refines() => Stage::Refine,
                    Stage::Refine | Stage::Identify if self.selects() => Stage::Select,
                    _ => Stage::Fill,
                };
                Recipe::new(before(input)?, &settings)
            }
            Stage::Predict => {
                Recipe::new(before(Stage::Identify)?, &serde_json::json!({ "frames": self.frames_to_simulate() }))
            }
            Stage::Appearance => {
                let settings =
                    serde_json::json!({ "seed": self.config.seed, "appearance": self.config.appearance.train });
                Recipe::new(before(Stage::Predict)?, &settings)
            }
        }
    }

    /// Seconds that each finished stage took.
    fn stage_seconds(&self) -> Result<Vec<(Stage, f64)>> {
        let mut seconds = Vec::new();
        for stage in Stage::ALL {
            seconds.extend(Stamp::read(&results::stamp_file(&self.folder, stage))?.map(|stamp| (stage, stamp.seconds)));
        }
        Ok(seconds)
    }

    /// Whether to stop.
    pub(crate) fn interrupt(&self) -> &Interrupt {
        self.interrupt
    }

    /// Fails where the user asked to stop; `after` is what is done.
    pub(crate) fn stop_if_asked(&self, after: &str) -> Result<()> {
        if self.interrupt.requested() { Err(self.interrupted(&format!("after {after}"))) } else { Ok(()) }
    }

    fn check_interrupt(&self, stage: Stage) -> Result<()> {
        if !self.interrupt.requested() {
            return Ok(());
        }
        let before = (stage != Stage::Reconstruct).then(|| format!("the stages before {}", stage.name()));
        Err(self.interrupted(&before.unwrap_or_default()))
    }

    fn interrupted(&self, after: &str) -> Error {
        Error::Interrupted { after: after.into(), resume: "run the same command again to go on from there".into() }
    }
}
