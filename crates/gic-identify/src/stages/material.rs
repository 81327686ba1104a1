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
use crate::solve::levenberg_marquardt::{Fit, Limits};
use crate::solve::problem::Problem;
use crate::stages::adam::adam;
use crate::stages::basin::{Basin, fit_outside};
use crate::stages::candidates::cheapest;
use crate::stages::identification::Identification;
use crate::stages::neighbours::Walls;
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
        Optimizer::LevenbergMarquardt => stage.best(session, starts),
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
    fn best(&self, session: &mut Session, starts: Vec<State>) -> Result<State, FitError> {
        self.first_steps(session, starts)?;
        let fits = session.checkpoint().fits.clone();
        let minima = self.local_minima(session, &self.material_alone(), fits.into_iter().flatten().collect())?;
        let minima = self.around_the_best(session, minima)?;
        self.best_when_sharp(session, minima)
    }

    /// A step from each start. What they found goes into the checkpoint.
    fn first_steps(&self, session: &mut Session, starts: Vec<State>) -> Result<(), FitError> {
        let done = session.checkpoint().fits.len();
        let mut failure = FitError::NoIteration;
        let problem = self.material_alone();
        for start in starts.into_iter().skip(done) {
            let found = match self.fit(session, (&problem, start), 1) {
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
            match fit_outside(&known, session, (Stage::Material, problem, self.limits(self.iterations)), state) {
                Ok(None) => (),
                Ok(Some(mut found)) => {
                    known.push(Basin::of(problem, &mut found));
                    minima.push(found);
                }
                Err(FitError::Interrupted) => return Err(FitError::Interrupted),
                Err(reason) => failure = reason,
            }
        }
        if minima.is_empty() { Err(failure) } else { Ok(minima) }
    }

    /// `minima`, of which the best has gone on with everything that is sought, and those around it.
    fn around_the_best(&self, session: &mut Session, mut minima: Vec<Fit>) -> Result<Vec<Fit>, FitError> {
        minima.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        let mut best = minima.swap_remove(0);
        let problem = self.everything();
        if problem.unknowns != self.material_alone().unknowns {
            best = self.fit(session, (&problem, best.state), self.iterations)?;
        }
        let limits = self.limits(self.iterations);
        let walls = Walls { stage: Stage::Material, problem: &problem, limits, tuning: self.tuning };
        let (best, others) = walls.look_over(session, best)?;
        minima.push(best);
        minima.extend(others);
        Ok(minima)
    }

    /// Which of several minima that cost about the same is right shows in sharper masks.
    fn best_when_sharp(&self, session: &mut Session, mut minima: Vec<Fit>) -> Result<State, FitError> {
        if self.identification.settings.target.masks() {
            let ends = minima.into_iter().map(|end| (end.cost, end.state)).collect();
            minima = self.local_minima(session, &self.identification.material_problem(self.simulation, 1), ends)?;
        }
        let best = minima.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost));
        best.map(|fit| fit.state).ok_or(FitError::NoIteration)
    }

    fn fit(
        &self,
        session: &mut Session,
        (problem, start): (&Problem, State),
        iterations: usize,
    ) -> Result<Fit, FitError> {
        session.minimise(Stage::Material, problem, (start, None), self.limits(iterations), &|_| false)
    }

    fn limits(&self, iterations: usize) -> Limits {
        Limits::rough(iterations, &self.identification.tuning.descent)
    }

    /// The fit of everything that is sought to blurred masks.
    fn everything(&self) -> Problem<'_> {
        self.identification.material_problem(self.simulation, self.identification.tuning.masks.blur_pooling)
    }

    /// The same of the material alone; of everything where no parameter of it is sought.
    fn material_alone(&self) -> Problem<'_> {
        self.everything().of_material_alone()
    }
}
