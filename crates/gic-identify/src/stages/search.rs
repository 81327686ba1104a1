//! Stage 2: starting points of the material.
//!
//! All points of a grid over the parameters' ranges are simulated on a coarse grid with fewer particles. That one is
//! biased, so that the cheapest, and starts that were given, compete again on the full grid. Without a search those
//! that were given are all. Where poses are free, each motion has those that fit best ([`Identification::posed`]).

use glam::DVec3;

use crate::forward::simulation::{Resolution, Simulation};
use crate::forward::splat_widths::SplatWidths;
use crate::forward::thinned::ThinnedContinuum;
use crate::forward::trajectories::ForwardModel;
use crate::result::Stage;
use crate::session::Session;
use crate::solve::objective::Objective;
use crate::stages::candidates::{costs, ranked};
use crate::stages::identification::Identification;
use crate::unknowns::state::State;
use crate::{FitError, IdentifyError, Start};

/// Starting points for the full grid, best first. They go into the checkpoint.
///
/// # Errors
/// Where none can be simulated, and interruption.
pub(crate) fn find_starts(identification: &Identification, session: &mut Session) -> Result<Vec<State>, IdentifyError> {
    let mut starts: Vec<State> = identification.settings.starts.iter().map(|s| given(identification, s)).collect();
    if identification.settings.stages.contains(&Stage::Search) {
        let candidates = grid_of_starts(identification);
        let cheapest = cheapest_on_coarse_grid(identification, session, &candidates);
        starts.extend(cheapest.map_err(|error| error.of_stage(candidates.len()))?);
        starts = rank_on_full_grid(identification, session, starts).map_err(|error| error.of_stage(1))?;
    }
    let reached = session.reach(Some(Stage::Search), |checkpoint| checkpoint.starts = Some(starts.clone()));
    reached.map_err(|error| error.of_stage(1))?;
    Ok(starts)
}

/// Those of `candidates` that cost least on the coarse grid, cheapest first.
fn cheapest_on_coarse_grid(
    identification: &Identification,
    session: &mut Session,
    candidates: &[State],
) -> Result<Vec<State>, FitError> {
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
    cheapest_of(identification, session, (&simulation, objective), (candidates, tuning.full_grid_points))
}

/// The coarse grid is biased: the last word between minima belongs to the full one.
fn rank_on_full_grid(
    identification: &Identification,
    session: &mut Session,
    found: Vec<State>,
) -> Result<Vec<State>, FitError> {
    if found.len() == 1 {
        return Ok(found);
    }
    let compared = (&identification.simulation(), identification.objective());
    cheapest_of(identification, session, compared, (&found, identification.tuning.search.starts))
}

/// Those of `states` that cost least as `simulation` has them, cheapest first, `most` at most.
///
/// # Errors
/// Where none can be simulated, and interruption.
fn cheapest_of(
    identification: &Identification,
    session: &mut Session,
    (simulation, objective): (&Simulation, Objective),
    (states, most): (&[State], usize),
) -> Result<Vec<State>, FitError> {
    let selection = identification.touched_frames(identification.tuning.masks.blur_pooling);
    let posed = identification.posed(simulation, objective);
    let cost = |state: &State| Ok(objective.cost(&posed.trajectories(state, &selection)?, &selection));
    let costs = costs(session, states, cost)?;
    let ranked = ranked(costs.iter().cloned(), states);
    if ranked.is_empty() {
        return Err(costs.into_iter().find_map(Result::err).unwrap_or(FitError::NoIteration));
    }
    Ok(ranked.into_iter().take(most).map(|(_, state)| state.clone()).collect())
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

/// A start that was given, with the values that are fixed.
fn given(identification: &Identification, start: &Start) -> State {
    let mut given = identification.flight.state.clone();
    for (i, p) in identification.parameters().iter().enumerate() {
        given.material[i] = p.coordinate(identification.settings.fixed_value(p).unwrap_or(start.parameters[i]));
    }
    if let Some(cell_m) = start.grid_spacing_m.filter(|_| identification.seeks_cells()) {
        given.log_cell = (cell_m / identification.input.grid_spacing_m).ln();
    }
    given.sticks = start.sticks && identification.contact_is_in_doubt();
    given
}
