//! What Gaussians fitted to pictures need besides motion: the colours of a twin, and the pose of a scan.
//!
//! - [`dress`] trains albedo, opacity, scale and one light for Gaussians whose positions are known at all times.
//! - [`register`] finds where a scan of the object lies in the first frame of a video.

mod dress;
mod error;
mod light;
mod register;
mod settings;

pub use dress::{DressProgress, LitGaussians, Posture, dress};
pub use error::AppearanceError;
pub use light::{Light, TERMS};
pub use register::{Candidate, Registration, check_registrable, placed, register};
pub use settings::{DressSettings, RegisterSettings};
