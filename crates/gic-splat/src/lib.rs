//! Differentiable Gaussian splatting on CPUs: colour, alpha and depth in one pass, forward and backward (paper eq. 2).

mod gaussians;
mod render;

pub use gaussians::{Gaussians, GaussianGradients, Shape};
pub use render::{ImageGradients, Rendered, RenderSettings, backward, render};
