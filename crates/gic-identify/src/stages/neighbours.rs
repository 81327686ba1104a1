//! Over the walls of a local minimum: a parameter is moved far, the others follow the quadratic model. Where that costs
//! much less than the model says, another minimum may begin.

use crate::FitError;
use crate::result::Stage;
use crate::session::Session;
use crate::solve::levenberg_marquardt::{Fit, Iterate, Limits};
use crate::solve::problem::Problem;
use crate::stages::basin::Basin;
use crate::stages::candidates::costs;
use crate::stages::identification::Identification;
use crate::tuning::MaterialTuning;
use crate::unknowns::state::{State, Unknown};

/// The search for other minima of a stage's problem.
pub(crate) struct Walls<'a> {
    pub stage: Stage,
    /// The fit of everything that is sought.
    pub everything: &'a Problem<'a>,
    /// The same of the material alone: rollouts are few, and nothing else makes up for a material that is still wrong.
    pub material_alone: &'a Problem<'a>,
    /// When either ends.
    pub limits: Limits,
    pub tuning: &'a MaterialTuning,
}

impl Walls<'_> {
    /// The best of `fit` and of the minima around it, then of those around the better one; and the others.
    ///
    /// # Errors
    /// Interruption.
    pub(crate) fn look_over(&self, session: &mut Session, mut fit: Fit) -> Result<(Fit, Vec<Fit>), FitError> {
        let mut others = Vec::new();
        let mut known = vec![Basin::of(self.everything, &mut fit)];
        let mut starts = self.starts(session, &known, &known[0])?.into_iter();
        while let Some(start) = starts.next().filter(|_| known.len() <= self.tuning.most_restarts) {
            let Some(mut found) = self.fit_from(session, self.everything, start.state, &known)? else {
                continue;
            };
            let basin = Basin::of(self.everything, &mut found);
            if found.cost < fit.cost {
                // Further down in the same minimum there is nothing new around.
                if !basin.holds(&fit.end()) {
                    starts = self.starts(session, &known, &basin)?.into_iter();
                }
                std::mem::swap(&mut fit, &mut found);
            }
            known.push(basin);
            others.push(found);
        }
        Ok((fit, others))
    }

    /// Where fits of the material alone end that start around `basin`, outside of what is `known`; the cheapest first.
    fn starts(&self, session: &mut Session, known: &[Basin], basin: &Basin) -> Result<Vec<Iterate>, FitError> {
        let mut ends = Vec::new();
        for start in self.neighbours(session, basin)? {
            let found = self.fit_from(session, self.material_alone, start, known)?;
            ends.extend(found.map(|fit| fit.end()));
        }
        ends.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        Ok(ends)
    }

    /// A fit to its end, unless that is in a minimum that is `known`, or it cannot be simulated.
    fn fit_from(
        &self,
        session: &mut Session,
        problem: &Problem,
        start: State,
        known: &[Basin],
    ) -> Result<Option<Fit>, FitError> {
        let returns = |step: &Iterate| known.iter().any(|basin| basin.holds(step));
        match session.minimise(self.stage, problem, (start, None), self.limits, &returns) {
            Err(FitError::Interrupted) => Err(FitError::Interrupted),
            found => Ok(found.ok().filter(|fit| !returns(&fit.end()))),
        }
    }

    /// Where other minima may begin next to that of `basin`. Each parameter of the material is moved both ways, the
    /// other unknowns to where they suit it best; of each way the cheapest distance counts.
    fn neighbours(&self, session: &mut Session, basin: &Basin) -> Result<Vec<State>, FitError> {
        let problem = self.everything;
        let is_material = |(_, unknown): &(usize, &Unknown)| matches!(unknown, Unknown::Material(_));
        let materials = problem.unknowns.iter().enumerate().filter(is_material);
        let ways = materials.flat_map(|(k, unknown)| {
            let longest = problem.coordinates.largest_step(*unknown);
            [longest, -longest].map(|length| (k, length))
        });
        let cost = |state: &State| Ok(problem.cost(state, &problem.forward.trajectories(state, &problem.selection)?));
        let mut starts = Vec::new();
        for (k, longest) in ways {
            let lengths = (0..self.tuning.neighbour_distances).map(|rung| longest * 0.5_f64.powi(rung as i32));
            let states: Vec<State> = lengths.filter_map(|length| neighbour(problem, basin, (k, length))).collect();
            let costs = costs(session, &states, cost)?;
            let found = states.into_iter().zip(costs);
            let found = found.filter_map(|(state, cost)| Some(Iterate { state, cost: cost.ok()? }));
            let left = found.filter(|at| at.cost < self.tuning.most_cost_ratio * basin.cost && basin.is_left(at));
            starts.extend(left.min_by(|a, b| a.cost.total_cmp(&b.cost)).map(|at| at.state));
        }
        Ok(starts)
    }
}

/// The state with the `k`-th unknown moved by `distance`, if it can be.
fn neighbour(problem: &Problem, basin: &Basin, (k, distance): (usize, f64)) -> Option<State> {
    let (unknown, (low, high)) = (problem.unknowns[k], problem.coordinates.limits(problem.unknowns[k]));
    let from = basin.state.get(unknown);
    let length = (from + distance).clamp(low, high) - from;
    let step = problem.step(&basin.normal, &basin.state, 0.0, vec![(k, length)]).filter(|_| length != 0.0)?;
    let short = |(i, unknown): (usize, &Unknown)| {
        let most = problem.coordinates.largest_step(*unknown);
        if i == k { step[i] } else { step[i].clamp(-most, most) }
    };
    let step: Vec<f64> = problem.unknowns.iter().enumerate().map(short).collect();
    Some(problem.moved(&basin.state, &step).0)
}

/// The same problem with the material alone as its unknowns; with all of them where no parameter of it is sought.
pub(crate) fn of_material_alone<'a>(identification: &Identification, everything: &Problem<'a>) -> Problem<'a> {
    let unknowns = identification.free_materials();
    let unknowns = if unknowns.is_empty() { everything.unknowns.clone() } else { unknowns };
    Problem { unknowns, selection: everything.selection.clone(), ..*everything }
}
