//! A plain particle set: an .npz of arrays and a .json of parameters, for Genesis, Newton, Taichi and anything else
//! that reads NumPy.

use std::borrow::Cow;
use std::io::{self, Cursor};
use std::path::{Path, PathBuf};

use gic_files::{PlyLayout, PlyProperty, write_ply};
use gic_mpm::Material;
use npyz::WriterBuilder;
use npyz::npz::NpzWriter;
use serde::Serialize;

use super::{ExportBody, lame, loaders};
use crate::atomic;
use crate::error::{Result, TwinError};
use crate::twin::Obstacle;

/// Writes `path` (.npz) with `positions` [m] and `velocities` [m/s], both float32 of shape [n, 3], `volumes` [m^3] and
/// `masses` [kg], both float32 of shape [n]; and beside it a .particles.json with the law, its parameters and Lame's,
/// density, gravity, obstacles and spacings, all in SI units; and a loader for Genesis. Returns the path of the .json.
///
/// # Errors
/// An unwritable file.
pub fn write_particle_set(path: &Path, body: &ExportBody) -> Result<PathBuf> {
    let n = body.particles().len();
    let flat = |v: glam::DVec3| v.as_vec3().to_array();
    let positions: Vec<f32> = body.particles().iter().flat_map(|p| flat(*p)).collect();
    let velocity_at = body.velocity_field();
    let velocities: Vec<f32> = body.particles().iter().flat_map(|p| flat(velocity_at(*p))).collect();
    let volume = |mass: &f64| (mass / body.twin().density_kg_m3) as f32;
    let arrays: [(&str, Vec<f32>, &[u64]); 4] = [
        ("positions", positions, &[n as u64, 3]),
        ("velocities", velocities, &[n as u64, 3]),
        ("volumes", body.masses_kg().iter().map(volume).collect(), &[n as u64]),
        ("masses", body.masses_kg().iter().map(|mass| *mass as f32).collect(), &[n as u64]),
    ];
    atomic::write(path, &archive(&arrays).map_err(TwinError::write(path))?)?;
    // Not `.json` alone: beside `twin.npz` lies `twin.json`, the twin itself.
    let parameters = path.with_extension("particles.json");
    atomic::write_json(&parameters, &describe(path, body))?;
    loaders::write_genesis(path)?;
    Ok(parameters)
}

/// Writes the particles at time 0 as binary PLY: x, y, z [m], vx, vy, vz [m/s], volume [m^3], mass [kg].
///
/// # Errors
/// An unwritable file.
pub fn write_particles_ply(path: &Path, body: &ExportBody) -> Result<()> {
    let comment = format!("gic particles, metres, {} kg", body.mass_kg());
    let properties = ["x", "y", "z", "vx", "vy", "vz", "volume", "mass"].map(PlyProperty::Float);
    let layout = PlyLayout { comment: Some(&comment), properties: &properties, triangles: None };
    let velocity_at = body.velocity_field();
    let rows = body.particles().iter().zip(body.masses_kg()).map(|(p, mass)| {
        let v = velocity_at(*p);
        [p.x, p.y, p.z, v.x, v.y, v.z, mass / body.twin().density_kg_m3, *mass].map(|value| value as f32)
    });
    Ok(write_ply(path, &layout, rows)?)
}

/// The bytes of an .npz file.
fn archive(arrays: &[(&str, Vec<f32>, &[u64])]) -> io::Result<Vec<u8>> {
    let mut bytes = Cursor::new(Vec::new());
    let mut archive = NpzWriter::new(&mut bytes);
    // The day of writing is no part of the content: same twin, same bytes.
    let undated = zip::write::FileOptions::default().last_modified_time(zip::DateTime::default());
    for (name, values, shape) in arrays {
        let mut writer = archive.array(name, undated)?.default_dtype().shape(shape).begin_nd()?;
        writer.extend(values.iter().copied())?;
        writer.finish()?;
    }
    archive.zip_writer().finish()?;
    drop(archive);
    Ok(bytes.into_inner())
}

/// What the arrays do not say.
#[derive(Serialize)]
struct ParticleSetJson<'a> {
    schema: &'static str,
    gic_version: &'static str,
    /// File of the arrays.
    arrays: Cow<'a, str>,
    particles: usize,
    material: &'a Material,
    elasticity: Option<ElasticityJson>,
    density_kg_m3: f64,
    mass_kg: f64,
    particle_spacing_m: Option<f64>,
    grid_spacing_m: f64,
    substeps_per_frame: Option<usize>,
    frame_rate_hz: f64,
    frames: usize,
    gravity_m_s2: [f64; 3],
    initial_velocity_m_s: [f64; 3],
    initial_angular_velocity_rad_s: [f64; 3],
    colliders: &'a [Obstacle],
}

/// The elastic moduli in both common forms.
#[derive(Serialize)]
struct ElasticityJson {
    youngs_modulus_pa: f64,
    poisson_ratio: f64,
    lame_mu_pa: f64,
    lame_lambda_pa: f64,
}

impl ElasticityJson {
    fn new(moduli: [f64; 2]) -> Self {
        let ([youngs_modulus_pa, poisson_ratio], [lame_mu_pa, lame_lambda_pa]) = (moduli, lame(moduli));
        Self { youngs_modulus_pa, poisson_ratio, lame_mu_pa, lame_lambda_pa }
    }
}

fn describe<'a>(path: &'a Path, body: &'a ExportBody) -> ParticleSetJson<'a> {
    let twin = body.twin();
    ParticleSetJson {
        schema: "gic.particles/1",
        gic_version: crate::VERSION,
        arrays: path.file_name().unwrap_or_default().to_string_lossy(),
        particles: body.particles().len(),
        material: &twin.material,
        elasticity: twin.material.elastic_moduli().map(ElasticityJson::new),
        density_kg_m3: twin.density_kg_m3,
        mass_kg: body.mass_kg(),
        particle_spacing_m: twin.particle_spacing_m,
        grid_spacing_m: body.world().grid_spacing_m,
        substeps_per_frame: twin.substeps_per_frame,
        frame_rate_hz: twin.frame_rate_hz,
        frames: twin.frames,
        gravity_m_s2: twin.gravity_m_s2,
        initial_velocity_m_s: twin.initial_velocity_m_s,
        initial_angular_velocity_rad_s: twin.initial_angular_velocity_rad_s,
        colliders: &twin.colliders,
    }
}
