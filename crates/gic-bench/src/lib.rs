//! Suites of scenes with their truth, and the paper's tables of what was found in them.

mod error;
mod evaluation;
mod paper;
pub mod states;
mod truth;

pub use error::{BenchError, Result};
pub use evaluation::{Evaluation, FrameError, ParameterError, PictureError, RegistrationError, VelocityError};
pub use paper::{paper_name, paper_value};
pub use truth::Truth;
