//! What to draw, and how.

use gic_simd::Level;

/// Which pictures to draw. Fewer cost less, forward and backward.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Channels {
    /// Colour, alpha and depth.
    #[default]
    ColorAlphaDepth,
    /// Colour and alpha: what a loss on pictures and masks looks at. `depth` stays empty.
    ColorAlpha,
    /// Alpha and depth; colours are not looked at and `color` stays empty.
    AlphaDepth,
    /// Alpha only: masks. `color` and `depth` stay empty.
    Alpha,
}

impl Channels {
    pub(crate) fn color(self) -> bool {
        matches!(self, Channels::ColorAlphaDepth | Channels::ColorAlpha)
    }

    pub(crate) fn depth(self) -> bool {
        matches!(self, Channels::ColorAlphaDepth | Channels::AlphaDepth)
    }
}

/// What to draw over, and what to draw. Make one with `..Default::default()`, [`RenderSettings::pictures`] or
/// [`RenderSettings::masks`].
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
    /// Instructions to use; the widest that the machine has by default (or what `GIC_SIMD` says).
    pub level: Level,
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
            level: Level::active(),
        }
    }
}

impl RenderSettings {
    /// For comparing with pictures and their masks: the defaults without the depth picture.
    pub fn pictures() -> RenderSettings {
        RenderSettings { channels: Channels::ColorAlpha, ..RenderSettings::default() }
    }

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
