//! The module's interface: functions over the linear memory.
//!
//! The page writes the numbers of a world where `gic_reserve` says, calls `gic_start`, and then `gic_advance` for every
//! frame; the lists that `gic_positions` and its like point to are those of the last frame, and stay valid until the
//! next call. What returns a count or `bool` is zero where it failed; `gic_message` then tells why.

use std::cell::RefCell;

use glam::DVec3;

use crate::{LiveSimulation, decode};

/// What the module holds.
#[derive(Default)]
struct Module {
    numbers: Vec<f64>,
    simulation: Option<LiveSimulation>,
    positions: Vec<f32>,
    speeds: Vec<f32>,
    stresses: Vec<f32>,
    outward: Vec<[f32; 3]>,
    held: [f64; 3],
    message: String,
}

thread_local! {
    static MODULE: RefCell<Module> = RefCell::default();
}

fn with<T>(action: impl FnOnce(&mut Module) -> T) -> T {
    MODULE.with_borrow_mut(action)
}

impl Module {
    fn lists(&mut self) {
        let Some(simulation) = &self.simulation else { return };
        let frame = simulation.frame();
        self.positions = frame.positions.iter().flat_map(|p| p.as_vec3().to_array()).collect();
        self.speeds = frame.velocities.iter().map(|v| v.length() as f32).collect();
        self.stresses.clone_from(&frame.von_mises_pa);
        self.outward = simulation.outward();
    }

    /// Works on the simulation; an error becomes the message.
    fn attempt<E: std::error::Error>(&mut self, action: impl FnOnce(&mut LiveSimulation) -> Result<(), E>) -> bool {
        let outcome = self.simulation.as_mut().map(action);
        if let Some(Err(error)) = &outcome {
            self.message = error.to_string();
        }
        matches!(outcome, Some(Ok(())))
    }
}

/// Room for so many numbers of a world.
#[unsafe(no_mangle)]
extern "C" fn gic_reserve(count: usize) -> *mut f64 {
    with(|module| {
        module.numbers = vec![0.0; count];
        module.numbers.as_mut_ptr()
    })
}

/// Sets up the world of the numbers; returns its particles.
#[unsafe(no_mangle)]
extern "C" fn gic_start() -> usize {
    with(|module| {
        module.simulation = None;
        let Some(world) = decode(&module.numbers) else {
            module.message = "these are not the numbers of a world".into();
            return 0;
        };
        match LiveSimulation::new(world) {
            Ok(simulation) => module.simulation = Some(simulation),
            Err(error) => module.message = error.to_string(),
        }
        module.lists();
        module.simulation.as_ref().map_or(0, |simulation| simulation.frame().positions.len())
    })
}

/// Computes the next frame.
#[unsafe(no_mangle)]
extern "C" fn gic_advance() -> bool {
    with(|module| {
        let went_well = module.attempt(LiveSimulation::advance);
        module.lists();
        went_well
    })
}

/// Back to the start.
#[unsafe(no_mangle)]
extern "C" fn gic_restart() -> bool {
    with(|module| {
        let went_well = module.attempt(LiveSimulation::restart);
        module.lists();
        went_well
    })
}

/// Changes a parameter of the law.
#[unsafe(no_mangle)]
extern "C" fn gic_set_parameter(index: usize, value: f64) -> bool {
    with(|module| {
        module.attempt(|simulation| simulation.set_parameter(index, value))
            && module.attempt(LiveSimulation::apply_changes)
    })
}

/// Changes gravity [m/s^2].
#[unsafe(no_mangle)]
extern "C" fn gic_set_gravity(x: f64, y: f64, z: f64) -> bool {
    with(|module| {
        module.attempt(|simulation| {
            simulation.set_gravity(DVec3::new(x, y, z));
            simulation.apply_changes()
        })
    })
}

/// Grabs what the ray from (x, y, z) along the unit vector (dx, dy, dz) meets first; [`gic_held`] says where.
#[unsafe(no_mangle)]
extern "C" fn gic_grab(x: f64, y: f64, z: f64, dx: f64, dy: f64, dz: f64) -> bool {
    with(|module| {
        let simulation = module.simulation.as_mut();
        let held = simulation.and_then(|simulation| simulation.grab(DVec3::new(x, y, z), DVec3::new(dx, dy, dz)));
        module.held = held.unwrap_or_default().to_array();
        held.is_some()
    })
}

/// Pulls what is held to a place [m].
#[unsafe(no_mangle)]
extern "C" fn gic_pull(x: f64, y: f64, z: f64) {
    with(|module| module.simulation.iter_mut().for_each(|simulation| simulation.pull(DVec3::new(x, y, z))));
}

/// Lets go.
#[unsafe(no_mangle)]
extern "C" fn gic_release() {
    with(|module| module.simulation.iter_mut().for_each(LiveSimulation::release));
}

/// Where the grabbed matter was held [m]: 3 f64.
#[unsafe(no_mangle)]
extern "C" fn gic_held() -> *const f64 {
    with(|module| module.held.as_ptr())
}

/// Positions [m]: f32, shape [n, 3].
#[unsafe(no_mangle)]
extern "C" fn gic_positions() -> *const f32 {
    with(|module| module.positions.as_ptr())
}

/// Speeds [m/s]: f32, shape [n].
#[unsafe(no_mangle)]
extern "C" fn gic_speeds() -> *const f32 {
    with(|module| module.speeds.as_ptr())
}

/// Von Mises stresses [Pa]: f32, shape [n].
#[unsafe(no_mangle)]
extern "C" fn gic_stresses() -> *const f32 {
    with(|module| module.stresses.as_ptr())
}

/// Outward directions: f32, shape [n, 3].
#[unsafe(no_mangle)]
extern "C" fn gic_outward() -> *const f32 {
    with(|module| module.outward.as_ptr().cast())
}

/// Substeps of the last frame.
#[unsafe(no_mangle)]
extern "C" fn gic_substeps() -> usize {
    with(|module| module.simulation.as_ref().map_or(0, |simulation| simulation.frame().substeps))
}

/// Time since the start [s].
#[unsafe(no_mangle)]
extern "C" fn gic_time() -> f64 {
    with(|module| module.simulation.as_ref().map_or(0.0, LiveSimulation::time_s))
}

/// A coordinate of the centre of mass [m].
#[unsafe(no_mangle)]
extern "C" fn gic_centre(axis: usize) -> f64 {
    with(|module| module.simulation.as_ref().map_or(f64::NAN, |simulation| simulation.centre_of_mass()[axis.min(2)]))
}

/// Why the last call failed: UTF-8 of [`gic_message_length`] bytes.
#[unsafe(no_mangle)]
extern "C" fn gic_message() -> *const u8 {
    with(|module| module.message.as_ptr())
}

/// Bytes of [`gic_message`].
#[unsafe(no_mangle)]
extern "C" fn gic_message_length() -> usize {
    with(|module| module.message.len())
}
