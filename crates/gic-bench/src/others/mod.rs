//! Other methods on the same scenes: a suite in the layout that their released code reads, and what they found.
//!
//! GIC (github.com/Jukgei/gic) and ProJo4D (github.com/daniel03c1/ProJo4D, which is built on it) read PAC-NeRF's
//! layout: `all_data.json` and, for each picture `data/r_CAMERA_FRAME.png` that it names, `data/m_CAMERA_FRAME.png`
//! with the object over pure white. They write one JSON file of what they found into the folder of each result.

mod export;
mod read;

pub use export::{Method, export_suite};
pub use read::{OtherResult, read_others};
