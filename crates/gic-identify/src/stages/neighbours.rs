//! Over the walls of a local minimum: a parameter is moved far, the others follow the quadratic model. Where that costs
//! less than the model says, another minimum may begin.

use rayon::prelude::*;

use crate::FitError;
use crate::session::Session;
use crate::solve::levenberg_marquardt::Fit;
use crate::solve::normal_equations::Normal;
use crate::solve::problem::Problem;
use crate::unknowns::state::{State, Unknown};

/// Where a better minimum next to that of `fit` may begin. Each unknown is moved both ways, as far as `far` says, the
/// others to where they suit it best. Of those that cost at most `most_cost_ratio` times as much as `fit` the one
/// counts that costs least in comparison with what the quadratic model predicts. Along a flat direction of the same
/// minimum none costs less than that.
///
/// # Errors
/// Interruption.
pub(crate) fn neighbouring_start(
    session: &mut Session,
    problem: &Problem,
    fit: &mut Fit,
    far: &dyn Fn(&Unknown) -> Option<f64>,
    most_cost_ratio: f64,
) -> Result<Option<State>, FitError> {
    let normal = problem.normal(fit.linearisation.blocks(problem), &fit.state);
    let moves = problem.unknowns.iter().enumerate().filter_map(|(k, unknown)| Some((k, far(unknown)?)));
    let neighbours: Vec<(f64, State)> = moves
        .flat_map(|(k, distance)| [(k, distance), (k, -distance)])
        .filter_map(|moved| neighbour(problem, &normal, fit, moved))
        .collect();
    let mut best: Option<(f64, State)> = None;
    // The work may be stopped after each batch.
    for batch in neighbours.chunks(rayon::current_num_threads()) {
        let cost = |(_, state): &(f64, State)| {
            let trajectories = problem.forward.trajectories(state, &problem.selection).ok()?;
            Some(problem.cost(state, &trajectories))
        };
        let costs: Vec<Option<f64>> = batch.par_iter().with_max_len(1).map(cost).collect();
        for ((predicted, state), cost) in batch.iter().zip(costs) {
            let most = (predicted - problem.descent.gain_tolerance * fit.cost).min(most_cost_ratio * fit.cost);
            let Some(gain) = cost.filter(|cost| *cost < most).map(|cost| predicted - cost) else { continue };
            if best.as_ref().is_none_or(|(least, _)| gain >= *least) {
                best = Some((gain, state.clone()));
            }
        }
        session.pause()?;
    }
    Ok(best.map(|(_, state)| state))
}

/// The state with the `k`-th unknown moved by `distance`, and what the quadratic model predicts that it costs.
fn neighbour(problem: &Problem, normal: &Normal, fit: &Fit, (k, distance): (usize, f64)) -> Option<(f64, State)> {
    let step = normal.step_along(k, distance)?;
    let short = |(i, unknown): (usize, &Unknown)| {
        let most = problem.coordinates.largest_step(*unknown);
        if i == k { step[i] } else { step[i].clamp(-most, most) }
    };
    let step: Vec<f64> = problem.unknowns.iter().enumerate().map(short).collect();
    let (state, delta) = problem.moved(&fit.state, &step);
    (delta[k] != 0.0).then(|| (fit.cost - normal.predicted_decrease(&delta), state))
}
