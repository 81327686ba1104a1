//! The stages in order: velocity, search, material, joint, intervals.

use std::cell::{Cell, RefCell};
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use gic_mpm::Options;
use nalgebra::{DMatrix, DVector};

use crate::adam::adam;
use crate::checkpoint::{Checkpoint, Event};
use crate::checks;
use crate::data::Data;
use crate::dilution::Dilution;
use crate::flight::Flight;
use crate::interval::{self, effective_weights};
use crate::levenberg::{Fit, Iterate, Limits, minimise};
use crate::normal::Weights;
use crate::objective::{Forward, Level, Objective, Prior, Problem};
use crate::result::{Identification, Stage, Step};
use crate::simulation::{Resolution, Simulation};
use crate::state::{State, Unknown};
use crate::surface::Context;
use crate::velocity::{Launch, clearance, launch};
use crate::{IdentifyError, Input, MaterialKind, Optimizer, Parameter, Settings};

/// Steps from each start, from the best of them, and with sharper masks.
const SHORT_FIT: usize = 3;
const LONG_FIT: usize = 6;
const SHARP_FIT: usize = 4;

/// Extra pooling of the masks while the outlines may still be far apart: Gauss-Newton steps reach about as far as the pictures are
/// blurred, and a sharp outline would let it creep.
pub(crate) const BLUR: usize = 8;

/// Pooling of the last steps of the material stage.
const SHARP: usize = 2;

/// Who hears of events and may say stop.
pub(crate) type Listener<'a> = dyn FnMut(Event) -> ControlFlow<()> + 'a;

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
    /// Seconds of earlier sessions.
    pub before: f64,
    pub checkpoint: RefCell<Checkpoint>,
    pub listener: RefCell<&'a mut Listener<'a>>,
    pub stopped: Cell<bool>,
    pub warnings: RefCell<Vec<String>>,
}

impl Job<'_> {
    pub(crate) fn parameters(&self) -> &'static [Parameter] {
        self.kind.parameters()
    }

    pub(crate) fn objective<'b>(&'b self, opacities: &'b [f32]) -> Objective<'b> {
        Objective { data: &self.data, opacities, surface_context: &self.context, weights: self.weights }
    }

    pub(crate) fn base_objective(&self) -> Objective<'_> {
        self.objective(&self.input.opacities)
    }

    pub(crate) fn all_frames(&self) -> Level {
        Level { first: 0, end: self.data.moments.len(), pooling: 1 }
    }

    /// The frames that tell about the material: those after the last of free flight.
    pub(crate) fn touched_frames(&self, launched: &Launch, pooling: usize) -> Level {
        let last = self.data.moments.len() - 1;
        Level { first: launched.free.min(last), pooling, ..self.all_frames() }
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

    pub(crate) fn warn(&self, message: String) {
        self.warnings.borrow_mut().push(message);
    }

    /// Tells the listener; an error once it said stop.
    pub(crate) fn tell(&self, event: Event) -> Result<(), String> {
        if self.stopped.get() || (self.listener.borrow_mut())(event).is_break() {
            self.stopped.set(true);
            return Err("interrupted".to_owned());
        }
        Ok(())
    }

    /// The error of a stage, which is another where it was stopped.
    pub(crate) fn failure(&self, starts: usize) -> impl Fn(String) -> IdentifyError {
        let stopped = self.stopped.clone();
        move |reason| {
            if stopped.get() { IdentifyError::Interrupted } else { IdentifyError::NoStart { starts, reason } }
        }
    }

    pub(crate) fn report(&self, stage: Stage, iterate: &Iterate) -> Result<(), String> {
        let step = {
            let trace = &mut self.checkpoint.borrow_mut().trace;
            let step = Step {
                stage,
                iteration: trace.iter().filter(|s| s.stage == stage).count(),
                objective: iterate.cost,
                values: self.parameters().iter().zip(&iterate.state.material).map(|(p, c)| p.value(*c)).collect(),
                velocity_m_s: iterate.state.velocity,
                rollouts: self.fine.load(Ordering::Relaxed),
                seconds: self.before + self.clock.elapsed().as_secs_f64(),
            };
            trace.push(step.clone());
            step
        };
        self.tell(Event::Step(&step))
    }

    /// Changes the checkpoint and hands it out, with the time since the last stage booked on `stage`.
    fn reach(&self, stage: Option<Stage>, change: impl FnOnce(&mut Checkpoint)) -> Result<(), IdentifyError> {
        let checkpoint = {
            let mut checkpoint = self.checkpoint.borrow_mut();
            change(&mut checkpoint);
            checkpoint.rollouts = (self.fine.load(Ordering::Relaxed), self.coarse.load(Ordering::Relaxed));
            if let Some(stage) = stage {
                let booked: f64 = checkpoint.seconds.iter().map(|(_, s)| s).sum();
                checkpoint.seconds.push((stage, self.before + self.clock.elapsed().as_secs_f64() - booked));
            }
            checkpoint.clone()
        };
        self.tell(Event::Reached(&checkpoint)).map_err(|_| IdentifyError::Interrupted)
    }

    #[allow(clippy::too_many_arguments)]
    pub(crate) fn minimise(
        &self,
        stage: Stage,
        forward: &dyn Forward,
        objective: Objective,
        unknowns: Vec<Unknown>,
        level: Level,
        prior: Option<&Prior>,
        start: State,
        iterations: usize,
    ) -> Result<Fit, String> {
        let problem = Problem { forward, objective, unknowns, parameters: self.parameters(), level, prior };
        // The early stages only have to hand over a good start.
        let gain_tolerance = match stage {
            Stage::Search => 0.02,
            Stage::Material => 0.01,
            _ => 1e-3,
        };
        let limits = Limits { iterations, step_tolerance: 0.05, gain_tolerance, secants: true };
        minimise(&problem, start, limits, &mut |iterate| self.report(stage, iterate))
    }
}

/// Identifies material and initial velocity.
///
/// `listener` hears of every accepted step and of every checkpoint, and stops the work by [`ControlFlow::Break`]: the error is then
/// [`IdentifyError::Interrupted`]. `resume` is the last checkpoint of an earlier call with the same arguments, or the default one; the answer
/// is the same. A rollout that fails is a rejected step; only where no start at all can be simulated is that an error.
pub fn identify(
    input: &Input,
    kind: MaterialKind,
    settings: &Settings,
    resume: Checkpoint,
    listener: &mut Listener,
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
        fine: AtomicUsize::new(resume.rollouts.0),
        coarse: AtomicUsize::new(resume.rollouts.1),
        clock: Instant::now(),
        before: resume.seconds.iter().map(|(_, s)| s).sum(),
        checkpoint: RefCell::new(resume),
        listener: RefCell::new(listener),
        stopped: Cell::new(false),
        warnings: RefCell::new(warnings),
    };
    run(job)
}

/// Weights never exceed those of a thousandth of a pixel's alpha and of a cell.
fn weight_ceilings(input: &Input) -> Weights {
    Weights { mask: 1e6, surface: (1e-3 * input.grid_spacing_m).powi(-2) }
}

fn run(mut job: Job) -> Result<Identification, IdentifyError> {
    let resumed = job.checkpoint.borrow().clone();
    let launched = job.launch()?;
    if resumed.seconds.is_empty() {
        job.reach(Some(Stage::Velocity), |_| ())?;
    }
    let flown = job.flown(&launched);
    // From here on each modality counts by the noise that it showed before anything was touched.
    job.weights = effective_weights(&launched.clusters, launched.unknowns.len(), weight_ceilings(job.input));
    if launched.free == job.data.moments.len() && !job.touches(&launched) {
        job.warn("the object never touches anything: only its velocity is determined, not its material".to_owned());
        return Ok(job.finish_untouched(&launched));
    }
    let starts = match resumed.starts {
        Some(starts) => starts,
        None => {
            let starts = job.search(&launched)?;
            job.reach(Some(Stage::Search), |checkpoint| checkpoint.starts = Some(starts.clone()))?;
            starts
        }
    };
    let material = match resumed.material {
        Some(state) => state,
        None => {
            let state = job.fit_material(&launched, starts)?;
            job.reach(Some(Stage::Material), |checkpoint| checkpoint.material = Some(state.clone()))?;
            state
        }
    };
    let joint = match resumed.joint {
        Some(state) => state,
        None => {
            let state = job.fit_jointly(&launched, flown.as_ref(), material)?;
            job.reach(Some(Stage::Joint), |checkpoint| checkpoint.joint = Some(state.clone()))?;
            state
        }
    };
    job.finish(&launched, flown.as_ref(), &joint)
}

impl Job<'_> {
    fn launch(&self) -> Result<Launch, IdentifyError> {
        let middle = |p: &Parameter| {
            let fixed = self.settings.fixed.iter().find(|(name, _)| name == p.name).map(|(_, value)| *value);
            p.coordinate(fixed.unwrap_or_else(|| f64::midpoint(p.starts.0, p.starts.1)))
        };
        let mut start = State::new(self.parameters().iter().map(middle).collect());
        start.velocity = self.settings.velocity_m_s.unwrap_or_default();
        let known = self.settings.velocity_m_s.is_some();
        launch(self.input, &self.data, self.base_objective(), start, self.settings.rotation, known)
            .map_err(self.failure(1))
    }

    /// What free flight says of velocity, rotation and splat size, with its own uncertainty; `None` where nothing flew freely.
    ///
    /// The frames after contact say less about the velocity than they seem to: a shape that is slightly wrong pulls at it through the
    /// impact, while in free flight it moves along with the body.
    fn flown(&self, launched: &Launch) -> Option<Prior> {
        if launched.free < 2 {
            return None;
        }
        let (fitted, none) = (&launched.unknowns, DMatrix::zeros(0, 0));
        let covariance = interval::covariance(&launched.clusters, self.weights, fitted.len(), &none, &none)?;
        let kept: Vec<usize> = (0..fitted.len()).filter(|k| !matches!(fitted[*k], Unknown::Offset(_))).collect();
        let unknowns: Vec<Unknown> = kept.iter().map(|k| fitted[*k]).collect();
        let marginal = DMatrix::from_fn(kept.len(), kept.len(), |i, j| {
            // Never surer than a tenth of a difference step.
            let floor = if i == j { (0.1 * unknowns[i].difference_step(&[])).powi(2) } else { 0.0 };
            covariance[(kept[i], kept[j])] + floor
        });
        let mean = DVector::from_iterator(kept.len(), unknowns.iter().map(|u| launched.state.get(*u)));
        Some(Prior { information: marginal.try_inverse()?, mean, unknowns })
    }

    /// Whether the free flight goes on to touch something between or after the observed frames.
    fn touches(&self, launched: &Launch) -> bool {
        let flight = Flight { input: self.input, data: &self.data };
        let last = self.data.moments.last().map_or(0, |moment| moment.frame);
        clearance(self.input, &flight.positions(&launched.state, last), last) < 1.5 * self.input.grid_spacing_m
    }

    /// Material from the best starts, with the velocity of stage 1.
    fn fit_material(&self, launched: &Launch, starts: Vec<State>) -> Result<State, IdentifyError> {
        let failed = self.failure(starts.len());
        if let Optimizer::Adam { iterations } = self.settings.optimizer {
            let start = starts.into_iter().next().ok_or(IdentifyError::Interrupted)?;
            return adam(self, launched.free, start, iterations).map_err(failed);
        }
        let simulation = self.simulation(launched.free);
        let fit = |start: State, pooling: usize, iterations: usize| {
            let (unknowns, level) = (self.free_materials(), self.touched_frames(launched, pooling));
            self.minimise(Stage::Material, &simulation, self.base_objective(), unknowns, level, None, start, iterations)
        };
        // A few steps from each start tell which basin is worth the rest.
        let done = self.checkpoint.borrow().fits.len();
        let mut reason = String::new();
        for start in starts.into_iter().skip(done) {
            let found = fit(start, BLUR, SHORT_FIT).map(|fit| (fit.cost, fit.state)).map_err(|e| reason = e).ok();
            if self.stopped.get() {
                return Err(IdentifyError::Interrupted);
            }
            self.reach(None, |checkpoint| checkpoint.fits.push(found))?;
        }
        let fits = self.checkpoint.borrow().fits.clone();
        let best = fits.into_iter().flatten().min_by(|a, b| a.0.total_cmp(&b.0));
        let (_, state) = best.ok_or_else(|| failed(reason))?;
        let state = fit(state, BLUR, LONG_FIT).map_err(&failed)?.state;
        if !self.settings.target.masks() {
            return Ok(state);
        }
        fit(state, SHARP, SHARP_FIT).map(|fit| fit.state).map_err(failed)
    }

    pub(crate) fn joint_unknowns(&self, flown: Option<&Prior>) -> Vec<Unknown> {
        let mut unknowns = self.free_materials();
        if let Some(flown) = flown {
            unknowns.extend(&flown.unknowns);
            return unknowns;
        }
        if self.settings.velocity_m_s.is_none() {
            unknowns.extend((0..3).map(Unknown::Velocity));
        }
        if self.settings.target.masks() {
            unknowns.push(Unknown::Splat);
        }
        unknowns
    }

    /// The frames of the joint stage: what free flight knows is known already.
    pub(crate) fn joint_frames(&self, launched: &Launch, flown: Option<&Prior>) -> Level {
        if flown.is_some() { self.touched_frames(launched, 1) } else { self.all_frames() }
    }

    /// Material, velocity and splat size together, so that errors of stage 1 do not bias the material.
    fn fit_jointly(&self, launched: &Launch, flown: Option<&Prior>, start: State) -> Result<State, IdentifyError> {
        let iterations = match self.settings.optimizer {
            Optimizer::LevenbergMarquardt => self.settings.iterations,
            // The paper stops after its material stage.
            Optimizer::Adam { .. } => return Ok(start),
        };
        let simulation = self.simulation(launched.free);
        let (unknowns, level) = (self.joint_unknowns(flown), self.joint_frames(launched, flown));
        self.minimise(Stage::Joint, &simulation, self.base_objective(), unknowns, level, flown, start, iterations)
            .map(|fit| fit.state)
            .map_err(self.failure(1))
    }
}
