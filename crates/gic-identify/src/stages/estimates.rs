//! Everything that was found as one result.

use gic_mpm::MaterialKind;
use glam::DVec3;

use crate::forward::drawing::Drawing;
use crate::forward::flight::{placed, volume_factors};
use crate::forward::simulation::Simulation;
use crate::forward::trajectories::{ForwardModel, Trajectories};
use crate::forward::world::{colliders, down, gravity};
use crate::result::{Estimate, Estimates, Loss, Stage};
use crate::session::Session;
use crate::solve::linearisation::Linearisation;
use crate::solve::loss::mean_loss;
use crate::stages::identification::Identification;
use crate::stages::intervals::{Uncertainty, flight_half_width, uncertainty};
use crate::stages::middle;
use crate::uncertainty::verdicts;
use crate::unknowns::parameter::sought_values;
use crate::unknowns::state::{State, Unknown};
use crate::{IdentifyError, Parameter, Start, WorldEstimate};

/// The result where nothing is touched.
pub(crate) fn of_free_flight(identification: &Identification, session: &mut Session) -> Estimates {
    let state = &identification.flight.state;
    let trajectories = identification.free_flight().trajectories(state, &identification.all_frames()).ok();
    unbounded(identification, session, state, trajectories.as_ref())
}

/// The end of the material stage or of the joint one as the result.
///
/// # Errors
/// Where it cannot be simulated.
pub(crate) fn without_intervals(
    identification: &Identification,
    session: &mut Session,
    state: &State,
) -> Result<Estimates, IdentifyError> {
    let trajectories = identification.simulation().trajectories(state, &identification.all_frames());
    let trajectories = trajectories.map_err(|error| error.of_stage(1))?;
    Ok(unbounded(identification, session, state, Some(&trajectories)))
}

/// The end of the joint stage as the result, with intervals and verdicts; `known` was measured at `state` before.
///
/// # Errors
/// Where it cannot be simulated, and interruption.
pub(crate) fn with_intervals(
    identification: &Identification,
    session: &mut Session,
    state: &State,
    known: Option<Linearisation>,
) -> Result<Estimates, IdentifyError> {
    let (trajectories, uncertainty) =
        uncertainty(identification, session, state, known).map_err(|error| error.of_stage(1))?;
    let may_be_believed = may_be_believed(identification, session, state, &trajectories);
    let (middle, trajectories) = middle::of_what_is_open(identification, session, (state, trajectories), &uncertainty)
        .map_err(|error| error.of_stage(1))?;
    let parameters = identification.parameters().iter().zip(&state.material).enumerate();
    let estimates = parameters
        .map(|(i, (p, coordinate))| {
            let interval = uncertainty.interval(Unknown::Material(i), state, &middle);
            let about_fit = estimate(identification, (i, p), *coordinate, interval);
            let identifiable = about_fit.identifiable && may_be_believed;
            Estimate { value: p.value(middle.material[i]), identifiable, ..about_fit }
        })
        .collect();
    Ok(result(identification, session, (&middle, Some(&trajectories)), estimates, Some(&uncertainty)))
}

/// Whether the body is known and the model explains the frames after contact. Warns where that is not so, and of
/// parameters at their limits.
fn may_be_believed(
    identification: &Identification,
    session: &mut Session,
    state: &State,
    trajectories: &Trajectories,
) -> bool {
    let compared = (&identification.video, &identification.comparison);
    let drawn = (trajectories, identification.input.opacities.as_slice());
    let (free, spacing_m) = (identification.flight.free, identification.input.particle_volume_m3.cbrt());
    let mut doubts = verdicts::unexplained(compared, drawn, free, spacing_m);
    doubts.extend(verdicts::guessed(identification.shape.told_share()));
    let may_be_believed = doubts.is_empty();
    session.warn(doubts);
    session.warn(verdicts::at_limits(&identification.coordinates(), &identification.free_materials(), state));
    may_be_believed
}

/// A result where the material's intervals are the ranges that are searched.
fn unbounded(
    identification: &Identification,
    session: &mut Session,
    state: &State,
    trajectories: Option<&Trajectories>,
) -> Estimates {
    let parameters = identification.parameters().iter().enumerate().zip(&state.material);
    let estimates = parameters.map(|(place, c)| estimate(identification, place, *c, None)).collect();
    result(identification, session, (state, trajectories), estimates, None)
}

/// Half-width of the velocity's interval [m/s]: of the flight by the outlines, which hangs on no shape. Where they say
/// nothing and the flight was fitted to the filled body, or in a world that is itself sought, the joint fit's counts
/// besides. `None` where one of them could not be measured.
fn velocity_half_width(
    identification: &Identification,
    joint: Option<&Uncertainty>,
    world: Option<&WorldEstimate>,
) -> Option<DVec3> {
    let by_gravity = world.map_or(DVec3::ZERO, |world| {
        let gravity = identification.input.gravity_m_s2;
        let (x, y) = down(gravity).any_orthonormal_pair();
        let [tilt_x, tilt_y] = world.gravity_tilt_half_width_rad;
        let ways = [(gravity, world.log_gravity_half_width), (x.cross(gravity), tilt_x), (y.cross(gravity), tilt_y)];
        let squares: DVec3 = ways.iter().map(|(way, half)| (*way * half.unwrap_or(0.0)).powf(2.0)).sum();
        identification.simulation().halfway_s() * squares.map(f64::sqrt)
    });
    let outlines_suffice = identification.motion_by_outlines.is_some() && world.is_none();
    let of_axis = |axis: usize| {
        let unknown = Unknown::Velocity(axis);
        if !identification.flight.motion.contains(&unknown) {
            return Some(0.0);
        }
        let from_joint = match joint {
            Some(uncertainty) if !outlines_suffice => uncertainty.half_width(unknown)?,
            _ => 0.0,
        };
        Some(flight_half_width(identification, unknown)?.hypot(from_joint).hypot(by_gravity[axis]))
    };
    Some(DVec3::new(of_axis(0)?, of_axis(1)?, of_axis(2)?))
}

fn estimate(
    identification: &Identification,
    (i, p): (usize, &Parameter),
    coordinate: f64,
    interval: Option<(f64, f64)>,
) -> Estimate {
    let value = p.value(coordinate);
    let fixed = identification.settings.fixed_value(p).is_some();
    let (low, high) = p.limits();
    let interval = match interval {
        _ if fixed => (value, value),
        Some((from, to)) => (p.value(from.max(low)).max(p.bounds.0), p.value(to.min(high)).min(p.bounds.1)),
        None => p.bounds,
    };
    let at_bound = !fixed && identification.coordinates().is_at_limit(i, coordinate);
    let width = 0.5 * p.error(interval.1, interval.0).abs();
    Estimate { parameter: *p, value, interval_95: interval, identifiable: !at_bound && width < p.widest, fixed }
}

/// The world as it was found.
fn world(state: &State, uncertainty: Option<&Uncertainty>) -> WorldEstimate {
    let half_width = |k: usize| uncertainty.and_then(|all| all.half_width(Unknown::World(k)));
    let [height_m, tilt_x, tilt_y, log_friction, log_gravity, gravity_tilt_x, gravity_tilt_y] = state.world;
    WorldEstimate {
        height_m,
        height_half_width_m: half_width(0),
        tilt_rad: [tilt_x, tilt_y],
        tilt_half_width_rad: [half_width(1), half_width(2)],
        log_friction,
        log_friction_half_width: half_width(3),
        sticks: state.sticks,
        log_gravity,
        log_gravity_half_width: half_width(4),
        gravity_tilt_rad: [gravity_tilt_x, gravity_tilt_y],
        gravity_tilt_half_width_rad: [half_width(5), half_width(6)],
    }
}

/// A minimum as a start of other fits.
fn start_of(simulation: &Simulation, state: &State) -> Start {
    Start {
        parameters: sought_values(&simulation.material(state)),
        grid_spacing_m: Some(simulation.cell_m(state)),
        sticks: state.sticks,
    }
}

fn result(
    identification: &Identification,
    session: &mut Session,
    (state, trajectories): (&State, Option<&Trajectories>),
    estimates: Vec<Estimate>,
    uncertainty: Option<&Uncertainty>,
) -> Estimates {
    let Identification { input, shape, video, comparison, .. } = identification;
    if identification.kind != MaterialKind::Sand && identification.settings.mass_kg.is_none() {
        session.warn([format!(
            "density is taken as {} kg/m^3: \
             the video determines only the ratios of the moduli, stresses and viscosities to it (--mass-kg)",
            input.density_kg_m3
        )]);
    }
    let world = input.world_doubt.map(|_| world(state, uncertainty));
    let (simulation, drawing) = (identification.simulation(), Drawing::of(state));
    let cell_m = simulation.cell_m(state);
    let cell_half_width = uncertainty.and_then(|all| all.half_width(Unknown::Cell));
    let found = session.checkpoint();
    let starts = found.material.as_ref().or(found.starts.as_ref());
    let minima = std::iter::once(state).chain(starts.into_iter().flatten().skip(1));
    let mut seconds = session.checkpoint().seconds.clone();
    seconds.push((Stage::Intervals, session.unbooked_seconds()));
    Estimates {
        material: simulation.material(state),
        estimates,
        minima: minima.map(|state| start_of(&simulation, state)).collect(),
        velocity_m_s: simulation.velocity(state),
        velocity_interval_95: velocity_half_width(identification, uncertainty, world.as_ref()),
        angular_velocity_rad_s: state.angular,
        free_frames: identification.flight.free,
        loss: trajectories.map_or_else(Loss::default, |t| mean_loss(video, comparison, &input.opacities, t)),
        trace: session.checkpoint().trace.clone(),
        rollouts: identification.rollouts.full(),
        coarse_rollouts: identification.rollouts.coarse(),
        seconds,
        warnings: session.warnings().to_vec(),
        splat_factor: state.splat.exp(),
        grid_spacing_m: cell_m,
        grid_spacing_interval_95_m: cell_half_width.map(|half| (cell_m * (-half).exp(), cell_m * half.exp())),
        substeps_per_frame: simulation.substeps_per_frame(state),
        colliders: colliders(input, state),
        gravity_m_s2: gravity(input, state),
        world,
        devices: (0..input.device_doubts.len()).map(|device| drawing.offset(device)).collect(),
        positions: placed(input, shape, state).0,
        particle_volume_m3: input.particle_volume_m3,
        volume_factors: volume_factors(input, shape, state),
    }
}
