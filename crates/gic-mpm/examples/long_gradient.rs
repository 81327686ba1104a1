//! Time and peak memory of a long gradient: 59,319 particles, 13 frames of 200 substeps, under the default memory
//! budget.
//!
//! `cargo run --release -p gic-mpm --example long_gradient [elastic|plasticine]`

use std::time::Instant;

use gic_mpm::{Body, Collider, Contact, Material, Options, Stepping, World, gradient};
use glam::DVec3;

const SIDE: usize = 39;
const FRAMES: usize = 14;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let material = match std::env::args().nth(1).as_deref() {
        None | Some("elastic") => Material::Elastic { youngs_modulus_pa: 3e5, poisson_ratio: 0.3 },
        Some("plasticine") => Material::Plasticine { youngs_modulus_pa: 1e6, poisson_ratio: 0.3, yield_stress_pa: 5e3 },
        Some(other) => return Err(format!("{other}: choose elastic or plasticine").into()),
    };
    let start = Instant::now();
    let last = FRAMES - 1;
    let found = gradient(&world(material), &Options::default(), FRAMES, |frame| {
        (frame.index == last).then(|| frame.positions.clone())
    })?;
    let seconds = start.elapsed().as_secs_f64();
    let names = material.parameter_names();
    println!("{}: {names:?} {:?}, {seconds:.1} s of wall time", material.model(), found.bodies[0].material);
    // Linux tells the peak of the resident memory.
    if let Ok(status) = std::fs::read_to_string("/proc/self/status") {
        status.lines().filter(|line| line.starts_with("VmHWM")).for_each(|line| println!("{line}"));
    }
    Ok(())
}

/// A cube, 8 particles per cell, that falls on the ground.
fn world(material: Material) -> World {
    let at = |i: usize| DVec3::new((i % SIDE) as f64, (i / SIDE % SIDE) as f64, (i / (SIDE * SIDE)) as f64);
    World {
        bodies: vec![Body {
            material,
            density_kg_m3: 1000.0,
            particle_volume_m3: 1e-6,
            volume_factors: Vec::new(),
            positions: (0..SIDE.pow(3)).map(|i| (at(i) + 0.5) * 0.01 + DVec3::Y * 0.03).collect(),
            velocity_m_s: DVec3::new(0.5, -2.0, 0.25),
            angular_velocity_rad_s: DVec3::ZERO,
        }],
        colliders: vec![Collider::plane(DVec3::ZERO, DVec3::Y, Contact::Sticky)],
        gravity_m_s2: DVec3::new(0.0, -9.8, 0.0),
        grid_spacing_m: 0.02,
        frame_rate_hz: 24.0,
        stepping: Stepping::Fixed { substeps_per_frame: 200 },
    }
}
