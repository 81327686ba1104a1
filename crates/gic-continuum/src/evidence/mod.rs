//! What the views' pixels say of a place: is it inside the mask, and is it in front of the rendered surface?

mod depth_map;
mod pyramid;
mod view;

pub use view::MaskedView;
pub(crate) use {
    pyramid::{BoxBounds, EvidencePyramid},
    view::{Evidence, pixel_index},
};
