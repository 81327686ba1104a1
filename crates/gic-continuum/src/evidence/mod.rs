//! What the views' pixels say of a place.

mod overview;
mod view;

pub use view::MaskedView;
pub(crate) use {
    overview::{Overview, Survey},
    view::Evidence,
};
