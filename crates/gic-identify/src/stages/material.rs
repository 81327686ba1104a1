//! Stage 3: the material, with the motion of free flight.
//!
//! The cost has several local minima. At first the material alone is fitted, in the world and on the cells that are
//! given: far from the best fit, cells of another size make up for what the material lacks, and lead away. A step from
//! each start tells which are worth the rest; those that cost not much more than the best are fitted on. The best goes
//! on with everything that is sought. Then each parameter of it is doubled and halved, the others following the
//! quadratic model, and the fit starts again where that costs less than the model predicts. Of minima that cost about
//! the same, sharper masks decide.

use crate::forward::simulation::Simulation;
use crate::result::Stage;
use crate::session::Session;
use crate::settings::Optimizer;
use crate::solve::levenberg_marquardt::{Fit, Iterate, Limits};
use crate::solve::problem::Problem;
use crate::stages::adam::adam;
use crate::stages::candidates::{cheapest, same_minimum};
use crate::stages::identification::Identification;
use crate::stages::neighbours::neighbouring_start;
use crate::tuning::MaterialTuning;
use crate::unknowns::state::{State, Unknown};
use crate::{FitError, IdentifyError};

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
    let tuning = &identification.tuning.material;
    let iterations = identification.settings.iterations;
    let stage = MaterialStage { identification, simulation: &identification.simulation(), tuning, iterations };
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
    tuning: &'a MaterialTuning,
    /// Most steps of a fit to its end.
    iterations: usize,
}

impl MaterialStage<'_> {
    fn fit(&self, session: &mut Session, starts: Vec<State>) -> Result<State, FitError> {
        self.first_steps(session, starts)?;
        let fits = session.checkpoint().fits.clone();
        let minima = self.local_minima(session, fits.into_iter().flatten().collect())?;
        let minima = self.best_with_everything(session, minima)?;
        let minima = self.neighbouring_minima(session, minima)?;
        self.best_when_sharp(session, minima)
    }

    /// A step from each start. What they found goes into the checkpoint.
    fn first_steps(&self, session: &mut Session, starts: Vec<State>) -> Result<(), FitError> {
        let done = session.checkpoint().fits.len();
        let mut failure = FitError::NoIteration;
        let problem = self.material_alone();
        for start in starts.into_iter().skip(done) {
            let found = match self.fit_until(session, (&problem, start), 1, &|_| false) {
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
        let (problem, space) = (self.material_alone(), self.identification.minimum_space());
        for state in cheapest(&space, fits, self.tuning.most_cost_ratio) {
            // What comes down into a minimum that is known would end there.
            let is_known = |step: &Iterate| {
                let same = |end: &Fit| end.cost <= step.cost && same_minimum(&space, &end.state, &step.state);
                minima.iter().any(same)
            };
            match self.fit_until(session, (&problem, state), self.iterations, &is_known) {
                Ok(found) => minima.push(found),
                Err(FitError::Interrupted) => return Err(FitError::Interrupted),
                Err(reason) => failure = reason,
            }
        }
        if minima.is_empty() { Err(failure) } else { Ok(minima) }
    }

    /// The same minima, cheapest first, of which the best has gone on with everything that is sought.
    fn best_with_everything(&self, session: &mut Session, mut minima: Vec<Fit>) -> Result<Vec<Fit>, FitError> {
        minima.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        let problem = self.everything();
        if problem.unknowns != self.material_alone().unknowns {
            let best = minima[0].state.clone();
            minima[0] = self.fit_until(session, (&problem, best), self.iterations, &|_| false)?;
        }
        Ok(minima)
    }

    /// `minima` and those that fits from neighbours of the best find: at the long distance, and at the short one where
    /// that leads nowhere.
    fn neighbouring_minima(&self, session: &mut Session, mut minima: Vec<Fit>) -> Result<Vec<Fit>, FitError> {
        let problem = self.everything();
        let space = self.identification.minimum_space();
        let (long, short) = self.tuning.restart_distances;
        let (mut restarts, mut distances) = (0, [long, short].into_iter());
        while let Some(distance) = distances.next().filter(|_| restarts < self.tuning.most_restarts) {
            minima.sort_by(|a, b| a.cost.total_cmp(&b.cost));
            // Each parameter of which there are several starts is moved.
            let far = |unknown: &Unknown| self.identification.is_varied(unknown).then_some(distance);
            let ratio = self.tuning.most_cost_ratio;
            let Some(start) = neighbouring_start(session, &problem, &mut minima[0], &far, ratio)? else { continue };
            let found = match self.fit_until(session, (&problem, start), self.iterations, &|_| false) {
                Ok(found) => found,
                Err(FitError::Interrupted) => return Err(FitError::Interrupted),
                Err(_) => continue,
            };
            restarts += 1;
            // Back in the minimum that was left, or in a worse one, there is nothing new around, but there may be
            // nearer by.
            if found.cost < minima[0].cost && !same_minimum(&space, &found.state, &minima[0].state) {
                distances = [long, short].into_iter();
            }
            minima.push(found);
        }
        minima.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        Ok(minima)
    }

    /// Which of several minima that cost about the same is right shows in sharper masks.
    fn best_when_sharp(&self, session: &mut Session, minima: Vec<Fit>) -> Result<State, FitError> {
        let ends = minima.into_iter().map(|end| (end.cost, end.state)).collect();
        let mut finalists = cheapest(&self.identification.minimum_space(), ends, self.tuning.most_cost_ratio);
        if !self.identification.settings.target.masks() {
            return Ok(finalists.swap_remove(0));
        }
        let problem = self.identification.material_problem(self.simulation, 1);
        let mut sharp: Vec<Fit> = Vec::new();
        for state in finalists {
            sharp.push(self.fit_until(session, (&problem, state), self.iterations, &|_| false)?);
        }
        let best = sharp.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost));
        best.map(|fit| fit.state).ok_or(FitError::NoIteration)
    }

    fn fit_until(
        &self,
        session: &mut Session,
        (problem, start): (&Problem, State),
        iterations: usize,
        is_enough: &dyn Fn(&Iterate) -> bool,
    ) -> Result<Fit, FitError> {
        let limits = Limits::rough(iterations, problem.descent);
        session.minimise(Stage::Material, problem, (start, None), limits, is_enough)
    }

    /// The fit of everything that is sought to blurred masks.
    fn everything(&self) -> Problem<'_> {
        self.identification.material_problem(self.simulation, self.identification.tuning.masks.blur_pooling)
    }

    /// The same of the material alone; of everything where no parameter of it is sought.
    fn material_alone(&self) -> Problem<'_> {
        let everything = self.everything();
        let unknowns = self.identification.free_materials();
        if unknowns.is_empty() { everything } else { Problem { unknowns, ..everything } }
    }
}
