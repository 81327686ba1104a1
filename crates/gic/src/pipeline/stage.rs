//! The stages of a run: their names, and the files that they leave.

use std::path::Path;

use gic_view::skinned_gaussians::FILES as APPEARANCE_FILES;

/// Folder of the body as refined, inside the run.
pub(crate) const REFINED: &str = "refined";
/// Name of the file, beside `twin.json`, of the twin's particles at time 0: the continuum as the fit moved and reshaped
/// it.
pub(crate) const TWIN_MATTER: &str = "twin.ply";

/// Endings of the files that a stage leaves in a folder of its own. Other files there are notes for going on, or what
/// somebody made of the results.
const RESULT_ENDINGS: [&str; 3] = ["ply", "safetensors", "json"];

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
    /// The body of the first frame by the pictures of all frames.
    Refine,
    /// Matter to material: the twin.
    Identify,
    /// The twin's motion, over the frames of the video.
    Predict,
    /// The twin's colours.
    Appearance,
}

impl Stage {
    pub(crate) const ALL: [Self; 8] = [
        Self::Reconstruct,
        Self::Register,
        Self::Fill,
        Self::Select,
        Self::Refine,
        Self::Identify,
        Self::Predict,
        Self::Appearance,
    ];

    /// Its name in events, messages and files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Reconstruct => "reconstruct",
            Self::Register => "register",
            Self::Fill => "fill",
            Self::Select => "select",
            Self::Refine => "refine",
            Self::Identify => "identify",
            Self::Predict => "predict",
            Self::Appearance => "appearance",
        }
    }

    /// Files that it leaves; a folder stands for the particles and tensors in it.
    pub(crate) fn outputs(self) -> &'static [&'static str] {
        match self {
            Self::Reconstruct => &["gaussians"],
            Self::Register => &["registration.json"],
            Self::Fill => &["continuum.ply", "fill.json", "surface", "filling"],
            Self::Select => &["selection.json"],
            Self::Refine => &[REFINED],
            Self::Identify => &["twin.json", TWIN_MATTER, "identify.json"],
            Self::Predict => &["prediction"],
            Self::Appearance => &APPEARANCE_FILES,
        }
    }
}

/// Whether a file in the folder of a stage is one of its results.
pub(crate) fn is_result_name(name: &Path) -> bool {
    name.extension().is_some_and(|ending| RESULT_ENDINGS.iter().any(|result| ending == *result))
}
