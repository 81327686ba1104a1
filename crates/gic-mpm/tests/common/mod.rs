//! What the validation scenes share.
#![allow(dead_code)]

use gic_mpm::{Body, Collider, Contact, Frame, Material, Options, Simulator, Stepping, World};
use glam::DVec3;

/// Standard gravity of the scenes [m/s^2], downwards along y.
pub(crate) const GRAVITY: f64 = 9.8;

/// Density of everything [kg/m^3].
pub(crate) const DENSITY: f64 = 1000.0;

/// Particles at the centres of a regular grid that fills a box from `low`, two per cell and axis.
pub(crate) fn block(low: DVec3, size: DVec3, grid_spacing_m: f64) -> Vec<DVec3> {
    let spacing = 0.5 * grid_spacing_m;
    let [nx, ny, nz] = (size / spacing).round().to_array().map(|n| n as usize);
    let mut positions = Vec::with_capacity(nx * ny * nz);
    for i in 0..nx {
        for j in 0..ny {
            for k in 0..nz {
                positions.push(low + (DVec3::new(i as f64, j as f64, k as f64) + 0.5) * spacing);
            }
        }
    }
    positions
}

/// A body of such particles, at rest.
pub(crate) fn body(material: Material, positions: Vec<DVec3>, grid_spacing_m: f64) -> Body {
    Body {
        material,
        density_kg_m3: DENSITY,
        particle_volume_m3: (0.5 * grid_spacing_m).powi(3),
        volume_factors: Vec::new(),
        positions,
        velocity_m_s: DVec3::ZERO,
        angular_velocity_rad_s: DVec3::ZERO,
        own_velocities_m_s: Vec::new(),
    }
}

/// A world of one body under gravity.
pub(crate) fn world(body: Body, colliders: Vec<Collider>, grid_spacing_m: f64, frame_rate_hz: f64) -> World {
    World {
        bodies: vec![body],
        colliders,
        gravity_m_s2: DVec3::new(0.0, -GRAVITY, 0.0),
        grid_spacing_m,
        frame_rate_hz,
        stepping: Stepping::STABLE,
    }
}

/// Two frictionless walls across z, at 0 and `width`: the flow between them is plane.
pub(crate) fn side_walls(width: f64) -> [Collider; 2] {
    let slip = Contact::Slip { friction: 0.0 };
    [Collider::plane(DVec3::ZERO, DVec3::Z, slip), Collider::plane(DVec3::Z * width, DVec3::NEG_Z, slip)]
}

/// A simulator, or the error as a failure of the test.
pub(crate) fn simulator(world: &World) -> Simulator {
    Simulator::new(world, &Options::default()).unwrap_or_else(|error| panic!("{error}"))
}

/// The next frame, or the error as a failure of the test.
pub(crate) fn next(simulator: &mut Simulator) -> Frame {
    simulator.advance_frame().unwrap_or_else(|error| panic!("{error}"))
}

/// Frame `count` of a world.
pub(crate) fn frame_after(world: &World, count: usize) -> Frame {
    let mut simulator = simulator(world);
    for _ in 0..count {
        next(&mut simulator);
    }
    simulator.frame()
}

/// Sets the particles' velocities at the start, as a function of position.
pub(crate) fn set_velocities(simulator: &mut Simulator, mut velocity: impl FnMut(DVec3) -> DVec3) {
    let mut snapshot = simulator.snapshot();
    for particle in &mut snapshot.particles {
        let v = velocity(DVec3::from_slice(&particle[..3]));
        particle[3..6].copy_from_slice(&v.to_array());
    }
    simulator.restore(&snapshot).unwrap_or_else(|error| panic!("{error}"));
}

/// Mean of something over particles.
pub(crate) fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), value| (sum + value, count + 1));
    sum / f64::from(count)
}

/// When a signal, sampled at whole multiples of `step_s` from time zero on, first comes back to zero after its first
/// sample.
pub(crate) fn first_return_to_zero(signal: &[f64], step_s: f64) -> Option<f64> {
    let sign = signal[1].signum();
    let after = (2..signal.len()).find(|&i| signal[i] * sign <= 0.0)?;
    let (before, now) = (signal[after - 1], signal[after]);
    Some(step_s * (after as f64 - 1.0 + before / (before - now)))
}
