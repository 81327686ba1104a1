//! `gic export`: the matter of a run for other tools.

use std::path::Path;

use gic_continuum::{write_mesh_ply, write_msh, write_obj, write_particles_ply, write_stl};

use super::Run;
use crate::error::{Error, Result};

/// Forms of export.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Export {
    /// Particles with density and volume, binary PLY.
    Ply,
    /// The surface, binary PLY.
    SurfacePly,
    /// The surface, Wavefront OBJ.
    Obj,
    /// The surface, binary STL.
    Stl,
    /// Tetrahedra, Gmsh MSH 2.2.
    Msh,
}

impl Export {
    /// Name of the file where none is given.
    pub fn default_file(self) -> &'static str {
        match self {
            Self::Ply => "particles.ply",
            Self::SurfacePly => "surface.ply",
            Self::Obj => "surface.obj",
            Self::Stl => "surface.stl",
            Self::Msh => "tetrahedra.msh",
        }
    }
}

impl Run<'_> {
    /// Writes the matter at the first frame; says in a sentence what was written.
    ///
    /// # Errors
    /// A run without filling, an unwritable file.
    pub fn export(&self, format: Export, path: &Path) -> Result<String> {
        let continuum = self.continuum()?;
        if format == Export::Ply {
            write_particles_ply(path, &continuum.particles).map_err(Error::stage("export"))?;
            return Ok(format!("{} particles", continuum.particles.positions.len()));
        }
        let filling = self.first_filling(&continuum)?;
        if format == Export::Msh {
            let mesh = filling.tetrahedra(2.0 * continuum.particles.spacing).map_err(Error::stage("export"))?;
            write_msh(path, &mesh).map_err(Error::stage("export"))?;
            let (least, _) = mesh.dihedral_angles();
            return Ok(format!("{} tetrahedra, smallest dihedral angle {least:.1} degrees", mesh.tetrahedra.len()));
        }
        let mesh = filling.surface_mesh();
        match format {
            Export::Obj => write_obj(path, &mesh),
            Export::Stl => write_stl(path, &mesh),
            _ => write_mesh_ply(path, &mesh),
        }
        .map_err(Error::stage("export"))?;
        Ok(format!("{} triangles", mesh.triangles.len()))
    }
}
