//! Stage 3: the material, with the motion of free flight.
//!
//! The cost has several local minima. A few steps from each start tell which are worth the rest; those that cost little more than the best
//! are fitted on. Then each parameter of the best fit is doubled and halved, the others following the quadratic model, and the fit starts
//! again where that costs less than the model predicts. Of minima that cost about the same, sharper masks decide.

use crate::forward::simulation::Simulation;
use crate::result::Stage;
use crate::session::Session;
use crate::settings::Optimizer;
use crate::solve::levenberg_marquardt::{Fit, Iterate, Limits};
use crate::solve::normal_equations::Normal;
use crate::solve::problem::Problem;
use crate::stages::adam::adam;
use crate::stages::candidates::{cheapest, costs, same_minimum};
use crate::stages::identification::{BLUR, Identification};
use crate::unknowns::state::{State, Unknown};
use crate::{FitError, IdentifyError};

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

/// Material from the best starts, with the velocity of stage 1. It goes into the checkpoint.
///
/// # Errors
/// Where no start can be simulated, and interruption.
pub(crate) fn fit_material(
    identification: &Identification,
    session: &mut Session,
    starts: Vec<State>,
) -> Result<State, IdentifyError> {
    let count = starts.len();
    let stage = MaterialStage { identification, simulation: &identification.simulation() };
    let fitted = match identification.settings.optimizer {
        Optimizer::Adam => adam(identification, session, starts),
        Optimizer::LevenbergMarquardt => stage.fit(session, starts),
    };
    let state = fitted.map_err(|error| error.of_stage(count))?;
    let reached = session.reach(Some(Stage::Material), |checkpoint| checkpoint.material = Some(state.clone()));
    reached.map_err(|error| error.of_stage(count))?;
    Ok(state)
}

struct MaterialStage<'a> {
    identification: &'a Identification<'a>,
    simulation: &'a Simulation<'a>,
}

impl MaterialStage<'_> {
    fn fit(&self, session: &mut Session, starts: Vec<State>) -> Result<State, FitError> {
        self.short_fits(session, starts)?;
        let fits = session.checkpoint().fits.clone();
        let minima = self.local_minima(session, fits.into_iter().flatten().collect())?;
        let minima = self.neighbouring_minima(session, minima)?;
        self.best_when_sharp(session, minima)
    }

    /// Some steps from each start. What they found goes into the checkpoint.
    fn short_fits(&self, session: &mut Session, starts: Vec<State>) -> Result<(), FitError> {
        let done = session.checkpoint().fits.len();
        let mut failure = FitError::NoIteration;
        for start in starts.into_iter().skip(done) {
            let fits = session.checkpoint().fits.iter().flatten();
            let best = fits.map(|fit| fit.0).fold(f64::INFINITY, f64::min);
            let is_hopeless = |step: &Iterate| step.cost > GIVE_UP_COST_RATIO * best;
            let found = match self.fit_until(session, start, (BLUR, SHORT_FIT), &is_hopeless) {
                Ok(fit) => Some((fit.cost, fit.state)),
                Err(FitError::Interrupted) => return Err(FitError::Interrupted),
                Err(reason) => {
                    failure = reason;
                    None
                }
            };
            session.reach(None, |checkpoint| checkpoint.fits.push(found))?;
        }
        if session.checkpoint().fits.iter().all(Option::is_none) { Err(failure) } else { Ok(()) }
    }

    /// The ends of the fits that are about as good so far.
    fn local_minima(&self, session: &mut Session, fits: Vec<(f64, State)>) -> Result<Vec<Fit>, FitError> {
        let mut minima: Vec<Fit> = Vec::new();
        let mut failure = FitError::NoIteration;
        let parameters = self.identification.parameters();
        for state in cheapest(parameters, fits, CONTINUE_COST_RATIO) {
            // What comes down into a minimum that is known would end there.
            let is_known = |step: &Iterate| {
                let same = |end: &Fit| end.cost <= step.cost && same_minimum(parameters, &end.state, &step.state);
                minima.iter().any(same)
            };
            match self.fit_until(session, state, (BLUR, LONG_FIT), &is_known) {
                Ok(found) => minima.push(found),
                Err(FitError::Interrupted) => return Err(FitError::Interrupted),
                Err(reason) => failure = reason,
            }
        }
        if minima.is_empty() { Err(failure) } else { Ok(minima) }
    }

    /// `minima` and those that fits from neighbours of the best find: at the long distance, and at the short one where that leads nowhere.
    fn neighbouring_minima(&self, session: &mut Session, mut minima: Vec<Fit>) -> Result<Vec<Fit>, FitError> {
        let parameters = self.identification.parameters();
        let (mut restarts, mut distances) = (0, RESTART_DISTANCES.iter());
        while let Some(distance) = distances.next().filter(|_| restarts < MOST_RESTARTS) {
            minima.sort_by(|a, b| a.cost.total_cmp(&b.cost));
            let Some(start) = self.neighbouring_start(session, &mut minima[0], *distance)? else { continue };
            let found = match self.fit_until(session, start, (BLUR, LONG_FIT), &|_| false) {
                Ok(found) => found,
                Err(FitError::Interrupted) => return Err(FitError::Interrupted),
                Err(_) => continue,
            };
            restarts += 1;
            // Back in the minimum that was left, or in a worse one, there is nothing new around, but there may be nearer by.
            if found.cost < minima[0].cost && !same_minimum(parameters, &found.state, &minima[0].state) {
                distances = RESTART_DISTANCES.iter();
            }
            minima.push(found);
        }
        minima.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        Ok(minima)
    }

    /// Which of several minima that cost about the same is right shows in sharper masks.
    fn best_when_sharp(&self, session: &mut Session, minima: Vec<Fit>) -> Result<State, FitError> {
        let ends = minima.into_iter().map(|end| (end.cost, end.state)).collect();
        let mut finalists = cheapest(self.identification.parameters(), ends, SHARPEN_COST_RATIO);
        if !self.identification.settings.target.masks() {
            return Ok(finalists.swap_remove(0));
        }
        let mut sharp: Vec<Fit> = Vec::new();
        for state in finalists {
            sharp.push(self.fit_until(session, state, (SHARP, SHARP_FIT), &|_| false)?);
        }
        let best = sharp.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost));
        best.map(|fit| fit.state).ok_or(FitError::NoIteration)
    }

    fn fit_until(
        &self,
        session: &mut Session,
        start: State,
        (pooling, iterations): (usize, usize),
        is_enough: &dyn Fn(&Iterate) -> bool,
    ) -> Result<Fit, FitError> {
        let problem = self.identification.material_problem(self.simulation, pooling);
        let limits = Limits { iterations, ..Limits::ROUGH };
        let is_enough = |step: &Iterate| step.steps >= STEPS_BEFORE_GIVING_UP && is_enough(step);
        session.minimise(Stage::Material, &problem, (start, None), limits, &is_enough)
    }

    /// Where a better minimum next to that of `fit` may begin: each parameter of which there are several starts is moved by `distance` both
    /// ways, the others to where they suit it best. Of those that cost little more than `fit` the one counts that costs least in comparison
    /// with what the quadratic model predicts. Along a flat direction of the same minimum none costs less than that.
    fn neighbouring_start(
        &self,
        session: &mut Session,
        fit: &mut Fit,
        distance: f64,
    ) -> Result<Option<State>, FitError> {
        let problem = self.identification.material_problem(self.simulation, BLUR);
        let normal = problem.normal(fit.linearisation.blocks(&problem), &fit.state);
        let (predicted, states): (Vec<f64>, Vec<State>) = (0..problem.unknowns.len())
            .filter(|k| self.identification.is_varied(&problem.unknowns[*k]))
            .flat_map(|k| [(k, distance), (k, -distance)])
            .filter_map(|moved| neighbour(&problem, &normal, fit, moved))
            .unzip();
        let costs = costs(session, (self.simulation, problem.objective), &states, &problem.selection)?;
        let gain = |((cost, predicted), state): ((Result<f64, FitError>, f64), State)| {
            let most = (predicted - LEAST_RESTART_GAIN * fit.cost).min(CONTINUE_COST_RATIO * fit.cost);
            let cost = cost.ok().filter(|cost| *cost < most)?;
            Some((predicted - cost, state))
        };
        let gains = costs.into_iter().zip(predicted).zip(states).filter_map(gain);
        Ok(gains.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, state)| state))
    }
}

/// The state with the `k`-th unknown moved by `distance`, and what the quadratic model predicts that it costs.
fn neighbour(problem: &Problem, normal: &Normal, fit: &Fit, (k, distance): (usize, f64)) -> Option<(f64, State)> {
    let step = normal.step_along(k, distance)?;
    let short = |(i, unknown): (usize, &Unknown)| {
        let most = unknown.largest_step(problem.parameters);
        if i == k { step[i] } else { step[i].clamp(-most, most) }
    };
    let step: Vec<f64> = problem.unknowns.iter().enumerate().map(short).collect();
    let (state, delta) = problem.moved(&fit.state, &step);
    (delta[k] != 0.0).then(|| (fit.cost - normal.predicted_decrease(&delta), state))
}
