//! Over the walls of a local minimum: some unknowns are moved far, the others follow the quadratic model. Where that
//! costs much less than the model says, another minimum may begin.

use std::collections::BTreeMap;

use crate::FitError;
use crate::session::Session;
use crate::solve::levenberg_marquardt::Iterate;
use crate::solve::problem::Problem;
use crate::stages::basin::Basin;
use crate::stages::candidates::{costs, ranked};
use crate::stages::minima::Minima;
use crate::tuning::MaterialTuning;
use crate::unknowns::state::{State, Unknown};

/// Adds the minima around the best one, then those around a better one, until none is.
///
/// # Errors
/// Interruption.
pub(crate) fn look_over_the_walls(
    session: &mut Session,
    minima: &mut Minima,
    tuning: &MaterialTuning,
) -> Result<(), FitError> {
    let problem = minima.problem;
    loop {
        let Some(best) = minima.best() else { return Ok(()) };
        let (cost, starts) = (best.cost, neighbours(session, problem, best, tuning)?);
        minima.seek_from_each(session, starts)?;
        if !minima.are_better_than(cost) {
            return Ok(());
        }
    }
}

/// Where other minima may begin next to that of `basin`. Each parameter of the material is moved both ways, the other
/// unknowns to where they suit it best; of each way the cheapest distance counts.
fn neighbours(
    session: &mut Session,
    problem: &Problem,
    basin: &Basin,
    tuning: &MaterialTuning,
) -> Result<Vec<State>, FitError> {
    let is_material = |(_, unknown): &(usize, &Unknown)| matches!(unknown, Unknown::Material(_));
    let materials = problem.unknowns.iter().enumerate().filter(is_material);
    let ways = materials.flat_map(|(k, unknown)| {
        let longest = problem.coordinates.largest_step(*unknown);
        [(k, longest), (k, -longest)]
    });
    let along = |(way, (k, longest)): (usize, (usize, f64))| {
        let lengths = (0..tuning.neighbour_distances).map(move |rung| longest * 0.5_f64.powi(rung as i32));
        lengths.filter_map(move |length| Some((way, moved(problem, basin, &[(k, length)])?)))
    };
    let mut places: Vec<(usize, State)> = ways.enumerate().flat_map(along).collect();
    // Several distances may end at the same limit.
    places.dedup();
    let (ways, states): (Vec<usize>, Vec<State>) = places.into_iter().unzip();
    let mut cheapest = BTreeMap::new();
    for place in where_minima_may_begin(session, problem, basin, (&states, tuning))? {
        cheapest.entry(ways[place]).or_insert(place);
    }
    Ok(cheapest.into_values().map(|place| states[place].clone()).collect())
}

/// Which of `states` cost so little that another minimum than that of `basin` may begin there, the cheapest first.
///
/// # Errors
/// Interruption.
pub(crate) fn where_minima_may_begin(
    session: &mut Session,
    problem: &Problem,
    basin: &Basin,
    (states, tuning): (&[State], &MaterialTuning),
) -> Result<Vec<usize>, FitError> {
    let cost = |state: &State| Ok(problem.cost(state, &problem.forward.trajectories(state, &problem.selection)?));
    let costs = costs(session, states, cost)?;
    let may_begin = |cost: f64, state: &State| {
        cost < tuning.most_cost_ratio * basin.cost && basin.is_left(&Iterate { state: state.clone(), cost })
    };
    let ranked = ranked(costs, 0..states.len()).into_iter();
    Ok(ranked.filter(|(cost, place)| may_begin(*cost, &states[*place])).map(|(_, place)| place).collect())
}

/// The state of a minimum with some unknowns moved by lengths, as far as they can be, and the others where the
/// quadratic model has them then; `None` where nothing moves.
pub(crate) fn moved(problem: &Problem, basin: &Basin, lengths: &[(usize, f64)]) -> Option<State> {
    let within = |(k, length): &(usize, f64)| {
        let (unknown, (low, high)) = (problem.unknowns[*k], problem.coordinates.limits(problem.unknowns[*k]));
        let from = basin.state.get(unknown);
        (*k, (from + length).clamp(low, high) - from)
    };
    let held: Vec<(usize, f64)> = lengths.iter().map(within).collect();
    if held.iter().all(|(_, length)| *length == 0.0) {
        return None;
    }
    let step = problem.step(&basin.normal, &basin.state, 0.0, held.clone())?;
    let short = |(i, unknown): (usize, &Unknown)| {
        let most = problem.coordinates.largest_step(*unknown);
        if held.iter().any(|(k, _)| *k == i) { step[i] } else { step[i].clamp(-most, most) }
    };
    let step: Vec<f64> = problem.unknowns.iter().enumerate().map(short).collect();
    Some(problem.moved(&basin.state, &step).0)
}
