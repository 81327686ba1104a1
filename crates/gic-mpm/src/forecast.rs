//! What a simulation will take, known before it starts.

use glam::DVec3;

use crate::World;
use crate::budget::{Budget, Forecast};
use crate::error::SimulationError;
use crate::rollouts::timestep_bound::planned_substeps;
use crate::substep::prepared_world::MAX_GRID_NODES;

/// Particle-substeps that a second computes. Budget: what one core does in docs/results.md, halved for slower laws and
/// machines.
const PARTICLE_SUBSTEPS_PER_S: f64 = 1e7;
/// Work of a frame beside its substeps, in substeps: it is reported, and its state kept. Budget: a tenth of a frame of
/// a twin of a video.
const SUBSTEPS_OF_A_REPORT: f64 = 20.0;
/// Fewest particles whose work counts. Budget: the work of an empty substep.
const LEAST_PARTICLES: f64 = 100.0;
/// Bytes for each particle: its state four times (current, next, sorted, saved), and what a frame reports of it.
const BYTES_PER_PARTICLE: f64 = 600.0;
/// Bytes for each node: the grid and the slabs that threads scatter into.
const BYTES_PER_NODE: f64 = 64.0;

impl Forecast {
    /// Of `frames` frames of a world, the initial state included.
    ///
    /// # Errors
    /// Where [`World::validate`] finds something wrong, and where the first frame would take too many substeps.
    pub fn of(world: &World, frames: usize) -> Result<Self, SimulationError> {
        let particles = world.bodies.iter().map(|body| body.positions.len()).sum();
        let substeps_per_frame = planned_substeps(world)?;
        let work = (particles as f64).max(LEAST_PARTICLES) * (substeps_per_frame as f64 + SUBSTEPS_OF_A_REPORT);
        Ok(Self {
            particles,
            frames,
            substeps_per_frame,
            memory_bytes: Self::memory_of(particles as f64) + BYTES_PER_NODE * nodes(world),
            seconds: work * frames as f64 / PARTICLE_SUBSTEPS_PER_S,
        })
    }

    /// Memory [bytes] for so many particles, without the grid.
    pub fn memory_of(particles: f64) -> f64 {
        BYTES_PER_PARTICLE * particles
    }

    /// Refuses what is over the budget.
    ///
    /// # Errors
    /// [`SimulationError::OverBudget`].
    pub fn check(&self, budget: &Budget) -> Result<(), SimulationError> {
        // Phrased so that NaN is over.
        let is_within = self.memory_bytes <= budget.memory_bytes && self.seconds <= budget.seconds;
        if is_within { Ok(()) } else { Err(SimulationError::OverBudget { forecast: *self, budget: *budget }) }
    }
}

/// Nodes of the first grid.
fn nodes(world: &World) -> f64 {
    let positions = || world.bodies.iter().flat_map(|body| &body.positions);
    let low = positions().fold(DVec3::INFINITY, |low, p| low.min(*p));
    let high = positions().fold(DVec3::NEG_INFINITY, |high, p| high.max(*p));
    ((high - low) / world.grid_spacing_m + 6.0).element_product().min(MAX_GRID_NODES as f64)
}
