//! Particles for simulation: points inside the level set at a requested spacing.

use gic_geometry::{GeometryError, KdTree, MAX_VOXELS};
use glam::DVec3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::tuning::ParticleTuning;
use crate::{ContinuumError, Filling};

/// Particles of a body; all vectors have the same length n.
#[derive(Clone, Debug, PartialEq)]
pub struct Particles {
    /// Positions [m].
    pub positions: Vec<DVec3>,
    /// Mean volume of a particle [m^3].
    pub volume: f64,
    /// Volume of each particle in units of that: the part of the body that is nearer to it than to the others. They sum
    /// to n.
    pub volume_factors: Vec<f32>,
    /// Density of the field where each particle is, in [th_min, 1]: sigma_F of eq. 7.
    pub densities: Vec<f32>,
    /// Whether a particle is within about one spacing of the surface.
    pub surface: Vec<bool>,
    /// How much each particle is in doubt, in [0, 1]: 1 at a boundary that no view sees, 0 well below it.
    pub doubts: Vec<f32>,
    /// Distance between neighbours on the lattice [m].
    pub spacing: f64,
}

impl Particles {
    /// The same particles without order: each lies anywhere in its own cell of the lattice. Grains lie like this; those
    /// of a lattice glide past each other in sheets, and a heap of them is neither as wide nor as high.
    pub fn without_order(mut self, seed: u64) -> Particles {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        for position in &mut self.positions {
            let within = DVec3::from_array(std::array::from_fn(|_| random.random::<f64>() - 0.5));
            *position += self.spacing * within;
        }
        self
    }
}

/// Fills the body with particles `spacing` metres apart. A point is inside where the interpolated field is at least
/// th_min, so the boundary is followed below the size of a voxel. The particles share the body's volume: each has what
/// is nearest to it, so that a limb of six and a half layers is as heavy as that, whether six or seven of them fell
/// inside.
pub fn sample_particles(filling: &Filling, spacing: f64, tuning: &ParticleTuning) -> Result<Particles, ContinuumError> {
    let mut positions = place(filling, spacing)?;
    let volume_factors = share_volume(filling, &mut positions, spacing, tuning);
    Ok(describe(filling, positions, volume_factors, spacing))
}

/// As [`sample_particles`], but each particle stays where it is placed and has the mean volume: enough to compare
/// shapes and outlines with.
///
/// # Errors
/// Those of [`sample_particles`].
pub fn sample_points(filling: &Filling, spacing: f64) -> Result<Particles, ContinuumError> {
    let positions = place(filling, spacing)?;
    let volume_factors = vec![1.0; positions.len()];
    Ok(describe(filling, positions, volume_factors, spacing))
}

/// Points inside the body [m]; at least one.
fn place(filling: &Filling, spacing: f64) -> Result<Vec<DVec3>, ContinuumError> {
    let good = spacing > 0.0 && spacing.is_finite();
    if !good {
        return Err(ContinuumError::Setting { setting: "particle spacing", value: spacing, must: "above 0 m" });
    }
    let field = &filling.field;
    let extent = DVec3::from_array(field.size.map(|n| n as f64)) * field.spacing;
    let count = (extent / spacing).ceil();
    let voxels = count.x * count.y * count.z;
    let fits = voxels <= MAX_VOXELS;
    if !fits {
        return Err(GeometryError::TooManyVoxels { voxels, limit: MAX_VOXELS }.into());
    }
    let [nx, ny, nz] = count.to_array().map(|c| c as usize);
    let points: Vec<DVec3> = (0..nx * ny * nz)
        .map(|i| {
            let lattice = DVec3::new((i % nx) as f64, (i / nx % ny) as f64, (i / (nx * ny)) as f64);
            field.origin + spacing * (lattice + 0.5)
        })
        .collect();
    let mut inside: Vec<DVec3> = points.into_par_iter().filter(|&p| field.sample(p) >= filling.th_min).collect();
    arrange_in_layers(filling, &mut inside, spacing);
    if inside.is_empty() { Err(ContinuumError::Empty) } else { Ok(inside) }
}

/// The particles at `positions` with their attributes.
fn describe(filling: &Filling, positions: Vec<DVec3>, volume_factors: Vec<f32>, spacing: f64) -> Particles {
    let field = &filling.field;
    let doubt = |p: &DVec3| field.discretize(*p).and_then(|i| filling.doubt.get(i)).map_or(0.0, |d| *d);
    Particles {
        volume: filling.volume() / positions.len() as f64,
        volume_factors,
        densities: positions.par_iter().map(|p| (field.sample(*p) as f32).min(1.0)).collect(),
        surface: positions.par_iter().map(|p| near_surface(filling, *p, spacing)).collect(),
        doubts: positions.iter().map(doubt).collect(),
        spacing,
        positions,
    }
}

/// Gives each particle what is nearest to it of the points of a finer lattice inside, and moves it to their middle
/// where that is inside. Returns the shares, in units of their mean.
fn share_volume(filling: &Filling, positions: &mut [DVec3], spacing: f64, tuning: &ParticleTuning) -> Vec<f32> {
    let step = spacing / tuning.share_points as f64;
    let [nx, ny, nz] = filling.field.size.map(|n| (n as f64 * filling.field.spacing / step).ceil() as usize);
    let tree = KdTree::new(&positions.iter().map(|p| p.as_vec3().to_array()).collect::<Vec<_>>());
    let owned_in_slice = |z: usize| -> Vec<(usize, DVec3)> {
        let point =
            |i: usize| filling.field.origin + step * (DVec3::new((i % nx) as f64, (i / nx) as f64, z as f64) + 0.5);
        let inside = (0..nx * ny).map(point).filter(|p| filling.field.sample(*p) >= filling.th_min);
        inside.filter_map(|p| tree.nearest(p.as_vec3().to_array()).map(|(owner, _)| (owner, p))).collect()
    };
    // Its own place counts as one point, so that no particle is without volume.
    let mut sums: Vec<(f64, DVec3)> = positions.iter().map(|p| (1.0, *p)).collect();
    for (owner, p) in (0..nz).into_par_iter().map(owned_in_slice).collect::<Vec<_>>().into_iter().flatten() {
        sums[owner].0 += 1.0;
        sums[owner].1 += p;
    }
    for (position, (count, sum)) in positions.iter_mut().zip(&sums) {
        let middle = *sum / *count;
        if filling.field.sample(middle) >= filling.th_min {
            *position = middle;
        }
    }
    let mean = sums.iter().map(|(count, _)| count).sum::<f64>() / sums.len() as f64;
    sums.into_iter().map(|(count, _)| (count / mean) as f32).collect()
}

/// Moves particles towards the middle of their layer: all the way in the outermost one, half as far from layer to
/// layer. One that would leave the body stays.
fn arrange_in_layers(filling: &Filling, points: &mut [DVec3], spacing: f64) {
    let mesh = filling.surface_mesh();
    let vertices: Vec<[f32; 3]> = mesh.vertices.iter().map(|v| v.as_vec3().to_array()).collect();
    let tree = KdTree::new(&vertices);
    points.par_iter_mut().for_each(|p| {
        let Some((nearest, _)) = tree.nearest(p.as_vec3().to_array()) else { return };
        let normal = mesh.normals[nearest];
        let depth = (mesh.vertices[nearest] - *p).dot(normal);
        let layer = (depth / spacing).floor();
        if layer >= 0.0 {
            let moved = *p + 0.5f64.powf(layer) * (depth - (layer + 0.5) * spacing) * normal;
            if filling.field.sample(moved) >= filling.th_min {
                *p = moved;
            }
        }
    });
}

/// Whether one of the six points at a distance [m] along the axes is outside.
fn near_surface(filling: &Filling, point: DVec3, distance: f64) -> bool {
    DVec3::AXES.iter().any(|&axis| {
        [distance, -distance].iter().any(|&along| filling.field.sample(point + along * axis) < filling.th_min)
    })
}
