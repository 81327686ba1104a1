//! Stage 1: initial velocity from the frames before contact. The contact frame is found, not given.

use std::ops::ControlFlow;

use glam::DVec3;

use crate::Input;
use crate::forward::flight::Flight;
use crate::forward::shape::ShapeModes;
use crate::forward::trajectories::FrameSelection;
use crate::observe::video::ObservedVideo;
use crate::solve::levenberg_marquardt::{Fit, Limits, minimise};
use crate::solve::linearisation::Tangents;
use crate::solve::normal_equations::Normal;
use crate::solve::objective::Objective;
use crate::solve::problem::Problem;
use crate::solve::residual_block::ResidualBlock;
use crate::unknowns::state::{State, Unknown};

/// What stage 1 found.
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
}

/// Splat size, position and velocity fitted to the frames before contact.
///
/// `known` keeps the start's velocity.
#[allow(clippy::too_many_arguments)]
pub(crate) fn launch(
    input: &Input,
    video: &ObservedVideo,
    shape: &ShapeModes,
    objective: Objective,
    start: State,
    allow_rotation: bool,
    known: bool,
) -> Result<FreeFlightFit, String> {
    let flight = Flight { input, video, shape };
    let mut state = start;
    let run = |state: &mut State, unknowns: &[Unknown], end: usize, pooling: usize| -> Result<Fit, String> {
        let selection = FrameSelection { first: 0, end, pooling };
        let problem = problem(&flight, objective, unknowns, selection);
        let limits =
            Limits { iterations: 10, step_tolerance: 0.1, gain_tolerance: 1e-4, secants: false, ..Limits::ROUGH };
        let fit = minimise(&problem, state.clone(), None, limits, &mut |_| Ok(ControlFlow::Continue(())))?;
        *state = fit.state.clone();
        Ok(fit)
    };
    let linearised = |fit: &Fit, unknowns: &[Unknown], end: usize| -> Result<Vec<ResidualBlock>, String> {
        let problem = problem(&flight, objective, unknowns, FrameSelection { first: 0, end, pooling: 1 });
        Ok(Tangents::measure(&problem, &fit.state, &fit.trajectories)?.blocks(&problem, &fit.trajectories))
    };
    let masks = video.frames[0].views.iter().len() > 0;
    let mut all: Vec<Unknown> = (0..3).map(Unknown::Offset).collect();
    if masks {
        all.push(Unknown::Splat);
        // The Gaussians' size that reproduces the first outline, before anything moves.
        run(&mut state, &all, 1, 1)?;
    }
    let speed: Vec<Unknown> = if known { Vec::new() } else { (0..3).map(Unknown::Velocity).collect() };
    // One frame more at a time: each starts where the last ended, so that the outline never jumps by more than it overlaps.
    let mut free = 1;
    while free < video.frames.len() {
        let mut candidate = state.clone();
        if !known {
            if free == 1 {
                run(&mut candidate, &speed, free + 1, 8)?;
            }
            run(&mut candidate, &speed, free + 1, if free == 1 { 1 } else { 2 })?;
        }
        let frame = video.frames[free].simulated_frame;
        if clearance(input, &flight.positions(&candidate, frame), frame) < 1.5 * input.grid_spacing_m {
            break;
        }
        state = candidate;
        free += 1;
    }
    if free == 1 && !known {
        // Contact before the second frame: its velocity is a first guess that the joint stage corrects.
        run(&mut state, &speed, 2, 1)?;
    }
    all.extend(&speed);
    let mut fit = run(&mut state, &all, free.max(2), 1)?;
    let mut blocks = linearised(&fit, &all, free.max(2))?;
    if allow_rotation && !known && free >= 2 {
        let mut with_spin = all.clone();
        with_spin.extend((0..3).map(Unknown::Angular));
        let turning = run(&mut state.clone(), &with_spin, free, 1)?;
        // Rotation counts as shown when it explains a tenth of the residual and stands above its own uncertainty.
        let spinning = linearised(&turning, &with_spin, free)?;
        if turning.cost < 0.9 * fit.cost && spin_significance(&spinning, &turning, &with_spin, objective) > 5.0 {
            (fit, all, blocks) = (turning, with_spin, spinning);
        }
    }
    Ok(FreeFlightFit { state: fit.state, free, blocks, unknowns: all })
}

fn problem<'a>(
    flight: &'a Flight,
    objective: Objective<'a>,
    unknowns: &[Unknown],
    selection: FrameSelection,
) -> Problem<'a> {
    Problem { forward: flight, objective, unknowns: unknowns.to_vec(), parameters: &[], selection, prior: None }
}

/// Size of the angular velocity in standard errors (blocks as independent).
fn spin_significance(blocks: &[ResidualBlock], fit: &Fit, unknowns: &[Unknown], objective: Objective) -> f64 {
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
        .map(|(i, u)| fit.state.get(*u).abs() / covariance[(i, i)].sqrt().max(f64::MIN_POSITIVE))
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
