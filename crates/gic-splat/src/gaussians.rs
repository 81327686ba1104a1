//! A set of Gaussians as a structure of arrays.

use thiserror::Error;

use crate::limits::SHORTEST_QUATERNION;

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
        /// Unit quaternions (w, x, y, z) from local to world axes, shape [n, 4]; normalised when used, rejected if
        /// shorter than 1e-6.
        rotations: Vec<[f32; 4]>,
    },
}

impl Shape {
    /// How many Gaussians it describes.
    #[inline]
    pub fn len(&self) -> usize {
        match self {
            Shape::Isotropic { scales } => scales.len(),
            Shape::Anisotropic { scales, .. } => scales.len(),
        }
    }

    /// Whether it describes none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Standard deviations [m] as flat numbers, one or three per Gaussian.
    pub fn flat_scales(&self) -> &[f32] {
        match self {
            Shape::Isotropic { scales } => scales,
            Shape::Anisotropic { scales, .. } => scales.as_flattened(),
        }
    }

    /// The same kind of shape, all zero, for `n` Gaussians.
    pub fn zeros_like(&self, n: usize) -> Shape {
        match self {
            Shape::Isotropic { .. } => Shape::Isotropic { scales: vec![0.0; n] },
            Shape::Anisotropic { .. } => Shape::Anisotropic { scales: vec![[0.0; 3]; n], rotations: vec![[0.0; 4]; n] },
        }
    }
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
    /// May be empty when no colour is ever drawn (see [`crate::Channels`]).
    pub sh: Vec<[f32; 3]>,
}

impl Gaussians {
    /// Isotropic Gaussians without colour, for masks and depth only.
    ///
    /// `positions` [m] shape [n, 3], `opacities` shape [n], `scales` [m] shape [n].
    pub fn colorless(positions: Vec<[f32; 3]>, opacities: Vec<f32>, scales: Vec<f32>) -> Gaussians {
        Gaussians { positions, opacities, shape: Shape::Isotropic { scales }, sh_degree: 0, sh: Vec::new() }
    }

    /// How many Gaussians.
    #[inline]
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Standard deviation of a Gaussian [m]; of an anisotropic one the geometric mean.
    #[inline]
    pub fn scale(&self, i: usize) -> f32 {
        match &self.shape {
            Shape::Isotropic { scales } => scales[i],
            Shape::Anisotropic { scales, .. } => scales[i].iter().product::<f32>().cbrt(),
        }
    }

    /// Spherical-harmonics coefficients per Gaussian and channel: (degree + 1)^2.
    #[inline]
    pub fn sh_per_gaussian(&self) -> usize {
        (self.sh_degree + 1) * (self.sh_degree + 1)
    }

    /// The Gaussians listed in `rows`, in that order.
    ///
    /// # Panics
    /// If a row is beyond the end.
    #[must_use]
    pub fn select(&self, rows: &[usize]) -> Gaussians {
        let k = if self.sh.is_empty() { 0 } else { self.sh_per_gaussian() };
        let shape = match &self.shape {
            Shape::Isotropic { scales } => Shape::Isotropic { scales: rows.iter().map(|&i| scales[i]).collect() },
            Shape::Anisotropic { scales, rotations } => Shape::Anisotropic {
                scales: rows.iter().map(|&i| scales[i]).collect(),
                rotations: rows.iter().map(|&i| rotations[i]).collect(),
            },
        };
        Gaussians {
            positions: rows.iter().map(|&i| self.positions[i]).collect(),
            opacities: rows.iter().map(|&i| self.opacities[i]).collect(),
            shape,
            sh_degree: self.sh_degree,
            sh: rows.iter().flat_map(|&i| &self.sh[i * k..(i + 1) * k]).copied().collect(),
        }
    }

    /// Checks lengths, degree and values; what a set from outside should pass before it is drawn.
    ///
    /// # Errors
    /// A [`GaussiansError`] naming the attribute and, for values, the first Gaussian concerned.
    pub fn validate(&self) -> Result<(), GaussiansError> {
        self.check_lengths()?;
        let finite = |name, ok: &dyn Fn(usize) -> bool| match (0..self.len()).find(|&i| !ok(i)) {
            Some(index) => Err(GaussiansError::Value { attribute: name, index }),
            None => Ok(()),
        };
        finite("position", &|i| self.positions[i].iter().all(|v| v.is_finite()))?;
        finite("opacity", &|i| (0.0..=1.0).contains(&self.opacities[i]))?;
        match &self.shape {
            Shape::Isotropic { scales } => finite("scale", &|i| scales[i] >= 0.0 && scales[i].is_finite())?,
            Shape::Anisotropic { scales, rotations } => {
                finite("scale", &|i| scales[i].iter().all(|&s| s >= 0.0 && s.is_finite()))?;
                finite("rotation", &|i| {
                    let norm2: f64 = rotations[i].iter().map(|&v| f64::from(v).powi(2)).sum();
                    norm2 >= SHORTEST_QUATERNION.powi(2) && norm2.is_finite()
                })?;
            }
        }
        let k = if self.sh.is_empty() { 0 } else { self.sh_per_gaussian() };
        finite("sh", &|i| self.sh[i * k..(i + 1) * k].iter().flatten().all(|v| v.is_finite()))
    }

    /// The part of [`Gaussians::validate`] that drawing relies on: the arrays belong together.
    pub(crate) fn check_lengths(&self) -> Result<(), GaussiansError> {
        let n = self.len();
        let same = |attribute, found: usize, expected: usize| {
            if found == expected { Ok(()) } else { Err(GaussiansError::Length { attribute, found, expected }) }
        };
        same("opacities", self.opacities.len(), n)?;
        same("scales", self.shape.len(), n)?;
        if let Shape::Anisotropic { rotations, .. } = &self.shape {
            same("rotations", rotations.len(), n)?;
        }
        if self.sh_degree > 3 {
            return Err(GaussiansError::Degree { degree: self.sh_degree });
        }
        if !self.sh.is_empty() {
            same("sh", self.sh.len(), n * self.sh_per_gaussian())?;
        }
        Ok(())
    }
}

/// Why a set of Gaussians cannot be drawn.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum GaussiansError {
    /// Arrays of different lengths.
    #[error(
        "Gaussians: `{attribute}` has {found} entries where {expected} belong; every attribute needs one per Gaussian"
    )]
    Length {
        /// Which array.
        attribute: &'static str,
        /// Entries it has.
        found: usize,
        /// Entries it should have.
        expected: usize,
    },
    /// Spherical harmonics beyond degree 3.
    #[error("Gaussians: spherical harmonics of degree {degree}; 0 to 3 are supported, drop the higher coefficients")]
    Degree {
        /// The degree asked for.
        degree: usize,
    },
    /// A value that is not finite or out of its range.
    #[error("Gaussians: {attribute} of Gaussian {index} is not finite or out of range; remove that Gaussian")]
    Value {
        /// Which attribute.
        attribute: &'static str,
        /// The first Gaussian concerned.
        index: usize,
    },
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

impl GaussianGradients {
    /// Zero for every attribute of `gaussians`.
    pub fn zeros(gaussians: &Gaussians) -> GaussianGradients {
        let n = gaussians.len();
        GaussianGradients {
            positions: vec![[0.0; 3]; n],
            opacities: vec![0.0; n],
            shape: gaussians.shape.zeros_like(n),
            sh: vec![[0.0; 3]; gaussians.sh.len()],
            screen: vec![0.0; n],
        }
    }
}
