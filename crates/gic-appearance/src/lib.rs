//! What Gaussians fitted to pictures need besides motion: the colours of a twin, and the pose of a scan.
//!
//! - [`fit_appearance`] trains albedo, opacity, scale and one light for Gaussians whose positions are known at all
//!   times.
//! - [`register`] finds where a scan of the object lies in the first frame of a video.

mod appearance_fit;
mod error;
mod hidden;
mod light;
mod register;
mod settings;
mod tuning;

pub use appearance_fit::{AppearanceProgress, LitGaussians, PosedPoints, fit_appearance};
pub use error::AppearanceError;
pub use light::{IRRADIANCE_TERMS, Light};
pub use register::{Candidate, Registration, check_registrable, place_scan, register};
pub use settings::{AppearanceFitSettings, RegisterSettings};
