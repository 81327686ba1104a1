//! A least-squares problem: a forward model, the observations, a prior, and what is varied.

use nalgebra::DVector;

use crate::forward::trajectories::{ForwardModel, FrameSelection, Trajectories};
use crate::solve::normal_equations::Normal;
use crate::solve::objective::Objective;
use crate::solve::prior::Prior;
use crate::solve::residual_block::{ResidualBlock, Weights};
use crate::tuning::DescentTuning;
use crate::unknowns::coordinates::Coordinates;
use crate::unknowns::state::{State, Unknown};

/// A forward model, the data, and what is varied.
pub(crate) struct Problem<'a> {
    pub forward: &'a dyn ForwardModel,
    pub objective: Objective<'a>,
    pub unknowns: Vec<Unknown>,
    pub coordinates: Coordinates<'a>,
    pub descent: &'a DescentTuning,
    pub selection: FrameSelection,
    pub prior: Option<&'a Prior>,
}

impl<'a> Problem<'a> {
    /// The same with the material alone unknown; with everything where no parameter of it is.
    pub(crate) fn of_material_alone(&self) -> Problem<'a> {
        let is_material = |unknown: &Unknown| matches!(unknown, Unknown::Material(_));
        let material: Vec<Unknown> = self.unknowns.iter().copied().filter(is_material).collect();
        let unknowns = if material.is_empty() { self.unknowns.clone() } else { material };
        Problem { unknowns, selection: self.selection.clone(), ..*self }
    }

    /// The same with other weights.
    pub(crate) fn weighted_by<'b>(&'b self, weights: &'b Weights) -> Problem<'b> {
        let objective = Objective { weights, ..self.objective };
        Problem { objective, unknowns: self.unknowns.clone(), selection: self.selection.clone(), ..*self }
    }

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
        let moved = self.coordinates.moved(state, &self.unknowns, step);
        let delta = self.unknowns.iter().map(|u| moved.get(*u) - state.get(*u)).collect();
        (moved, delta)
    }

    /// The damped step of the quadratic model `normal` around `state` that stays within the limits, those in `held`
    /// with their lengths. `None` where the model has no lowest point.
    pub(crate) fn step(
        &self,
        normal: &Normal,
        state: &State,
        damping: f64,
        held: Vec<(usize, f64)>,
    ) -> Option<DVector<f64>> {
        let room = |unknown: &Unknown| {
            let (at, (low, high)) = (state.get(*unknown), self.coordinates.limits(*unknown));
            (low - at, high - at)
        };
        normal.step_within(damping, &self.unknowns.iter().map(room).collect::<Vec<_>>(), held)
    }

    /// How much cheaper than `state` the lowest point of the quadratic model `normal` around it is, within the limits.
    /// `None` where there is none.
    pub(crate) fn largest_decrease(&self, normal: &Normal, state: &State) -> Option<f64> {
        let lowest = self.step(normal, state, 0.0, Vec::new())?;
        Some(normal.predicted_decrease(lowest.as_slice()))
    }

    /// Normal equations of the observations and the prior.
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
