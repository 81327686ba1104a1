//! A run: a folder, its settings, and the stages from video to twin.
//!
//! Every stage writes its results into the folder, and a stamp of what they were made from. [`Run::bring_up_to_date`]
//! runs the stages whose results are missing or whose stamp no longer fits, and says why.

mod appearance;
mod export;
mod fill;
mod fill_input;
mod frame_filler;
mod identify;
mod log;
mod predict;
mod reconstruct;
mod register;
mod rigid_frames;
mod select;
mod stamp;

use std::path::{Path, PathBuf};

use gic_identify::MaterialChoice;
use gic_motion::TrainSettings;
use gic_scene::Scene;
use gic_twin::Interrupt;
use gic_twin::ResourceMeter;
use gic_twin::atomic;
use gic_twin::events::{Event, Events};
use gic_view::skinned_gaussians::FILES as APPEARANCE_FILES;
use sha2::{Digest, Sha256};

use crate::config::{Config, Layer};
use crate::error::{Error, Result};
pub use export::Export;
pub(crate) use fill::filling_file;
#[cfg(feature = "rerun")]
pub(crate) use fill::surface_file;
pub use fill::{Continuum, FillSummary, FrameFilling, Surface};
pub(crate) use identify::TWIN_MATTER;
pub use identify::{EstimateRecord, IdentifyRecord, StepRecord};
pub(crate) use predict::{prediction_file, simulated_frame};
pub use register::{PlacementRecord, RegistrationRecord};
pub use select::{LawRecord, Selection};
use stamp::Stamp;

/// The stages, in the order of the data.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stage {
    /// Pictures to moving Gaussians.
    Reconstruct,
    /// Where the scan lies in the video; only for scenes with photographs of the object at rest.
    Register,
    /// Gaussians to matter.
    Fill,
    /// Which law the matter follows; only where the material is `auto`.
    Select,
    /// Matter to material: the twin.
    Identify,
    /// The twin's motion, over the frames of the video.
    Predict,
    /// The twin's colours.
    Appearance,
}

impl Stage {
    pub(crate) const ALL: [Self; 7] =
        [Self::Reconstruct, Self::Register, Self::Fill, Self::Select, Self::Identify, Self::Predict, Self::Appearance];

    /// Its name in events, messages and files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Reconstruct => "reconstruct",
            Self::Register => "register",
            Self::Fill => "fill",
            Self::Select => "select",
            Self::Identify => "identify",
            Self::Predict => "predict",
            Self::Appearance => "appearance",
        }
    }

    /// Files and folders that it leaves.
    fn outputs(self) -> &'static [&'static str] {
        match self {
            Self::Reconstruct => &["gaussians/canonical.ply"],
            Self::Register => &["registration.json"],
            Self::Fill => &["continuum.ply", "fill.json", "surface", "filling"],
            Self::Select => &["selection.json"],
            Self::Identify => &["twin.json", TWIN_MATTER, "identify.json"],
            Self::Predict => &["prediction/trajectory.json"],
            Self::Appearance => &APPEARANCE_FILES,
        }
    }
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
}

impl<'a> Run<'a> {
    /// Opens or makes a run folder: settings are what the folder holds, or else the defaults for the scene, changed by
    /// `layers`.
    ///
    /// # Errors
    /// Unusable settings, an unreadable scene, an unwritable folder.
    pub fn open(folder: &Path, layers: Vec<Layer>, events: &'a Events, interrupt: &'a Interrupt) -> Result<Self> {
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
        let scene = fitted_part(&video, &config)?;
        atomic::create_folder(&folder.join("stamps"))?;
        config.write(&file)?;
        events.add(log::Log::open(&folder.join("log.jsonl"))?);
        let command = std::env::args().collect::<Vec<_>>().join(" ");
        events.send(&Event::Started { command, gic_version: gic_twin::VERSION.into() });
        for problem in &video.warnings {
            events.warn("scene", problem.to_string());
        }
        let scene_hash = hash_scene(&scene)?;
        Ok(Self { folder: folder.to_owned(), config, video, scene, scene_hash, events, interrupt })
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
        if last >= Stage::Identify {
            // An unknown material is an error before the first stage starts.
            self.material()?;
        }
        if last == Stage::Register {
            self.require_scan()?;
        }
        if last >= Stage::Register && self.scan().is_some() {
            self.check_scan()?;
        }
        let mut before = None;
        for stage in Stage::ALL.into_iter().filter(|stage| *stage <= last) {
            let wanted = match stage {
                Stage::Register => self.scan().is_some(),
                Stage::Select => self.selects(),
                _ => true,
            };
            if wanted && self.bring(stage, before)? {
                before = Some(stage);
            }
        }
        Ok(())
    }

    /// Runs a stage if its result is missing or outdated; returns whether it ran. `before` is the last stage before it
    /// that ran anew: what it left may differ.
    fn bring(&self, stage: Stage, before: Option<Stage>) -> Result<bool> {
        let stamp = self.stamp(stage)?;
        let file = self.path(format!("stamps/{}.json", stage.name()));
        let complete = stage.outputs().iter().all(|output| self.path(output).exists());
        let outdated = Stamp::read(&file).map(|found| found.outdated_for(&stamp));
        let reason = match (outdated, before) {
            (Some(None), None) if complete => {
                let reason = "up to date".into();
                self.events.send(&Event::StageSkipped { stage: stage.name().into(), reason });
                return Ok(false);
            }
            (Some(Some(difference)), _) => format!("runs again: {difference}"),
            (Some(None), Some(before)) => format!("runs again: {} ran anew", before.name()),
            (Some(None), None) => "runs again: files are missing".into(),
            (None, _) => "starts".into(),
        };
        self.check_interrupt(stage)?;
        self.events.send(&Event::StageStarted { stage: stage.name().into(), reason });
        // From here on the old result is no longer whole.
        if file.exists() {
            std::fs::remove_file(&file).map_err(Error::write(&file))?;
        }
        let meter = ResourceMeter::start();
        match stage {
            Stage::Reconstruct => self.reconstruct(&stamp)?,
            Stage::Register => self.register()?,
            Stage::Fill => self.fill()?,
            Stage::Select => self.select(&stamp)?,
            Stage::Identify => self.identify(&stamp)?,
            Stage::Predict => self.predict()?,
            Stage::Appearance => self.appearance()?,
        }
        stamp.after(meter.seconds()).write(&file)?;
        self.events.send(&meter.done(stage.name()));
        Ok(true)
    }

    /// Whether the law is to be found.
    fn selects(&self) -> bool {
        self.config.identify.material == Some(MaterialChoice::Auto)
    }

    fn stamp(&self, stage: Stage) -> Result<Stamp> {
        let before = |stage: Stage| Ok::<_, Error>((stage.name(), self.stamp(stage)?.hash()));
        match stage {
            Stage::Reconstruct => {
                let settings = serde_json::json!({ "seed": self.config.seed, "reconstruct": self.config.reconstruct });
                Stamp::new(("scene", self.scene_hash.clone()), &settings)
            }
            Stage::Register => {
                let settings = serde_json::json!({ "register": self.config.register });
                Stamp::new(before(Stage::Reconstruct)?, &settings)
            }
            Stage::Fill => {
                let input = if self.scan().is_some() { Stage::Register } else { Stage::Reconstruct };
                Stamp::new(before(input)?, &serde_json::json!({ "seed": self.config.seed, "fill": self.config.fill }))
            }
            Stage::Select | Stage::Identify => {
                let colliders = match &self.config.identify.colliders {
                    Some(path) => hash(std::fs::read(path).map_err(Error::read(path))?),
                    None => String::new(),
                };
                let settings = serde_json::json!({ "identify": self.config.identify, "colliders": colliders });
                let input = if stage == Stage::Identify && self.selects() { Stage::Select } else { Stage::Fill };
                Stamp::new(before(input)?, &settings)
            }
            Stage::Predict => {
                Stamp::new(before(Stage::Identify)?, &serde_json::json!({ "frames": self.frames_to_simulate() }))
            }
            Stage::Appearance => {
                let settings =
                    serde_json::json!({ "seed": self.config.seed, "appearance": self.config.appearance.train });
                Stamp::new(before(Stage::Predict)?, &settings)
            }
        }
    }

    /// Seconds that each finished stage took.
    fn stage_seconds(&self) -> Vec<(Stage, f64)> {
        let stamp = |stage: &Stage| Stamp::read(&self.path(format!("stamps/{}.json", stage.name())));
        Stage::ALL.into_iter().filter_map(|stage| Some((stage, stamp(&stage)?.seconds))).collect()
    }

    fn check_interrupt(&self, stage: Stage) -> Result<()> {
        if self.interrupt.requested() { Err(self.interrupted(&format!("before {}", stage.name()))) } else { Ok(()) }
    }

    fn interrupted(&self, after: &str) -> Error {
        Error::Interrupted { after: after.into(), resume: "run the same command again to go on from there".into() }
    }
}

/// Opens the scene of a run folder, with all frames of the video.
///
/// # Errors
/// Those of [`open_scene`], unusable settings.
pub fn scene_of_run(run: &Path) -> Result<Scene> {
    open_scene(&Config::resolve(vec![Layer::read(&run.join("config.toml"))?])?)
}

/// Opens the scene that a configuration names.
///
/// # Errors
/// No scene named, or everything that is wrong with it.
pub fn open_scene(config: &Config) -> Result<Scene> {
    let Some(path) = &config.scene.path else {
        return Err(Error::Usage {
            problem: "the run does not know its scene".into(),
            hint: Some("start it with `gic run SCENE -o RUN` or `gic reconstruct SCENE -o RUN`".into()),
        });
    };
    Scene::open_with(path, &config.scene).map_err(Error::stage("reading the scene"))
}

/// The frames that everything is fitted to.
fn fitted_part(video: &Scene, config: &Config) -> Result<Scene> {
    const MIN_FITTED_FRAMES: usize = 2;
    let all = video.times.len();
    match config.scene.fit_frames {
        None => Ok(video.clone()),
        Some(count) if (MIN_FITTED_FRAMES..=all).contains(&count) => Ok(video.first_frames(count)),
        Some(count) => Err(Error::Usage {
            problem: format!("scene.fit_frames is {count}, and the video has {all} frames"),
            hint: Some(format!("give --fit-frames a number from {MIN_FITTED_FRAMES} to {all}, or leave it out")),
        }),
    }
}

/// Hash of everything that the stages read of a scene: pictures, masks, cameras, times.
fn hash_scene(scene: &Scene) -> Result<String> {
    let mut all = Sha256::new();
    all.update(format!("{:?} {:?} {:?} {:?}", scene.format, scene.cameras, scene.times, scene.world));
    let mut files: Vec<&Path> = Vec::new();
    for view in &scene.views {
        files.extend([view.picture.as_path(), view.mask_path()]);
    }
    files.extend(scene.backgrounds.iter().flatten().map(PathBuf::as_path));
    files.dedup();
    for file in files {
        all.update(std::fs::read(file).map_err(Error::read(file))?);
    }
    if let Some(rest) = &scene.rest {
        all.update(hash_scene(rest)?);
    }
    Ok(format!("{:x}", all.finalize()))
}

fn hash(bytes: Vec<u8>) -> String {
    format!("{:x}", Sha256::digest(bytes))
}
