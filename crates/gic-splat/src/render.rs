//! The fast renderer's front door.

use gic_scene::Camera;

use crate::{GaussianGradients, Gaussians};

/// What to draw over, and what to draw.
#[derive(Clone, Debug)]
pub struct RenderSettings {
    /// Background colour in [0, 1].
    pub background: [f32; 3],
}

/// Pictures of one view, row-major from the top left, plus what the backward pass needs.
#[derive(Clone, Debug)]
pub struct Rendered {
    /// Colour over the background, shape [height * width, 3].
    pub color: Vec<[f32; 3]>,
    /// Accumulated alpha A(u), shape [height * width].
    pub alpha: Vec<f32>,
    /// Accumulated depth D(u) = sum T alpha d (not divided by alpha) [m], shape [height * width].
    pub depth: Vec<f32>,
}

/// Derivative of a scalar loss with respect to the three pictures; an empty vector means zero.
#[derive(Clone, Debug, Default)]
pub struct ImageGradients {
    /// d loss / d colour, shape [height * width, 3] or empty.
    pub color: Vec<[f32; 3]>,
    /// d loss / d alpha, shape [height * width] or empty.
    pub alpha: Vec<f32>,
    /// d loss / d depth, shape [height * width] or empty.
    pub depth: Vec<f32>,
}

/// Draws the Gaussians as `camera` sees them (paper eq. 2).
pub fn render(_gaussians: &Gaussians, _camera: &Camera, _settings: &RenderSettings) -> Rendered {
    todo!("owned by the splat room")
}

/// Gradient of a loss on the pictures with respect to every attribute of the Gaussians.
pub fn backward(
    _gaussians: &Gaussians,
    _camera: &Camera,
    _settings: &RenderSettings,
    _rendered: &Rendered,
    _loss: &ImageGradients,
) -> GaussianGradients {
    todo!("owned by the splat room")
}
