//! What can be wrong when matter is made from Gaussians.

/// Why no continuum could be made, or why it is not usable for what was asked.
#[derive(Debug, thiserror::Error)]
pub enum ContinuumError {
    /// Fewer usable Gaussians than a body needs.
    #[error(
        "of {total} Gaussians {kept} are opaque enough and inside the masks; a body needs at least {needed}. \
         Check that masks and cameras belong together (`gic inspect`), and that the reconstruction has converged"
    )]
    TooFewGaussians {
        /// Gaussians given.
        total: usize,
        /// Gaussians that count.
        kept: usize,
        /// How many are needed.
        needed: usize,
    },
    /// No view has a mask.
    #[error("none of the {views} views of this frame has a mask; filling needs at least one")]
    NoMasks {
        /// Views given.
        views: usize,
    },
    /// A mask has not the size of its camera's image.
    #[error(
        "the mask of view {view} has {found} pixels, its camera {width}x{height}; give the mask at the camera's size"
    )]
    MaskSize {
        /// Index of the view.
        view: usize,
        /// Pixels of the mask.
        found: usize,
        /// Image width [pixels].
        width: usize,
        /// Image height [pixels].
        height: usize,
    },
    /// A setting is out of its range.
    #[error("{setting} is {value}, but must be {must}")]
    Setting {
        /// Name of the setting.
        setting: &'static str,
        /// The value given.
        value: f64,
        /// What it must be.
        must: &'static str,
    },
    /// The field has no inside.
    #[error(
        "nothing is left of the body after filling: no voxel is inside every mask and behind every depth \
         map; check the cameras and masks"
    )]
    Empty,
    /// A grid or a mesh cannot be made.
    #[error(transparent)]
    Geometry(#[from] gic_geometry::GeometryError),
}
