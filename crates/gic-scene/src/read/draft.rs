//! What a reader hands over.

use std::path::PathBuf;

use glam::{DMat3, DVec2, DVec3};

use crate::error::Problem;
use crate::format::Format;
use crate::lens::Lens;
use crate::scene::Scene;
use crate::view::{MaskSource, Split};
use crate::world::{ColouredPoint, World};

/// Intrinsics of a camera whose picture size may not be known yet.
pub(crate) enum Intrinsics {
    /// In pixels of a picture of `size` (that of the files, if `None`).
    Pixels { focal: DVec2, principal: DVec2, size: Option<(usize, usize)> },
    /// Horizontal field of view [rad]; square pixels, principal point in the centre.
    HorizontalAngle(f64),
}

pub(crate) struct DraftCamera {
    pub(crate) name: String,
    pub(crate) intrinsics: Intrinsics,
    /// Columns: right, down, forward in the world.
    pub(crate) world_from_camera: DMat3,
    pub(crate) centre: DVec3,
    pub(crate) lens: Option<Lens>,
    pub(crate) background: Option<PathBuf>,
}

pub(crate) struct DraftView {
    pub(crate) camera: usize,
    /// [s]
    pub(crate) time: f64,
    pub(crate) split: Split,
    pub(crate) picture: PathBuf,
    /// `None` when the reader found no mask file: the alpha channel or the background decide.
    pub(crate) mask: Option<MaskSource>,
}

/// What a reader found, before the checks that all formats share.
pub(crate) struct Draft {
    pub(crate) format: Format,
    /// The file that lists the pictures.
    pub(crate) list: PathBuf,
    pub(crate) cameras: Vec<DraftCamera>,
    pub(crate) views: Vec<DraftView>,
    pub(crate) world: World,
    /// Where the format states it.
    pub(crate) frame_rate: Option<f64>,
    pub(crate) points: Vec<ColouredPoint>,
    pub(crate) rest: Option<Box<Scene>>,
    pub(crate) problems: Vec<Problem>,
}

impl Draft {
    pub(crate) fn new(format: Format, list: PathBuf, world: World) -> Draft {
        Draft {
            format,
            list,
            cameras: Vec::new(),
            views: Vec::new(),
            world,
            frame_rate: None,
            points: Vec::new(),
            rest: None,
            problems: Vec::new(),
        }
    }
}
