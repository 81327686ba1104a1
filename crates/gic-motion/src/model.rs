//! What training gives: canonical Gaussians and their motion, so Gaussians at any time.
//!
//! `mu(t) = b(mu_0, t) + sum_i w_i d mu_i(t)` and `ln s(t) = ln s_0 + sum_i w_i d s_i(t)`: paper eq. 3 with the base
//! motion b in front. Without a base motion, b is the identity.

use gic_splat::{Gaussians, Shape};
use serde::{Deserialize, Serialize};

use crate::{BaseMotion, MotionNetwork};

/// How the network's units relate to the scene's.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Domain {
    /// Origin of the network's positions [m].
    pub centre: [f64; 3],
    /// Length [m] of one unit of the network's positions and displacements.
    pub extent: f64,
    /// Time [s] that the network sees as 0, and all before it, too: the end of the flight, where there is one.
    pub start: f64,
    /// Time [s] from there that the network sees as 1.
    pub duration: f64,
}

impl Domain {
    /// Positions [m], shape [n, 3], in the network's units.
    pub fn normalised(&self, positions: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let unit = |x: f32, axis: usize| ((f64::from(x) - self.centre[axis]) / self.extent) as f32;
        positions.iter().map(|p| core::array::from_fn(|axis| unit(p[axis], axis))).collect()
    }

    /// A time [s] in the network's unit.
    pub fn normalised_time(&self, time: f64) -> f32 {
        ((time - self.start) / self.duration).max(0.0) as f32
    }

    /// The network's residuals in metres; the fourth, which is added to the logarithm of the scale, has no unit.
    pub(crate) fn residuals(&self, residuals: &[[f32; 4]]) -> Vec<[f32; 4]> {
        let e = self.extent as f32;
        residuals.iter().map(|&[x, y, z, s]| [x * e, y * e, z * e, s]).collect()
    }
}

/// Gaussians that move (paper section 4.1).
#[derive(Clone, Debug)]
pub struct DynamicGaussians {
    /// The canonical Gaussians: mu_0, s_0, and everything that does not change.
    pub canonical: Gaussians,
    /// What moves them; `None` for a static scene.
    pub motion: Option<Displacement>,
}

/// The motion of canonical Gaussians.
#[derive(Clone, Debug)]
pub struct Displacement {
    /// The motion-factorised network.
    pub network: MotionNetwork<f32>,
    /// Its units.
    pub domain: Domain,
    /// The motion to which the network's residuals are added; without it they are the whole motion, as in the paper.
    pub base: Option<BaseMotion>,
}

impl DynamicGaussians {
    /// The Gaussians at `time` [s from the first frame]: paper eq. 3 with the base motion in front, and s the logarithm
    /// of the scale.
    pub fn at(&self, time: f64) -> Gaussians {
        let mut gaussians = self.canonical.clone();
        let Some(Displacement { network, domain, base }) = &self.motion else { return gaussians };
        let normalised = domain.normalised(&gaussians.positions);
        let residuals = domain.residuals(&network.forward(&normalised, domain.normalised_time(time)).residuals);
        if let Some(base) = base {
            let pose = base.at(time);
            base.shade(&pose, &gaussians.positions, &mut gaussians.sh);
            gaussians.positions.iter_mut().for_each(|x| *x = base.moved(&pose, *x));
        }
        for (position, residual) in gaussians.positions.iter_mut().zip(&residuals) {
            for axis in 0..3 {
                position[axis] += residual[axis];
            }
        }
        let (scales, axes) = match &mut gaussians.shape {
            Shape::Isotropic { scales } => (scales.as_mut_slice(), 1),
            Shape::Anisotropic { scales, .. } => (scales.as_flattened_mut(), 3),
        };
        for (scales, residual) in scales.chunks_exact_mut(axes).zip(&residuals) {
            scales.iter_mut().for_each(|scale| *scale *= residual[3].exp());
        }
        gaussians
    }
}
