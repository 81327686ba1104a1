//! `gic export`: a twin for other programs. Every form describes the same body, see
//! [`gic_twin::interchange::ExportBody`].

mod gaussians;
mod source;

use std::path::{Path, PathBuf};

use gic_geometry::{MeshNotes, write_mesh_ply, write_msh, write_obj, write_stl};
use gic_twin::interchange::{
    ExportBody, Paint, UpAxis, UsdLook, write_glb, write_mjcf, write_particle_set, write_particles_ply, write_usd,
};

pub use self::source::ExportSource;
use crate::error::{Error, Result};

/// Forms of export.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Export {
    /// Particles with velocity, volume and mass, binary PLY.
    Ply,
    /// The surface with colours, binary PLY.
    SurfacePly,
    /// The surface with colours, Wavefront OBJ.
    Obj,
    /// The surface, binary STL.
    Stl,
    /// The surface with colours and motion, binary glTF; y up.
    Glb,
    /// Tetrahedra, Gmsh MSH 2.2.
    Msh,
    /// A deformable body of MuJoCo 4: elasticity, mass, velocity, obstacles.
    Mjcf,
    /// An OpenUSD stage with motion: a deformable body of Isaac, material points of Newton, obstacles.
    Usd,
    /// The particles with colours and motion, OpenUSD: for Houdini, Blender and Newton.
    ParticleUsd,
    /// NumPy arrays, parameters as JSON, and a loader for Genesis.
    Particles,
    /// Gaussians in the scene's light at the first frame, PLY for splat viewers.
    Gaussians,
    /// Gaussians of every frame, a folder of PLY files.
    GaussianSequence,
    /// Gaussians with motion, OpenUSD's particle fields.
    GaussianUsd,
}

impl Export {
    /// Name of the file or folder where none is given.
    pub fn default_file(self) -> &'static str {
        match self {
            Self::Ply => "particles.ply",
            Self::SurfacePly => "surface.ply",
            Self::Obj => "surface.obj",
            Self::Stl => "surface.stl",
            Self::Glb => "twin.glb",
            Self::Msh => "tetrahedra.msh",
            Self::Mjcf => "twin.xml",
            Self::Usd => "twin.usda",
            Self::ParticleUsd => "particles.usda",
            Self::Particles => "twin.npz",
            Self::Gaussians => "gaussians.ply",
            Self::GaussianSequence => "gaussian-sequence",
            Self::GaussianUsd => "gaussians.usda",
        }
    }

    /// The files that it writes to `path`; of a folder, the folder.
    pub fn files(self, path: &Path) -> Vec<PathBuf> {
        let beside: &[&str] = match self {
            Self::Particles => &["particles.json", "genesis.py"],
            _ => &[],
        };
        std::iter::once(path.to_owned()).chain(beside.iter().map(|ending| path.with_extension(ending))).collect()
    }
}

/// How it is exported.
#[derive(Clone, Copy, Debug)]
pub struct ExportOptions {
    /// The form.
    pub format: Export,
    /// Which axis shall point up; as it is where not given.
    pub up: Option<UpAxis>,
    /// Whether a format that lacks the twin's law may take the nearest that it has.
    pub approximate: bool,
}

/// Writes a twin to `path`; says in a sentence what was written.
///
/// # Errors
/// A form that cannot hold the twin, a motion or colours that are not there, an unwritable file.
pub fn export(source: ExportSource, options: ExportOptions, path: &Path) -> Result<String> {
    if options.format == Export::Glb && options.up == Some(UpAxis::Z) {
        return Err(Error::Usage {
            problem: "glTF has y up by its definition".into(),
            hint: Some("leave --up away: programs with z up turn it when they read it".into()),
        });
    }
    let up = options.up.unwrap_or(source.body.up());
    let mass = format!("{:.4} kg", source.body.mass_kg());
    if matches!(options.format, Export::Gaussians | Export::GaussianSequence | Export::GaussianUsd) {
        return Ok(format!("{} of a body of {mass}", gaussians::write(&source, options.format, up, path)?));
    }
    let colors = source.colors_toward(up);
    let paint: Option<&Paint> = colors.as_ref().map(|colors| colors as &Paint);
    let body = source.body.turned_up(up);
    let written = match options.format {
        Export::Ply => {
            write_particles_ply(path, &body)?;
            particles(&body)
        }
        Export::Particles => {
            let parameters = write_particle_set(path, &body)?;
            format!("{}, parameters in {}", particles(&body), parameters.display())
        }
        Export::Mjcf => {
            write_mjcf(path, &body, options.approximate)?;
            "a deformable body".to_owned()
        }
        Export::Usd => {
            write_usd(path, &body, paint, UsdLook::Surface)?;
            format!("{} and their motion in {} frames", particles(&body), body.motion().frames.len())
        }
        Export::ParticleUsd => {
            write_usd(path, &body, paint, UsdLook::Particles)?;
            format!("{} in {} frames", particles(&body), body.motion().frames.len())
        }
        Export::Glb => {
            let frames = body.motion().frames.len();
            write_glb(path, &body, paint)?;
            format!("{frames} frames")
        }
        Export::Msh => {
            let mesh = body.tetrahedra()?;
            write_msh(path, &mesh, &stated(&body)).map_err(Error::stage("export"))?;
            let (least, _) = mesh.dihedral_angles();
            format!("{} tetrahedra, smallest dihedral angle {least:.1} degrees", mesh.tetrahedra.len())
        }
        _ => surface(&body, paint, options.format, path)?,
    };
    Ok(format!("{written} of {mass}"))
}

fn particles(body: &ExportBody) -> String {
    format!("{} particles", body.particles().len())
}

/// Mass and density, for comments in files.
fn stated(body: &ExportBody) -> String {
    format!("{} kg at {} kg/m^3", body.mass_kg(), body.twin().density_kg_m3)
}

fn surface(body: &ExportBody, paint: Option<&Paint>, format: Export, path: &Path) -> Result<String> {
    let mesh = body.surface()?;
    let colors = paint.map(|paint| paint(&mesh.vertices));
    let comment = stated(body);
    let notes = MeshNotes { comment: &comment, colors: colors.as_deref() };
    match format {
        Export::Obj => write_obj(path, &mesh, &notes),
        Export::Stl => write_stl(path, &mesh),
        _ => write_mesh_ply(path, &mesh, &notes),
    }
    .map_err(Error::stage("export"))?;
    Ok(format!("{} triangles", mesh.triangles.len()))
}
