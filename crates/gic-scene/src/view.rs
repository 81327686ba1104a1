//! One picture of a scene: who took it, when, what it is for, and where its mask comes from.

use std::path::{Path, PathBuf};

/// What a view is meant for, where the format says so; everything is [`Split::Train`] otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Split {
    /// To reconstruct from.
    Train,
    /// To tune with.
    Validation,
    /// To measure on.
    Test,
}

/// Where the mask of a view comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MaskSource {
    /// The alpha channel of the picture.
    Alpha,
    /// A mask file: 8 or 16-bit grey coverage, or the alpha channel of an RGBA file.
    File(PathBuf),
    /// A copy of the picture composited over white; the coverage follows from comparing both.
    OverWhite(PathBuf),
    /// Made by comparing the picture with the empty background picture of its camera ([`crate::difference_matte`]).
    Difference,
    /// Made by the matting network given in [`crate::SceneSettings::matting`].
    Network,
}

/// One picture: which camera took it, and when.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Index into [`crate::Scene::cameras`].
    pub camera: usize,
    /// Index into [`crate::Scene::times`].
    pub frame: usize,
    /// When it was taken, on the clock of these times; no earlier than its frame [s].
    pub time_s: f64,
    /// What the view is meant for.
    pub split: Split,
    /// The picture's file.
    pub picture: PathBuf,
    /// Where its mask comes from.
    pub mask: MaskSource,
}

impl View {
    /// The file that the mask is in or made from.
    pub fn mask_path(&self) -> &Path {
        match &self.mask {
            MaskSource::File(path) | MaskSource::OverWhite(path) => path,
            MaskSource::Alpha | MaskSource::Difference | MaskSource::Network => &self.picture,
        }
    }
}
