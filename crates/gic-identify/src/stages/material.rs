//! Stage 3: the minima of the material, with the motion of free flight, and with free poses where these are asked for
//! ([`Posed`]).
//!
//! The cost has several local minima. The material alone is fitted, in the world and on the cells that are given: far
//! from the best fit, these make up for what the material and the shape lack, and lead away. A step from each start
//! tells which are worth the rest; those that cost not much more than the best are fitted on, and the best looks over
//! the walls of its minimum. Where nobody says if the ground holds what touches it, all that is done with either
//! contact: minima of one are none of the other. The best goes on with the cells; the rest of the world waits for the
//! fit of everything. Masks are blurred.
//!
//! The range of each parameter is known before: a Gaussian of the mean and the deviation of its even distribution.
//! Refinement settles the body to the motion that is found here. Along a valley that the pictures do not tell apart any
//! end would do, and the body that an end shapes would then speak for it. The fit of everything knows of no ranges.

use crate::result::Stage;
use crate::session::Session;
use crate::settings::Optimizer;
use crate::solve::levenberg_marquardt::Limits;
use crate::solve::posed::Posed;
use crate::solve::problem::Problem;
use crate::stages::adam::adam;
use crate::stages::candidates::cheapest;
use crate::stages::identification::Identification;
use crate::stages::minima::Minima;
use crate::stages::neighbours::look_over_the_walls;
use crate::unknowns::state::State;
use crate::{FitError, IdentifyError};

/// Minima of the material from the best starts, with the velocity of stage 1, the cheapest first. They go into the
/// checkpoint.
///
/// # Errors
/// Where no start can be simulated, and interruption.
pub(crate) fn fit_material(
    identification: &Identification,
    session: &mut Session,
    starts: Vec<State>,
) -> Result<Vec<State>, IdentifyError> {
    let count = starts.len();
    let simulation = identification.simulation();
    let motion = identification.posed(&simulation, identification.objective());
    let stage = MaterialStage { identification, motion: &motion };
    let fitted = match identification.settings.optimizer {
        Optimizer::Adam => adam(identification, session, starts).map(|best| vec![best]),
        Optimizer::LevenbergMarquardt => stage.minima(session, starts),
    };
    let minima = fitted.map_err(|error| error.of_stage(count))?;
    let reached = session.reach(Some(Stage::Material), |checkpoint| checkpoint.material = Some(minima.clone()));
    reached.map_err(|error| error.of_stage(count))?;
    Ok(minima)
}

struct MaterialStage<'a> {
    identification: &'a Identification<'a>,
    motion: &'a Posed<'a>,
}

impl MaterialStage<'_> {
    fn minima(&self, session: &mut Session, starts: Vec<State>) -> Result<Vec<State>, FitError> {
        self.first_steps(session, starts)?;
        let steps = session.checkpoint().fits.iter().flatten().cloned().collect();
        let tuning = &self.identification.tuning.material;
        let on_sought_cells = self.on_sought_cells();
        let material = on_sought_cells.of_material_alone();
        let limits = self.limits(self.identification.settings.iterations);
        let starts = cheapest(steps, tuning.most_cost_ratio);
        let (mut ends, mut failure) = (Vec::new(), None);
        for &sticks in self.contacts() {
            let mut minima = Minima::new(Stage::Material, &material, limits);
            let starts = starts.iter().map(|start| State { sticks, ..start.clone() }).collect();
            failure = minima.seek_from_each(session, starts)?.or(failure);
            look_over_the_walls(session, &mut minima, tuning)?;
            ends.extend(minima.into_ends());
        }
        let mut ends = cheapest(ends, tuning.most_cost_ratio).into_iter();
        let best = ends.next().ok_or(failure.unwrap_or(FitError::NoIteration))?;
        let best = if on_sought_cells.unknowns == material.unknowns {
            best
        } else {
            session.minimise(Stage::Material, &on_sought_cells, (best, None), limits, &|_| false)?.state
        };
        Ok(std::iter::once(best).chain(ends).collect())
    }

    /// A step from each start. What they found goes into the checkpoint.
    fn first_steps(&self, session: &mut Session, starts: Vec<State>) -> Result<(), FitError> {
        let done = session.checkpoint().fits.len();
        let mut failure = FitError::NoIteration;
        let problem = self.on_sought_cells().of_material_alone();
        for start in starts.into_iter().skip(done) {
            let found = match session.minimise(Stage::Material, &problem, (start, None), self.limits(1), &|_| false) {
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

    /// Whether the ground holds what touches it: one answer where that is known, as the world has it, or both.
    fn contacts(&self) -> &'static [bool] {
        if self.identification.contact_is_in_doubt() { &[false, true] } else { &[false] }
    }

    fn limits(&self, iterations: usize) -> Limits {
        Limits::rough(iterations, &self.identification.tuning.descent)
    }

    /// The fit of the material and of the cells, where these are sought, to blurred masks.
    fn on_sought_cells(&self) -> Problem<'_> {
        let pooling = self.identification.tuning.masks.blur_pooling;
        self.identification.material_problem(self.motion, pooling)
    }
}
