//! Differentiable Gaussian splatting on CPUs: colour, alpha and depth in one pass, forward and backward (paper eq. 2).

mod activation;
mod gaussians;
mod limits;
mod ply;
mod projection;
mod raster;
mod render;
mod settings;
pub mod sh;
mod tiles;
pub mod twin;
mod usd;

pub use activation::{coefficient_of_color, color_of_coefficient, logit, sigmoid};
pub use gaussians::{GaussianGradients, Gaussians, GaussiansError, Shape};
pub use limits::{ALPHA_MAX, ALPHA_MIN, FRUSTUM_MARGIN, TRANSMITTANCE_MIN};
pub use ply::{Imported, PlyError, read_ply, write_ply};
pub use render::{ImageGradients, Rendered, backward, render};
pub use settings::{Channels, RenderSettings};
pub use usd::write_usd;
