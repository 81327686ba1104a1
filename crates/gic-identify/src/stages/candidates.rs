//! Many states compared: what each costs.

use rayon::prelude::*;

use crate::FitError;
use crate::session::Session;
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

/// The states that cost at most `ratio` times as much as the cheapest of `fits`, cheapest first.
pub(crate) fn cheapest(mut fits: Vec<(f64, State)>, ratio: f64) -> Vec<State> {
    fits.sort_by(|a, b| a.0.total_cmp(&b.0));
    let most = ratio * fits.first().map_or(0.0, |(cost, _)| *cost);
    fits.into_iter().filter(|(cost, _)| *cost <= most).map(|(_, state)| state).collect()
}
