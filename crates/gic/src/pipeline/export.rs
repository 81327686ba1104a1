//! `gic export`: the matter of a run for other tools.

use std::path::Path;

use gic_continuum::write_particles_ply;
use gic_geometry::{write_mesh_ply, write_msh, write_obj, write_stl};
use gic_twin::interchange::{EmbeddedPoints, MotionSamples, write_mjcf, write_particle_set, write_usd};
use gic_twin::matter::read_particles;
use gic_twin::simulate::Trajectory;
use gic_twin::twin::Twin;
use glam::DVec3;

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
    /// The twin as a deformable body of MuJoCo: tetrahedra, elasticity, masses, obstacles.
    Mjcf,
    /// The twin as an OpenUSD stage: deformable body, material, and the predicted motion.
    Usd,
    /// Particles as NumPy arrays, and all parameters beside them as JSON: for Genesis, Newton, Taichi.
    Particles,
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
            Self::Mjcf => "twin.xml",
            Self::Usd => "twin.usda",
            Self::Particles => "twin.npz",
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
        if format == Export::Particles {
            let (twin, world) = self.finished_twin()?.to_world()?;
            let parameters = write_particle_set(path, &twin, &world)?;
            return Ok(format!(
                "{} particles, parameters in {}",
                continuum.particles.positions.len(),
                parameters.display()
            ));
        }
        if format == Export::Ply {
            write_particles_ply(path, &continuum.particles).map_err(Error::stage("export"))?;
            return Ok(format!("{} particles", continuum.particles.positions.len()));
        }
        let filling = self.first_filling(&continuum)?;
        if matches!(format, Export::Msh | Export::Mjcf | Export::Usd) {
            let mesh = filling.tetrahedra(2.0 * continuum.particles.spacing).map_err(Error::stage("export"))?;
            match format {
                Export::Mjcf => write_mjcf(path, &mesh, &self.finished_twin()?)?,
                Export::Usd => write_usd(path, &mesh, &self.finished_twin()?, &self.predicted_motion(&mesh.vertices)?)?,
                _ => write_msh(path, &mesh).map_err(Error::stage("export"))?,
            }
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

    fn finished_twin(&self) -> Result<Twin> {
        Ok(Twin::read(&self.path("twin.json"), &[])?)
    }

    /// The points [m], given at the first frame, in every frame of the prediction; no frames where there is no
    /// prediction.
    fn predicted_motion(&self, points: &[DVec3]) -> Result<MotionSamples> {
        let folder = self.path("prediction");
        let Some(trajectory) = Trajectory::read(&folder)? else { return Ok(MotionSamples::default()) };
        let particles = |file: &str| read_particles(&folder.join(file)).map(|read| read.positions);
        let Some(first) = trajectory.frames.first() else { return Ok(MotionSamples::default()) };
        let carrier = EmbeddedPoints::new(points, &particles(&first.file)?);
        let frames = trajectory.frames.iter().map(|frame| Ok(carrier.deformed(&particles(&frame.file)?)));
        let rate = trajectory.twin.get("frame_rate_hz").and_then(|rate| rate.as_f64());
        Ok(MotionSamples { frame_rate_hz: rate.unwrap_or_default(), frames: frames.collect::<Result<_>>()? })
    }
}
