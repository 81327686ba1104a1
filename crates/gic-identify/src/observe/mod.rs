//! What the video shows: masks and extracted surfaces, prepared once.

pub(crate) mod mask_view;
pub(crate) mod surface;
pub(crate) mod video;
