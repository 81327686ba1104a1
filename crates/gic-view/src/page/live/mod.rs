//! `gic view --live`: the twin simulated in the page, pulled by the pointer, with other parameters.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use gic_live::{FRAME_RATE_HZ, encode, reduced};
use gic_mpm::{Body, World};
use gic_twin::twin::Twin;
use glam::DVec3;
use serde::Serialize;

use super::matter::MatterHeader;
use super::obstacles::posed;
use super::{Meaning, PageBody, PageOutcome, PageRequest, Viewer, ViewerHeader, write_page};
use crate::error::{Result, ViewError};
use crate::render::particle_splats::{OPACITY, SCALE};
use crate::template;
use crate::units::{Unit, quantity};

/// The simulator for the page: what `scripts/build_live.sh` makes of `gic-live`.
const MODULE: &[u8] = include_bytes!("gic_live.wasm");
/// How far a slider of a positive parameter goes to both sides. Budget: softer and harder than anything like it.
const PARAMETER_FACTOR: f64 = 30.0;
/// Highest Poisson's ratio of its slider. Budget: beyond, waves are so fast that a page crawls.
const MAX_POISSON_RATIO: f64 = 0.48;
/// Highest angle of friction of its slider [degrees]. Budget: steeper than any heap.
const MAX_FRICTION_ANGLE_DEG: f64 = 60.0;
/// Highest gravity of its slider [m/s^2]. Budget: twice the Earth's.
const MAX_GRAVITY_M_S2: f64 = 20.0;
/// For how long moving obstacles are followed [s]. Budget: a page that stays small.
const OBSTACLES_S: f64 = 20.0;

/// What the page needs to simulate.
#[derive(Serialize)]
pub(super) struct Live {
    /// The module: bytes, base64.
    module: String,
    /// The world for it: f64, little-endian, base64.
    numbers: String,
}

/// What the script needs to know about the simulation.
#[derive(Serialize)]
pub(super) struct LiveHeader {
    parameters: Vec<Parameter>,
    gravity_m_s2: [f64; 3],
    max_gravity_m_s2: f64,
    /// Size of each particle in units of the largest, shape [n].
    sizes: Vec<f64>,
    opacity: f32,
    /// Whether an obstacle moves: its way ends with `times_s`.
    has_moving_obstacle: bool,
}

/// A slider.
#[derive(Serialize)]
struct Parameter {
    name: &'static str,
    unit: &'static str,
    /// From SI to the unit.
    factor: f64,
    /// Value and ends, SI.
    value: f64,
    range: [f64; 2],
    is_logarithmic: bool,
}

/// Writes the page in which a twin is simulated.
///
/// # Errors
/// A twin that no simulation takes, an unwritable page.
pub fn view_live(request: &PageRequest, twin: &Twin) -> Result<PageOutcome> {
    let (twin, world) = twin.to_world()?;
    let world = reduced(&world);
    world.validate().map_err(ViewError::stage("preparing the simulation"))?;
    let viewer = live_viewer(&twin, &world)?;
    write_page(request, format!("{} twin, live", twin.material.model()), viewer, "null".into())
}

fn live_viewer(twin: &Twin, world: &World) -> Result<Viewer> {
    let body = &world.bodies[0];
    let moving = twin.colliders.iter().any(|obstacle| obstacle.moves());
    let frames = if moving { (OBSTACLES_S * FRAME_RATE_HZ) as usize } else { 1 };
    let times_s: Vec<f64> = (0..frames).map(|frame| frame as f64 / FRAME_RATE_HZ).collect();
    let head = ViewerHeader {
        matter: matter_header(world, body),
        obstacles: twin.colliders.iter().enumerate().map(|(i, obstacle)| posed(obstacle, i, &times_s)).collect(),
        times_s,
        frame_rate_hz: FRAME_RATE_HZ,
        up: up(world).into(),
        bodies: vec![PageBody { name: "the twin".into(), splats: body.positions.len() }],
        meanings: meanings(),
        live: Some(live_header(world, body, moving)),
    };
    let no_numbers = || ViewError::Usage { problem: "a page simulates one body".into(), hint: None };
    let numbers: Vec<u8> = encode(world).ok_or_else(no_numbers)?.iter().flat_map(|x| x.to_le_bytes()).collect();
    Ok(Viewer {
        head: template::script_json(&head)?,
        data: String::new(),
        splats: body.positions.len(),
        frames,
        live: Some(Live { module: STANDARD.encode(MODULE), numbers: STANDARD.encode(numbers) }),
    })
}

fn up(world: &World) -> DVec3 {
    (-world.gravity_m_s2).normalize_or(DVec3::Y)
}

/// The view's box: the body at its start and where it falls to, with room beside it.
fn matter_header(world: &World, body: &Body) -> MatterHeader {
    let low = body.positions.iter().fold(DVec3::INFINITY, |low, p| low.min(*p));
    let high = body.positions.iter().fold(DVec3::NEG_INFINITY, |high, p| high.max(*p));
    let up = up(world);
    let gap_below = |collider: &gic_mpm::Collider| {
        let below = collider.normal().is_some_and(|normal| normal.dot(up) > 0.5);
        let gap = |p: &DVec3| collider.signed_distance(*p, 0.0);
        below.then(|| body.positions.iter().map(gap).fold(f64::INFINITY, f64::min).max(0.0))
    };
    let side = (high - low).max_element();
    let fall = -up * world.colliders.iter().filter_map(gap_below).fold(f64::INFINITY, f64::min).min(3.0 * side);
    let spacing = body.particle_volume_m3.cbrt();
    MatterHeader {
        particles: body.positions.len(),
        splats: body.positions.len(),
        frames: 1,
        low_m: (low.min(low + fall) - 0.5 * side).to_array(),
        high_m: (high.max(high + fall) + 0.5 * side).to_array(),
        max_offset_m: 1.0,
        max_scale_m: SCALE * spacing * largest_factor(body).cbrt(),
        max_stress_pa: 1.0,
        max_speed_m_s: 1.0,
        spacing_m: spacing,
        lights: None,
    }
}

fn largest_factor(body: &Body) -> f64 {
    body.volume_factors.iter().copied().reduce(f64::max).unwrap_or(1.0)
}

/// Stress, speed, or none; the ranges follow the motion.
fn meanings() -> Vec<Meaning> {
    let pressure = Unit::pressure(1e3);
    let stress = Meaning {
        name: "stress",
        kind: 1,
        title: "von Mises stress",
        unit: pressure.name,
        factor: 1.0 / pressure.size,
        range: Some([0.0, 1.0]),
    };
    let speed = Meaning { name: "speed", kind: 2, title: "speed", unit: "m/s", factor: 1.0, range: Some([0.0, 1.0]) };
    let plain = Meaning { name: "plain", kind: 3, title: "", unit: "", factor: 1.0, range: None };
    vec![speed, stress, plain]
}

fn live_header(world: &World, body: &Body, has_moving_obstacle: bool) -> LiveHeader {
    let names = body.material.parameter_names();
    let largest = largest_factor(body);
    let factor = |p: usize| body.volume_factors.get(p).copied().unwrap_or(1.0);
    LiveHeader {
        parameters: names.iter().zip(body.material.parameters()).map(|(name, value)| parameter(name, value)).collect(),
        gravity_m_s2: world.gravity_m_s2.to_array(),
        max_gravity_m_s2: MAX_GRAVITY_M_S2.max(world.gravity_m_s2.length()),
        sizes: (0..body.positions.len()).map(|p| (factor(p) / largest).cbrt()).collect(),
        opacity: OPACITY,
        has_moving_obstacle,
    }
}

fn parameter(key: &str, value: f64) -> Parameter {
    let (name, unit) = quantity(key, value);
    let (low, high, is_logarithmic) = match key {
        "poisson_ratio" => (value.min(-0.2), value.max(MAX_POISSON_RATIO), false),
        "friction_angle_deg" => (0.0, value.max(MAX_FRICTION_ANGLE_DEG), false),
        // A parameter that may be zero, and is.
        _ if value == 0.0 => (0.0, 1.0, false),
        _ => (value / PARAMETER_FACTOR, value * PARAMETER_FACTOR, true),
    };
    Parameter { name, unit: unit.name, factor: 1.0 / unit.size, value, range: [low, high], is_logarithmic }
}

#[cfg(test)]
mod tests;
