//! Points to draw a body with, finer than the particles that are simulated.

use gic_geometry::KdTree;
use glam::DVec3;

use super::sample::{Particles, sample_particles};
use crate::tuning::ParticleTuning;
use crate::{ContinuumError, Filling};

/// Points to draw that are finer than the particles that are simulated: eq. 7 on a finer sampling of the same field.
/// Outlines are then ragged by half of the finer spacing only, while the simulation costs what it did.
///
/// Every point is bound to the nearest particle and moves with it by translation. Appearances of the drawing are
/// calibrated on [`Drawing::particles`].
#[derive(Clone, Debug, PartialEq)]
pub struct Drawing {
    /// The points at the time of the filling; their densities and spacing are those to draw with.
    pub particles: Particles,
    /// Index of the simulated particle that carries each point.
    pub parents: Vec<u32>,
    /// From the parent to the point at the time of the filling [m].
    pub offsets: Vec<DVec3>,
}

impl Drawing {
    /// Samples the body of `filling` anew, `spacing` metres apart, and binds the points to `simulated`, which were
    /// sampled from the same filling.
    pub fn new(
        filling: &Filling,
        simulated: &Particles,
        spacing: f64,
        tuning: &ParticleTuning,
    ) -> Result<Drawing, ContinuumError> {
        let particles = sample_particles(filling, spacing, tuning)?;
        let anchors: Vec<[f32; 3]> = simulated.positions.iter().map(|p| p.as_vec3().to_array()).collect();
        let tree = KdTree::new(&anchors);
        let parents: Vec<u32> = particles
            .positions
            .iter()
            .map(|p| tree.nearest(p.as_vec3().to_array()).map(|(i, _)| i as u32).ok_or(ContinuumError::Empty))
            .collect::<Result<_, _>>()?;
        let offsets =
            particles.positions.iter().zip(&parents).map(|(p, &i)| *p - simulated.positions[i as usize]).collect();
        Ok(Drawing { particles, parents, offsets })
    }

    /// Where the points are when the simulated particles are at `moved` [m], in the order of those.
    pub fn positions(&self, moved: &[DVec3]) -> Vec<DVec3> {
        self.parents.iter().zip(&self.offsets).map(|(&i, &offset)| moved[i as usize] + offset).collect()
    }

    /// The gradient with respect to `simulated` particles' positions from that with respect to the points': the
    /// transpose of [`Drawing::positions`], summed in the order of the points.
    pub fn pull_back(&self, gradient: &[DVec3], simulated: usize) -> Vec<DVec3> {
        let mut sums = vec![DVec3::ZERO; simulated];
        for (&i, &g) in self.parents.iter().zip(gradient) {
            sums[i as usize] += g;
        }
        sums
    }
}
