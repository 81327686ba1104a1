//! Residuals of a hypothesis against the observations, and their normal equations.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::forward::footprint::IsotropicGaussians;
use crate::forward::silhouette::alpha;
use crate::normal::{Modality, Normal, ResidualBlock, Weights};
use crate::observe::mask_view::{MaskView, pool};
use crate::observe::video::{ObservedFrame, ObservedVideo};
use crate::solve::levenberg_marquardt::Tangents;
use crate::unknowns::state::{State, Unknown};

/// Positions of all particles [m] at each observation that takes part, and how large they are drawn.
#[derive(Clone, Debug)]
pub(crate) struct Trajectories {
    /// Shape [observations][n][3]; empty for an observation that takes no part.
    pub positions: Vec<Vec<[f32; 3]>>,
    /// Standard deviations of the particles' Gaussians [m], shape [observations][n].
    pub scales: Vec<Vec<f32>>,
    /// Factor on all of them.
    pub splat_factor: f32,
    /// How far each particle was moved outward at rest by a change of the shape [m], shape [n]; empty for not at all. The extracted
    /// surfaces are taken to be as wrong in all frames as in the first, so that they tell of the motion but not of the shape.
    pub outward_displacements: Vec<f32>,
}

impl Trajectories {
    /// The same motion with all Gaussians wider by a factor e^`step`.
    pub(crate) fn drawn_wider(&self, step: f64) -> Trajectories {
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

/// The observations as a function of a hypothesis.
#[derive(Clone, Copy)]
pub(crate) struct Objective<'a> {
    pub video: &'a ObservedVideo,
    pub opacities: &'a [f32],
    pub surface_context: &'a crate::observe::surface::Context,
    pub weights: &'a Weights,
}

impl Objective<'_> {
    /// Half the weighted sum of squares.
    pub(crate) fn cost(&self, trajectories: &Trajectories, selection: &FrameSelection) -> f64 {
        let blocks = self.blocks(trajectories, &[], &[], selection);
        Normal::sum(&blocks, self.weights, 0).cost
    }

    /// Normal equations from a base motion and one perturbed motion per unknown.
    pub(crate) fn blocks(
        &self,
        base: &Trajectories,
        perturbed: &[Trajectories],
        steps: &[f64],
        selection: &FrameSelection,
    ) -> Vec<ResidualBlock> {
        let range = selection.first..selection.end.min(self.video.frames.len());
        let views: Vec<(usize, &MaskView)> =
            range.clone().flat_map(|o| self.video.frames[o].views.iter().map(move |view| (o, view))).collect();
        let mut blocks: Vec<ResidualBlock> = views
            .into_par_iter()
            .map(|(o, view)| self.mask_block(o, view, base, perturbed, steps, selection.pooling))
            .collect();
        let surfaces: Vec<Vec<ResidualBlock>> =
            range.into_par_iter().map(|o| self.surface_blocks(o, base, perturbed, steps)).collect();
        blocks.extend(surfaces.into_iter().flatten());
        blocks
    }

    fn mask_block(
        &self,
        o: usize,
        view: &MaskView,
        base: &Trajectories,
        perturbed: &[Trajectories],
        steps: &[f64],
        pooling: usize,
    ) -> ResidualBlock {
        // Outside of this window neither the particles nor the mask are, so that it only saves time.
        let window = view.window(base.gaussians(o, self.opacities), pooling);
        let camera = &window.camera(&view.camera);
        let draw = |trajectories: &Trajectories| {
            let full = alpha(trajectories.gaussians(o, self.opacities), camera);
            pool(&full, camera.width, camera.height, pooling)
        };
        let observed = pool(&window.cut(&view.mask, view.camera.width), camera.width, camera.height, pooling);
        let reference = draw(base);
        let moved: Vec<Vec<f32>> = perturbed.iter().map(draw).collect();
        let mut block = ResidualBlock::new(Modality::Mask, o, Some(view.camera_index), steps.len());
        let mut row = vec![0.0; steps.len()];
        // A pooled pixel stands for that many working pixels.
        let weight = (pooling * pooling) as f64;
        for (i, (a, m)) in reference.iter().zip(&observed).enumerate() {
            let residual = f64::from(a - m);
            let mut touched = residual != 0.0;
            for ((slot, image), step) in row.iter_mut().zip(&moved).zip(steps) {
                *slot = f64::from(image[i] - a) / step;
                touched |= *slot != 0.0;
            }
            if touched {
                block.add(residual, &row, weight);
            }
        }
        block.finish()
    }

    fn surface_blocks(
        &self,
        o: usize,
        base: &Trajectories,
        perturbed: &[Trajectories],
        steps: &[f64],
    ) -> Vec<ResidualBlock> {
        let frame: &ObservedFrame = &self.video.frames[o];
        let Some(surface) = &frame.surface else { return Vec::new() };
        vec![self.surface_context.block((o, frame.time_s), surface, base, perturbed, steps)]
    }
}

/// A model of motion.
pub(crate) trait ForwardModel: Sync {
    /// Positions at the observations of `level`; the message says why there are none.
    fn trajectories(&self, state: &State, selection: &FrameSelection) -> Result<Trajectories, String>;
}

/// What is known of some unknowns besides the observations of the level: a Gaussian.
#[derive(Clone, Debug)]
pub(crate) struct Prior {
    pub unknowns: Vec<Unknown>,
    pub mean: DVector<f64>,
    /// Inverse of the covariance.
    pub information: DMatrix<f64>,
}

impl Prior {
    fn deviation(&self, state: &State) -> DVector<f64> {
        DVector::from_iterator(self.unknowns.len(), self.unknowns.iter().map(|u| state.get(*u))) - &self.mean
    }

    /// Its information matrix in the order of `unknowns`, zero elsewhere.
    pub(crate) fn information_of(&self, unknowns: &[Unknown]) -> DMatrix<f64> {
        let place = |u: &Unknown| self.unknowns.iter().position(|own| own == u);
        DMatrix::from_fn(unknowns.len(), unknowns.len(), |i, j| match (place(&unknowns[i]), place(&unknowns[j])) {
            (Some(a), Some(b)) => self.information[(a, b)],
            _ => 0.0,
        })
    }
}

/// A forward model, the data, and what is varied.
pub(crate) struct Problem<'a> {
    pub forward: &'a dyn ForwardModel,
    pub objective: Objective<'a>,
    pub unknowns: Vec<Unknown>,
    pub parameters: &'a [crate::Parameter],
    pub selection: FrameSelection,
    pub prior: Option<&'a Prior>,
}

impl Problem<'_> {
    /// Half the weighted sum of squares, that of the prior included.
    pub(crate) fn cost(&self, state: &State, trajectories: &Trajectories) -> f64 {
        let known = self.prior.map_or(0.0, |prior| {
            let d = prior.deviation(state);
            0.5 * (&prior.information * &d).dot(&d)
        });
        self.objective.cost(trajectories, &self.selection) + known
    }

    /// The state displaced by `step` along the unknowns, and how far the limits let it go.
    pub(crate) fn moved(&self, state: &State, step: &[f64]) -> (State, Vec<f64>) {
        let moved = state.moved(&self.unknowns, step, self.parameters);
        let delta = self.unknowns.iter().map(|u| moved.get(*u) - state.get(*u)).collect();
        (moved, delta)
    }

    /// Normal equations of the observations, kept apart by block.
    pub(crate) fn blocks(&self, trajectories: &Trajectories, tangents: &Tangents) -> Vec<ResidualBlock> {
        self.objective.blocks(trajectories, &tangents.perturbed, &tangents.steps, &self.selection)
    }

    /// Their sum, with the prior.
    pub(crate) fn normal(&self, blocks: &[ResidualBlock], state: &State) -> Normal {
        let mut normal = Normal::sum(blocks, self.objective.weights, self.unknowns.len());
        if let Some(prior) = self.prior {
            normal.hessian += prior.information_of(&self.unknowns);
            let pull = &prior.information * prior.deviation(state);
            for (unknown, p) in prior.unknowns.iter().zip(pull.iter()) {
                if let Some(k) = self.unknowns.iter().position(|u| u == unknown) {
                    normal.gradient[k] += p;
                }
            }
        }
        normal
    }
}
