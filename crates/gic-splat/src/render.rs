//! The fast renderer's front door: what to draw, the pictures, and their gradients.

use gic_scene::Camera;

use crate::{GaussianGradients, Gaussians};

/// Below this alpha a Gaussian does not count in a pixel: half a step of an 8-bit picture.
pub const ALPHA_MIN: f64 = 1.0 / 255.0;
/// No Gaussian covers a pixel more than this, so that something of what lies behind keeps a gradient.
pub const ALPHA_MAX: f64 = 0.99;
/// A pixel whose transmittance has fallen below this is finished.
pub const TRANSMITTANCE_MIN: f64 = 1e-4;
/// The affine approximation of the projection is taken no further outside the picture than this share of its size:
/// beyond, its Jacobian would smear Gaussians that are near the camera plane over the whole picture.
pub const FRUSTUM_MARGIN: f64 = 0.15;

/// Which pictures to draw. Fewer cost less, forward and backward.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Channels {
    /// Colour, alpha and depth.
    #[default]
    ColorAlphaDepth,
    /// Alpha and depth; colours are not looked at and `color` stays empty.
    AlphaDepth,
    /// Alpha only: masks. `color` and `depth` stay empty.
    Alpha,
}

/// What to draw over, and what to draw. Make one with `..Default::default()` or [`RenderSettings::masks`].
#[derive(Clone, Debug, PartialEq)]
pub struct RenderSettings {
    /// Background colour in [0, 1].
    pub background: [f32; 3],
    /// Which pictures to draw.
    pub channels: Channels,
    /// Low-pass filter: added to the diagonal of every projected covariance [pixels^2]. The default, 0.3, is the
    /// convention of the field, which the usual viewers apply as well; it widens every Gaussian.
    pub dilation: f32,
    /// Scale the opacity by sqrt(det / dilated det), so that the filter spreads each Gaussian instead of adding to it.
    /// Off by default, as in the usual viewers.
    pub compensate: bool,
    /// Gaussians whose centre is nearer to the camera plane than this are not drawn [m].
    pub near: f32,
    /// Spherical harmonics above this degree are left out (their gradient is zero); training raises it step by step.
    pub max_sh_degree: usize,
}

impl Default for RenderSettings {
    fn default() -> RenderSettings {
        RenderSettings {
            background: [0.0; 3],
            channels: Channels::ColorAlphaDepth,
            dilation: 0.3,
            compensate: false,
            near: 0.01,
            max_sh_degree: 3,
        }
    }
}

impl RenderSettings {
    /// For masks that are true to the geometry below a pixel: alpha only, the low-pass filter has the variance of one
    /// pixel (1/12 pixels^2: a true mask averages over the pixel) and keeps each Gaussian's total.
    pub fn masks() -> RenderSettings {
        RenderSettings {
            channels: Channels::Alpha,
            dilation: 1.0 / 12.0,
            compensate: true,
            ..RenderSettings::default()
        }
    }
}

/// Pictures of one view, row-major from the top left, plus what the backward pass needs.
#[derive(Clone, Debug)]
pub struct Rendered {
    /// Colour over the background, shape [height * width, 3]; empty if not asked for.
    pub color: Vec<[f32; 3]>,
    /// Accumulated alpha A(u), shape [height * width].
    pub alpha: Vec<f32>,
    /// Accumulated depth D(u) = sum T alpha d (not divided by alpha) [m], shape [height * width]; empty if not asked for.
    pub depth: Vec<f32>,
    /// Gaussians that were left out because an attribute was not finite (or a scale or opacity negative). Such a Gaussian
    /// gets a zero gradient; [`Gaussians::validate`] names it.
    pub rejected: usize,
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
pub fn render(gaussians: &Gaussians, camera: &Camera, settings: &RenderSettings) -> Rendered {
    let pictures =
        crate::twin::render(&crate::twin::Set::from(gaussians), camera, settings, crate::twin::Cutoffs::Hard);
    let f = |v: Vec<f64>| v.iter().map(|&x| x as f32).collect();
    Rendered {
        color: pictures.color.iter().map(|c| c.as_vec3().to_array()).collect(),
        alpha: f(pictures.alpha),
        depth: f(pictures.depth),
        rejected: 0,
    }
}

/// Gradient of a loss on the pictures with respect to every attribute of the Gaussians.
pub fn backward(
    gaussians: &Gaussians,
    camera: &Camera,
    settings: &RenderSettings,
    _rendered: &Rendered,
    loss: &ImageGradients,
) -> GaussianGradients {
    let g = crate::twin::backward(
        &crate::twin::Set::from(gaussians),
        camera,
        settings,
        crate::twin::Cutoffs::Hard,
        &crate::twin::Pictures::from(loss),
    );
    g.to_f32(gaussians)
}
