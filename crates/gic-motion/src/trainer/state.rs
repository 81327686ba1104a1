//! What changes during training.

use gic_optimize::Moments;
use gic_splat::Gaussians;

use crate::base::fit::BaseFit;
use crate::gaussians::density::ScreenGradients;
use crate::gaussians::parameters::{ParameterMoments, Parameters};
use crate::gaussians::smoothing::SmoothingGraph;
use crate::tuning::NETWORK_UNIT_RADII;
use crate::{BaseMotion, Deformation, Domain, MotionNetwork, Pose};

/// Everything that changes during training; what a checkpoint holds.
#[derive(Clone, Debug)]
pub(crate) struct State {
    pub(crate) step: usize,
    pub(crate) domain: Domain,
    /// Spacing of the first points [m].
    pub(crate) spacing: f64,
    pub(crate) parameters: Parameters,
    pub(crate) moments: ParameterMoments,
    pub(crate) network: MotionNetwork<f32>,
    pub(crate) network_moments: Moments,
    pub(crate) network_steps: usize,
    pub(crate) screen: ScreenGradients,
    /// What smoothing goes by.
    pub(crate) smoothing_graph: SmoothingGraph,
    pub(crate) base: Option<BaseFit>,
    pub(crate) mean_loss: f64,
    pub(crate) lowest_loss: Option<f64>,
    /// The mean of the last steps, once they are reached.
    pub(crate) mean: Option<Mean>,
    pub(crate) best: Option<Best>,
    /// Evaluations since the best.
    pub(crate) stale: usize,
}

/// What training gives.
#[derive(Clone, Debug)]
pub(crate) struct Learned {
    pub(crate) parameters: Parameters,
    /// Parameters of the network.
    pub(crate) network: Vec<f32>,
}

/// The mean of the last steps.
#[derive(Clone, Debug)]
pub(crate) struct Mean {
    pub(crate) learned: Learned,
    pub(crate) steps: usize,
}

/// The best state by the held-out views so far.
#[derive(Clone, Debug)]
pub(crate) struct Best {
    pub(crate) psnr: f64,
    pub(crate) learned: Learned,
    pub(crate) base: Option<BaseMotion>,
}

impl State {
    /// Width of the object at the first frame [m]: its ball's diameter.
    pub(super) fn object_size(&self) -> f64 {
        2.0 * self.domain.extent / NETWORK_UNIT_RADII
    }

    /// What training gives at this step: the Gaussians and the network's parameters.
    pub(super) fn result(&self) -> (&Parameters, &[f32]) {
        match &self.mean {
            Some(Mean { learned, .. }) => (&learned.parameters, &learned.network),
            None => (&self.parameters, &self.network.parameters),
        }
    }

    /// Displacements [m] and changes of the logarithm of the scale; `None` where nothing moves.
    pub(super) fn residuals(
        &self,
        pose: Option<&Pose>,
        deformation: Option<&Deformation<f32>>,
    ) -> Option<Vec<[f32; 4]>> {
        let mut residuals = match deformation {
            Some(deformation) => self.domain.residuals(&deformation.residuals),
            None if pose.is_none() => return None,
            None => vec![[0.0; 4]; self.parameters.len()],
        };
        if let (Some(base), Some(pose)) = (&self.base, pose) {
            add_displacements(&mut residuals, &self.parameters.positions, &base.motion, pose);
        }
        Some(residuals)
    }

    /// The canonical Gaussians moved by a pose alone.
    pub(super) fn posed(&self, motion: &BaseMotion, pose: &Pose) -> Gaussians {
        let mut residuals = vec![[0.0; 4]; self.parameters.len()];
        add_displacements(&mut residuals, &self.parameters.positions, motion, pose);
        self.parameters.gaussians(Some(&residuals))
    }
}

fn add_displacements(residuals: &mut [[f32; 4]], positions: &[[f32; 3]], motion: &BaseMotion, pose: &Pose) {
    for (residual, &x) in residuals.iter_mut().zip(positions) {
        let moved = motion.moved(pose, x);
        for axis in 0..3 {
            residual[axis] += moved[axis] - x[axis];
        }
    }
}
