//! The material stage: the valleys of the starts, walked to their ends, and those next door.

use crate::IdentifyError;
use crate::forward::simulation::Simulation;
use crate::result::Stage;
use crate::settings::Optimizer;
use crate::solve::adam::adam;
use crate::solve::levenberg_marquardt::{Fit, Iterate, Limits};
use crate::solve::normal_equations::Normal;
use crate::solve::problem::Problem;
use crate::stages::free_flight::FreeFlightFit;
use crate::stages::{BLUR, Identification};
use crate::unknowns::state::{State, Unknown};

/// Steps from each start, from the best of them, and with sharper masks.
const SHORT_FIT: usize = 5;
const LONG_FIT: usize = 14;
const SHARP_FIT: usize = 8;

/// Steps before a search may be given up.
const STEPS_BEFORE_GIVING_UP: usize = 2;

/// How much more than the best a start may cost during its short fit.
const GIVE_UP_COST_RATIO: f64 = 3.0;

/// How much more than the best a start may cost after its short fit to be fitted on.
const CONTINUE_COST_RATIO: f64 = 1.3;

/// How much more than the deepest a valley may cost at its end to be tried with sharper masks.
const SHARPEN_COST_RATIO: f64 = 1.05;

/// How far beyond a valley's walls to look, in the parameters' coordinates: a factor of two in a modulus, and where that leads nowhere, one of
/// 1.26. A stiff ring that comes down on its rim has valleys that narrow.
const RESTART_DISTANCES: [f64; 2] = [0.3, 0.1];

/// A probe counts where it undercuts the valley's curvature by more than this share of the cost: what a walk may leave where it ends.
const LEAST_RESTART_GAIN: f64 = 0.01;

/// Valleys that may be left for the next one.
const MOST_RESTARTS: usize = 3;

/// Pooling of the last steps of the material stage.
const SHARP: usize = 2;

impl Identification<'_> {
    /// Material from the best starts, with the velocity of stage 1.
    pub(crate) fn fit_material(&self, flight_fit: &FreeFlightFit, starts: Vec<State>) -> Result<State, IdentifyError> {
        let failed = self.failure(starts.len());
        if self.settings.optimizer == Optimizer::Adam {
            let iterations = self.settings.adam_iterations;
            let start = starts.into_iter().next().ok_or(IdentifyError::Interrupted)?;
            return adam(self, flight_fit.free, start, iterations).map_err(failed);
        }
        let simulation = self.simulation(flight_fit.free);
        let fit_until = |start: State, pooling: usize, iterations: usize, is_idle: &dyn Fn(&Iterate) -> bool| {
            let (unknowns, selection) = (self.free_materials(), self.touched_frames(flight_fit, pooling));
            let limits = Limits { iterations, ..Limits::ROUGH };
            let is_idle = |step: &Iterate| step.steps >= STEPS_BEFORE_GIVING_UP && is_idle(step);
            let objective = self.base_objective();
            self.minimise(Stage::Material, &simulation, objective, unknowns, selection, start, limits, &is_idle)
        };
        let fit = |start: State, pooling: usize, iterations: usize| fit_until(start, pooling, iterations, &|_| false);
        // Some steps from each start tell which valley is worth the rest; those that have arrived stop earlier.
        let done = self.checkpoint.borrow().fits.len();
        let mut reason = String::new();
        for start in starts.into_iter().skip(done) {
            let best = self.checkpoint.borrow().fits.iter().flatten().map(|fit| fit.0).fold(f64::INFINITY, f64::min);
            let found = fit_until(start, BLUR, SHORT_FIT, &|step| step.cost > GIVE_UP_COST_RATIO * best);
            let found = found.map(|fit| (fit.cost, fit.state)).map_err(|e| reason = e).ok();
            if self.stopped.get() {
                return Err(IdentifyError::Interrupted);
            }
            self.reach(None, |checkpoint| checkpoint.fits.push(found))?;
        }
        let fits = self.checkpoint.borrow().fits.clone();
        // Valleys that are about as deep so far are walked to their ends, and those next door to the deepest.
        let mut ends: Vec<Fit> = Vec::new();
        for state in self.contenders(fits.into_iter().flatten().collect(), CONTINUE_COST_RATIO) {
            // What comes down into a valley that was walked already would end where that walk did.
            let is_known = |step: &Iterate| {
                ends.iter().any(|end| end.cost <= step.cost && self.same_minimum(&end.state, &step.state))
            };
            match fit_until(state, BLUR, LONG_FIT, &is_known) {
                Ok(found) => ends.push(found),
                Err(e) => reason = e,
            }
            if self.stopped.get() {
                return Err(IdentifyError::Interrupted);
            }
        }
        let (mut walks, mut distances) = (0, RESTART_DISTANCES.iter());
        while let Some(distance) = distances.next().filter(|_| walks < MOST_RESTARTS) {
            ends.sort_by(|a, b| a.cost.total_cmp(&b.cost));
            let Some(best) = ends.first() else { return Err(failed(reason)) };
            let beyond = self.beyond(&simulation, flight_fit, best, *distance)?;
            let Some(Ok(found)) = beyond.map(|state| fit(state, BLUR, LONG_FIT)) else { continue };
            walks += 1;
            // Back in the valley that was left, or in a shallower one, there is nothing new next door, but there may be nearer by.
            if found.cost < best.cost && !self.same_minimum(&found.state, &best.state) {
                distances = RESTART_DISTANCES.iter();
            }
            ends.push(found);
        }
        ends.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        if self.stopped.get() {
            return Err(IdentifyError::Interrupted);
        }
        // Which of several that are as deep as each other is right shows in sharper masks.
        let mut finalists =
            self.contenders(ends.into_iter().map(|end| (end.cost, end.state)).collect(), SHARPEN_COST_RATIO);
        if !self.settings.target.masks() {
            return Ok(finalists.swap_remove(0));
        }
        let sharp: Vec<Fit> = finalists
            .into_iter()
            .map(|state| fit(state, SHARP, SHARP_FIT))
            .collect::<Result<_, _>>()
            .map_err(&failed)?;
        let best = sharp.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost));
        best.map(|fit| fit.state).ok_or_else(|| failed(reason))
    }

    /// Distinct states that cost at most `factor` times as much as the cheapest of `fits`, cheapest first.
    fn contenders(&self, mut fits: Vec<(f64, State)>, factor: f64) -> Vec<State> {
        fits.sort_by(|a, b| a.0.total_cmp(&b.0));
        let most = factor * fits.first().map_or(0.0, |(cost, _)| *cost);
        self.distinct(fits.into_iter().filter(|(cost, _)| *cost <= most).map(|(_, state)| state))
    }

    /// The first of `states` in each valley, in their order.
    pub(crate) fn distinct(&self, states: impl Iterator<Item = State>) -> Vec<State> {
        states.fold(Vec::new(), |mut distinct, state| {
            if !distinct.iter().any(|other| self.same_minimum(other, &state)) {
                distinct.push(state);
            }
            distinct
        })
    }

    /// Whether two states differ little in what tells valleys apart: not in what has one start only.
    fn same_minimum(&self, a: &State, b: &State) -> bool {
        let pairs = a.material.iter().zip(&b.material);
        self.parameters().iter().zip(pairs).filter(|(p, _)| p.grid > 1).all(|(_, (a, b))| (a - b).abs() < 0.2)
    }

    /// Where a deeper valley next to that of `fit` may begin: each parameter of which there are several starts is moved by `distance` both
    /// ways, the others to where they suit it best, and of those that cost little more than `fit` the one counts that undercuts the
    /// valley's curvature most. Along a valley's floor nothing undercuts it.
    fn beyond(
        &self,
        simulation: &Simulation,
        flight_fit: &FreeFlightFit,
        fit: &Fit,
        distance: f64,
    ) -> Result<Option<State>, IdentifyError> {
        let Some(tangents) = &fit.tangents else { return Ok(None) };
        let problem = Problem {
            forward: simulation,
            objective: self.base_objective(),
            unknowns: self.free_materials(),
            parameters: self.parameters(),
            selection: self.touched_frames(flight_fit, BLUR),
            prior: None,
        };
        let normal = problem.normal(&tangents.blocks(&problem, &fit.trajectories), &fit.state);
        let (predicted, states): (Vec<f64>, Vec<State>) = (0..problem.unknowns.len())
            .filter(|k| self.is_varied(&problem.unknowns[*k]))
            .flat_map(|k| [(k, distance), (k, -distance)])
            .filter_map(|(k, distance)| probe(&problem, &normal, fit, (k, distance)))
            .unzip();
        let costs = self.costs(simulation, problem.objective, &states, &problem.selection)?;
        let undercut = |((cost, predicted), state): ((Result<f64, String>, f64), State)| {
            let most = (predicted - LEAST_RESTART_GAIN * fit.cost).min(CONTINUE_COST_RATIO * fit.cost);
            let cost = cost.ok().filter(|cost| *cost < most)?;
            Some((predicted - cost, state))
        };
        let probes = costs.into_iter().zip(predicted).zip(states).filter_map(undercut);
        Ok(probes.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, state)| state))
    }
}

/// The state with the `k`-th unknown moved by `distance`, and what the quadratic model foretells that it costs.
fn probe(problem: &Problem, normal: &Normal, fit: &Fit, (k, distance): (usize, f64)) -> Option<(f64, State)> {
    let step = normal.step_along(k, distance)?;
    let short = |(i, unknown): (usize, &Unknown)| {
        let most = unknown.largest_step(problem.parameters);
        if i == k { step[i] } else { step[i].clamp(-most, most) }
    };
    let step: Vec<f64> = problem.unknowns.iter().enumerate().map(short).collect();
    let (state, delta) = problem.moved(&fit.state, &step);
    (delta[k] != 0.0).then(|| (fit.cost - normal.predicted_decrease(&delta), state))
}
