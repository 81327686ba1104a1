//! After stage 5: from the best fit to the mean of what the video leaves open.
//!
//! Where the range of a parameter cuts off a part of what the video admits, the best fit is not in the middle of the
//! rest: in a valley along which nothing tells Poisson's ratio it ends anywhere, and often at the edge. The mean of the
//! Gaussian about the fit, cut at the range, errs least on average. The parameter is held there, and all else is fitted
//! again, from where the quadratic model about the fit has it then.

use nalgebra::DVector;

use crate::FitError;
use crate::forward::trajectories::Trajectories;
use crate::result::Stage;
use crate::session::Session;
use crate::settings::Optimizer;
use crate::solve::levenberg_marquardt::Limits;
use crate::solve::problem::Problem;
use crate::stages::identification::Identification;
use crate::stages::intervals::Uncertainty;
use crate::stages::joint;
use crate::uncertainty::variance::Covariance;
use crate::unknowns::state::{State, Unknown};

/// The state in the middle of what the video leaves open about the joint `fit`, and its trajectories. It is the fit
/// where nothing is cut off, and where the pictures tell the two apart: then it is not they that leave it open.
///
/// # Errors
/// Interruption.
pub(crate) fn of_what_is_open(
    identification: &Identification,
    session: &mut Session,
    (fit, trajectories): (&State, Trajectories),
    uncertainty: &Uncertainty,
) -> Result<(State, Trajectories), FitError> {
    let held = held(identification, fit, uncertainty);
    // The paper reports the end of its material stage.
    let is_fitted = identification.settings.optimizer == Optimizer::LevenbergMarquardt;
    let Some(weights) = uncertainty.weights().filter(|_| is_fitted && !held.is_empty()) else {
        return Ok((fit.clone(), trajectories));
    };
    let (simulation, prior) = (identification.simulation(), joint::prior(identification));
    let problem = joint::problem(identification, (&simulation, &prior), 1);
    let problem = problem.weighted_by(weights);
    let Some((start, here)) = uncertainty.moved(&problem, (fit, &trajectories), &held) else {
        return Ok((fit.clone(), trajectories));
    };
    let is_free = |unknown: &Unknown| held.iter().all(|(other, _)| other != unknown);
    let here = here.of_unknowns(|k| is_free(&problem.unknowns[k]));
    let unknowns = problem.unknowns.iter().copied().filter(is_free).collect();
    let problem = Problem { unknowns, ..problem };
    let (iterations, least_gain) = (identification.settings.iterations, identification.tuning.joint.least_gain);
    let limits = Limits::to_the_end(iterations, least_gain);
    let middle = match session.minimise(Stage::Intervals, &problem, (start, Some(here)), limits, &|_| false) {
        Err(FitError::Interrupted) => return Err(FitError::Interrupted),
        Err(_) => return Ok((fit.clone(), trajectories)),
        Ok(middle) => middle,
    };
    let more = middle.cost - problem.cost(fit, &trajectories);
    let is_told = held.iter().all(|(unknown, _)| uncertainty.tells_apart(*unknown, more));
    Ok(if is_told { (fit.clone(), trajectories) } else { (middle.state, middle.linearisation.trajectories) })
}

/// The parameters whose Gaussian is cut, and the means of the rests. The one that is cut most comes first: given that
/// one, the others of its valley hardly are.
fn held(identification: &Identification, fit: &State, uncertainty: &Uncertainty) -> Vec<(Unknown, f64)> {
    let (open, mut held) = (identification.free_materials(), Vec::new());
    let Some(mut covariance) = uncertainty.covariance_of(&open) else { return held };
    let mut centre = DVector::from_iterator(open.len(), open.iter().map(|unknown| fit.get(*unknown)));
    while let Some((k, mean)) = most_cut(identification, &open, &centre, &covariance) {
        held.push((open[k], mean));
        // The Gaussian of the others, given this one.
        let matrix = &mut covariance.matrix;
        let slopes = matrix.column(k) / matrix[(k, k)];
        centre += &slopes * (mean - centre[k]);
        *matrix -= &slopes * matrix.row(k);
        matrix.fill_row(k, 0.0);
        matrix.fill_column(k, 0.0);
    }
    held
}

/// Of the parameters whose interval reaches beyond their range, the one whose interval is the widest for its range: its
/// place, and the mean of what is left.
fn most_cut(
    identification: &Identification,
    open: &[Unknown],
    centre: &DVector<f64>,
    covariance: &Covariance,
) -> Option<(usize, f64)> {
    let cut = |(k, unknown): (usize, &Unknown)| {
        let Unknown::Material(i) = *unknown else { return None };
        let (parameter, variance) = (&identification.parameters()[i], covariance.variance(k));
        let (half_width, (low, high)) = (variance.half_width(), parameter.limits());
        let at = centre[k].clamp(low, high);
        let is_cut = at - half_width < low || at + half_width > high;
        is_cut.then(|| (k, parameter.mean_within_bounds(at, variance.value.sqrt()), half_width / (high - low)))
    };
    let most = open.iter().enumerate().filter_map(cut).max_by(|a, b| a.2.total_cmp(&b.2));
    most.map(|(k, mean, _)| (k, mean))
}
