//! How trajectories change with the unknowns: finite differences of parallel rollouts, carried along by secants in
//! between.

use rayon::prelude::*;

use crate::FitError;
use crate::forward::trajectories::{Neighbour, Trajectories};
use crate::solve::problem::Problem;
use crate::solve::residual_block::ResidualBlock;
use crate::unknowns::state::{State, Unknown};

/// The trajectories of a state and of its neighbours.
#[derive(Clone, Debug)]
pub(crate) struct Linearisation {
    pub trajectories: Trajectories,
    tangents: Tangents,
    /// Those of trajectories and tangents, once they were needed.
    blocks: Option<Vec<ResidualBlock>>,
}

impl Linearisation {
    /// One forward run more than there are unknowns, all side by side.
    pub(crate) fn measure(problem: &Problem, state: &State) -> Result<Linearisation, FitError> {
        let (trajectories, tangents) = Tangents::measure_with_trajectories(problem, state)?;
        Ok(Linearisation::of_parts(trajectories, tangents?))
    }

    /// One forward run per unknown from `state`, whose own `trajectories` are known.
    pub(crate) fn around(
        problem: &Problem,
        state: &State,
        trajectories: Trajectories,
    ) -> Result<Linearisation, FitError> {
        let tangents = Tangents::of_runs(Tangents::runs(problem, state, &problem.unknowns)?);
        Ok(Linearisation::of_parts(trajectories, tangents))
    }

    /// Carried to the `new` trajectories, `delta` away.
    pub(crate) fn carried(mut self, new: Trajectories, delta: &[f64]) -> Linearisation {
        self.tangents.carry(&self.trajectories, &new, delta);
        Linearisation::of_parts(new, self.tangents)
    }

    /// Carried from a state to another one far away, where the tangents of the material are measured: those of all else
    /// hang less on it, and they are many.
    ///
    /// # Errors
    /// Where the other state or its neighbours cannot be simulated.
    pub(crate) fn carried_far(&self, problem: &Problem, state: &State) -> Result<Linearisation, FitError> {
        let is_of_material = |(_, unknown): &(usize, Unknown)| matches!(unknown, Unknown::Material(_) | Unknown::Cell);
        let (places, material): (Vec<usize>, Vec<Unknown>) =
            problem.unknowns.iter().copied().enumerate().filter(is_of_material).unzip();
        let (there, runs) = rayon::join(
            || problem.forward.trajectories(state, &problem.selection),
            || Tangents::runs(problem, state, &material),
        );
        // Unlike a small move, a large one shows no slope.
        let mut carried = self.clone().carried(there?, &vec![0.0; problem.unknowns.len()]);
        carried.tangents.replace(&places, runs?);
        Ok(carried)
    }

    /// The same for an objective that compares other things.
    pub(crate) fn drawn_anew(self) -> Linearisation {
        Linearisation { blocks: None, ..self }
    }

    /// Whether the tangents were measured where they are, rather than carried there.
    pub(crate) fn is_fresh(&self) -> bool {
        self.tangents.fresh
    }

    /// Residuals with their Jacobian, kept apart by where they come from. They depend on the problem's objective, but
    /// not on its weights.
    pub(crate) fn blocks(&mut self, problem: &Problem) -> &[ResidualBlock] {
        self.blocks.get_or_insert_with(|| self.tangents.blocks(problem, &self.trajectories))
    }

    /// Of trajectories and their tangents.
    pub(crate) fn of_parts(trajectories: Trajectories, tangents: Tangents) -> Linearisation {
        Linearisation { trajectories, tangents, blocks: None }
    }

    /// The same for a problem with some of the unknowns.
    pub(crate) fn of_unknowns(self, is_left: impl Fn(usize) -> bool) -> Linearisation {
        Linearisation::of_parts(self.trajectories, self.tangents.of_unknowns(is_left))
    }

    /// The trajectories and their tangents.
    pub(crate) fn into_parts(self) -> (Trajectories, Tangents) {
        (self.trajectories, self.tangents)
    }
}

/// How trajectories change with each unknown: neighbours and how far they are, shape [unknowns].
#[derive(Clone, Debug)]
pub(crate) struct Tangents {
    neighbours: Vec<Neighbour>,
    steps: Vec<f64>,
    /// Whether they belong to the present state rather than being carried along.
    fresh: bool,
}

impl Tangents {
    /// The trajectories at `state` and their tangents.
    ///
    /// # Errors
    /// Where the state itself cannot be simulated; the inner error is that of a neighbour.
    pub(crate) fn measure_with_trajectories(
        problem: &Problem,
        state: &State,
    ) -> Result<(Trajectories, Result<Tangents, FitError>), FitError> {
        let (trajectories, runs) = rayon::join(
            || problem.forward.trajectories(state, &problem.selection),
            || Tangents::runs(problem, state, &problem.unknowns),
        );
        let trajectories = trajectories?;
        let tangents = runs.map(Tangents::of_runs);
        Ok((trajectories, tangents))
    }

    /// Adds a column for something that the fit held: `trajectories` a unit of it away.
    pub(crate) fn push(&mut self, trajectories: Trajectories) {
        self.neighbours.push(Neighbour::moved(trajectories));
        self.steps.push(1.0);
    }

    /// Those of some of the unknowns.
    pub(crate) fn of_unknowns(self, is_left: impl Fn(usize) -> bool) -> Tangents {
        let all = self.neighbours.into_iter().zip(self.steps).enumerate();
        let (neighbours, steps) = all.filter(|(k, _)| is_left(*k)).map(|(_, run)| run).unzip();
        Tangents { neighbours, steps, fresh: self.fresh }
    }

    /// Residuals around `trajectories`, to which these belong, with their Jacobian.
    pub(crate) fn blocks(&self, problem: &Problem, trajectories: &Trajectories) -> Vec<ResidualBlock> {
        problem.objective.blocks(trajectories, &self.neighbours, &self.steps, &problem.selection)
    }

    /// Puts `runs` that were measured in the `places` of those that were carried there.
    fn replace(&mut self, places: &[usize], runs: Vec<(Neighbour, f64)>) {
        for (k, (neighbour, step)) in places.iter().zip(runs) {
            (self.neighbours[*k], self.steps[*k]) = (neighbour, step);
        }
        self.fresh = places.len() == self.steps.len();
    }

    /// A neighbour and its step for each of the `unknowns`. A perturbation that fails is tried in the other direction.
    fn runs(problem: &Problem, state: &State, unknowns: &[Unknown]) -> Result<Vec<(Neighbour, f64)>, FitError> {
        let run = |unknown: &Unknown| {
            let step = problem.coordinates.difference(*unknown);
            if unknown.is_of_drawing() {
                return Ok((Neighbour::Drawn(*unknown), step));
            }
            let (_, high) = problem.coordinates.limits(*unknown);
            let forward = if state.get(*unknown) + step <= high { step } else { -step };
            let run = |step: f64| {
                let moved = problem.coordinates.moved(state, &[*unknown], &[step]);
                problem.forward.trajectories(&moved, &problem.selection).map(|m| (Neighbour::moved(m), step))
            };
            run(forward).or_else(|_| run(-forward))
        };
        unknowns.par_iter().with_max_len(1).map(run).collect()
    }

    fn of_runs(runs: Vec<(Neighbour, f64)>) -> Tangents {
        let (neighbours, steps) = runs.into_iter().unzip();
        Tangents { neighbours, steps, fresh: true }
    }

    /// Carries the tangents from `old` to `new`, `delta` away, and corrects them by what the step showed.
    ///
    /// Broyden's rank-one update on the particles' positions x, with the move u in difference steps and the tangents
    /// `dx_k`: `dx_k += u_k / |u|^2 (x_new - x_old - sum_j u_j dx_j)`. An iteration then costs one forward run instead
    /// of one per unknown.
    fn carry(&mut self, old: &Trajectories, new: &Trajectories, delta: &[f64]) {
        self.fresh = false;
        let neighbours = self.neighbours.iter_mut().zip(delta.iter().zip(&self.steps));
        // With the moves in units of the difference steps.
        let mut runs: Vec<(&mut Trajectories, f64)> = neighbours
            .filter_map(|(neighbour, (d, step))| match neighbour {
                Neighbour::Moved(run) => Some((run, d / step)),
                Neighbour::Drawn(_) => None,
            })
            .collect();
        let square: f64 = runs.iter().map(|(_, u)| u * u).sum();
        let gain = |u: &f64| if square > 0.0 { (u / square) as f32 } else { 0.0 };
        let gains: Vec<f32> = runs.iter().map(|(_, u)| gain(u)).collect();
        for o in 0..new.positions.len() {
            for i in 0..new.positions[o].len() {
                for axis in 0..3 {
                    let (was, is) = (old.positions[o][i][axis], new.positions[o][i][axis]);
                    let mut rest = is - was;
                    for (run, u) in &runs {
                        rest -= *u as f32 * (run.positions[o][i][axis] - was);
                    }
                    for ((run, _), gain) in runs.iter_mut().zip(&gains) {
                        let slot = &mut run.positions[o][i][axis];
                        *slot = is + (*slot - was) + gain * rest;
                    }
                }
            }
            for i in 0..new.scales[o].len() {
                let (was, is) = (old.scales[o][i], new.scales[o][i]);
                for (run, _) in &mut runs {
                    run.scales[o][i] = (run.scales[o][i] - was + is).max(0.0);
                }
            }
        }
        for (run, _) in runs {
            run.outward_displacements =
                sum_of(&new.outward_displacements, &run.outward_displacements, &old.outward_displacements);
        }
    }
}

/// a + b - c; those that are missing are zero.
fn sum_of(a: &[f32], b: &[f32], c: &[f32]) -> Vec<f32> {
    let at = |v: &[f32], i: usize| v.get(i).copied().unwrap_or(0.0);
    (0..a.len().max(b.len()).max(c.len())).map(|i| at(a, i) + at(b, i) - at(c, i)).collect()
}
