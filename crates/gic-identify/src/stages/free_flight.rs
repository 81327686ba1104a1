//! Stage 1: motion before contact. The frame of contact is found, not given.
//!
//! The body moves rigidly: `x(t) = c + R(omega t) (x_0 - c) + v t + g t (t + dt) / 2`. Position, the Gaussians' size
//! and v are fitted to one frame more at a time, until the body comes near an obstacle. omega is fitted, too, where it
//! shows. Where outlines alone tell v and omega, only the position and the Gaussians' size are fitted.

use std::ops::ControlFlow;

use glam::DVec3;

use crate::forward::flight::Flight;
use crate::forward::trajectories::FrameSelection;
use crate::solve::levenberg_marquardt::{Fit, Limits, minimise};
use crate::solve::normal_equations::Normal;
use crate::solve::objective::Objective;
use crate::solve::prior::Prior;
use crate::solve::problem::Problem;
use crate::solve::residual_block::ResidualBlock;
use crate::stages::outline_flight::{put, turns};
use crate::unknowns::coordinates::Coordinates;
use crate::unknowns::state::{State, Unknown};
use crate::{FitError, Input, Settings};

/// What free flight shows.
#[derive(Clone, Debug)]
pub(crate) struct FreeFlightFit {
    /// Velocity, angular velocity, offset and splat size; material untouched.
    pub state: State,
    /// Number of leading observations in which nothing is touched.
    pub free: usize,
    /// Normal equations at the state.
    pub blocks: Vec<ResidualBlock>,
    /// The unknowns that were fitted.
    pub unknowns: Vec<Unknown>,
    /// Components of velocity and, where it shows, angular velocity.
    pub motion: Vec<Unknown>,
}

/// The clearance below which an obstacle is touched [m].
pub(crate) fn touching(input: &Input) -> f64 {
    gic_mpm::STENCIL_REACH_CELLS * input.grid_spacing_m
}

/// Splat size, position and velocity fitted to the frames before contact.
///
/// # Errors
/// None of free flight; those of a fit.
pub(crate) fn fit_free_flight(
    flight: &Flight,
    objective: Objective,
    start: State,
    outlines: Option<&Prior>,
    settings: &Settings,
) -> Result<FreeFlightFit, FitError> {
    let stage = FlightStage { flight, objective, settings };
    let seeks_velocity = settings.velocity_m_s.is_none() && outlines.is_none();
    let mut state = start;
    let mut motion: Vec<Unknown> = Vec::new();
    if let Some(outlines) = outlines {
        let turns = settings.rotation && turns(outlines, settings.tuning.free_flight.rotation_significance);
        put(outlines, turns, &mut state);
        motion.extend((0..3).map(Unknown::Velocity));
        motion.extend((0..3).filter(|_| turns).map(Unknown::Angular));
    }
    let mut unknowns: Vec<Unknown> = (0..3).map(Unknown::Offset).collect();
    if !flight.video.frames[0].views.is_empty() {
        unknowns.push(Unknown::Splat);
        // The Gaussians' size that reproduces the first outline, before anything moves.
        state = stage.fit(state, &unknowns, 1, 1)?.state;
    }
    let velocity: Vec<Unknown> = if seeks_velocity { (0..3).map(Unknown::Velocity).collect() } else { Vec::new() };
    let (mut state, free) = stage.follow_until_contact(state, &velocity)?;
    if free == 1 && seeks_velocity {
        // Contact before the second frame: its velocity is a first guess that the joint stage corrects.
        state = stage.fit(state, &velocity, 2, 1)?.state;
    }
    unknowns.extend(&velocity);
    let mut fit = stage.fit(state, &unknowns, free.max(2), 1)?;
    let mut blocks = stage.blocks(&mut fit, &unknowns, free.max(2));
    if settings.rotation && seeks_velocity && free >= 2 {
        let mut with_rotation = unknowns.clone();
        with_rotation.extend((0..3).map(Unknown::Angular));
        let mut turning = stage.fit(fit.state.clone(), &with_rotation, free, 1)?;
        let turning_blocks = stage.blocks(&mut turning, &with_rotation, free);
        // Rotation counts as shown when it stands above its own uncertainty.
        let significance = rotation_significance(&turning_blocks, &turning.state, &with_rotation, objective);
        if significance > settings.tuning.free_flight.rotation_significance {
            (fit, unknowns, blocks) = (turning, with_rotation, turning_blocks);
        }
    }
    motion.extend(unknowns.iter().filter(|u| matches!(u, Unknown::Velocity(_) | Unknown::Angular(_))));
    Ok(FreeFlightFit { state: fit.state, free, blocks, unknowns, motion })
}

struct FlightStage<'a> {
    flight: &'a Flight<'a>,
    objective: Objective<'a>,
    settings: &'a Settings,
}

impl FlightStage<'_> {
    fn problem(&self, unknowns: &[Unknown], end: usize, pooling: usize) -> Problem<'_> {
        Problem {
            forward: self.flight,
            objective: self.objective,
            unknowns: unknowns.to_vec(),
            coordinates: Coordinates { parameters: &[], tuning: &self.settings.tuning.descent },
            descent: &self.settings.tuning.descent,
            selection: FrameSelection { first: 0, end, pooling },
            prior: None,
        }
    }

    /// A fit to the first `end` observations.
    fn fit(&self, start: State, unknowns: &[Unknown], end: usize, pooling: usize) -> Result<Fit, FitError> {
        // Free flight is in closed form, and cheap: it is fitted as far as rounding lets it.
        let (iterations, gain_tolerance) = (self.settings.iterations, f64::from(f32::EPSILON));
        let limits = Limits { gain_tolerance, secants: false, ..Limits::to_the_end(iterations, 0.0) };
        let problem = self.problem(unknowns, end, pooling);
        minimise(&problem, start, None, limits, &mut |_| Ok(ControlFlow::Continue(())))
    }

    fn blocks(&self, fit: &mut Fit, unknowns: &[Unknown], end: usize) -> Vec<ResidualBlock> {
        fit.linearisation.blocks(&self.problem(unknowns, end, 1)).to_vec()
    }

    /// The velocity from one frame more at a time, and how many frames are free of contact. Each fit starts where the
    /// last ended, so that the outline never jumps by more than it overlaps.
    fn follow_until_contact(&self, start: State, velocity: &[Unknown]) -> Result<(State, usize), FitError> {
        let Flight { input, video, .. } = *self.flight;
        let (mut state, mut free) = (start, 1);
        while free < video.frames.len() {
            let mut candidate = state.clone();
            if !velocity.is_empty() {
                if free == 1 {
                    // Outlines that do not overlap must pull.
                    let blur = self.settings.tuning.masks.blur_pooling;
                    candidate = self.fit(candidate, velocity, free + 1, blur)?.state;
                }
                candidate = self.fit(candidate, velocity, free + 1, 1)?.state;
            }
            let frame = video.frames[free].simulated_frame;
            if clearance(input, &self.flight.positions(&candidate, frame), frame) < touching(input) {
                break;
            }
            state = candidate;
            free += 1;
        }
        Ok((state, free))
    }
}

/// Largest component of the angular velocity in standard errors (blocks as independent).
fn rotation_significance(blocks: &[ResidualBlock], state: &State, unknowns: &[Unknown], objective: Objective) -> f64 {
    let normal = Normal::sum(blocks, objective.weights, unknowns.len());
    let Some(inverse) = normal.hessian.try_inverse() else { return 0.0 };
    let mut middle = nalgebra::DMatrix::zeros(unknowns.len(), unknowns.len());
    for block in blocks {
        let g = &block.gradient * objective.weights.of(block);
        middle += &g * g.transpose();
    }
    let covariance = &inverse * middle * &inverse;
    unknowns
        .iter()
        .enumerate()
        .filter(|(_, u)| matches!(u, Unknown::Angular(_)))
        .map(|(i, u)| state.get(*u).abs() / covariance[(i, i)].sqrt().max(f64::MIN_POSITIVE))
        .fold(0.0, f64::max)
}

/// Smallest distance between the particles and any obstacle at a frame [m].
pub(crate) fn clearance(input: &Input, positions: &[DVec3], frame: usize) -> f64 {
    let time = frame as f64 / input.frame_rate_hz;
    input
        .colliders
        .iter()
        .flat_map(|collider| positions.iter().map(move |p| collider.signed_distance(*p, time)))
        .fold(f64::INFINITY, f64::min)
}
