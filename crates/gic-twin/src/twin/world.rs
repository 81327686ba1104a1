//! From a twin to the world that the simulator knows.

use gic_files::FileError;
use gic_mpm::{Body, Budget, Forecast, Stepping, World};
use glam::DVec3;

use super::{MatterSource, Twin};
use crate::error::{Result, TwinError};
use crate::matter::{self, Matter};

/// Cells across the object's largest side where the twin does not say how long a cell is.
const CELLS_ALONG_LARGEST_SIDE: f64 = 16.0;

impl Twin {
    /// The twin with spacings resolved, and its world; reads and fills the continuum.
    pub fn to_world(&self) -> Result<(Self, World)> {
        let matter = match &self.continuum {
            MatterSource::File(path) => Some(matter::read_matter(path)?),
            MatterSource::Solid(_) => None,
        };
        let mut twin = self.clone();
        let (grid, particle) = self.spacings(matter.as_ref())?;
        (twin.grid_spacing_m, twin.particle_spacing_m) = (Some(grid), Some(particle));
        let (positions, volume_factors) = self.particles(matter, particle)?;
        let stepping = self.substeps_per_frame.map_or(Stepping::STABLE, Stepping::at_least);
        let world = World {
            bodies: vec![Body {
                material: self.material,
                density_kg_m3: self.density_kg_m3,
                particle_volume_m3: particle.powi(3),
                volume_factors,
                positions,
                velocity_m_s: self.initial_velocity_m_s.into(),
                angular_velocity_rad_s: self.initial_angular_velocity_rad_s.into(),
                own_velocities_m_s: Vec::new(),
            }],
            colliders: self.colliders.iter().map(|o| o.to_collider()).collect(),
            gravity_m_s2: self.gravity_m_s2.into(),
            grid_spacing_m: grid,
            frame_rate_hz: self.frame_rate_hz,
            stepping,
        };
        Ok((twin, world))
    }

    /// Grid and particle spacing [m]: given by the twin, or derived from what it gives.
    fn spacings(&self, matter: Option<&Matter>) -> Result<(f64, f64)> {
        match (self.grid_spacing_m, self.particle_spacing_m) {
            (Some(grid), Some(particle)) => Ok((grid, particle)),
            (Some(grid), None) => Ok((grid, grid / 2.0)),
            (None, Some(particle)) => Ok((2.0 * particle, particle)),
            (None, None) => {
                let side = match (matter, &self.continuum) {
                    (_, MatterSource::Solid(shape)) => shape.largest_side(),
                    (Some(Matter::Mesh(mesh)), _) => {
                        let (low, high) = mesh.bounds();
                        (high - low).max_element()
                    }
                    // The spacing of given particles is a fact that decides their mass; guessing it would be wrong in
                    // silence.
                    (_, MatterSource::File(path)) => {
                        return Err(TwinError::File(FileError::Content {
                            path: path.clone(),
                            problem: "holds particles, and the twin does not say how far apart they are".into(),
                            hint: Some(
                                "add `particle_spacing_m` to the twin; its cube is the volume of a particle".into(),
                            ),
                        }));
                    }
                };
                Ok((side / CELLS_ALONG_LARGEST_SIDE, side / CELLS_ALONG_LARGEST_SIDE / 2.0))
            }
        }
    }

    /// Positions [m] and factors on the volume of particles; no factors where all have the cube of the spacing.
    fn particles(&self, matter: Option<Matter>, spacing: f64) -> Result<(Vec<DVec3>, Vec<f64>)> {
        let too_many = |volume: f64| TwinError::Usage {
            problem: format!(
                "a particle spacing of {spacing} m asks for about {:.1e} particles",
                volume / spacing.powi(3)
            ),
            hint: Some("raise `particle_spacing_m`".into()),
        };
        let none = || TwinError::Usage {
            problem: format!("no particle fits into the continuum at a particle spacing of {spacing} m"),
            hint: Some("lower `particle_spacing_m`, or check that the continuum's lengths are in metres".into()),
        };
        let within_reason = |volume: f64| {
            let memory = Forecast::memory_of(volume / spacing.powi(3));
            if memory <= Budget::default().memory_bytes { Ok(()) } else { Err(too_many(volume)) }
        };
        let positions = match (matter, &self.continuum) {
            (Some(Matter::Particles { positions, volume_factors }), _) => return Ok((positions, volume_factors)),
            (Some(Matter::Mesh(mesh)), _) => {
                let (low, high) = mesh.bounds();
                within_reason((high - low).element_product())?;
                mesh.sample(spacing)
            }
            (None, MatterSource::Solid(shape)) => {
                within_reason(8.0 * shape.kind.half_extent().element_product())?;
                shape.sample(spacing)
            }
            (None, MatterSource::File(_)) => Vec::new(),
        };
        if positions.is_empty() { Err(none()) } else { Ok((positions, Vec::new())) }
    }
}
