//! Writes a cantilever in every format for other simulators, for `scripts/check_simulators.py`:
//!
//! ```text
//! cargo run --release -p gic-twin --example write_interchange -- FOLDER
//! ```

use std::error::Error;
use std::path::PathBuf;

use gic_geometry::write_msh;
use gic_mpm::{Material, Options, rollout};
use gic_twin::interchange::{ExportBody, Motion, UsdLook, write_mjcf, write_particle_set, write_usd};
use gic_twin::matter::{Solid, SolidKind};
use gic_twin::twin::{ContactKind, MatterSource, Obstacle, ObstacleShape, Twin};
use glam::DVec3;

/// Sides [m]; clamped at x = 0.
const SIZE: DVec3 = DVec3::new(0.2, 0.04, 0.04);

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).ok_or("give the folder to write to")?);
    std::fs::create_dir_all(&folder)?;
    let twin = beam();
    twin.write(&folder.join("beam.json"))?;
    let (_, world) = twin.to_world()?;
    let (mut frames, mut sag) = (Vec::new(), Vec::new());
    let tip: Vec<usize> =
        (0..world.bodies[0].positions.len()).filter(|&p| world.bodies[0].positions[p].x > SIZE.x - 0.006).collect();
    rollout(&world, &Options::default(), twin.frames, |frame| {
        frames.push(frame.positions.clone());
        sag.push(tip.iter().map(|&p| frame.positions[p].y).sum::<f64>() / tip.len() as f64);
    })?;
    let body = ExportBody::new(&twin, Motion { frame_rate_hz: twin.frame_rate_hz, frames })?;
    write_msh(&folder.join("beam.msh"), &body.tetrahedra()?, "")?;
    write_particle_set(&folder.join("beam.npz"), &body)?;
    write_usd(&folder.join("beam.usda"), &body, None, UsdLook::Surface)?;
    let free = Twin { colliders: Vec::new(), ..twin };
    write_mjcf(&folder.join("beam.xml"), &ExportBody::new(&free, Motion::default())?, false)?;
    let heights: Vec<String> = sag.iter().map(|y| format!("{y:.8}")).collect();
    std::fs::write(folder.join("beam_tip.csv"), format!("tip_y_m\n{}\n", heights.join("\n")))?;
    println!("{:.4} kg in {}", body.mass_kg(), folder.display());
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
