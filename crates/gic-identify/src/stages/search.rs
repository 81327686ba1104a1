//! Stage 2: starting points of the material.
//!
//! All points of a grid over the parameters' ranges are simulated on a coarse grid with fewer particles; the cheapest
//! are improved there. The coarse grid is biased, so that the improved ones, the cheapest as they are and a start that
//! was given compete again on the full grid.

use glam::DVec3;

use crate::forward::simulation::{Resolution, Simulation};
use crate::forward::splat_widths::SplatWidths;
use crate::forward::thinned::ThinnedContinuum;
use crate::forward::trajectories::ForwardModel;
use crate::result::Stage;
use crate::session::Session;
use crate::solve::levenberg_marquardt::Limits;
use crate::solve::objective::Objective;
use crate::solve::problem::Problem;
use crate::stages::candidates::{costs, distinct, ranked};
use crate::stages::identification::Identification;
use crate::tuning::SearchTuning;
use crate::unknowns::state::{State, Unknown};
use crate::{FitError, IdentifyError};

/// Starting points for the full grid, best first. They go into the checkpoint.
///
/// # Errors
/// Where none can be simulated, and interruption.
pub(crate) fn find_starts(identification: &Identification, session: &mut Session) -> Result<Vec<State>, IdentifyError> {
    let mut found = Vec::new();
    if identification.settings.search {
        let candidates = grid_of_starts(identification);
        found =
            coarse_starts(identification, session, &candidates).map_err(|error| error.of_stage(candidates.len()))?;
    }
    found.extend(given_start(identification).map(|given| (0.0, given)));
    let starts = rank_on_full_grid(identification, session, found).map_err(|error| error.of_stage(1))?;
    let reached = session.reach(Some(Stage::Search), |checkpoint| checkpoint.starts = Some(starts.clone()));
    reached.map_err(|error| error.of_stage(1))?;
    Ok(starts)
}

/// The cheapest of `candidates` with their costs, improved on the coarse grid and as they are.
fn coarse_starts(
    identification: &Identification,
    session: &mut Session,
    candidates: &[State],
) -> Result<Vec<(f64, State)>, FitError> {
    let (input, tuning) = (identification.input, &identification.tuning.search);
    let factor = tuning.coarse_factor;
    let thinned = ThinnedContinuum::new(input, tuning);
    let positions: Vec<DVec3> = thinned.ids.iter().map(|i| input.positions[*i]).collect();
    let spacing = factor * input.particle_volume_m3.cbrt();
    let splat_widths =
        SplatWidths::new(&positions, &thinned.scales, spacing, identification.kind, &identification.tuning.surfaces);
    let simulation = Simulation {
        resolution: Resolution {
            thinning: Some(thinned.ids.clone()),
            spacing_factor: factor,
            substeps_per_frame: (input.substeps_per_frame as f64 / factor).ceil() as usize,
        },
        rollouts: &identification.rollouts.coarse,
        splat_widths: &splat_widths,
        ..identification.simulation()
    };
    let comparison = identification.comparison.thinned(&thinned.ids, factor);
    let objective =
        Objective { surface_comparison: &comparison, opacities: &thinned.opacities, ..identification.objective() };
    // The coarse grid would only distort what the grid of starts does not vary.
    let is_varied = |unknown: &Unknown| identification.is_varied(unknown);
    let problem = identification.material_problem(&simulation, identification.tuning.masks.blur_pooling);
    let unknowns = problem.unknowns.iter().copied().filter(is_varied).collect();
    let problem = Problem { objective, unknowns, ..problem };
    let costs = costs(session, candidates, |state| {
        Ok(objective.cost(&simulation.trajectories(state, &problem.selection)?, &problem.selection))
    })?;
    let ranked = ranked(costs.iter().cloned(), candidates);
    let mut found = improved(session, &problem, &ranked, tuning)?;
    found.extend(ranked.iter().take(tuning.full_grid_points).map(|(cost, state)| (*cost, (*state).clone())));
    if found.is_empty() {
        return Err(costs.into_iter().find_map(Result::err).unwrap_or(FitError::NoIteration));
    }
    Ok(found)
}

/// The cheapest of `ranked` after a few steps on the coarse grid; those that fail are left out.
fn improved(
    session: &mut Session,
    problem: &Problem,
    ranked: &[(f64, &State)],
    tuning: &SearchTuning,
) -> Result<Vec<(f64, State)>, FitError> {
    let fits = if problem.unknowns.is_empty() { 0 } else { tuning.starts };
    let limits = Limits::rough(problem.descent.short_iterations, problem.descent);
    let mut found = Vec::new();
    for (_, start) in ranked.iter().take(fits) {
        match session.minimise(Stage::Search, problem, ((*start).clone(), None), limits, &|_| false) {
            Ok(fit) => found.push((fit.cost, fit.state)),
            Err(FitError::Interrupted) => return Err(FitError::Interrupted),
            Err(_) => (),
        }
    }
    Ok(found)
}

/// The coarse grid is biased: the last word between minima belongs to the full one.
fn rank_on_full_grid(
    identification: &Identification,
    session: &mut Session,
    mut found: Vec<(f64, State)>,
) -> Result<Vec<State>, FitError> {
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let distinct = distinct(&identification.minimum_space(), found.into_iter().map(|(_, state)| state));
    if distinct.len() == 1 {
        return Ok(distinct);
    }
    let (simulation, selection) =
        (identification.simulation(), identification.touched_frames(identification.tuning.masks.blur_pooling));
    let objective = identification.objective();
    let cost = |state: &State| Ok(objective.cost(&simulation.trajectories(state, &selection)?, &selection));
    let costs = costs(session, &distinct, cost)?;
    let ranked = ranked(costs.iter().cloned(), distinct);
    if ranked.is_empty() {
        return Err(costs.into_iter().find_map(Result::err).unwrap_or(FitError::NoIteration));
    }
    Ok(ranked.into_iter().take(identification.tuning.search.starts).map(|(_, state)| state).collect())
}

/// Points of the grid of starts: over the whole range of each parameter.
fn grid_of_starts(identification: &Identification) -> Vec<State> {
    let (settings, from) = (identification.settings, &identification.flight.state);
    let mut list = vec![from.clone()];
    for (i, p) in identification.parameters().iter().enumerate() {
        let values: Vec<f64> = match settings.fixed_value(p) {
            Some(value) => vec![p.coordinate(value)],
            None => {
                let (low, high) = (p.coordinate(p.starts.0), p.coordinate(p.starts.1));
                (0..p.grid).map(|k| low + (k as f64 + 0.5) / p.grid as f64 * (high - low)).collect()
            }
        };
        let with = |state: &State, value: f64| {
            let mut next = state.clone();
            next.material[i] = value;
            next
        };
        list = list.iter().flat_map(|state| values.iter().map(|value| with(state, *value))).collect();
    }
    list
}

/// The start that was given, with the values that are fixed.
fn given_start(identification: &Identification) -> Option<State> {
    let settings = identification.settings;
    let start = settings.start.as_ref()?;
    let mut given = identification.flight.state.clone();
    for (i, p) in identification.parameters().iter().enumerate() {
        given.material[i] = p.coordinate(settings.fixed_value(p).unwrap_or(start[i]));
    }
    Some(given)
}
