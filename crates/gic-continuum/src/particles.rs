//! Particles for simulation: points inside the level set at a requested spacing.

use glam::DVec3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::{ContinuumError, Filling};

/// How particles are placed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Placement {
    /// A cubic lattice.
    Lattice,
    /// A cubic lattice whose points are moved at random by up to `amount` / 2 spacings along each axis, 0 to 1.
    Jittered {
        /// Share of its own cell that a particle may be in.
        amount: f64,
        /// Seed of the random numbers.
        seed: u64,
    },
}

/// Particles of a body; all vectors have the same length n.
#[derive(Clone, Debug, PartialEq)]
pub struct Particles {
    /// Positions [m].
    pub positions: Vec<DVec3>,
    /// Volume of each particle [m^3]; they sum to the volume of the body.
    pub volume: f64,
    /// Density of the field where each particle is, in [th_min, 1]: sigma_F of eq. 7.
    pub densities: Vec<f32>,
    /// Whether a particle is within about one spacing of the surface.
    pub surface: Vec<bool>,
    /// Distance between neighbours on the lattice [m].
    pub spacing: f64,
}

impl Particles {
    /// Positions of the surface particles [m].
    pub fn surface_positions(&self) -> Vec<DVec3> {
        self.positions.iter().zip(&self.surface).filter(|(_, s)| **s).map(|(p, _)| *p).collect()
    }
}

/// Fills the body with particles `spacing` metres apart. A point is inside where the interpolated field is at least th_min, so the
/// boundary is followed below the size of a voxel; each particle has an equal share of the body's volume.
pub fn sample_particles(filling: &Filling, spacing: f64, placement: Placement) -> Result<Particles, ContinuumError> {
    let good = spacing > 0.0 && spacing.is_finite();
    if !good {
        return Err(ContinuumError::Setting { setting: "particle spacing", value: spacing, must: "above 0 m" });
    }
    let field = &filling.field;
    let extent = DVec3::from_array(field.size.map(|n| n as f64)) * field.spacing;
    let count = (extent / spacing).ceil();
    let voxels = count.x * count.y * count.z;
    if !(voxels <= crate::MAX_VOXELS) {
        return Err(ContinuumError::TooManyVoxels { voxels, limit: crate::MAX_VOXELS });
    }
    let [nx, ny, nz] = count.to_array().map(|c| c as usize);
    let mut points: Vec<DVec3> = (0..nx * ny * nz)
        .map(|i| {
            let lattice = DVec3::new((i % nx) as f64, (i / nx % ny) as f64, (i / (nx * ny)) as f64);
            field.origin + spacing * (lattice + 0.5)
        })
        .collect();
    if let Placement::Jittered { amount, seed } = placement {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut offset = || amount.clamp(0.0, 1.0) * spacing * (random.random::<f64>() - 0.5);
        for p in &mut points {
            *p += DVec3::new(offset(), offset(), offset());
        }
    }
    let inside: Vec<(DVec3, f32, bool)> = points
        .into_par_iter()
        .filter_map(|p| {
            let density = field.sample(p);
            (density >= filling.th_min).then(|| (p, density as f32, near_surface(filling, p, spacing)))
        })
        .collect();
    if inside.is_empty() {
        return Err(ContinuumError::Empty);
    }
    let volume = filling.volume() / inside.len() as f64;
    let mut particles = Particles { positions: vec![], volume, densities: vec![], surface: vec![], spacing };
    for (position, density, surface) in inside {
        particles.positions.push(position);
        particles.densities.push(density.min(1.0));
        particles.surface.push(surface);
    }
    Ok(particles)
}

/// Whether one of the six points a spacing away is outside.
fn near_surface(filling: &Filling, point: DVec3, spacing: f64) -> bool {
    DVec3::AXES.iter().any(|&axis| {
        [spacing, -spacing].iter().any(|&reach| filling.field.sample(point + reach * axis) < filling.th_min)
    })
}
