//! Residuals of a hypothesis against the observations, and their normal equations.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::forward::footprint::Cloud;
use crate::forward::silhouette::alpha;
use crate::normal::{Cluster, Modality, Normal, Weights};
use crate::observe::data::{Data, Moment};
use crate::observe::mask_view::{MaskView, pool};
use crate::solve::levenberg::Tangents;
use crate::unknowns::state::{State, Unknown};

/// Positions of all particles [m] at each observation that takes part, and how large they are drawn.
#[derive(Clone, Debug)]
pub(crate) struct Motion {
    /// Shape [observations][n][3]; empty for an observation that takes no part.
    pub positions: Vec<Vec<[f32; 3]>>,
    /// Standard deviations of the particles' Gaussians [m], shape [observations][n].
    pub scales: Vec<Vec<f32>>,
    /// Factor on all of them.
    pub splat_factor: f32,
    /// How far each particle was moved outward at rest by a change of the shape [m], shape [n]; empty for not at all. The extracted
    /// surfaces are taken to be as wrong in all frames as in the first, so that they tell of the motion but not of the shape.
    pub swelling: Vec<f32>,
}

impl Motion {
    /// The same motion with all Gaussians wider by a factor e^`step`.
    pub(crate) fn drawn_wider(&self, step: f64) -> Motion {
        Motion { splat_factor: self.splat_factor * step.exp() as f32, ..self.clone() }
    }

    /// What is drawn at an observation.
    pub(crate) fn cloud<'a>(&'a self, o: usize, opacities: &'a [f32]) -> Cloud<'a> {
        Cloud { positions: &self.positions[o], opacities, scales: &self.scales[o], factor: self.splat_factor }
    }
}

/// Which observations take part and how coarsely they are compared.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Level {
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
    pub data: &'a Data,
    pub opacities: &'a [f32],
    pub surface_context: &'a crate::observe::surface::Context,
    pub weights: &'a Weights,
}

impl Objective<'_> {
    /// Half the weighted sum of squares.
    pub(crate) fn cost(&self, motion: &Motion, level: &Level) -> f64 {
        let clusters = self.clusters(motion, &[], &[], level);
        Normal::sum(&clusters, self.weights, 0).cost
    }

    /// Normal equations from a base motion and one perturbed motion per unknown.
    pub(crate) fn clusters(&self, base: &Motion, perturbed: &[Motion], steps: &[f64], level: &Level) -> Vec<Cluster> {
        let range = level.first..level.end.min(self.data.moments.len());
        let views: Vec<(usize, &MaskView)> =
            range.clone().flat_map(|o| self.data.moments[o].views.iter().map(move |view| (o, view))).collect();
        let mut clusters: Vec<Cluster> = views
            .into_par_iter()
            .map(|(o, view)| self.mask_cluster(o, view, base, perturbed, steps, level.pooling))
            .collect();
        let surfaces: Vec<Vec<Cluster>> =
            range.into_par_iter().map(|o| self.surface_clusters(o, base, perturbed, steps)).collect();
        clusters.extend(surfaces.into_iter().flatten());
        clusters
    }

    fn mask_cluster(
        &self,
        o: usize,
        view: &MaskView,
        base: &Motion,
        perturbed: &[Motion],
        steps: &[f64],
        pooling: usize,
    ) -> Cluster {
        // Outside of this window neither the particles nor the mask are, so that it only saves time.
        let window = view.window(base.cloud(o, self.opacities), pooling);
        let camera = &window.camera(&view.camera);
        let draw = |motion: &Motion| {
            let full = alpha(motion.cloud(o, self.opacities), camera);
            pool(&full, camera.width, camera.height, pooling)
        };
        let observed = pool(&window.cut(&view.mask, view.camera.width), camera.width, camera.height, pooling);
        let reference = draw(base);
        let moved: Vec<Vec<f32>> = perturbed.iter().map(draw).collect();
        let mut cluster = Cluster::new(Modality::Mask, o, Some(view.camera_index), steps.len());
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
                cluster.add(residual, &row, weight);
            }
        }
        cluster.finish()
    }

    fn surface_clusters(&self, o: usize, base: &Motion, perturbed: &[Motion], steps: &[f64]) -> Vec<Cluster> {
        let moment: &Moment = &self.data.moments[o];
        let Some(observed) = &moment.surface else { return Vec::new() };
        vec![self.surface_context.cluster((o, moment.time_s), observed, base, perturbed, steps)]
    }
}

/// A model of motion.
pub(crate) trait Forward: Sync {
    /// Positions at the observations of `level`; the message says why there are none.
    fn motion(&self, state: &State, level: &Level) -> Result<Motion, String>;
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
    pub forward: &'a dyn Forward,
    pub objective: Objective<'a>,
    pub unknowns: Vec<Unknown>,
    pub parameters: &'a [crate::Parameter],
    pub level: Level,
    pub prior: Option<&'a Prior>,
}

impl Problem<'_> {
    /// Half the weighted sum of squares, that of the prior included.
    pub(crate) fn cost(&self, state: &State, motion: &Motion) -> f64 {
        let known = self.prior.map_or(0.0, |prior| {
            let d = prior.deviation(state);
            0.5 * (&prior.information * &d).dot(&d)
        });
        self.objective.cost(motion, &self.level) + known
    }

    /// The state displaced by `step` along the unknowns, and how far the limits let it go.
    pub(crate) fn moved(&self, state: &State, step: &[f64]) -> (State, Vec<f64>) {
        let moved = state.moved(&self.unknowns, step, self.parameters);
        let delta = self.unknowns.iter().map(|u| moved.get(*u) - state.get(*u)).collect();
        (moved, delta)
    }

    /// Normal equations of the observations, kept apart by cluster.
    pub(crate) fn clusters(&self, motion: &Motion, tangents: &Tangents) -> Vec<Cluster> {
        self.objective.clusters(motion, &tangents.motions, &tangents.steps, &self.level)
    }

    /// Their sum, with the prior.
    pub(crate) fn normal(&self, clusters: &[Cluster], state: &State) -> Normal {
        let mut normal = Normal::sum(clusters, self.objective.weights, self.unknowns.len());
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
