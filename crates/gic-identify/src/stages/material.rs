//! Stage 3: the material, with the motion of free flight.
//!
//! The cost has several local minima. At first the material alone is fitted, in the world and on the cells that are
//! given: far from the best fit, cells of another size make up for what the material lacks, and lead away. A step from
//! each start tells which are worth the rest; those that cost not much more than the best are fitted on. The best goes
//! on with everything that is sought, and looks over the walls of its minimum. Of minima that cost about the same,
//! sharper masks decide.

use crate::forward::simulation::Simulation;
use crate::result::Stage;
use crate::session::Session;
use crate::settings::Optimizer;
use crate::solve::levenberg_marquardt::{Fit, Iterate, Limits};
use crate::solve::problem::Problem;
use crate::stages::adam::adam;
use crate::stages::basin::Basin;
use crate::stages::candidates::cheapest;
use crate::stages::identification::Identification;
use crate::stages::neighbours::{Walls, of_material_alone};
use crate::tuning::MaterialTuning;
use crate::unknowns::state::State;
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
        let minima = self.local_minima(session, &self.material_alone(), fits.into_iter().flatten().collect())?;
        let minima = self.best_with_everything(session, minima)?;
        let minima = self.and_neighbouring(session, minima)?;
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

    /// The distinct ends of fits that start from those of `fits` that are about as good.
    fn local_minima(
        &self,
        session: &mut Session,
        problem: &Problem,
        fits: Vec<(f64, State)>,
    ) -> Result<Vec<Fit>, FitError> {
        let mut minima: Vec<Fit> = Vec::new();
        let mut failure = FitError::NoIteration;
        let mut known = Vec::new();
        for state in cheapest(fits, self.tuning.most_cost_ratio) {
            // What comes down into a minimum that is known would end there.
            let is_known = |step: &Iterate| known.iter().any(|basin: &Basin| basin.holds(step));
            match self.fit_until(session, (problem, state), self.iterations, &is_known) {
                Ok(found) if is_known(&found.end()) => (),
                Ok(mut found) => {
                    known.push(Basin::of(problem, &mut found));
                    minima.push(found);
                }
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

    /// `minima` and those around the best.
    fn and_neighbouring(&self, session: &mut Session, mut minima: Vec<Fit>) -> Result<Vec<Fit>, FitError> {
        let problem = self.everything();
        let (best, others) = Walls {
            stage: Stage::Material,
            everything: &problem,
            limits: Limits::rough(self.iterations, problem.descent),
            material_alone: &self.material_alone(),
            tuning: self.tuning,
        }
        .look_over(session, minima.swap_remove(0))?;
        minima.push(best);
        minima.extend(others);
        Ok(minima)
    }

    /// Which of several minima that cost about the same is right shows in sharper masks.
    fn best_when_sharp(&self, session: &mut Session, minima: Vec<Fit>) -> Result<State, FitError> {
        let ends = minima.into_iter().map(|end| (end.cost, end.state)).collect();
        if !self.identification.settings.target.masks() {
            return cheapest(ends, 1.0).pop().ok_or(FitError::NoIteration);
        }
        let problem = self.identification.material_problem(self.simulation, 1);
        let sharp = self.local_minima(session, &problem, ends)?;
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
        of_material_alone(self.identification, &self.everything())
    }
}
