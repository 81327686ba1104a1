//! Writes a cantilever in every format for other simulators, for `scripts/check_simulators.py`:
//!
//! ```text
//! cargo run --release -p gic-twin --example write_interchange -- FOLDER
//! ```

use std::error::Error;
use std::path::PathBuf;

use gic_continuum::{ContinuumError, Filling};
use gic_geometry::write_msh;
use gic_mpm::{Material, Options, rollout};
use gic_twin::interchange::{EmbeddedPoints, MotionSamples, write_mjcf, write_particle_set, write_usd};
use gic_twin::matter::{Solid, SolidKind};
use gic_twin::twin::{ContactKind, MatterSource, Obstacle, ObstacleShape, Twin};
use glam::DVec3;

/// Sides [m]; clamped at x = 0.
const SIZE: DVec3 = DVec3::new(0.2, 0.04, 0.04);
/// Edge of the cubes that the tetrahedra are cut from [m].
const EDGE: f64 = 0.0125;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).ok_or("give the folder to write to")?);
    std::fs::create_dir_all(&folder)?;
    let twin = beam();
    twin.write(&folder.join("beam.json"))?;
    let mesh = filling()?.tetrahedra(EDGE)?;
    write_msh(&folder.join("beam.msh"), &mesh)?;
    write_mjcf(&folder.join("beam.xml"), &mesh, &Twin { colliders: Vec::new(), ..twin.clone() })?;
    let (twin, world) = twin.to_world()?;
    write_particle_set(&folder.join("beam.npz"), &twin, &world)?;
    let carrier = EmbeddedPoints::new(&mesh.vertices, &world.bodies[0].positions);
    let (mut frames, mut sag) = (Vec::new(), Vec::new());
    let tip: Vec<usize> =
        (0..world.bodies[0].positions.len()).filter(|&p| world.bodies[0].positions[p].x > SIZE.x - 0.006).collect();
    rollout(&world, &Options::default(), twin.frames, |frame| {
        frames.push(carrier.deformed(&frame.positions));
        sag.push(tip.iter().map(|&p| frame.positions[p].y).sum::<f64>() / tip.len() as f64);
    })?;
    let motion = MotionSamples { frame_rate_hz: twin.frame_rate_hz, frames };
    write_usd(&folder.join("beam.usda"), &mesh, &twin, &motion)?;
    let heights: Vec<String> = sag.iter().map(|y| format!("{y:.8}")).collect();
    std::fs::write(folder.join("beam_tip.csv"), format!("tip_y_m\n{}\n", heights.join("\n")))?;
    println!("{} vertices, {} tetrahedra in {}", mesh.vertices.len(), mesh.tetrahedra.len(), folder.display());
    Ok(())
}

/// A beam that sags by a few per cent of its length.
fn beam() -> Twin {
    let material = Material::Elastic { youngs_modulus_pa: 2e6, poisson_ratio: 0.3 };
    let shape = Solid {
        kind: SolidKind::Box { size_m: SIZE.to_array() },
        centre_m: [0.5 * SIZE.x, 0.0, 0.0],
        rotation_deg: [0.0; 3],
    };
    let wall = ObstacleShape::HalfSpace { point_m: [0.0; 3], normal: [1.0, 0.0, 0.0] };
    Twin {
        colliders: vec![Obstacle::new(wall, ContactKind::Sticky)],
        grid_spacing_m: Some(0.01),
        frame_rate_hz: 200.0,
        frames: 121,
        ..Twin::new(material, MatterSource::Solid(shape))
    }
}

fn filling() -> Result<Filling, ContinuumError> {
    let centre = DVec3::X * 0.5 * SIZE.x;
    let half = 0.5 * SIZE;
    let distance = |p: DVec3| {
        let beyond = (p - centre).abs() - half;
        beyond.max(DVec3::ZERO).length() + beyond.max_element().min(0.0)
    };
    Filling::of_body((centre - half - 0.01, centre + half + 0.01), 0.0025, 0.005, distance)
}
