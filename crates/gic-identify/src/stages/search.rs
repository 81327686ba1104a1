//! The search: a grid of starts on a coarse simulation grid, judged again on the full one.

use glam::DVec3;
use rayon::prelude::*;

use crate::IdentifyError;
use crate::checkpoint::Event;
use crate::forward::simulation::{Resolution, Simulation};
use crate::forward::splat_widths::SplatWidths;
use crate::forward::thinned::ThinnedContinuum;
use crate::forward::trajectories::{ForwardModel, FrameSelection};
use crate::result::Stage;
use crate::solve::levenberg_marquardt::Limits;
use crate::solve::objective::Objective;
use crate::stages::free_flight::FreeFlightFit;
use crate::stages::{BLUR, Identification};
use crate::unknowns::state::{State, Unknown};

/// Factor between the grid of the search and that of the estimate.
const COARSE: f64 = 2.0;

/// Starts that are improved on the coarse grid.
const COARSE_FITS: usize = 3;

/// Iterations of each.
const COARSE_STEPS: usize = 5;

/// Points of the grid of starts that are compared on the full grid: so many that their particles are about this many, but
/// within limits. The fewer particles there are, the less does the coarse grid resolve, and the cheaper is the full one.
const FULL_GRID_PARTICLES: usize = 40_000;
const FULL_GRID_POINTS: (usize, usize) = (4, 16);

/// Starts from which the material is fitted on the full grid: as many as it has unknowns, but at least these. The more unknowns, the more
/// valleys.
const FULL_GRID_FITS: usize = 2;

/// Rollouts between two looks at whether to stop.
const BATCH: usize = 8;

impl Identification<'_> {
    /// Starting points for the full grid, best first: the cheapest points of a grid of starts, improved on the coarse grid.
    pub(crate) fn search(&self, flight_fit: &FreeFlightFit) -> Result<Vec<State>, IdentifyError> {
        let coarse = ThinnedContinuum::new(self.input, COARSE);
        let mut simulation = self.simulation(flight_fit.free);
        simulation.resolution = Resolution {
            thinning: Some(coarse.ids.clone()),
            spacing_factor: COARSE,
            substeps_per_frame: (self.input.substeps_per_frame as f64 / COARSE).ceil() as usize,
        };
        simulation.rollouts = &self.coarse;
        let thinned: Vec<DVec3> = coarse.ids.iter().map(|i| self.input.positions[*i]).collect();
        let spacing = COARSE * self.input.particle_volume_m3.cbrt();
        let splat_widths = SplatWidths::new(&thinned, &coarse.scales, spacing);
        simulation.splat_widths = &splat_widths;
        let context = self.context.thinned(&coarse.ids, COARSE);
        let objective = Objective { surface_comparison: &context, ..self.objective(&coarse.opacities) };
        let candidates = self.candidates(&flight_fit.state);
        let selection = self.touched_frames(flight_fit, BLUR);
        let costs = self.costs(&simulation, objective, &candidates, &selection)?;
        let mut ranked: Vec<(f64, &State)> =
            costs.iter().zip(&candidates).filter_map(|(cost, state)| Some((*cost.as_ref().ok()?, state))).collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut found: Vec<(f64, State)> = Vec::new();
        // The coarse grid would only distort what the grid of starts does not vary.
        let unknowns: Vec<Unknown> = self.free_materials().into_iter().filter(|u| self.is_varied(u)).collect();
        let coarse_fits = if unknowns.is_empty() { 0 } else { COARSE_FITS };
        let limits = Limits { iterations: COARSE_STEPS, gain_tolerance: 0.02, ..Limits::ROUGH };
        for (_, start) in ranked.iter().take(coarse_fits) {
            let (start, selection, unknowns) = ((*start).clone(), selection.clone(), unknowns.clone());
            if let Ok(fit) =
                self.minimise(Stage::Search, &simulation, objective, unknowns, selection, start, limits, &|_| false)
            {
                found.push((fit.cost, fit.state));
            }
            if self.stopped.get() {
                return Err(IdentifyError::Interrupted);
            }
        }
        // The coarse grid may lead astray: its best points go to the full grid as they are, too.
        let points = (FULL_GRID_PARTICLES / self.input.positions.len()).clamp(FULL_GRID_POINTS.0, FULL_GRID_POINTS.1);
        found.extend(ranked.iter().take(points).map(|(cost, state)| (*cost, (*state).clone())));
        if found.is_empty() {
            let reason = costs.into_iter().find_map(Result::err).unwrap_or_default();
            return Err(IdentifyError::NoStart { starts: candidates.len(), reason });
        }
        self.rank_on_full_grid(flight_fit, found)
    }

    /// What each of `states` costs, or why it cannot be simulated.
    pub(crate) fn costs(
        &self,
        simulation: &Simulation,
        objective: Objective,
        states: &[State],
        selection: &FrameSelection,
    ) -> Result<Vec<Result<f64, String>>, IdentifyError> {
        let mut costs = Vec::new();
        for batch in states.chunks(BATCH) {
            let run = |state| {
                simulation.trajectories(state, selection).map(|trajectories| objective.cost(&trajectories, selection))
            };
            costs.extend(batch.par_iter().with_max_len(1).map(run).collect::<Vec<_>>());
            self.tell(Event::Working).map_err(|_| IdentifyError::Interrupted)?;
        }
        Ok(costs)
    }

    /// The coarse grid is biased: the last word between basins belongs to the full one.
    fn rank_on_full_grid(
        &self,
        flight_fit: &FreeFlightFit,
        mut found: Vec<(f64, State)>,
    ) -> Result<Vec<State>, IdentifyError> {
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        let distinct = self.distinct(found.into_iter().map(|(_, state)| state));
        if distinct.len() == 1 {
            return Ok(distinct);
        }
        let selection = self.touched_frames(flight_fit, BLUR);
        let simulation = self.simulation(flight_fit.free);
        let costs = self.costs(&simulation, self.base_objective(), &distinct, &selection)?;
        let mut ranked: Vec<(f64, State)> =
            costs.into_iter().zip(distinct).filter_map(|(cost, state)| Some((cost.ok()?, state))).collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        let Some(best) = ranked.first().map(|r| r.0) else {
            return Err(IdentifyError::NoStart { starts: 1, reason: "no start runs on the full grid".to_owned() });
        };
        Ok(ranked
            .into_iter()
            .filter(|(cost, _)| *cost < 3.0 * best)
            .take(self.free_materials().len().max(FULL_GRID_FITS))
            .map(|(_, state)| state)
            .collect())
    }

    /// Points of the grid of starts: over the whole range of each parameter, plus the start that was given.
    fn candidates(&self, from: &State) -> Vec<State> {
        let mut list = vec![from.clone()];
        for (i, p) in self.parameters().iter().enumerate() {
            let fixed = self.settings.fixed.iter().find(|(name, _)| name == p.name);
            let values: Vec<f64> = if let Some((_, value)) = fixed {
                vec![p.coordinate(*value)]
            } else {
                let (low, high) = (p.coordinate(p.starts.0), p.coordinate(p.starts.1));
                let count = p.grid;
                (0..count).map(|k| low + (k as f64 + 0.5) / count as f64 * (high - low)).collect()
            };
            list = list
                .into_iter()
                .flat_map(|state| {
                    values.iter().map(move |value| {
                        let mut next = state.clone();
                        next.material[i] = *value;
                        next
                    })
                })
                .collect();
        }
        if let Some(start) = &self.settings.start {
            let mut given = from.clone();
            for (i, p) in self.parameters().iter().enumerate() {
                if !self.settings.fixed.iter().any(|(name, _)| name == p.name) {
                    given.material[i] = p.coordinate(start[i]);
                }
            }
            list.push(given);
        }
        list
    }
}
