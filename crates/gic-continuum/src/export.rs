//! Particles as a file for other tools.

use std::io::{self, Write};
use std::path::Path;

use gic_files::{WriteError, write_with};

use crate::Particles;

/// Writes particles as binary PLY: x, y, z [m], density, volume [m^3], doubt (0 to 1), surface (0 or 1).
pub fn write_particles_ply(path: &Path, particles: &Particles) -> Result<(), WriteError> {
    write_with(path, |out| {
        write!(
            out,
            "ply\nformat binary_little_endian 1.0\ncomment gic continuum, metres\nelement vertex {}\n\
             property float x\nproperty float y\nproperty float z\nproperty float density\nproperty float volume\n\
             property float doubt\nproperty uchar surface\nend_header\n",
            particles.positions.len()
        )?;
        for i in 0..particles.positions.len() {
            write_f32(out, &particles.positions[i].as_vec3().to_array())?;
            write_f32(
                out,
                &[particles.densities[i], particles.volume as f32 * particles.volume_factors[i], particles.doubts[i]],
            )?;
            out.write_all(&[u8::from(particles.surface[i])])?;
        }
        Ok(())
    })
}

fn write_f32(out: &mut impl Write, values: &[f32]) -> io::Result<()> {
    values.iter().try_for_each(|v| out.write_all(&v.to_le_bytes()))
}
