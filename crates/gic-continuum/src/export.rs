//! Particles as a file for other tools.

use std::path::Path;

use gic_files::{PlyLayout, PlyProperty, WriteError, write_ply};

use crate::Particles;

/// Writes particles as binary PLY: x, y, z [m], density, volume [m^3], doubt (0 to 1), surface (0 or 1).
///
/// # Errors
/// What the system says.
pub fn write_particles_ply(path: &Path, particles: &Particles) -> Result<(), WriteError> {
    let floats = ["x", "y", "z", "density", "volume", "doubt"].map(PlyProperty::Float);
    let properties = [&floats[..], &[PlyProperty::Byte("surface")]].concat();
    let layout = PlyLayout { comment: Some("gic continuum, metres"), properties: &properties, triangles: None };
    let rows = (0..particles.positions.len()).map(|i| {
        let [x, y, z] = particles.positions[i].as_vec3().to_array();
        let volume = particles.volume as f32 * particles.volume_factors[i];
        let surface = f32::from(u8::from(particles.surface[i]));
        [x, y, z, particles.densities[i], volume, particles.doubts[i], surface]
    });
    write_ply(path, &layout, rows)
}
