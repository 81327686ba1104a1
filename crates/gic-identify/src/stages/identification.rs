//! What the stages after free flight are given, and what they are made of. Nothing here changes while they run.

use gic_mpm::{Ball, MaterialKind, Options};
use glam::DVec3;

use crate::forward::flight::Flight;
use crate::forward::shape::ShapeModes;
use crate::forward::simulation::{Resolution, RolloutCounts, Simulation};
use crate::forward::splat_widths::SplatWidths;
use crate::forward::trajectories::{ForwardModel, FrameSelection};
use crate::observe::video::ObservedVideo;
use crate::session::Session;
use crate::solve::objective::Objective;
use crate::solve::posed::Posed;
use crate::solve::prior::Prior;
use crate::solve::problem::Problem;
use crate::solve::residual_block::{ResidualBlock, Weights};
use crate::solve::surface_residuals::SurfaceComparison;
use crate::stages::free_flight::{FreeFlightFit, clearance, fit_free_flight, touching};
use crate::stages::outline_flight::motion_by_outlines;
use crate::tuning::{NoiseTuning, STEP_VARIANCE};
use crate::uncertainty::input_checks;
use crate::uncertainty::noise::effective_weights;
use crate::unknowns::coordinates::Coordinates;
use crate::unknowns::devices;
use crate::unknowns::parameter::sought;
use crate::unknowns::state::{State, Unknown};
use crate::{IdentifyError, Input, Parameter, Settings, Tuning, WorldDoubt};

/// The observations, the body, the fit of free flight and the weights that it gives.
pub(crate) struct Identification<'a> {
    pub input: &'a Input,
    pub kind: MaterialKind,
    pub settings: &'a Settings,
    pub tuning: &'a Tuning,
    pub rollouts: &'a RolloutCounts,
    pub video: ObservedVideo,
    pub comparison: SurfaceComparison,
    pub shape: ShapeModes,
    pub splat_widths: SplatWidths,
    /// Velocity and angular velocity, where the outlines alone tell them.
    pub motion_by_outlines: Option<Prior>,
    /// What is known of the world and of the grid besides the pictures; `None` where both are as they are said to be.
    pub world_and_grid: Option<Prior>,
    /// What is known of the grid and of the material before the video: the range of each parameter.
    pub before_any_video: Prior,
    /// What is known of the devices besides the pictures; of nothing where all are as they are said to be.
    pub devices: Prior,
    pub flight: FreeFlightFit,
    /// Of free flight's noise, for all frames.
    pub weights: Weights,
}

impl<'a> Identification<'a> {
    /// Prepares the observations and fits free flight. `input` is valid.
    pub(crate) fn new(
        input: &'a Input,
        kind: MaterialKind,
        settings: &'a Settings,
        rollouts: &'a RolloutCounts,
        session: &mut Session,
    ) -> Result<Identification<'a>, IdentifyError> {
        let (tuning, mut warnings) = (&settings.tuning, Vec::new());
        if input.observations.len() < 3 {
            warnings.push("two frames only: the material can hardly show; expect wide intervals".to_owned());
        }
        let excluded = input_checks::wrong_cameras(input, settings.target, &tuning.verdicts, &mut warnings);
        input_checks::cut_views(input, settings.target, &mut warnings);
        session.warn(warnings);
        let mut video = ObservedVideo::new(input, settings.target, &excluded, tuning);
        let comparison = SurfaceComparison::new(input, video.frames[0].surface.as_ref(), tuning);
        let spacing = input.particle_volume_m3.cbrt();
        let splat_widths = SplatWidths::new(&input.positions, &input.scales, spacing, kind, &tuning.surfaces);
        let shape = ShapeModes::new(input, &tuning.shape, &tuning.surfaces);
        let count = video.frames.len();
        // Until the data's own noise is known: its size is without effect where no prior acts.
        let weights = weights_of_variance(1.0, input, count);
        let objective = Objective {
            video: &video,
            opacities: &input.opacities,
            surface_comparison: &comparison,
            weights: &weights,
        };
        let flight = Flight { input, video: &video, shape: &shape };
        let motion_by_outlines = motion_by_outlines(input, settings, &excluded);
        let (start, outlines) = (start_of_flight(kind, settings), motion_by_outlines.as_ref());
        let flight =
            fit_free_flight(&flight, objective, start, outlines, settings).map_err(|error| error.of_stage(1))?;
        let weights = flight_weights(&flight, &largest_weights(input, count), &tuning.noise);
        video.discount_unseen(input, flight.free);
        let world_and_grid = world_and_grid(input, settings);
        Ok(Identification {
            input,
            kind,
            settings,
            tuning,
            rollouts,
            video,
            comparison,
            shape,
            splat_widths,
            motion_by_outlines,
            before_any_video: before_any_video(kind, settings, world_and_grid.clone()),
            world_and_grid,
            devices: devices::prior(input),
            flight,
            weights,
        })
    }

    pub(crate) fn parameters(&self) -> &'static [Parameter] {
        sought(self.kind)
    }

    pub(crate) fn coordinates(&self) -> Coordinates<'_> {
        Coordinates { parameters: self.parameters(), tuning: &self.tuning.descent }
    }

    /// The material parameters that are sought.
    pub(crate) fn free_materials(&self) -> Vec<Unknown> {
        free_parameters(self.kind, self.settings).map(|(i, _)| Unknown::Material(i)).collect()
    }

    /// All observations, compared as sharply as they are.
    pub(crate) fn all_frames(&self) -> FrameSelection {
        FrameSelection { first: 0, end: self.video.frames.len(), pooling: 1 }
    }

    /// The observations that tell about the material: those after the last of free flight.
    pub(crate) fn touched_frames(&self, pooling: usize) -> FrameSelection {
        let last = self.video.frames.len() - 1;
        FrameSelection { first: self.flight.free.min(last), pooling, ..self.all_frames() }
    }

    /// The comparison of all particles.
    pub(crate) fn objective(&self) -> Objective<'_> {
        Objective {
            video: &self.video,
            opacities: &self.input.opacities,
            surface_comparison: &self.comparison,
            weights: &self.weights,
        }
    }

    /// What is sought of the world and of the grid.
    pub(crate) fn unknowns_of_world_and_grid(&self) -> Vec<Unknown> {
        self.world_and_grid.as_ref().map(|prior| prior.unknowns.clone()).unwrap_or_default()
    }

    /// Whether the side of the grid's cells is sought.
    pub(crate) fn seeks_cells(&self) -> bool {
        self.unknowns_of_world_and_grid().contains(&Unknown::Cell)
    }

    /// Whether nobody says if the ground holds what touches it.
    pub(crate) fn contact_is_in_doubt(&self) -> bool {
        self.input.world_doubt.is_some_and(|doubt| doubt.may_stick)
    }

    /// The search for material parameters and cells with the motion of free flight, in the world as given.
    pub(crate) fn material_problem<'b>(&'b self, forward: &'b dyn ForwardModel, pooling: usize) -> Problem<'b> {
        let mut unknowns = self.free_materials();
        unknowns.extend(self.seeks_cells().then_some(Unknown::Cell));
        Problem {
            forward,
            objective: self.objective(),
            unknowns,
            coordinates: self.coordinates(),
            descent: &self.tuning.descent,
            selection: self.touched_frames(pooling),
            prior: Some(&self.before_any_video),
        }
    }

    /// The motion by which the material alone is fitted. Free poses begin at the end of free flight.
    pub(crate) fn posed<'b>(&self, model: &'b dyn ForwardModel, objective: Objective<'b>) -> Posed<'b> {
        let first = if self.settings.free_poses { self.flight.free } else { self.video.frames.len() };
        Posed { model, video: objective.video, opacities: objective.opacities, first }
    }

    /// Free flight as a forward model.
    pub(crate) fn free_flight(&self) -> Flight<'_> {
        Flight { input: self.input, video: &self.video, shape: &self.shape }
    }

    /// Rollouts of all particles on the full grid.
    pub(crate) fn simulation(&self) -> Simulation<'_> {
        Simulation {
            input: self.input,
            video: &self.video,
            shape: &self.shape,
            kind: self.kind,
            options: Options { parallel: false, domain: self.domain(), ..Options::default() },
            resolution: Resolution {
                thinning: None,
                spacing_factor: 1.0,
                substeps_per_frame: self.input.substeps_per_frame,
            },
            free: self.flight.free,
            rollouts: &self.rollouts.full,
            splat_widths: &self.splat_widths,
        }
    }

    /// Where the body may be: around all surfaces that were seen, and as far away as it flies from its first contact on
    /// where that takes none of its speed. An obstacle gives none. `None` where a frame has no surface.
    fn domain(&self) -> Option<Ball> {
        let (input, observations) = (self.input, &self.input.observations);
        let seen = observations.iter().flat_map(|observation| &observation.surface).chain(&input.positions);
        let (low, high) =
            seen.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(*p), high.max(*p)));
        let contact_s = observations[self.flight.free.max(1) - 1].time_s;
        let left_s = observations.last().map_or(0.0, |last| last.time_s) - contact_s;
        let speed = (self.flight.state.velocity + contact_s * input.gravity_m_s2).length();
        let flown_m = left_s * speed + 0.5 * left_s * left_s * input.gravity_m_s2.length();
        let is_followed = observations.iter().all(|observation| !observation.surface.is_empty());
        is_followed.then(|| Ball { centre_m: 0.5 * (low + high), radius_m: low.distance(high) + flown_m })
    }

    /// The weights that the data's own noise gives at a fit.
    pub(crate) fn weights_at(&self, blocks: &[ResidualBlock], unknowns: usize) -> Weights {
        let ceilings = largest_weights(self.input, self.video.frames.len());
        effective_weights(blocks, unknowns, self.flight.free, &ceilings, &self.tuning.noise)
    }

    /// Whether anything is touched in the observed frames, between them or shortly after.
    pub(crate) fn has_contact(&self) -> bool {
        let last = self.video.frames.last().map_or(0, |observed| observed.simulated_frame);
        let at_the_end = || self.free_flight().positions(&self.flight.state, last);
        self.flight.free < self.video.frames.len() || clearance(self.input, &at_the_end(), last) < touching(self.input)
    }
}

/// The world, as sure as it was given, and the grid's cells, where a simulator had some and nobody says how large.
fn world_and_grid(input: &Input, settings: &Settings) -> Option<Prior> {
    let deviations = input.world_doubt.as_ref().map(WorldDoubt::deviations).unwrap_or_default();
    let is_sought = settings.grid_spacing_m.is_none() && !input.was_filmed;
    let of_cell = is_sought.then_some(settings.tuning.resolution.log_cell_deviation);
    let world = deviations.into_iter().enumerate().map(|(k, deviation)| (Unknown::World(k), 0.0, deviation));
    let known = Prior::independent(world.chain(of_cell.map(|deviation| (Unknown::Cell, 0.0, deviation))));
    Some(known).filter(|known| !known.unknowns.is_empty())
}

/// The parameters that are sought, with their places in [`sought`].
fn free_parameters(kind: MaterialKind, settings: &Settings) -> impl Iterator<Item = (usize, &'static Parameter)> {
    sought(kind).iter().enumerate().filter(|(_, parameter)| settings.fixed_value(parameter).is_none())
}

/// The range of each parameter that is sought, and what is known of the world and of the grid.
fn before_any_video(kind: MaterialKind, settings: &Settings, world_and_grid: Option<Prior>) -> Prior {
    let ranges = free_parameters(kind, settings).map(|(i, parameter)| {
        let (mean, deviation) = parameter.before_any_video();
        (Unknown::Material(i), mean, deviation)
    });
    world_and_grid.into_iter().fold(Prior::independent(ranges), Prior::and)
}

/// Material parameters as given or in the middle of their starts, at the given velocity or at rest.
fn start_of_flight(kind: MaterialKind, settings: &Settings) -> State {
    let middle =
        |p: &Parameter| p.coordinate(settings.fixed_value(p).unwrap_or_else(|| f64::midpoint(p.starts.0, p.starts.1)));
    let mut start = State::new(sought(kind).iter().map(middle).collect());
    start.velocity = settings.velocity_m_s.map(DVec3::from_array).unwrap_or_default();
    start
}

/// Weights of a variance of alpha, and of surfaces in squares of cells.
fn weights_of_variance(variance: f64, input: &Input, frames: usize) -> Weights {
    Weights::uniform(variance.recip(), (variance * input.grid_spacing_m.powi(2)).recip(), frames)
}

/// Of alpha that is rounded to eight bits: no mask tells more, and no surface more than this share of a cell.
fn largest_weights(input: &Input, frames: usize) -> Weights {
    weights_of_variance(f64::from(STEP_VARIANCE) / f64::from(u8::MAX).powi(2), input, frames)
}

/// The noise of free flight as that of all frames.
fn flight_weights(flight: &FreeFlightFit, ceilings: &Weights, tuning: &NoiseTuning) -> Weights {
    let count = ceilings.mask.len();
    let own = effective_weights(&flight.blocks, flight.unknowns.len(), flight.free, ceilings, tuning);
    let mean = |values: &[f64]| {
        let used = &values[..flight.free.clamp(1, count)];
        used.iter().sum::<f64>() / used.len() as f64
    };
    let mut weights = Weights::uniform(mean(&own.mask), mean(&own.surface), count);
    weights.inflate_surface_errors(flight.free, tuning.surface_error_inflation);
    weights
}
