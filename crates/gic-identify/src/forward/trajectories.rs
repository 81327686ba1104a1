//! What a forward model predicts: where every particle is at every observed time.

use crate::FitError;
use crate::forward::drawing::{Drawing, Shown};
use crate::forward::footprint::IsotropicGaussians;
use crate::unknowns::state::{State, Unknown};

/// Positions of all particles [m] at each observation that takes part, and how large they are drawn.
#[derive(Clone, Debug)]
pub(crate) struct Trajectories {
    /// Shape [observations][n][3]; empty for an observation that takes no part.
    pub positions: Vec<Vec<[f32; 3]>>,
    /// Velocities of all particles [m/s], shape [observations][n]; empty where all clocks are exact.
    pub velocities: Vec<Vec<[f32; 3]>>,
    /// Standard deviations of the particles' Gaussians [m], shape [observations][n].
    pub scales: Vec<Vec<f32>>,
    /// How they are drawn.
    pub drawing: Drawing,
    /// How far each particle was moved outward at rest by a change of the shape [m], shape [n]; empty for not at all.
    /// The extracted surfaces are taken to be as wrong in all frames as in the first, so that they tell of the motion
    /// but not of the shape.
    pub outward_displacements: Vec<f32>,
}

impl Trajectories {
    /// Velocities at an observation [m/s], shape [n]; empty where all clocks are exact.
    fn velocities(&self, o: usize) -> &[[f32; 3]] {
        self.velocities.get(o).map_or(&[], Vec::as_slice)
    }

    /// An observation as it is drawn.
    pub(crate) fn shown<'a>(&'a self, o: usize, opacities: &'a [f32]) -> Shown<'a> {
        Shown { gaussians: self.gaussians(o, opacities), velocities: self.velocities(o), drawing: &self.drawing }
    }

    /// What is drawn at an observation.
    pub(crate) fn gaussians<'a>(&'a self, o: usize, opacities: &'a [f32]) -> IsotropicGaussians<'a> {
        IsotropicGaussians {
            positions: &self.positions[o],
            opacities,
            scales: &self.scales[o],
            factor: self.drawing.splat_factor,
        }
    }
}

/// A motion that differs from another one along one unknown.
#[derive(Clone, Debug)]
pub(crate) enum Neighbour {
    /// By itself, without velocities: it is as late as the other one is.
    Moved(Trajectories),
    /// Only as it is drawn.
    Drawn(Unknown),
}

impl Neighbour {
    pub(crate) fn moved(trajectories: Trajectories) -> Neighbour {
        Neighbour::Moved(Trajectories { velocities: Vec::new(), ..trajectories })
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
