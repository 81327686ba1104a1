//! Over the walls of a local minimum: a parameter is moved far, the others follow the quadratic model. Where that costs
//! less than the model says, another minimum may begin.

use crate::FitError;
use crate::session::Session;
use crate::solve::levenberg_marquardt::Fit;
use crate::solve::normal_equations::Normal;
use crate::solve::problem::Problem;
use crate::stages::candidates::costs;
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
    let (predicted, states): (Vec<f64>, Vec<State>) = moves
        .flat_map(|(k, distance)| [(k, distance), (k, -distance)])
        .filter_map(|moved| neighbour(problem, &normal, fit, moved))
        .unzip();
    let cost = |state: &State| Ok(problem.cost(state, &problem.forward.trajectories(state, &problem.selection)?));
    let costs = costs(session, &states, cost)?;
    let gain = |((cost, predicted), state): ((Result<f64, FitError>, f64), State)| {
        let most = (predicted - problem.descent.gain_tolerance * fit.cost).min(most_cost_ratio * fit.cost);
        let cost = cost.ok().filter(|cost| *cost < most)?;
        Some((predicted - cost, state))
    };
    let gains = costs.into_iter().zip(predicted).zip(states).filter_map(gain);
    Ok(gains.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, state)| state))
}

/// The state with the `k`-th unknown moved by `distance`, and what the quadratic model predicts that it costs.
fn neighbour(problem: &Problem, normal: &Normal, fit: &Fit, (k, distance): (usize, f64)) -> Option<(f64, State)> {
    let (unknown, (low, high)) = (problem.unknowns[k], problem.coordinates.limits(problem.unknowns[k]));
    let from = fit.state.get(unknown);
    let length = (from + distance).clamp(low, high) - from;
    let step = problem.step(normal, &fit.state, 0.0, vec![(k, length)]).filter(|_| length != 0.0)?;
    let short = |(i, unknown): (usize, &Unknown)| {
        let most = problem.coordinates.largest_step(*unknown);
        if i == k { step[i] } else { step[i].clamp(-most, most) }
    };
    let step: Vec<f64> = problem.unknowns.iter().enumerate().map(short).collect();
    let (state, delta) = problem.moved(&fit.state, &step);
    Some((fit.cost - normal.predicted_decrease(&delta), state))
}
