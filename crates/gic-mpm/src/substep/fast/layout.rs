//! The particles in the order of their cells, cut into chunks on a grid with room for a segment.

use core::ops::Range;

use gic_simd::Scalar;
use rayon::prelude::*;

use super::block::{BLOCK, Block};
use super::chunk::{Chunk, Flags};
use super::stencils::Window;
use crate::substep::engine::{BodyBars, Segment};
use crate::substep::grid::GridBox;
use crate::substep::prepared_world::{PreparedBody, PreparedWorld};
use crate::substep::state::{State, map_particles};
use crate::substep::violation::Violation;

/// Particles per chunk, about: few enough for several chunks per core, many enough for a slab to pay. The order of
/// sums, and so the last bits of a result, depend on it.
const PARTICLES_PER_CHUNK: usize = 16_384;
/// Most chunks per body: more slabs would cost more than more threads gain.
const MAX_CHUNKS_PER_BODY: usize = 16;

/// Chunks on a grid, at the start of a segment.
pub(super) struct Layout<T> {
    pub(super) extent: GridBox,
    pub(super) chunks: Vec<Chunk<T>>,
}

impl<T: Scalar> Layout<T> {
    /// Sorts the particles of each body by cell and cuts them into chunks, on a grid with room for a segment.
    pub(super) fn new(
        world: &PreparedWorld,
        state: &State<T>,
        segment: Segment,
        margin: f64,
        parallel: bool,
    ) -> Result<Self, Violation> {
        let horizon = segment.dt * segment.substeps as f64;
        let extent = world.extent(state, horizon, margin)?;
        let inverse = 1.0 / world.spacing;
        let base = |p: usize, axis: usize| (state.position[p][axis].to_f64() * inverse - 0.5).floor() as i32;
        let cell = |p: usize| {
            let at = [0, 1, 2].map(|axis| (base(p, axis) - extent.first[axis]) as usize);
            extent.index(at[0], at[1], at[2]) as u32
        };
        let mut orders = Vec::new();
        for (number, body) in world.bodies.iter().enumerate() {
            let keys = map_particles(parallel, body.range.clone(), cell);
            let order = sorted(body.range.clone(), &keys, extent.nodes());
            let count = order.len().div_ceil(PARTICLES_PER_CHUNK).min(MAX_CHUNKS_PER_BODY);
            // Whole blocks, so that only the last chunk has a partial one.
            let blocks = order.len().div_ceil(BLOCK).div_ceil(count);
            orders.extend(order.chunks(blocks * BLOCK).map(|order| (number, order.to_vec())));
        }
        let chunk = |(body, order): (usize, Vec<u32>)| {
            let (window, first_node) = window(world, state, &order, extent, horizon, margin);
            Chunk {
                body,
                blocks: Block::gather(state, &order),
                factors: factors(&world.bodies[body], &order),
                order,
                window,
                first_node,
                slab: vec![[T::zero(); 4]; window.nodes()],
                flags: Flags::default(),
                tape: None,
                bars: BodyBars::default(),
                factor_bars: Vec::new(),
            }
        };
        let chunks = if parallel {
            orders.into_par_iter().with_max_len(1).map(chunk).collect()
        } else {
            orders.into_iter().map(chunk).collect()
        };
        Ok(Self { extent, chunks })
    }
}

/// Factors of particles on their masses and volumes, then ones to fill the last block.
fn factors<T: Scalar>(body: &PreparedBody, order: &[u32]) -> Vec<T> {
    let own = order.iter().map(|p| T::splat(body.factors[*p as usize - body.range.start]));
    own.chain(core::iter::repeat(T::one())).take(order.len().next_multiple_of(BLOCK)).collect()
}

/// Particles in the order of their cells; those of a cell in the order of their numbers.
fn sorted(particles: Range<usize>, keys: &[u32], cells: usize) -> Vec<u32> {
    let mut next = vec![0u32; cells + 1];
    for key in keys.iter().map(|&key| key as usize) {
        next[key + 1] += 1;
    }
    for key in 0..cells {
        next[key + 1] += next[key];
    }
    let mut order = vec![0; keys.len()];
    for (particle, key) in particles.zip(keys.iter().map(|&key| key as usize)) {
        order[next[key] as usize] = particle as u32;
        next[key] += 1;
    }
    order
}

/// The part of the grid that some particles may touch in a segment, and its first node: all planes along x that they
/// may reach.
fn window<T: Scalar>(
    world: &PreparedWorld,
    state: &State<T>,
    particles: &[u32],
    extent: GridBox,
    horizon: f64,
    margin: f64,
) -> (Window, usize) {
    let (mut lowest, mut highest) = (f64::INFINITY, f64::NEG_INFINITY);
    for &p in particles {
        let (low, high) = world.swept_cells(state, p as usize, horizon, margin);
        lowest = lowest.min(low.x);
        highest = highest.max(high.x);
    }
    let first = (lowest - 0.5).floor() as i32;
    let last = (highest - 0.5).floor() as i32;
    let skipped = (first - extent.first.x) as usize;
    let size = [(last - first) as usize + 3, extent.size[1], extent.size[2]];
    (Window { first: [first, extent.first.y, extent.first.z], size }, skipped * extent.plane())
}
