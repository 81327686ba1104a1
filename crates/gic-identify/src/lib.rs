//! Material parameters from surfaces and masks, with error bars (paper section 4.3).
//!
//! A hypothesis is a material, an initial motion, and nuisances: the size of the Gaussians that draw the particles, and
//! how the body differs from its reconstruction. The simulator predicts every particle's path from it. Residuals
//! compare the drawn outlines with masks and the particles' surface with extracted surfaces. Identification minimises
//!
//! ```text
//! 1/2 sum_k w_k |r_k|^2  +  1/2 (s - m)^T P (s - m)
//! ```
//!
//! over all pictures and surfaces k. The weights w_k are the inverse of their effective noise, which the residuals
//! themselves show. The Gaussian around m with information P is known of the nuisances: the shape's is a Gaussian
//! process on the surface.
//!
//! The folders in the order of the work:
//! - `observe`: what the video shows, prepared once;
//! - `unknowns`: material parameters and motion as coordinates of a search;
//! - `forward`: what a hypothesis predicts, by free flight or by simulation, and how it is drawn;
//! - `solve`: residuals, their linearisation, and Levenberg-Marquardt with Broyden's secants;
//! - `uncertainty`: effective noise, the jackknife's covariance, profiles, verdicts;
//! - `stages`: free flight, search, material, joint fit, intervals. [`identify`] runs them in order.
//!
//! [`Tuning`] has every tuned number with its origin.

mod checkpoint;
mod error;
mod forward;
mod input;
mod observe;
mod result;
mod session;
mod settings;
mod solve;
mod stages;
mod tuning;
mod uncertainty;
mod unknowns;
mod vector;

pub use checkpoint::{Checkpoint, Event};
pub use error::{FitError, IdentifyError};
pub use input::{DeviceDoubt, Input, Observation, View, WorldDoubt};
pub use result::{Estimate, Estimates, Loss, Stage, Step, WorldEstimate};
pub use settings::{MaterialChoice, Optimizer, Settings, Start, Target};
pub use stages::identify;
pub use tuning::{
    AdamTuning, DescentTuning, FreeFlightTuning, JointTuning, MaskTuning, MaterialTuning, NoiseTuning,
    ResolutionTuning, SearchTuning, ShapeTuning, SurfaceTuning, Tuning, VerdictTuning,
};
pub use unknowns::parameter::{Parameter, material_of, sought, sought_values};
