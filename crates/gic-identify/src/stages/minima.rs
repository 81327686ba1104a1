//! The distinct local minima of a problem. A fit that comes into one that is known ends there.
//!
//! The best is the cheapest. A ground that holds what touches it is rare where nobody says so: such a minimum counts
//! only if the video tells it from all whose ground lets go (decision 87).

use crate::FitError;
use crate::result::Stage;
use crate::session::Session;
use crate::solve::levenberg_marquardt::{Fit, Iterate, Limits};
use crate::solve::problem::Problem;
use crate::stages::basin::Basin;
use crate::uncertainty::interval::told;
use crate::uncertainty::variance::Variance;
use crate::unknowns::state::State;

/// The minima that were found so far.
pub(crate) struct Minima<'a> {
    stage: Stage,
    pub problem: &'a Problem<'a>,
    /// When fits end.
    limits: Limits,
    found: Vec<(Fit, Basin)>,
}

impl<'a> Minima<'a> {
    /// None yet.
    pub(crate) fn new(stage: Stage, problem: &'a Problem<'a>, limits: Limits) -> Minima<'a> {
        Minima { stage, problem, limits, found: Vec::new() }
    }

    /// Fits from `start`, with what is known of the best minimum, and keeps a minimum that is new.
    ///
    /// # Errors
    /// Where the start cannot be simulated, and interruption.
    fn seek_from(&mut self, session: &mut Session, start: State) -> Result<(), FitError> {
        let is_known = |step: &Iterate| self.found.iter().any(|(_, basin)| basin.holds(step));
        let known = self.first().map(|(best, _)| best.linearisation.carried_far(self.problem, &start)).transpose()?;
        let fit = session.minimise(self.stage, self.problem, (start, known), self.limits, &is_known)?;
        if !is_known(&fit.end()) {
            self.keep(fit);
        }
        Ok(())
    }

    /// Adds the end of a fit of the same problem.
    pub(crate) fn keep(&mut self, mut fit: Fit) {
        let basin = Basin::of(self.problem, &mut fit);
        self.found.push((fit, basin));
    }

    /// Fits from each of the `starts` that can be simulated; says why the last of the others cannot.
    ///
    /// # Errors
    /// Interruption.
    pub(crate) fn seek_from_each(
        &mut self,
        session: &mut Session,
        starts: Vec<State>,
    ) -> Result<Option<FitError>, FitError> {
        let mut failure = None;
        for start in starts {
            match self.seek_from(session, start) {
                Ok(()) => (),
                Err(FitError::Interrupted) => return Err(FitError::Interrupted),
                Err(reason) => failure = Some(reason),
            }
        }
        Ok(failure)
    }

    /// The best of them, if any.
    pub(crate) fn best(&self) -> Option<&Basin> {
        self.first().map(|(_, basin)| basin)
    }

    fn first(&self) -> Option<&(Fit, Basin)> {
        self.found.iter().min_by(|(a, _), (b, _)| counted(a.cost, &a.state).total_cmp(&counted(b.cost, &b.state)))
    }

    /// Whether one of them costs less than `cost` by what a fit goes on for.
    pub(crate) fn are_better_than(&self, cost: f64) -> bool {
        self.best().is_some_and(|best| best.cost < cost - self.limits.least_gain_at(cost))
    }

    /// Where they are and what they count for, the best first.
    pub(crate) fn into_ends(self) -> Vec<(f64, State)> {
        self.into_fits().into_iter().map(|fit| (counted(fit.cost, &fit.state), fit.state)).collect()
    }

    /// All of them, the best first.
    pub(crate) fn into_fits(self) -> Vec<Fit> {
        let mut fits: Vec<Fit> = self.found.into_iter().map(|(fit, _)| fit).collect();
        fits.sort_by(|a, b| counted(a.cost, &a.state).total_cmp(&counted(b.cost, &b.state)));
        fits
    }
}

/// What a minimum counts for: what it costs and, if its ground holds what touches it, as much more as tells two apart
/// at noise that is known.
fn counted(cost: f64, state: &State) -> f64 {
    let known = Variance { value: 1.0, freedom: f64::INFINITY };
    if state.sticks { cost + told(1.0, known, known.value).recip() } else { cost }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_two_that_the_video_does_not_tell_apart_the_ground_lets_go() {
        let separating_ground = State::new(Vec::new());
        let sticky_ground = State { sticks: true, ..separating_ground.clone() };
        let sticks_rather =
            |sticky: f64, separating: f64| counted(sticky, &sticky_ground) < counted(separating, &separating_ground);
        // The filmed ball, and a rendered film whose floor sticks.
        assert!(!sticks_rather(16.1, 17.3) && sticks_rather(1135.0, 1211.0));
        assert!(!sticks_rather(0.0, 0.0), "a body that touches nothing");
    }
}
