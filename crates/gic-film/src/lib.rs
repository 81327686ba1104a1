//! Films in: what cameras recorded becomes a scene folder.
//!
//! [`open_films`] finds the films, [`Film::frames`] decodes them. `background` makes the picture of the empty scene,
//! `align` finds a flash or clap, `import` writes the scene, `masks` its masks.

mod align;
mod background;
mod cameras;
mod cut;
mod error;
mod ffmpeg;
mod film;
mod frames;
mod import;
mod imported;
mod masks;
mod request;
mod scene_file;
mod sheet;
mod tuning;

pub use align::{Align, Alignment, align};
pub use background::EmptyScene;
pub use cameras::KnownCameras;
pub use error::{FilmError, Result};
pub use film::{Film, open_films};
pub use frames::{Frame, Frames, Selection};
pub use import::import;
pub use imported::{Imported, ImportedCamera};
pub use masks::{BoxError, Masks, MasksRequest, ObjectBox, ViewReport, make_masks};
pub use request::ImportRequest;
pub use sheet::thumbnails;
