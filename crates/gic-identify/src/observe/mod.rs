//! What the video shows: masks and extracted surfaces, prepared once.

pub(crate) mod extracted_surface;
pub(crate) mod mask_view;
#[cfg(test)]
pub(crate) mod test_camera;
pub(crate) mod video;
