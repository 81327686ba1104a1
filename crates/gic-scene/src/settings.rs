//! How a scene is read.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::flight::Seek;

/// Settings of reading a scene; [`Default`] is right for every scene whose folder says all that is needed.
///
/// [`crate::Scene::open_with`] takes all but `path`, `clocks`, `calibration` and `fit_frames`, which are the caller's.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::Args), group(skip), command(next_help_heading = "Scene"))]
#[serde(default, deny_unknown_fields)]
pub struct SceneSettings {
    /// The scene's folder.
    #[cfg_attr(feature = "cli", arg(skip))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub path: Option<PathBuf>,
    /// Which masks to use.
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t))]
    pub masks: MaskChoice,
    /// Make the masks with this matting network (needs the cargo feature `onnx`).
    #[cfg_attr(feature = "cli", arg(long, value_name = "MODEL.onnx"))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub matting: Option<PathBuf>,
    /// Frames per second, in place of what the scene says: the times of the frames become frame / rate.
    #[cfg_attr(feature = "cli", arg(long, value_name = "HZ"))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame_rate_hz: Option<f64>,
    /// Whether to believe the stated times of pictures.
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t))]
    pub clocks: Trust,
    /// Whether to believe the stated places, focal lengths and distortion of cameras.
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t))]
    pub calibration: Trust,
    /// Which of several sets in the folder, such as an object of a real capture; by default the first by name.
    #[cfg_attr(feature = "cli", arg(long = "scene-set", value_name = "NAME"))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub set: Option<String>,
    /// Look at these cameras only, by number from 0; they become cameras 0, 1, ... in this order. By default at all.
    #[cfg_attr(feature = "cli", arg(long, value_name = "CAMERA", value_delimiter = ','))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cameras: Option<Vec<usize>>,
    /// Fit everything to the first N frames only, and predict the others. By default fit to all.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N"))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fit_frames: Option<usize>,
}

/// How much to believe what the scene states.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Trust {
    /// As long as the free flight does not show otherwise; then what it shows.
    #[default]
    Auto,
    /// Whatever the pictures show.
    Stated,
}

impl SceneSettings {
    /// What the free flight is asked about the cameras.
    pub fn seek(&self) -> Seek {
        Seek { delays: self.clocks == Trust::Auto, errors: self.calibration == Trust::Auto }
    }
}

/// Where masks come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum MaskChoice {
    /// Alpha channels or mask files where the scene has them, else matting against the empty background.
    #[default]
    Auto,
    /// Matting against the empty background, even where the scene has masks.
    Difference,
}
