//! Many states compared: what each costs, and which of them lie in the same local minimum.

use rayon::prelude::*;

use crate::FitError;
use crate::session::Session;
use crate::unknowns::parameter::Parameter;
use crate::unknowns::state::State;

/// What each of `states` costs, or why it cannot be simulated.
///
/// # Errors
/// Interruption.
pub(crate) fn costs(
    session: &mut Session,
    states: &[State],
    cost: impl Fn(&State) -> Result<f64, FitError> + Sync,
) -> Result<Vec<Result<f64, FitError>>, FitError> {
    let mut costs = Vec::new();
    // The work may be stopped after each batch.
    for batch in states.chunks(rayon::current_num_threads()) {
        costs.extend(batch.par_iter().with_max_len(1).map(&cost).collect::<Vec<_>>());
        session.pause()?;
    }
    Ok(costs)
}

/// Those that could be simulated, cheapest first.
pub(crate) fn ranked<T>(
    costs: impl IntoIterator<Item = Result<f64, FitError>>,
    states: impl IntoIterator<Item = T>,
) -> Vec<(f64, T)> {
    let mut ranked: Vec<(f64, T)> =
        costs.into_iter().zip(states).filter_map(|(cost, state)| Some((cost.ok()?, state))).collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    ranked
}

/// When two states count as the same local minimum.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MinimumSpace<'a> {
    pub parameters: &'a [Parameter],
    /// States whose coordinates differ by less lie in the same minimum.
    pub distance: f64,
}

/// Whether two states lie in the same local minimum: parameters with a single start do not count.
pub(crate) fn same_minimum(space: &MinimumSpace, a: &State, b: &State) -> bool {
    are_near(space, a, b, |parameter| parameter.grid > 1)
}

/// Whether two states have about the same material: all parameters count.
pub(crate) fn same_material(space: &MinimumSpace, a: &State, b: &State) -> bool {
    are_near(space, a, b, |_| true)
}

fn are_near(space: &MinimumSpace, a: &State, b: &State, counts: impl Fn(&Parameter) -> bool) -> bool {
    let pairs = a.material.iter().zip(&b.material);
    space.parameters.iter().zip(pairs).filter(|(p, _)| counts(p)).all(|(_, (a, b))| (a - b).abs() < space.distance)
}

/// The first of `states` in each local minimum, in their order.
pub(crate) fn distinct(space: &MinimumSpace, states: impl IntoIterator<Item = State>) -> Vec<State> {
    states.into_iter().fold(Vec::new(), |mut distinct, state| {
        if !distinct.iter().any(|other| same_minimum(space, other, &state)) {
            distinct.push(state);
        }
        distinct
    })
}

/// Distinct states that cost at most `ratio` times as much as the cheapest of `fits`, cheapest first.
pub(crate) fn cheapest(space: &MinimumSpace, mut fits: Vec<(f64, State)>, ratio: f64) -> Vec<State> {
    fits.sort_by(|a, b| a.0.total_cmp(&b.0));
    let most = ratio * fits.first().map_or(0.0, |(cost, _)| *cost);
    distinct(space, fits.into_iter().filter(|(cost, _)| *cost <= most).map(|(_, state)| state))
}
