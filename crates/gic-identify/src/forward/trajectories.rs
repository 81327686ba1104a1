//! What a forward model predicts: where every particle is at every observed time.

use crate::FitError;
use crate::forward::footprint::IsotropicGaussians;
use crate::unknowns::state::State;

/// Positions of all particles [m] at each observation that takes part, and how large they are drawn.
#[derive(Clone, Debug)]
pub(crate) struct Trajectories {
    /// Shape [observations][n][3]; empty for an observation that takes no part.
    pub positions: Vec<Vec<[f32; 3]>>,
    /// Standard deviations of the particles' Gaussians [m], shape [observations][n].
    pub scales: Vec<Vec<f32>>,
    /// Factor on all of them.
    pub splat_factor: f32,
    /// How far each particle was moved outward at rest by a change of the shape [m], shape [n]; empty for not at all.
    /// The extracted surfaces are taken to be as wrong in all frames as in the first, so that they tell of the motion
    /// but not of the shape.
    pub outward_displacements: Vec<f32>,
}

impl Trajectories {
    /// The same motion, drawn with the logarithm of the factor on the standard deviations `step` higher.
    pub(crate) fn drawn(&self, step: f64) -> Trajectories {
        Trajectories { splat_factor: self.splat_factor * step.exp() as f32, ..self.clone() }
    }

    /// What is drawn at an observation.
    pub(crate) fn gaussians<'a>(&'a self, o: usize, opacities: &'a [f32]) -> IsotropicGaussians<'a> {
        IsotropicGaussians {
            positions: &self.positions[o],
            opacities,
            scales: &self.scales[o],
            factor: self.splat_factor,
        }
    }
}

/// Which observations take part and how coarsely they are compared.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct FrameSelection {
    /// Index of the first observation.
    pub first: usize,
    /// Index after the last.
    pub end: usize,
    /// Extra pooling of the masks' residuals, for a wide basin of attraction.
    pub pooling: usize,
}

/// A model of motion.
pub(crate) trait ForwardModel: Sync {
    /// Trajectories at the observations of `selection`.
    ///
    /// # Errors
    /// Where the state cannot be simulated.
    fn trajectories(&self, state: &State, selection: &FrameSelection) -> Result<Trajectories, FitError>;
}
