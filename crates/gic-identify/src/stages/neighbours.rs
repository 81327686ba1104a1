//! Over the walls of a local minimum: a parameter is moved far, the others follow the quadratic model. Where that costs
//! much less than the model says, another minimum may begin.

use std::collections::BTreeMap;

use crate::FitError;
use crate::result::Stage;
use crate::session::Session;
use crate::solve::levenberg_marquardt::{Fit, Iterate, Limits};
use crate::solve::problem::Problem;
use crate::stages::basin::{Basin, fit_outside};
use crate::stages::candidates::{costs, ranked};
use crate::tuning::MaterialTuning;
use crate::unknowns::state::{State, Unknown};

/// The search for other minima of a stage's problem.
pub(crate) struct Walls<'a> {
    pub stage: Stage,
    /// The fit of everything that is sought.
    pub problem: &'a Problem<'a>,
    /// When fits end.
    pub limits: Limits,
    pub tuning: &'a MaterialTuning,
}

impl Walls<'_> {
    /// The best of `fit` and of the minima around it, then of those around the better one, until the likeliest of these
    /// is not better by what a fit goes on for; and the others.
    ///
    /// # Errors
    /// Interruption.
    pub(crate) fn look_over(&self, session: &mut Session, mut fit: Fit) -> Result<(Fit, Vec<Fit>), FitError> {
        let mut others = Vec::new();
        let mut known = vec![Basin::of(self.problem, &mut fit)];
        let mut starts = self.starts(session, &known)?.into_iter();
        while let Some(start) = starts.next() {
            let to_beat = fit.cost - self.limits.least_gain_at(fit.cost);
            let limits = Limits { to_beat, ..self.limits };
            let Some(mut found) = self.fit_from(session, (self.problem, limits), start, &known)? else { continue };
            if found.cost >= to_beat {
                others.push(found);
                break;
            }
            known.push(Basin::of(self.problem, &mut found));
            // Further down in the same minimum there is nothing new around.
            if !known[known.len() - 1].holds(&fit.end()) {
                starts = self.starts(session, &known)?.into_iter();
            }
            others.push(std::mem::replace(&mut fit, found));
        }
        Ok((fit, others))
    }

    /// Where fits of the material alone end that start around the last of the `known` minima, outside of all of these;
    /// the cheapest first. Their rollouts are few, and nothing else makes up for a material that is still wrong.
    fn starts(&self, session: &mut Session, known: &[Basin]) -> Result<Vec<State>, FitError> {
        let material_alone = self.problem.of_material_alone();
        let mut ends = Vec::new();
        for start in self.neighbours(session, &known[known.len() - 1])? {
            ends.extend(self.fit_from(session, (&material_alone, self.limits), start, known)?);
        }
        ends.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        Ok(ends.into_iter().map(|end| end.state).collect())
    }

    /// A fit to its end, unless that is in a minimum that is `known`, or it cannot be simulated.
    fn fit_from(
        &self,
        session: &mut Session,
        (problem, limits): (&Problem, Limits),
        start: State,
        known: &[Basin],
    ) -> Result<Option<Fit>, FitError> {
        match fit_outside(known, session, (self.stage, problem, limits), start) {
            Err(FitError::Interrupted) => Err(FitError::Interrupted),
            found => Ok(found.ok().flatten()),
        }
    }

    /// Where other minima may begin next to that of `basin`. Each parameter of the material is moved both ways, the
    /// other unknowns to where they suit it best; of each way the cheapest distance counts.
    fn neighbours(&self, session: &mut Session, basin: &Basin) -> Result<Vec<State>, FitError> {
        let problem = self.problem;
        let is_material = |(_, unknown): &(usize, &Unknown)| matches!(unknown, Unknown::Material(_));
        let materials = problem.unknowns.iter().enumerate().filter(is_material);
        let ways = materials.flat_map(|(k, unknown)| {
            let longest = problem.coordinates.largest_step(*unknown);
            [(k, longest), (k, -longest)]
        });
        let distances = 0..self.tuning.neighbour_distances;
        let along = |(way, (k, longest)): (usize, (usize, f64))| {
            let lengths = distances.clone().map(move |rung| longest * 0.5_f64.powi(rung as i32));
            lengths.filter_map(move |length| Some((way, neighbour(problem, basin, (k, length))?)))
        };
        let mut places: Vec<(usize, State)> = ways.enumerate().flat_map(along).collect();
        // Several distances may end at the same limit.
        places.dedup();
        let (ways, states): (Vec<usize>, Vec<State>) = places.into_iter().unzip();
        let cost = |state: &State| Ok(problem.cost(state, &problem.forward.trajectories(state, &problem.selection)?));
        let costs = costs(session, &states, cost)?;
        let mut cheapest = BTreeMap::new();
        for (cost, (way, state)) in ranked(costs, ways.into_iter().zip(states)) {
            let at = Iterate { state, cost };
            if cost < self.tuning.most_cost_ratio * basin.cost && basin.is_left(&at) {
                cheapest.entry(way).or_insert(at.state);
            }
        }
        Ok(cheapest.into_values().collect())
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
