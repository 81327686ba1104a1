//! What makes a simulation doubtful without making it impossible.

use std::collections::BTreeMap;

use glam::DVec3;

use crate::rollouts::frame::Frame;
use crate::substep::stencil::STENCIL_REACH_CELLS;
use crate::world::{Body, World};

/// Fewest cells across a body's largest side. Derived: a stencil is three cells wide; in a narrower body every particle
/// moves every other.
const FEWEST_CELLS_ACROSS: f64 = 3.0;
/// Thinnest obstacle [cells]. Derived: matter on one side of a thinner one feels what is on the other.
const THINNEST_COLLIDER_CELLS: f64 = STENCIL_REACH_CELLS;
/// Least and largest volume of a body's particles in that of the cells that they lie in. Derived: a thread of
/// particles, two to a cell, fills a quarter of its cells, and an eighth of those that it cuts the corners of;
/// particles farther apart than a cell fill more than theirs, and fall apart.
const FILLING: [f64; 2] = [0.1, 2.0];
/// Least and largest volume ratio J. Derived: at an eighth, particles that lie two to a cell along each axis at rest
/// lie four to a cell; at eight times, one to a cell, and beyond, matter tears because its particles no longer meet.
const JACOBIAN: [f32; 2] = [0.125, 8.0];

/// Something in a world or in a frame that the simulator computes, but not well. Its text says what, where, and the way
/// out.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Doubt {
    /// The grid hardly resolves a body.
    #[error(
        "bodies[{body}] is {cells:.1} cells across, so it moves nearly as one piece and meets obstacles from afar: \
         lower `grid_spacing_m`"
    )]
    Coarse {
        /// Number of the body.
        body: usize,
        /// Cells along its largest side.
        cells: f64,
    },
    /// An obstacle is so thin that matter may pass through it.
    #[error(
        "colliders[{collider}] is {cells:.1} cells thick, so matter may pass through it: \
         make it thicker or lower `grid_spacing_m`"
    )]
    Thin {
        /// Number of the obstacle.
        collider: usize,
        /// Its smallest side in cells.
        cells: f64,
    },
    /// The particles' volume is not that of the place which they take.
    #[error(
        "the particles of bodies[{body}] fill {share:.1e} of the cells that they lie in: \
         check their spacing (its cube is their volume) against their positions and `grid_spacing_m`"
    )]
    Filling {
        /// Number of the body.
        body: usize,
        /// Volume of its particles in units of that of its cells.
        share: f64,
    },
    /// Matter is squeezed beyond what particles can show.
    #[error(
        "frame {frame}: particle {particle} at {position} m is squeezed to {jacobian:.3e} of its volume at rest, \
         more than the grid can show: look for obstacles that meet in it, or take a stiffer material"
    )]
    Squeezed {
        /// The frame.
        frame: usize,
        /// Number of the particle.
        particle: usize,
        /// Where it is [m].
        position: DVec3,
        /// Its volume ratio J.
        jacobian: f32,
    },
    /// Matter is stretched until its particles no longer meet.
    #[error(
        "frame {frame}: particle {particle} at {position} m is stretched to {jacobian:.1} times its volume at rest, \
         so that it no longer meets its neighbours: take a stiffer material or more particles to a cell"
    )]
    Stretched {
        /// The frame.
        frame: usize,
        /// Number of the particle.
        particle: usize,
        /// Where it is [m].
        position: DVec3,
        /// Its volume ratio J.
        jacobian: f32,
    },
}

impl Doubt {
    /// The frame that it is about; `None` where it is about the world.
    pub fn frame(&self) -> Option<usize> {
        match *self {
            Self::Squeezed { frame, .. } | Self::Stretched { frame, .. } => Some(frame),
            Self::Coarse { .. } | Self::Thin { .. } | Self::Filling { .. } => None,
        }
    }
}

impl World {
    /// What is doubtful about the world before anything is computed.
    pub fn doubts(&self) -> Vec<Doubt> {
        let dx = self.grid_spacing_m;
        let bodies = self.bodies.iter().enumerate().flat_map(|(body, b)| {
            let (cells, share) = (b.largest_side_m() / dx, filling(b, dx));
            let coarse = (cells < FEWEST_CELLS_ACROSS).then_some(Doubt::Coarse { body, cells });
            let is_filled = (FILLING[0]..=FILLING[1]).contains(&share);
            let filled = (!is_filled).then_some(Doubt::Filling { body, share });
            coarse.into_iter().chain(filled)
        });
        let colliders = self.colliders.iter().enumerate().filter_map(|(collider, c)| {
            let cells = c.primitive.thickness() / dx;
            (cells < THINNEST_COLLIDER_CELLS).then_some(Doubt::Thin { collider, cells })
        });
        bodies.chain(colliders).collect()
    }
}

impl Frame {
    /// What is doubtful about the frame: the particle that is compressed the most, and the one that is stretched the
    /// most, where that is too much.
    pub fn doubts(&self) -> Vec<Doubt> {
        let by_volume = |a: &usize, b: &usize| self.jacobian[*a].total_cmp(&self.jacobian[*b]);
        let least = (0..self.jacobian.len()).min_by(by_volume).filter(|p| self.jacobian[*p] < JACOBIAN[0]);
        let most = (0..self.jacobian.len()).max_by(by_volume).filter(|p| self.jacobian[*p] > JACOBIAN[1]);
        let (frame, of) = (self.index, |p: usize| (self.positions[p], self.jacobian[p]));
        let squeezed = least.map(|particle| {
            let (position, jacobian) = of(particle);
            Doubt::Squeezed { frame, particle, position, jacobian }
        });
        let stretched = most.map(|particle| {
            let (position, jacobian) = of(particle);
            Doubt::Stretched { frame, particle, position, jacobian }
        });
        squeezed.into_iter().chain(stretched).collect()
    }
}

/// Volume of a body's particles in units of that of the cells that they lie in.
fn filling(body: &Body, dx: f64) -> f64 {
    let mut cells = BTreeMap::new();
    for p in &body.positions {
        *cells.entry((*p / dx).floor().to_array().map(|c| c as i64)).or_insert(0usize) += 1;
    }
    let count = match &body.volume_factors[..] {
        [] => body.positions.len() as f64,
        factors => factors.iter().sum(),
    };
    body.particle_volume_m3 * count / (cells.len() as f64 * dx.powi(3))
}
