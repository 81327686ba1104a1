//! A set of Gaussians as a structure of arrays.

/// The covariance of each Gaussian.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// One standard deviation per Gaussian [m], shape [n].
    Isotropic {
        /// Standard deviations [m].
        scales: Vec<f32>,
    },
    /// Three standard deviations and a rotation per Gaussian.
    Anisotropic {
        /// Standard deviations along the local axes [m], shape [n, 3].
        scales: Vec<[f32; 3]>,
        /// Unit quaternions (w, x, y, z) from local to world axes, shape [n, 4]; normalised when used.
        rotations: Vec<[f32; 4]>,
    },
}

/// n Gaussians in the world frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Gaussians {
    /// Centres [m], shape [n, 3].
    pub positions: Vec<[f32; 3]>,
    /// Opacity at the centre, in [0, 1), shape [n].
    pub opacities: Vec<f32>,
    /// Covariances.
    pub shape: Shape,
    /// Degree of the spherical harmonics, 0 to 3.
    pub sh_degree: usize,
    /// Spherical-harmonics coefficients, RGB, shape [n, (degree + 1)^2, 3], the 3DGS convention: colour = 0.5 + sum.
    pub sh: Vec<[f32; 3]>,
}

/// Derivative of a scalar loss with respect to every attribute of a set of Gaussians; same shapes as [`Gaussians`].
#[derive(Clone, Debug, PartialEq)]
pub struct GaussianGradients {
    /// d loss / d position, shape [n, 3].
    pub positions: Vec<[f32; 3]>,
    /// d loss / d opacity, shape [n].
    pub opacities: Vec<f32>,
    /// d loss / d scale (and rotation).
    pub shape: Shape,
    /// d loss / d spherical-harmonics coefficient.
    pub sh: Vec<[f32; 3]>,
    /// Norm of d loss / d projected centre [per pixel], shape [n]: what densification looks at. Zero where not drawn.
    pub screen: Vec<f32>,
}
