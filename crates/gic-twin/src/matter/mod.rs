//! The matter of a twin: particles read from a file, or sampled inside a mesh or a shape.

mod mesh;
mod ply;
mod solid;

use std::path::Path;

use gic_files::FileError;
use glam::DVec3;

pub use mesh::Mesh;
pub use ply::{PlyContent, PlyParticles, read_particles, read_ply, write_particles};
pub use solid::{Solid, SolidKind};

use crate::error::{Result, TwinError};

/// What a file of matter holds.
pub enum Matter {
    /// Particles, in the file's order.
    Particles {
        /// Positions [m], shape [n].
        positions: Vec<DVec3>,
        /// Volume of each in units of the cube of their spacing, shape [n]; empty where the file does not say.
        volume_factors: Vec<f64>,
    },
    /// A closed surface, to be filled.
    Mesh(Mesh),
}

/// Reads particles (.ply without faces) or a closed surface (.ply with faces, .obj, .stl).
pub fn read_matter(path: &Path) -> Result<Matter> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    let mesh = match extension.as_str() {
        "ply" => match read_ply(path)? {
            PlyContent::Particles(particles) => {
                let said = particles.volume_factors.iter().any(|factor| !factor.is_nan());
                let volume_factors = if said { particles.volume_factors } else { Vec::new() };
                return Ok(Matter::Particles { positions: particles.positions, volume_factors });
            }
            PlyContent::Mesh(mesh) => mesh,
        },
        "obj" => mesh::read_obj(path)?,
        "stl" => mesh::read_stl(path)?,
        _ => {
            return Err(TwinError::File(FileError::Content {
                path: path.to_owned(),
                problem: format!("the ending `.{extension}` is none that gic reads as matter"),
                hint: Some("give .ply (particles or a mesh), .obj or .stl".into()),
            }));
        }
    };
    mesh.check_closed(path)?;
    Ok(Matter::Mesh(mesh))
}
