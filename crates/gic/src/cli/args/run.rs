//! From a scene to its twin.

use std::path::PathBuf;

use clap::Args;
use gic_scene::SceneSettings;

use crate::cli::flags::{AppearanceFlags, Flags, ReconstructFlags, SettingsFlags};

/// See gic work: the scene that comes with it, from video to twin, against the truth (a few minutes)
#[derive(Debug, Args)]
pub(crate) struct DemoArgs {
    /// Folder for the scene and the run
    #[arg(short, long, value_name = "DIR", default_value = "gic-demo")]
    pub(crate) out: PathBuf,
}

/// Show what gic reads of a scene: cameras, frames, masks, size, ground, and what looks wrong
///
/// Knows PAC-NeRF, Spring-Gaus (synthetic and real), Blender / D-NeRF, nerfstudio and COLMAP folders by their files.
#[derive(Debug, Args)]
pub(crate) struct InspectArgs {
    /// The scene's folder
    #[arg(value_name = "SCENE")]
    pub(crate) scene_path: PathBuf,
    /// Write a contact sheet: small pictures with the masks' outlines
    #[arg(long, value_name = "FILE.png")]
    pub(crate) sheet: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    pub(crate) json: bool,
    #[command(flatten)]
    pub(crate) scene: SceneSettings,
}

/// Make a twin from videos: reconstruct, fill, identify, predict, dress, report
///
/// Runs what is missing in the run folder, so a run that was stopped goes on with the same command, and a changed
/// setting reruns only what depends on it. Results: twin.json (the twin), report.html (open it in a browser),
/// prediction/ (the twin's motion), appearance/ (its colours).
#[derive(Debug, Args)]
#[command(after_help = "Example: gic run SCENE --material elastic -o RUN")]
pub(crate) struct RunArgs {
    #[command(flatten)]
    pub(crate) place: SceneAndRun,
    #[command(flatten)]
    pub(crate) scene: SceneSettings,
    #[command(flatten)]
    pub(crate) reconstruct: ReconstructFlags,
    #[command(flatten)]
    pub(crate) fill: gic_continuum::Settings,
    #[command(flatten)]
    pub(crate) identify: gic_identify::Settings,
    #[command(flatten)]
    pub(crate) appearance: AppearanceFlags,
    #[command(flatten)]
    pub(crate) settings: SettingsFlags,
}

/// Only the first stage of `run`: from pictures to moving Gaussians
#[derive(Debug, Args)]
pub(crate) struct ReconstructArgs {
    #[command(flatten)]
    pub(crate) place: SceneAndRun,
    #[command(flatten)]
    pub(crate) scene: SceneSettings,
    #[command(flatten)]
    pub(crate) reconstruct: ReconstructFlags,
    #[command(flatten)]
    pub(crate) settings: SettingsFlags,
}

/// The stages of `run` up to registration: where photographs of the object at rest lie in the video's first frame
///
/// For real captures, which have `static` beside `dynamic`. Nobody gives a pose: all rotations are tried. Writes
/// registration.json.
#[derive(Debug, Args)]
pub(crate) struct RegisterArgs {
    /// The run folder
    pub(crate) run: PathBuf,
    #[command(flatten)]
    pub(crate) elsewhere: SceneElsewhere,
    #[command(flatten)]
    pub(crate) settings: SettingsFlags,
}

/// The stages of `run` up to filling: from Gaussians to matter
#[derive(Debug, Args)]
pub(crate) struct FillArgs {
    /// The run folder
    pub(crate) run: PathBuf,
    #[command(flatten)]
    pub(crate) elsewhere: SceneElsewhere,
    #[command(flatten)]
    pub(crate) fill: gic_continuum::Settings,
    #[command(flatten)]
    pub(crate) settings: SettingsFlags,
}

/// The stages of `run` up to the twin: from matter to material
#[derive(Debug, Args)]
pub(crate) struct IdentifyArgs {
    /// The run folder
    pub(crate) run: PathBuf,
    #[command(flatten)]
    pub(crate) elsewhere: SceneElsewhere,
    #[command(flatten)]
    pub(crate) identify: gic_identify::Settings,
    #[command(flatten)]
    pub(crate) settings: SettingsFlags,
}

/// Where a run's scene is.
#[derive(Debug, Args)]
pub(crate) struct SceneElsewhere {
    /// The scene that the run was made from, where it has moved
    #[arg(long, value_name = "SCENE")]
    pub(crate) scene: Option<PathBuf>,
}

/// Where a run reads and writes.
#[derive(Debug, Args)]
pub(crate) struct SceneAndRun {
    /// The scene's folder, in any known format (see `gic inspect`)
    #[arg(value_name = "SCENE")]
    pub(crate) scene_path: PathBuf,
    /// The run folder; made if it does not exist
    #[arg(short, long, value_name = "RUN")]
    pub(crate) out: PathBuf,
}

impl InspectArgs {
    /// The settings among the flags.
    pub(crate) fn flags(&self) -> Flags<'_> {
        Flags { scene_path: Some(&self.scene_path), scene: Some(&self.scene), ..Flags::default() }
    }
}

impl RunArgs {
    /// The settings among the flags.
    pub(crate) fn flags(&self) -> Flags<'_> {
        Flags {
            scene_path: Some(&self.place.scene_path),
            scene: Some(&self.scene),
            reconstruct: Some(&self.reconstruct),
            fill: Some(&self.fill),
            identify: Some(&self.identify),
            appearance: Some(&self.appearance),
            any: Some(&self.settings),
        }
    }
}

impl ReconstructArgs {
    /// The settings among the flags.
    pub(crate) fn flags(&self) -> Flags<'_> {
        Flags {
            scene_path: Some(&self.place.scene_path),
            scene: Some(&self.scene),
            reconstruct: Some(&self.reconstruct),
            any: Some(&self.settings),
            ..Flags::default()
        }
    }
}

impl RegisterArgs {
    /// The settings among the flags.
    pub(crate) fn flags(&self) -> Flags<'_> {
        Flags { any: Some(&self.settings), ..self.elsewhere.flags() }
    }
}

impl FillArgs {
    /// The settings among the flags.
    pub(crate) fn flags(&self) -> Flags<'_> {
        Flags { fill: Some(&self.fill), any: Some(&self.settings), ..self.elsewhere.flags() }
    }
}

impl IdentifyArgs {
    /// The settings among the flags.
    pub(crate) fn flags(&self) -> Flags<'_> {
        Flags { identify: Some(&self.identify), any: Some(&self.settings), ..self.elsewhere.flags() }
    }
}

impl SceneElsewhere {
    /// The settings among the flags.
    pub(crate) fn flags(&self) -> Flags<'_> {
        Flags { scene_path: self.scene.as_deref(), ..Flags::default() }
    }
}
