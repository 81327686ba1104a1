//! The stages in order: velocity, search, material, joint, intervals.

mod finish;
pub(crate) mod free_flight;
mod material;
mod search;

use std::cell::{Cell, RefCell};
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use gic_mpm::MaterialKind;
use gic_mpm::Options;
use glam::DVec3;
use nalgebra::{DMatrix, DVector};

use crate::checkpoint::{Checkpoint, Event};
use crate::forward::flight::Flight;
use crate::forward::shape::ShapeModes;
use crate::forward::simulation::{Resolution, Simulation};
use crate::forward::splat_widths::SplatWidths;
use crate::forward::trajectories::{ForwardModel, FrameSelection};
use crate::observe::video::ObservedVideo;
use crate::result::{Estimates, Stage, Step};
use crate::solve::levenberg_marquardt::{Fit, Iterate, Limits, minimise};
use crate::solve::linearisation::{Linearisation, Tangents};
use crate::solve::objective::Objective;
use crate::solve::prior::Prior;
use crate::solve::problem::Problem;
use crate::solve::residual_block::{ResidualBlock, Weights};
use crate::solve::surface_residuals::SurfaceComparison;
use crate::stages::free_flight::{FreeFlightFit, clearance, launch};
use crate::uncertainty::input_checks;
use crate::uncertainty::noise::effective_weights;
use crate::unknowns::parameter::{sought, sought_by_name};
use crate::unknowns::state::{State, Unknown};
use crate::{IdentifyError, Input, Optimizer, Parameter, Settings};

/// Extra pooling of the masks while the outlines may still be far apart: Gauss-Newton steps reach about as far as the pictures are
/// blurred, and a sharp outline would let it creep.
pub(crate) const BLUR: usize = 8;

/// Most steps of the joint stage under its first weights, and the share of the cost that a step must gain there: this fit only has to be
/// good enough to weigh the frames anew.
const FIRST_FIT: usize = 5;
const ROUGHLY: f64 = 0.02;

/// The joint stage ends where a step gains less than this of the cost, which is half of chi-squared.
const LEAST_GAIN: f64 = 0.1;

/// Standard deviation of the logarithm of the Gaussians' size about the one that fits free flight with the shape as reconstructed.
const SPLAT_SIGMA: f64 = 0.05;

/// Who hears of events and may say stop.
pub(crate) type Listener<'a> = dyn FnMut(Event) -> ControlFlow<()> + 'a;

/// Everything that the stages share.
pub(crate) struct Identification<'a> {
    pub input: &'a Input,
    pub kind: MaterialKind,
    pub settings: &'a Settings,
    pub video: ObservedVideo,
    pub context: SurfaceComparison,
    pub splat_widths: SplatWidths,
    pub shape: ShapeModes,
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

impl Identification<'_> {
    pub(crate) fn parameters(&self) -> &'static [Parameter] {
        sought(self.kind)
    }

    pub(crate) fn objective<'b>(&'b self, opacities: &'b [f32]) -> Objective<'b> {
        Objective { video: &self.video, opacities, surface_comparison: &self.context, weights: &self.weights }
    }

    pub(crate) fn base_objective(&self) -> Objective<'_> {
        self.objective(&self.input.opacities)
    }

    pub(crate) fn all_frames(&self) -> FrameSelection {
        FrameSelection { first: 0, end: self.video.frames.len(), pooling: 1 }
    }

    /// The frames that tell about the material: those after the last of free flight.
    pub(crate) fn touched_frames(&self, flight_fit: &FreeFlightFit, pooling: usize) -> FrameSelection {
        let last = self.video.frames.len() - 1;
        FrameSelection { first: flight_fit.free.min(last), pooling, ..self.all_frames() }
    }

    pub(crate) fn free_materials(&self) -> Vec<Unknown> {
        let fixed = |p: &Parameter| self.settings.fixed.iter().any(|(name, _)| name == p.name);
        (0..self.parameters().len()).filter(|i| !fixed(&self.parameters()[*i])).map(Unknown::Material).collect()
    }

    /// Whether it is a parameter of which the grid of starts has several values.
    pub(crate) fn is_varied(&self, unknown: &Unknown) -> bool {
        matches!(unknown, Unknown::Material(i) if self.parameters()[*i].grid > 1)
    }

    pub(crate) fn simulation(&self, free: usize) -> Simulation<'_> {
        Simulation {
            input: self.input,
            video: &self.video,
            shape: &self.shape,
            kind: self.kind,
            options: Options { parallel: false, ..Options::default() },
            resolution: Resolution {
                thinning: None,
                spacing_factor: 1.0,
                substeps_per_frame: self.input.substeps_per_frame,
            },
            free,
            rollouts: &self.fine,
            splat_widths: &self.splat_widths,
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
    pub(crate) fn reach(
        &self,
        stage: Option<Stage>,
        change: impl FnOnce(&mut Checkpoint),
    ) -> Result<(), IdentifyError> {
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

    /// A search without priors, which ends early at a step that `is_idle`.
    #[allow(clippy::too_many_arguments)]
    pub(crate) fn minimise(
        &self,
        stage: Stage,
        forward: &dyn ForwardModel,
        objective: Objective,
        unknowns: Vec<Unknown>,
        selection: FrameSelection,
        start: State,
        limits: Limits,
        is_idle: &dyn Fn(&Iterate) -> bool,
    ) -> Result<Fit, String> {
        let problem = Problem { forward, objective, unknowns, parameters: self.parameters(), selection, prior: None };
        minimise(&problem, start, None, limits, &mut |iterate| {
            self.report(stage, iterate)?;
            Ok(if is_idle(iterate) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
        })
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
) -> Result<Estimates, IdentifyError> {
    input.validate()?;
    for (name, value) in &settings.fixed {
        let parameter = *sought_by_name(kind, name)?;
        if !(*value >= parameter.bounds.0 && *value <= parameter.bounds.1) {
            let (low, high) = parameter.bounds;
            return Err(IdentifyError::input(name, format!("is fixed to {value}"), format!("give {low} to {high}")));
        }
    }
    if let Some(start) = &settings.start
        && start.len() != sought(kind).len()
    {
        let wanted = sought(kind).iter().map(|p| p.name).collect::<Vec<_>>().join(", ");
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
    let excluded = input_checks::wrong_cameras(&input, settings.target, &mut warnings);
    input_checks::cut_views(&input, settings.target, &mut warnings);
    let video = ObservedVideo::new(&input, settings.target, &excluded);
    let context = SurfaceComparison::new(&input, video.frames[0].surface.as_ref());
    let splat_widths = SplatWidths::new(&input.positions, &input.scales, input.particle_volume_m3.cbrt());
    // A tenth of a pixel's alpha and a tenth of a cell, until the data's own noise is known.
    let weights = Weights::uniform(100.0, (0.1 * input.grid_spacing_m).powi(-2), video.frames.len());
    let job = Identification {
        input: &input,
        kind,
        settings,
        video,
        context,
        splat_widths,
        shape: ShapeModes::new(&input),
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
fn weight_ceilings(job: &Identification) -> Weights {
    Weights::uniform(1e6, (1e-3 * job.input.grid_spacing_m).powi(-2), job.video.frames.len())
}

fn run(mut job: Identification) -> Result<Estimates, IdentifyError> {
    let resumed = job.checkpoint.borrow().clone();
    let flight_fit = job.launch()?;
    if resumed.seconds.is_empty() {
        job.reach(Some(Stage::Velocity), |_| ())?;
    }
    // From here on each modality counts by the noise that it showed before anything was touched.
    job.weights = job.flight_weights(&flight_fit);
    job.video.discount_unseen(job.input, flight_fit.free);
    if flight_fit.free == job.video.frames.len() && !job.touches(&flight_fit) {
        job.warn("the object never touches anything: only its velocity is determined, not its material".to_owned());
        return Ok(job.finish_untouched(&flight_fit));
    }
    let starts = match resumed.starts {
        Some(starts) => starts,
        None => {
            let starts = job.search(&flight_fit)?;
            job.reach(Some(Stage::Search), |checkpoint| checkpoint.starts = Some(starts.clone()))?;
            starts
        }
    };
    let material = match resumed.material {
        Some(state) => state,
        None => {
            let state = job.fit_material(&flight_fit, starts)?;
            job.reach(Some(Stage::Material), |checkpoint| checkpoint.material = Some(state.clone()))?;
            state
        }
    };
    if !job.settings.joint {
        return job.finish_roughly(&flight_fit, &material);
    }
    let (joint, known) = match resumed.joint {
        Some(state) => (state, None),
        None => {
            let (state, known) = job.fit_jointly(&flight_fit, material)?;
            job.reach(Some(Stage::Joint), |checkpoint| checkpoint.joint = Some(state.clone()))?;
            (state, known)
        }
    };
    job.finish(&flight_fit, &joint, known)
}

impl Identification<'_> {
    fn launch(&self) -> Result<FreeFlightFit, IdentifyError> {
        let middle = |p: &Parameter| {
            let fixed = self.settings.fixed.iter().find(|(name, _)| name == p.name).map(|(_, value)| *value);
            p.coordinate(fixed.unwrap_or_else(|| f64::midpoint(p.starts.0, p.starts.1)))
        };
        let mut start = State::new(self.parameters().iter().map(middle).collect());
        start.velocity = self.settings.velocity_m_s.map(DVec3::from_array).unwrap_or_default();
        let known = self.settings.velocity_m_s.is_some();
        launch(self.input, &self.video, &self.shape, self.base_objective(), start, self.settings.rotation, known)
            .map_err(self.failure(1))
    }

    /// The noise of free flight as that of all frames.
    fn flight_weights(&self, flight_fit: &FreeFlightFit) -> Weights {
        let ceilings = weight_ceilings(self);
        let (unknowns, count) = (flight_fit.unknowns.len(), self.video.frames.len());
        let own = effective_weights(&flight_fit.blocks, unknowns, flight_fit.free, &ceilings);
        let mean = |values: &[f64]| {
            let used = &values[..flight_fit.free.clamp(1, count)];
            used.iter().sum::<f64>() / used.len() as f64
        };
        let mut weights = Weights::uniform(mean(&own.mask), mean(&own.surface), count);
        weights.inflate_surface_errors(flight_fit.free);
        weights
    }

    /// The weights that the data's own noise gives at a fit.
    pub(crate) fn weights_at(&self, blocks: &[ResidualBlock], unknowns: usize, flight_fit: &FreeFlightFit) -> Weights {
        effective_weights(blocks, unknowns, flight_fit.free, &weight_ceilings(self))
    }

    /// Whether the free flight goes on to touch something between or after the observed frames.
    fn touches(&self, flight_fit: &FreeFlightFit) -> bool {
        let flight = Flight { input: self.input, video: &self.video, shape: &self.shape };
        let last = self.video.frames.last().map_or(0, |observed| observed.simulated_frame);
        clearance(self.input, &flight.positions(&flight_fit.state, last), last) < 1.5 * self.input.grid_spacing_m
    }

    /// Material, velocity, rotation where there is one, the Gaussians' size, and the shape. The position stays that of free flight: free, it
    /// is traded for the velocity.
    pub(crate) fn joint_unknowns(&self, flight_fit: &FreeFlightFit) -> Vec<Unknown> {
        let mut unknowns = self.free_materials();
        let flown = flight_fit.unknowns.iter().filter(|u| !matches!(u, Unknown::Offset(_)));
        unknowns.extend(flown);
        if !self.video.frames[0].views.is_empty() {
            unknowns.extend((0..self.shape.count()).map(Unknown::Shape));
        }
        unknowns
    }

    /// What is known of the joint stage's unknowns besides the pictures.
    pub(crate) fn joint_prior(&self, flight_fit: &FreeFlightFit) -> Prior {
        let unknowns: Vec<Unknown> = (self.joint_unknowns(flight_fit).into_iter())
            .filter(|u| matches!(u, Unknown::Splat | Unknown::Shape(_)))
            .collect();
        let deviation = |u: &Unknown| if *u == Unknown::Splat { SPLAT_SIGMA } else { 1.0 };
        let information = DVector::from_iterator(unknowns.len(), unknowns.iter().map(|u| deviation(u).powi(-2)));
        Prior {
            information: DMatrix::from_diagonal(&information),
            mean: DVector::from_iterator(unknowns.len(), unknowns.iter().map(|u| flight_fit.state.get(*u))),
            unknowns,
        }
    }

    /// Everything together, so that errors of stage 1 and of the shape do not bias the material, and the intervals know of them.
    ///
    /// The noise of the frames after contact is known only once they are explained, so fit and weights take turns. With the state comes what was
    /// measured there last, which would be the same if it were measured again.
    fn fit_jointly(
        &self,
        flight_fit: &FreeFlightFit,
        start: State,
    ) -> Result<(State, Option<Linearisation>), IdentifyError> {
        // The paper stops after its material stage.
        if self.settings.optimizer != Optimizer::LevenbergMarquardt {
            return Ok((start, None));
        }
        let (simulation, prior) = (self.simulation(flight_fit.free), self.joint_prior(flight_fit));
        let (unknowns, selection) = (self.joint_unknowns(flight_fit), self.all_frames());
        let (mut state, mut known) = (start, None);
        let first = (FIRST_FIT.min(self.settings.iterations), ROUGHLY);
        for (iterations, gain_tolerance) in [first, (self.settings.iterations, 0.0)] {
            let problem = Problem {
                forward: &simulation,
                objective: self.base_objective(),
                unknowns: unknowns.clone(),
                parameters: self.parameters(),
                selection: selection.clone(),
                prior: Some(&prior),
            };
            // Where the first fit ended, its tangents are good enough for weights, and for a first step.
            let mut here = match known {
                Some(known) => known,
                None => {
                    let (trajectories, tangents) = Tangents::measure_with_motion(&problem, &state);
                    let (trajectories, tangents) =
                        (trajectories.map_err(self.failure(1))?, tangents.map_err(self.failure(1))?);
                    Linearisation { trajectories, tangents, blocks: None }
                }
            };
            self.tell(Event::Working).map_err(|_| IdentifyError::Interrupted)?;
            let blocks = here.blocks.get_or_insert_with(|| here.tangents.blocks(&problem, &here.trajectories));
            let weights = self.weights_at(blocks, unknowns.len(), flight_fit);
            let problem = Problem { objective: Objective { weights: &weights, ..self.base_objective() }, ..problem };
            // The cost is in units of chi-squared: what matters is the absolute gain.
            let limits = Limits { iterations, gain_tolerance, least_gain: LEAST_GAIN, ..Limits::ROUGH };
            let report = &mut |step: &Iterate| self.report(Stage::Joint, step).map(ControlFlow::Continue);
            let fit = minimise(&problem, state, Some(here), limits, report).map_err(self.failure(1))?;
            state = fit.state.clone();
            known = fit.known();
        }
        Ok((state, known.filter(|known| known.tangents.is_fresh())))
    }
}
