//! How trajectories change with the unknowns: finite differences of parallel rollouts, carried along by secants in between.

use rayon::prelude::*;

use crate::forward::trajectories::Trajectories;
use crate::solve::problem::Problem;
use crate::solve::residual_block::ResidualBlock;
use crate::unknowns::state::{State, Unknown};

/// What is known at the start of a search, so that it need not be worked out again.
pub(crate) struct Linearisation {
    pub trajectories: Trajectories,
    pub tangents: Tangents,
    /// Those of `motion` and `tangents`, where they were needed.
    pub blocks: Option<Vec<ResidualBlock>>,
}

/// How the motion changes with each unknown: one perturbed motion and its step per unknown.
#[derive(Clone, Debug)]
pub(crate) struct Tangents {
    pub perturbed: Vec<Trajectories>,
    pub steps: Vec<f64>,
    /// Whether they belong to the present state rather than being carried along.
    fresh: bool,
}

impl Tangents {
    /// Residuals around `trajectories`, to which these belong, kept apart by where they come from.
    pub(crate) fn blocks(&self, problem: &Problem, trajectories: &Trajectories) -> Vec<ResidualBlock> {
        problem.objective.blocks(trajectories, &self.perturbed, &self.steps, &problem.selection)
    }

    /// Whether they were measured where they are, rather than carried there.
    pub(crate) fn is_fresh(&self) -> bool {
        self.fresh
    }

    /// One forward run per unknown from `state`, whose own `motion` is known. A perturbation that fails is tried in the other direction.
    pub(crate) fn measure(problem: &Problem, state: &State, trajectories: &Trajectories) -> Result<Tangents, String> {
        Tangents::runs(problem, state).map(|runs| Tangents::of_runs(runs, trajectories))
    }

    /// The motion at `state` and its tangents: one forward run more than there are unknowns, all side by side.
    pub(crate) fn measure_with_motion(
        problem: &Problem,
        state: &State,
    ) -> (Result<Trajectories, String>, Result<Tangents, String>) {
        let (trajectories, runs) =
            rayon::join(|| problem.forward.trajectories(state, &problem.selection), || Tangents::runs(problem, state));
        let tangents = trajectories.as_ref().map_err(Clone::clone).and_then(|m| Ok(Tangents::of_runs(runs?, m)));
        (trajectories, tangents)
    }

    /// A perturbed motion and its step per unknown; no motion where only the drawing changes.
    fn runs(problem: &Problem, state: &State) -> Result<Vec<(Option<Trajectories>, f64)>, String> {
        let run = |unknown: &Unknown| {
            let step = unknown.difference_step(problem.parameters);
            if *unknown == Unknown::Splat {
                return Ok((None, step));
            }
            let (_, high) = unknown.limits(problem.parameters);
            let forward = if state.get(*unknown) + step <= high { step } else { -step };
            let run = |step: f64| {
                let moved = state.moved(&[*unknown], &[step], problem.parameters);
                problem.forward.trajectories(&moved, &problem.selection).map(|m| (Some(m), step))
            };
            run(forward).or_else(|_| run(-forward))
        };
        problem.unknowns.par_iter().with_max_len(1).map(run).collect()
    }

    fn of_runs(runs: Vec<(Option<Trajectories>, f64)>, trajectories: &Trajectories) -> Tangents {
        let drawn =
            |(run, step): (Option<Trajectories>, f64)| (run.unwrap_or_else(|| trajectories.drawn_wider(step)), step);
        let (perturbed, steps) = runs.into_iter().map(drawn).unzip();
        Tangents { perturbed, steps, fresh: true }
    }

    /// Carries the tangents from `old` to `new`, `delta` away, and corrects them by what the step showed (Broyden's rank-one
    /// update, on the particles' positions): an iteration then costs one forward run instead of one per unknown.
    pub(crate) fn carry(&mut self, problem: &Problem, old: &Trajectories, new: &Trajectories, delta: &[f64]) {
        // In units of the difference steps; the drawing's own unknown moves no particle.
        let moved: Vec<f64> = (problem.unknowns.iter().zip(delta).zip(&self.steps))
            .map(|((unknown, d), step)| if *unknown == Unknown::Splat { 0.0 } else { d / step })
            .collect();
        let square: f64 = moved.iter().map(|u| u * u).sum();
        let gains: Vec<f32> = moved.iter().map(|u| if square > 0.0 { (u / square) as f32 } else { 0.0 }).collect();
        let moved: Vec<f32> = moved.iter().map(|u| *u as f32).collect();
        for o in 0..new.positions.len() {
            for i in 0..new.positions[o].len() {
                for axis in 0..3 {
                    let (was, is) = (old.positions[o][i][axis], new.positions[o][i][axis]);
                    let mut rest = is - was;
                    for (trajectories, u) in self.perturbed.iter().zip(&moved) {
                        rest -= u * (trajectories.positions[o][i][axis] - was);
                    }
                    for (trajectories, gain) in self.perturbed.iter_mut().zip(&gains) {
                        let slot = &mut trajectories.positions[o][i][axis];
                        *slot = is + (*slot - was) + gain * rest;
                    }
                }
            }
            for i in 0..new.scales[o].len() {
                let (was, is) = (old.scales[o][i], new.scales[o][i]);
                for trajectories in &mut self.perturbed {
                    trajectories.scales[o][i] = (trajectories.scales[o][i] - was + is).max(0.1 * is);
                }
            }
        }
        for ((trajectories, unknown), step) in self.perturbed.iter_mut().zip(&problem.unknowns).zip(&self.steps) {
            trajectories.splat_factor = new.splat_factor;
            trajectories.outward_displacements =
                sum_of(&new.outward_displacements, &trajectories.outward_displacements, &old.outward_displacements);
            if *unknown == Unknown::Splat {
                *trajectories = new.drawn_wider(*step);
            }
        }
        self.fresh = false;
    }
}

/// a + b - c; those that are missing are zero.
fn sum_of(a: &[f32], b: &[f32], c: &[f32]) -> Vec<f32> {
    let at = |v: &[f32], i: usize| v.get(i).copied().unwrap_or(0.0);
    (0..a.len().max(b.len()).max(c.len())).map(|i| at(a, i) + at(b, i) - at(c, i)).collect()
}
