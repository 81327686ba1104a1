//! The paper's optimiser, for comparison: Adam (Kingma and Ba 2015) with the paper's learning rates, on the simulator's
//! adjoint.

use gic_mpm::gradient;
use gic_optimize::Adam;
use glam::DVec3;

use crate::FitError;
use crate::forward::drawing::{Drawing, Shown};
use crate::forward::footprint::IsotropicGaussians;
use crate::result::Stage;
use crate::session::Session;
use crate::solve::levenberg_marquardt::Iterate;
use crate::solve::loss::frame_loss;
use crate::stages::identification::Identification;
use crate::unknowns::state::{State, Unknown};

/// Fits the material from the first of `starts` with the initial velocity fixed; the best iterate is returned, not the
/// last. It ends where an iterate cannot be simulated.
///
/// # Errors
/// Where the start cannot be simulated, and interruption.
pub(crate) fn adam(
    identification: &Identification,
    session: &mut Session,
    starts: Vec<State>,
) -> Result<State, FitError> {
    let (unknowns, parameters) = (identification.free_materials(), identification.parameters());
    let (coordinates, tuning) = (identification.coordinates(), &identification.tuning.adam);
    let mut state = starts.into_iter().next().ok_or(FitError::NoIteration)?;
    let mut best: Option<(f64, State)> = None;
    let mut optimiser = Adam::new(unknowns.len());
    for _ in 0..identification.settings.adam_iterations {
        let (loss, slope) = match loss_and_gradient(identification, &state, &unknowns) {
            Ok(found) => found,
            // It has left where the simulator works.
            Err(reason) if best.is_none() => return Err(reason),
            Err(_) => break,
        };
        if best.as_ref().is_none_or(|(least, _)| loss < *least) {
            best = Some((loss, state.clone()));
        }
        let iterate = Iterate { state: state.clone(), cost: loss };
        session.record(Stage::Material, parameters, &iterate)?;
        let rates: Vec<f64> = materials(&unknowns).map(|i| parameters[i].adam_rate(tuning)).collect();
        let delta = optimiser.step(&slope, &rates);
        state = coordinates.moved(&state, &unknowns, &delta);
    }
    best.map(|(_, state)| state).ok_or(FitError::NoIteration)
}

/// Numbers of the law's parameters among unknowns.
fn materials(unknowns: &[Unknown]) -> impl Iterator<Item = usize> {
    unknowns.iter().filter_map(|unknown| match *unknown {
        Unknown::Material(i) => Some(i),
        _ => None,
    })
}

/// Loss of eq. 8, mean over frames, and its derivative by the search coordinates of `unknowns`.
fn loss_and_gradient(
    identification: &Identification,
    state: &State,
    unknowns: &[Unknown],
) -> Result<(f64, Vec<f64>), FitError> {
    let Identification { input, video, .. } = identification;
    let simulation = identification.simulation();
    let (world, from) = simulation.world_and_start(state);
    let last = video.frames.last().map_or(0, |observed| observed.simulated_frame);
    let share = 1.0 / video.frames.len() as f64;
    let mut total = 0.0;
    simulation.count();
    let gradient = gradient(&world, &simulation.options, last + 1 - from, |frame| {
        let observed = video.frames.iter().find(|observed| observed.simulated_frame == frame.index + from)?;
        let positions: Vec<[f32; 3]> = frame.positions.iter().map(|p| p.as_vec3().to_array()).collect();
        // The widths' own change with the positions is left out of the gradient.
        let scales = identification.splat_widths.scales(&frame.positions);
        let (opacities, drawing) = (&input.opacities, Drawing::of(state));
        let factor = drawing.splat_factor;
        let gaussians = IsotropicGaussians { positions: &positions, opacities, scales: &scales, factor };
        let shown = Shown { gaussians, velocities: &[], drawing: &drawing };
        let loss = frame_loss(observed, &identification.comparison, &shown, true);
        total += share * (loss.chamfer_m + loss.mask_l1);
        Some(loss.gradient.iter().map(|g: &DVec3| *g * share).collect())
    })?;
    let slope = materials(unknowns)
        .map(|i| {
            let (p, at) = (identification.parameters()[i], state.material[i]);
            let chain = (p.value(at + 1e-6) - p.value(at - 1e-6)) / 2e-6;
            gradient.bodies[0].material[i] * chain
        })
        .collect();
    Ok((total, slope))
}
