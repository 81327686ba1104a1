//! Where drawing stops: the thresholds that the fast renderer and its twin share.
//!
//! The three on alpha and transmittance are those of 3DGS (Kerbl et al. 2023, section 6 and released code).

/// Below this alpha a Gaussian does not count in a pixel: half a step of an 8-bit picture.
pub const ALPHA_MIN: f64 = 1.0 / 255.0;
/// No Gaussian covers a pixel more than this, so that something of what lies behind keeps a gradient.
pub const ALPHA_MAX: f64 = 0.99;
/// A pixel whose transmittance has fallen below this is finished.
pub const TRANSMITTANCE_MIN: f64 = 1e-4;
/// The affine approximation of the projection is taken no further outside the picture than this share of its size:
/// beyond, its Jacobian would smear Gaussians that are near the camera plane over the whole picture.
pub const FRUSTUM_MARGIN: f64 = 0.15;

/// A quaternion shorter than this is no rotation: gradients grow with the reciprocal of the length.
pub(crate) const SHORTEST_QUATERNION: f64 = 1e-6;

/// Gaussians per parallel task: below this, a thread is not worth waking.
pub(crate) const GAUSSIANS_PER_TASK: usize = 512;
