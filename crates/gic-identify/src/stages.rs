//! The stages in order: velocity, search, material, joint, intervals.

use std::cell::RefCell;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use gic_mpm::Options;
use glam::DVec3;
use rayon::prelude::*;

use crate::adam::adam;
use crate::checks;
use crate::coarse::Coarse;
use crate::data::Data;
use crate::dilution::Dilution;
use crate::flight::Flight;
use crate::interval::{self, effective_weights, half_width};
use crate::levenberg::{Fit, Iterate, Limits, minimise, perturbed};
use crate::loss::mean_loss;
use crate::normal::{Normal, Weights};
use crate::objective::{Forward, Level, Motion, Objective, Problem};
use crate::result::{Estimate, Identification, Loss, Stage, Step};
use crate::simulation::{Resolution, Simulation};
use crate::state::{State, Unknown};
use crate::surface::Context;
use crate::velocity::{Launch, clearance, launch};
use crate::{IdentifyError, Input, MaterialKind, Optimizer, Parameter, Settings};

/// Factor between the grid of the search and that of the estimate.
const COARSE: f64 = 2.0;

/// Points of the grid of starts that are compared on the full grid.
const FULL_GRID_POINTS: usize = 16;

/// Iterations from each start, and from the best of them.
const SHORT_FIT: usize = 3;
const LONG_FIT: usize = 5;

/// Extra pooling of the masks while the outlines may still be far apart: Gauss-Newton steps reach about as far as the pictures are
/// blurred, and a sharp outline would let it creep.
const BLUR: usize = 8;

/// Starts from which the material is fitted on the full grid.
const FULL_GRID_FITS: usize = 3;

/// Starts that are improved on the coarse grid.
const COARSE_FITS: usize = 3;

/// Everything that the stages share.
pub(crate) struct Job<'a> {
    pub input: &'a Input,
    pub kind: MaterialKind,
    pub settings: &'a Settings,
    pub data: Data,
    pub context: Context,
    pub dilution: Dilution,
    pub weights: Weights,
    pub fine: AtomicUsize,
    pub coarse: AtomicUsize,
    pub clock: Instant,
    pub trace: RefCell<Vec<Step>>,
    pub events: RefCell<&'a mut dyn FnMut(&Step)>,
    pub warnings: RefCell<Vec<String>>,
    pub seconds: RefCell<Vec<(Stage, f64)>>,
}

impl Job<'_> {
    pub(crate) fn parameters(&self) -> &'static [Parameter] {
        self.kind.parameters()
    }

    pub(crate) fn objective<'b>(&'b self, opacities: &'b [f32]) -> Objective<'b> {
        Objective { data: &self.data, opacities, surface_context: &self.context, weights: self.weights }
    }

    pub(crate) fn all_frames(&self) -> Level {
        Level { first: 0, end: self.data.moments.len(), pooling: 1 }
    }

    pub(crate) fn free_materials(&self) -> Vec<Unknown> {
        let fixed = |p: &Parameter| self.settings.fixed.iter().any(|(name, _)| name == p.name);
        (0..self.parameters().len()).filter(|i| !fixed(&self.parameters()[*i])).map(Unknown::Material).collect()
    }

    pub(crate) fn simulation(&self, free: usize) -> Simulation<'_> {
        Simulation {
            input: self.input,
            data: &self.data,
            kind: self.kind,
            options: Options { parallel: false, ..Options::default() },
            resolution: Resolution {
                thinning: None,
                spacing_factor: 1.0,
                substeps_per_frame: self.input.substeps_per_frame,
            },
            free,
            rollouts: &self.fine,
            dilution: &self.dilution,
        }
    }

    pub(crate) fn report(&self, stage: Stage, iterate: &Iterate) {
        let mut trace = self.trace.borrow_mut();
        let iteration = trace.iter().filter(|s| s.stage == stage).count();
        let values = self.parameters().iter().zip(&iterate.state.material).map(|(p, c)| p.value(*c)).collect();
        let step = Step {
            stage,
            iteration,
            objective: iterate.cost,
            values,
            velocity_m_s: iterate.state.velocity,
            rollouts: self.fine.load(Ordering::Relaxed),
            seconds: self.clock.elapsed().as_secs_f64(),
        };
        (self.events.borrow_mut())(&step);
        trace.push(step);
    }

    #[allow(clippy::too_many_arguments)]
    pub(crate) fn minimise(
        &self,
        stage: Stage,
        forward: &dyn Forward,
        objective: Objective,
        unknowns: Vec<Unknown>,
        level: Level,
        start: State,
        iterations: usize,
    ) -> Result<Fit, String> {
        let problem = Problem { forward, objective, unknowns, parameters: self.parameters(), level };
        // The early stages only have to hand over a good start.
        let gain_tolerance = match stage {
            Stage::Search => 0.02,
            Stage::Material => 0.01,
            _ => 1e-4,
        };
        let limits = Limits { iterations, step_tolerance: 0.05, gain_tolerance };
        minimise(&problem, start, limits, &mut |iterate| self.report(stage, iterate))
    }
}

/// Identifies material and initial velocity.
///
/// `events` sees every accepted step. A rollout that fails is a rejected step; only where no start at all can be simulated is that
/// an error.
pub fn identify(
    input: &Input,
    kind: MaterialKind,
    settings: &Settings,
    events: &mut dyn FnMut(&Step),
) -> Result<Identification, IdentifyError> {
    input.validate()?;
    for (name, value) in &settings.fixed {
        let parameter = kind.parameters()[kind.index_of(name)?];
        if !(*value >= parameter.bounds.0 && *value <= parameter.bounds.1) {
            let (low, high) = parameter.bounds;
            return Err(IdentifyError::input(name, format!("is fixed to {value}"), format!("give {low} to {high}")));
        }
    }
    if let Some(start) = &settings.start
        && start.len() != kind.parameters().len()
    {
        let wanted = kind.parameters().iter().map(|p| p.name).collect::<Vec<_>>().join(", ");
        return Err(IdentifyError::input("start", format!("has {} values", start.len()), format!("give {wanted}")));
    }
    let mut input = input.clone();
    if let Some(frames) = settings.frames {
        input.observations.truncate(frames.max(2));
    }
    let outside = clearance(&input, &input.positions, 0) > 0.0;
    if !outside {
        return Err(IdentifyError::input(
            "colliders",
            "particles are inside an obstacle at time 0",
            "check the obstacles against the scene, or drop the one that contradicts it",
        ));
    }
    let mut warnings = Vec::new();
    if input.observations.len() < 3 {
        warnings.push("two frames only: the material can hardly show; expect wide intervals".to_owned());
    }
    let excluded = checks::wrong_cameras(&input, settings.target, &mut warnings);
    let data = Data::new(&input, settings.target, &excluded);
    let context = Context::new(&input, data.moments[0].surface.as_ref());
    let dilution = Dilution::new(&input.positions, &input.scales, input.particle_volume_m3.cbrt());
    // A tenth of a pixel's alpha and a tenth of a cell, until the data's own noise is known.
    let weights = Weights { mask: 100.0, surface: (0.1 * input.grid_spacing_m).powi(-2) };
    let job = Job {
        input: &input,
        kind,
        settings,
        data,
        context,
        dilution,
        weights,
        fine: AtomicUsize::new(0),
        coarse: AtomicUsize::new(0),
        clock: Instant::now(),
        trace: RefCell::new(Vec::new()),
        events: RefCell::new(events),
        warnings: RefCell::new(warnings),
        seconds: RefCell::new(Vec::new()),
    };
    run(job)
}

/// Weights never exceed those of a thousandth of a pixel's alpha and of a cell.
fn weight_ceilings(input: &Input) -> Weights {
    Weights { mask: 1e6, surface: (1e-3 * input.grid_spacing_m).powi(-2) }
}

fn run(mut job: Job) -> Result<Identification, IdentifyError> {
    let launched = job.launch()?;
    job.lap(Stage::Velocity);
    // From here on each modality counts by the noise that it showed before anything was touched.
    job.weights = effective_weights(&launched.clusters, launched.unknowns, weight_ceilings(job.input));
    if launched.free == job.data.moments.len() && !job.touches(&launched) {
        job.warn("the object never touches anything: only its velocity is determined, not its material".to_owned());
        return Ok(job.finish_untouched(&launched));
    }
    let starts = job.search(&launched)?;
    job.lap(Stage::Search);
    let state = job.fit_material(&launched, starts)?;
    job.lap(Stage::Material);
    let fit = job.fit_jointly(&launched, state)?;
    job.lap(Stage::Joint);
    Ok(job.finish(&launched, &fit))
}

impl Job<'_> {
    pub(crate) fn warn(&self, message: String) {
        self.warnings.borrow_mut().push(message);
    }

    /// Books the time since the last booking.
    fn lap(&self, stage: Stage) {
        let mut seconds = self.seconds.borrow_mut();
        let before: f64 = seconds.iter().map(|(_, s)| s).sum();
        seconds.push((stage, self.clock.elapsed().as_secs_f64() - before));
    }

    fn base_objective(&self) -> Objective<'_> {
        self.objective(&self.input.opacities)
    }

    fn launch(&self) -> Result<Launch, IdentifyError> {
        let middle = |p: &Parameter| {
            let fixed = self.settings.fixed.iter().find(|(name, _)| name == p.name).map(|(_, value)| *value);
            p.coordinate(fixed.unwrap_or_else(|| f64::midpoint(p.starts.0, p.starts.1)))
        };
        let mut start = State::new(self.parameters().iter().map(middle).collect());
        start.velocity = self.settings.velocity_m_s.unwrap_or_default();
        let known = self.settings.velocity_m_s.is_some();
        launch(self.input, &self.data, self.base_objective(), start, self.settings.rotation, known)
            .map_err(|reason| IdentifyError::NoStart { starts: 1, reason })
    }

    /// Whether the free flight goes on to touch something between or after the observed frames.
    fn touches(&self, launched: &Launch) -> bool {
        let flight = Flight { input: self.input, data: &self.data };
        let last = self.data.moments.last().map_or(0, |moment| moment.frame);
        clearance(self.input, &flight.positions(&launched.state, last), last) < 1.5 * self.input.grid_spacing_m
    }

    /// Material from the best starts, with the velocity of stage 1.
    fn fit_material(&self, launched: &Launch, starts: Vec<State>) -> Result<State, IdentifyError> {
        if let Optimizer::Adam { iterations } = self.settings.optimizer {
            let start = starts.into_iter().next().ok_or(IdentifyError::Interrupted)?;
            return adam(self, launched.free, start, iterations)
                .map_err(|reason| IdentifyError::NoStart { starts: 1, reason });
        }
        let simulation = self.simulation(launched.free);
        let level = Level { pooling: BLUR, ..self.all_frames() };
        let fit = |start: State, iterations: usize| {
            let (unknowns, level) = (self.free_materials(), level.clone());
            self.minimise(Stage::Material, &simulation, self.base_objective(), unknowns, level, start, iterations)
        };
        // A few steps from each start tell which basin is worth the rest.
        let mut best: Option<(f64, State)> = None;
        let (mut reason, tried) = (String::new(), starts.len());
        for start in starts {
            match fit(start, SHORT_FIT) {
                Ok(fit) if best.as_ref().is_none_or(|(cost, _)| fit.cost < *cost) => best = Some((fit.cost, fit.state)),
                Ok(_) => {}
                Err(error) => reason = error,
            }
        }
        let failed = |reason: String| IdentifyError::NoStart { starts: tried, reason };
        let (_, state) = best.ok_or_else(|| failed(reason))?;
        let state = fit(state, LONG_FIT).map_err(failed)?.state;
        if !self.settings.target.masks() {
            return Ok(state);
        }
        let (unknowns, level) = (self.free_materials(), Level { pooling: 2, ..self.all_frames() });
        self.minimise(Stage::Material, &simulation, self.base_objective(), unknowns, level, state, 3)
            .map(|fit| fit.state)
            .map_err(failed)
    }

    fn joint_unknowns(&self, launched: &Launch) -> Vec<Unknown> {
        let mut unknowns = self.free_materials();
        if self.settings.velocity_m_s.is_none() {
            unknowns.extend((0..3).map(Unknown::Velocity));
        }
        unknowns.extend((0..3).map(Unknown::Offset));
        if launched.rotates {
            unknowns.extend((0..3).map(Unknown::Angular));
        }
        if self.settings.target.masks() {
            unknowns.push(Unknown::Splat);
        }
        unknowns
    }

    /// Material, velocity and nuisances together, so that errors of stage 1 do not bias the material.
    fn fit_jointly(&self, launched: &Launch, start: State) -> Result<Fit, IdentifyError> {
        let simulation = self.simulation(launched.free);
        let iterations = match self.settings.optimizer {
            Optimizer::LevenbergMarquardt => self.settings.iterations,
            // The paper stops after its material stage; the Jacobian is still needed for the intervals.
            Optimizer::Adam { .. } => 0,
        };
        let unknowns = self.joint_unknowns(launched);
        let level = self.all_frames();
        self.minimise(Stage::Joint, &simulation, self.base_objective(), unknowns, level, start, iterations)
            .map_err(|reason| IdentifyError::NoStart { starts: 1, reason })
    }

    fn material(&self, state: &State) -> gic_mpm::Material {
        let values: Vec<f64> = self.parameters().iter().zip(&state.material).map(|(p, c)| p.value(*c)).collect();
        self.kind.material(&values)
    }

    fn finish_untouched(&self, launched: &Launch) -> Identification {
        let motion = Flight { input: self.input, data: &self.data }.motion(&launched.state, &self.all_frames());
        let estimates = self
            .parameters()
            .iter()
            .zip(&launched.state.material)
            .map(|(p, c)| self.estimate(p, *c, None, None))
            .collect();
        self.result(launched, &launched.state, estimates, DVec3::NAN, motion.ok().as_ref())
    }

    /// Intervals, checks, and everything into one result.
    fn finish(&self, launched: &Launch, fit: &Fit) -> Identification {
        let simulation = self.simulation(launched.free);
        let mut unknowns = self.joint_unknowns(launched);
        let count = unknowns.len();
        unknowns.push(Unknown::Size);
        let problem = Problem {
            forward: &simulation,
            objective: self.base_objective(),
            unknowns: unknowns.clone(),
            parameters: self.parameters(),
            level: self.all_frames(),
        };
        let (mut covariance, mut shifts) = (None, None);
        match perturbed(&problem, &fit.state, &fit.motion) {
            Ok((mut motions, mut steps)) => {
                // A refined grid is one more direction in which the residuals move.
                let refined = self.refined(launched, fit);
                if let Some(motion) = refined {
                    motions.push(motion);
                    steps.push(1.0);
                }
                let clusters = problem.objective.clusters(&fit.motion, &motions, &steps, &problem.level);
                let total = Normal::sum(&clusters, self.weights, steps.len());
                covariance = interval::covariance(&clusters, self.weights, count, self.size_sigma());
                shifts =
                    (steps.len() > count + 1).then(|| interval::response(&total.hessian, count, count + 1)).flatten();
            }
            Err(reason) => self.warn(format!("no intervals: {reason}")),
        }
        let deviation = |unknown: Unknown| {
            let k = unknowns.iter().position(|u| *u == unknown)?;
            covariance.as_ref().map(|c| half_width(c[(k, k)]))
        };
        let estimates = (0..self.parameters().len())
            .map(|i| {
                let unknown = Unknown::Material(i);
                let shift = unknowns.iter().position(|u| *u == unknown).and_then(|k| shifts.as_ref().map(|s| s[k]));
                self.estimate(&self.parameters()[i], fit.state.material[i], deviation(unknown), shift)
            })
            .collect();
        let velocity = DVec3::from_array([0, 1, 2].map(|a| deviation(Unknown::Velocity(a)).unwrap_or(0.0)));
        checks::explained(self, launched, fit);
        self.lap(Stage::Intervals);
        self.result(launched, &fit.state, estimates, velocity, Some(&fit.motion))
    }

    /// Standard deviation of the logarithm of the continuum's size: a tenth of a particle spacing on each side.
    fn size_sigma(&self) -> f64 {
        let centre = self.input.centre();
        let radius =
            self.input.positions.iter().map(|p| p.distance(centre)).sum::<f64>() / self.input.positions.len() as f64;
        0.1 * self.input.particle_volume_m3.cbrt() / radius
    }

    /// The motion at the estimate on a refined grid, for the resolution check.
    fn refined(&self, launched: &Launch, fit: &Fit) -> Option<Motion> {
        let factor = self.settings.resolution_check?;
        let mut simulation = self.simulation(launched.free);
        simulation.resolution.spacing_factor = 1.0 / factor;
        simulation.resolution.substeps_per_frame = (self.input.substeps_per_frame as f64 * factor).ceil() as usize;
        simulation.motion(&fit.state, &self.all_frames()).ok()
    }

    fn estimate(&self, p: &Parameter, coordinate: f64, half: Option<f64>, shift: Option<f64>) -> Estimate {
        let value = p.value(coordinate);
        let fixed = self.settings.fixed.iter().any(|(name, _)| name == p.name);
        let (low, high) = p.limits();
        let interval = match half {
            _ if fixed => (value, value),
            Some(half) => (p.value((coordinate - half).max(low)), p.value((coordinate + half).min(high))),
            None => p.bounds,
        };
        let at_bound = !fixed && ((coordinate - low).abs() < 1e-3 || (coordinate - high).abs() < 1e-3);
        let width = 0.5 * p.error(interval.1, interval.0).abs();
        Estimate {
            parameter: *p,
            value,
            interval_95: interval,
            identifiable: !at_bound && width < p.widest,
            fixed,
            resolution_shift: shift.map(|s| p.value((coordinate + s).clamp(low, high)) - value),
        }
    }

    fn result(
        &self,
        launched: &Launch,
        state: &State,
        estimates: Vec<Estimate>,
        velocity_interval_95: DVec3,
        motion: Option<&Motion>,
    ) -> Identification {
        if self.kind != MaterialKind::Sand {
            self.warn(format!(
                "density is taken as {} kg/m^3: the video determines only the ratios of the moduli, stresses and viscosities to it",
                self.input.density_kg_m3
            ));
        }
        Identification {
            material: self.material(state),
            estimates,
            velocity_m_s: state.velocity,
            velocity_interval_95,
            angular_velocity_rad_s: state.angular,
            free_frames: launched.free,
            loss: motion.map_or_else(Loss::default, |m| mean_loss(&self.data, &self.context, &self.input.opacities, m)),
            trace: self.trace.borrow().clone(),
            rollouts: self.fine.load(Ordering::Relaxed),
            coarse_rollouts: self.coarse.load(Ordering::Relaxed),
            seconds: self.seconds.borrow().clone(),
            warnings: self.warnings.borrow().clone(),
            splat_factor: state.splat.exp(),
            offset_m: state.offset,
        }
    }

    /// Starting points for the full grid, best first: the cheapest points of a grid of starts, improved on the coarse grid.
    fn search(&self, launched: &Launch) -> Result<Vec<State>, IdentifyError> {
        let coarse = Coarse::new(self.input, COARSE);
        let mut simulation = self.simulation(launched.free);
        simulation.resolution = Resolution {
            thinning: Some(coarse.ids.clone()),
            spacing_factor: COARSE,
            substeps_per_frame: (self.input.substeps_per_frame as f64 / COARSE).ceil() as usize,
        };
        simulation.rollouts = &self.coarse;
        let thinned: Vec<DVec3> = coarse.ids.iter().map(|i| self.input.positions[*i]).collect();
        let spacing = COARSE * self.input.particle_volume_m3.cbrt();
        let dilution = Dilution::new(&thinned, &coarse.scales, spacing);
        simulation.dilution = &dilution;
        let context = self.context.thinned(&coarse.ids, COARSE);
        let objective = Objective { surface_context: &context, ..self.objective(&coarse.opacities) };
        let candidates = self.candidates(&launched.state);
        let level = Level { pooling: BLUR, ..self.all_frames() };
        let costs: Vec<Result<f64, String>> = candidates
            .par_iter()
            .map(|state| simulation.motion(state, &level).map(|motion| objective.cost(&motion, &level)))
            .collect();
        let mut ranked: Vec<(f64, &State)> =
            costs.iter().zip(&candidates).filter_map(|(cost, state)| Some((*cost.as_ref().ok()?, state))).collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut found: Vec<(f64, State)> = Vec::new();
        for (_, start) in ranked.iter().take(COARSE_FITS) {
            let unknowns = self.free_materials();
            if let Ok(fit) =
                self.minimise(Stage::Search, &simulation, objective, unknowns, level.clone(), (*start).clone(), 5)
            {
                found.push((fit.cost, fit.state));
            }
        }
        // The coarse grid may lead astray: its best points go to the full grid as they are, too.
        found.extend(ranked.iter().take(FULL_GRID_POINTS).map(|(cost, state)| (*cost, (*state).clone())));
        if found.is_empty() {
            let reason = costs.into_iter().find_map(Result::err).unwrap_or_default();
            return Err(IdentifyError::NoStart { starts: candidates.len(), reason });
        }
        self.rank_on_full_grid(launched, found)
    }

    /// The coarse grid is biased: the last word between basins belongs to the full one.
    fn rank_on_full_grid(&self, launched: &Launch, mut found: Vec<(f64, State)>) -> Result<Vec<State>, IdentifyError> {
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut distinct: Vec<State> = Vec::new();
        for (_, state) in found {
            let near = |other: &State| other.material.iter().zip(&state.material).all(|(a, b)| (a - b).abs() < 0.2);
            if !distinct.iter().any(near) {
                distinct.push(state);
            }
        }
        if distinct.len() == 1 {
            return Ok(distinct);
        }
        let level = Level { pooling: BLUR, ..self.all_frames() };
        let simulation = self.simulation(launched.free);
        let objective = self.base_objective();
        let mut ranked: Vec<(f64, State)> = distinct
            .into_par_iter()
            .filter_map(|state| {
                let motion = simulation.motion(&state, &level).ok()?;
                Some((objective.cost(&motion, &level), state))
            })
            .collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        let Some(best) = ranked.first().map(|r| r.0) else {
            return Err(IdentifyError::NoStart { starts: 1, reason: "no start runs on the full grid".to_owned() });
        };
        Ok(ranked
            .into_iter()
            .filter(|(cost, _)| *cost < 3.0 * best)
            .take(FULL_GRID_FITS)
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
