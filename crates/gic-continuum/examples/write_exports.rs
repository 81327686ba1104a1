//! Writes one ring in every format, for `scripts/check_exports.py`:
//!
//! ```text
//! cargo run -p gic-continuum --example write_exports -- FOLDER python3 scripts/check_exports.py FOLDER/surface.obj
//! FOLDER/surface.stl FOLDER/surface.ply FOLDER/particles.ply FOLDER/body.msh
//! ```

use std::error::Error;
use std::path::PathBuf;

use gic_continuum::{ContinuumError, Filling, ParticleTuning, sample_particles, write_particles_ply};
use gic_geometry::{write_mesh_ply, write_msh, write_obj, write_stl};
use glam::DVec3;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).ok_or("give the folder to write to")?);
    std::fs::create_dir_all(&folder)?;
    let ring = ring()?;
    let surface = ring.surface_mesh();
    write_obj(&folder.join("surface.obj"), &surface)?;
    write_stl(&folder.join("surface.stl"), &surface)?;
    write_mesh_ply(&folder.join("surface.ply"), &surface)?;
    write_particles_ply(&folder.join("particles.ply"), &sample_particles(&ring, 0.01, &ParticleTuning::default())?)?;
    write_msh(&folder.join("body.msh"), &ring.tetrahedra(0.015)?)?;
    println!("{} vertices, {:.6} m^3, in {}", surface.vertices.len(), surface.volume(), folder.display());
    Ok(())
}

/// A ring of radius 0.09 m with a tube of radius 0.04 m.
fn ring() -> Result<Filling, ContinuumError> {
    let distance = |p: DVec3| (p.x.hypot(p.z) - 0.09).hypot(p.y) - 0.04;
    Filling::of_body((DVec3::splat(-0.16), DVec3::splat(0.16)), 0.01, 0.04, distance)
}
