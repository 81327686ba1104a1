//! Segments: sort, cut into chunks, run the passes and the grid updates, forward and backward.

use std::sync::Mutex;

use gic_simd::{Kernel, Level, Scalar, dispatch, oracle};
use rayon::prelude::*;

use super::block::{Block, SharedState};
use super::chunk::{Chunk, Flags};
use super::forward::Forward;
use super::g2p::G2pAdjoint;
use super::layout::Layout;
use super::p2g::P2gAdjoint;
use super::step::Step;
use crate::substep::engine::{Bars, Engine, Segment};
use crate::substep::grid::{GridBox, Node};
use crate::substep::grid_update::{GridUpdate, Impulse};
use crate::substep::prepared_world::PreparedWorld;
use crate::substep::state::State;
use crate::substep::violation::Violation;

/// First guess of how many cells farther particles move in a segment than their velocity at its start tells. A segment
/// in which one leaves this margin is repeated with twice the margin, so it decides about time, not about results.
const INITIAL_MARGIN_CELLS: f64 = 0.5;
/// Nodes from which a grid update is worth several threads; the result does not depend on it.
const MIN_NODES_FOR_THREADS: usize = 1 << 15;

/// A number with machine lanes: f32, or f64 without SIMD, for tests.
pub(crate) trait Machine: Scalar {
    /// Runs a kernel on a level's lanes.
    fn launch<K: Kernel<Self>>(level: Level, kernel: K) -> K::Output;
}

impl Machine for f32 {
    fn launch<K: Kernel>(level: Level, kernel: K) -> K::Output {
        dispatch(level, kernel)
    }
}

impl Machine for f64 {
    fn launch<K: Kernel<f64>>(_level: Level, kernel: K) -> K::Output {
        oracle(kernel)
    }
}

/// The engine.
pub(crate) struct FastEngine<T> {
    level: Level,
    /// Whether a segment may use several threads; the result is the same.
    parallel: bool,
    /// The tape buffers of the last segment, for the next: fresh memory costs more than what is written to it.
    spare: Mutex<Vec<Buffers<T>>>,
}

/// The large buffers of a [`Tape`].
struct Buffers<T> {
    states: Vec<Vec<Block<T>>>,
    momenta: Vec<Node<T>>,
}

/// A segment for the reverse pass.
pub(crate) struct Tape<T> {
    segment: Segment,
    extent: GridBox,
    chunks: Vec<Chunk<T>>,
    /// Momenta and masses of the grid, for each substep.
    momenta: Vec<Node<T>>,
}

/// How a segment ended.
enum Outcome {
    Done,
    /// A particle came too close to the edge of the grid.
    Escaped,
}

impl<T: Machine> FastEngine<T> {
    pub(crate) fn new(level: Level, parallel: bool) -> Self {
        Self { level, parallel, spare: Mutex::new(Vec::new()) }
    }

    /// Runs a segment from `state`, whatever room it needs.
    fn run(
        &self,
        world: &PreparedWorld,
        state: &State<T>,
        segment: Segment,
        record: bool,
    ) -> Result<(Tape<T>, Vec<Impulse>), Violation> {
        let mut margin = INITIAL_MARGIN_CELLS;
        loop {
            let layout = Layout::new(world, state, segment, margin, self.parallel)?;
            let mut impulses = vec![Impulse::default(); world.colliders.len()];
            let mut tape = Tape { segment, extent: layout.extent, chunks: layout.chunks, momenta: Vec::new() };
            if record {
                self.reuse_buffers(&mut tape);
            }
            match self.attempt(world, &mut tape, state, &mut impulses, record)? {
                Outcome::Done => return Ok((tape, impulses)),
                Outcome::Escaped => margin *= 2.0,
            }
        }
    }

    /// Makes a tape ready to record.
    fn reuse_buffers(&self, tape: &mut Tape<T>) {
        let spare = self.spare.lock().ok().and_then(|mut spare| spare.pop());
        let Buffers { states, mut momenta } =
            spare.unwrap_or_else(|| Buffers { states: Vec::new(), momenta: Vec::new() });
        momenta.clear();
        momenta.reserve(tape.segment.substeps * tape.extent.nodes());
        tape.momenta = momenta;
        let mut states = states.into_iter();
        for chunk in &mut tape.chunks {
            let mut blocks = states.next().unwrap_or_default();
            blocks.clear();
            blocks.reserve(chunk.blocks.len() * (tape.segment.substeps + 1));
            chunk.tape = Some(blocks);
        }
    }

    fn attempt(
        &self,
        world: &PreparedWorld,
        tape: &mut Tape<T>,
        start: &State<T>,
        impulses: &mut [Impulse],
        record: bool,
    ) -> Result<Outcome, Violation> {
        let segment = tape.segment;
        let mut grid = vec![[T::zero(); 4]; tape.extent.nodes()];
        for i in 0..=segment.substeps {
            let velocities = (i > 0).then_some(&grid[..]);
            let scatter = i < segment.substeps;
            self.for_chunks(&mut tape.chunks, |_, chunk| {
                let step = step(world, chunk.body, segment.dt);
                T::launch(self.level, Forward { step, chunk, velocities, scatter });
            });
            let flags = tape.chunks.iter().map(|chunk| chunk.flags);
            let Flags { too_fast, escaped } = flags.fold(Flags::default(), Flags::or);
            if too_fast {
                let mut state = start.clone();
                self.write_back(&mut tape.chunks, &mut state);
                return Err(too_fast_particle(&state, world.spacing / segment.dt));
            }
            if escaped {
                return Ok(Outcome::Escaped);
            }
            if scatter {
                self.sum_slabs(&tape.chunks, tape.extent, &mut grid);
                if record {
                    tape.momenta.extend_from_slice(&grid);
                }
                let update = world.grid_update(tape.extent, segment.time(i), segment.dt);
                self.update_grid(&update, &mut grid, impulses);
            }
        }
        Ok(Outcome::Done)
    }

    fn for_chunks(&self, chunks: &mut [Chunk<T>], f: impl Fn(usize, &mut Chunk<T>) + Send + Sync) {
        if self.parallel && chunks.len() > 1 {
            chunks.par_iter_mut().enumerate().with_max_len(1).for_each(|(i, chunk)| f(i, chunk));
        } else {
            chunks.iter_mut().enumerate().for_each(|(i, chunk)| f(i, chunk));
        }
    }

    /// Runs `f` on each plane of constant x of a grid; results in order.
    fn for_planes<U: Send>(
        &self,
        extent: GridBox,
        grid: &mut [Node<T>],
        f: impl Fn(usize, &mut [Node<T>]) -> U + Send + Sync,
    ) -> Vec<U> {
        if self.parallel && grid.len() >= MIN_NODES_FOR_THREADS {
            grid.par_chunks_exact_mut(extent.plane()).enumerate().map(|(x, plane)| f(x, plane)).collect()
        } else {
            grid.chunks_exact_mut(extent.plane()).enumerate().map(|(x, plane)| f(x, plane)).collect()
        }
    }

    /// The grid as the sum of the chunks' slabs, in the order of the chunks.
    fn sum_slabs(&self, chunks: &[Chunk<T>], extent: GridBox, grid: &mut [Node<T>]) {
        let size = extent.plane();
        self.for_planes(extent, grid, |x, plane| {
            plane.fill([T::zero(); 4]);
            for chunk in chunks {
                let Some(within) = (x * size).checked_sub(chunk.first_node) else { continue };
                let Some(slab) = chunk.slab.get(within..within + size) else { continue };
                for (node, given) in plane.as_flattened_mut().iter_mut().zip(slab.as_flattened()) {
                    *node += *given;
                }
            }
        });
    }

    /// Copies the chunks' particles (or adjoints) into a state (or adjoint).
    fn write_back(&self, chunks: &mut [Chunk<T>], state: &mut State<T>) {
        let shared = SharedState::new(state);
        // SAFETY: no particle is in two chunks, and all are particles of the state.
        self.for_chunks(chunks, |_, chunk| unsafe { Block::scatter(&chunk.blocks, &chunk.order, &shared) });
    }

    /// From momenta to velocities.
    fn update_grid(&self, update: &GridUpdate<'_>, grid: &mut [Node<T>], impulses: &mut [Impulse]) {
        let by_plane = self.for_planes(update.extent, grid, |x, plane| {
            let mut impulses = vec![Impulse::default(); update.colliders.len()];
            update.forward_plane(x, plane, &mut impulses);
            impulses
        });
        for plane in by_plane {
            for (total, impulse) in impulses.iter_mut().zip(plane) {
                *total += impulse;
            }
        }
    }
}

impl<T: Machine> Engine for FastEngine<T> {
    type Number = T;
    type Tape = Tape<T>;

    fn advance(
        &self,
        world: &PreparedWorld,
        state: &mut State<T>,
        segment: Segment,
        impulses: &mut [Impulse],
    ) -> Result<(), Violation> {
        let (mut tape, taken) = self.run(world, state, segment, false)?;
        self.write_back(&mut tape.chunks, state);
        for (total, impulse) in impulses.iter_mut().zip(taken) {
            *total += impulse;
        }
        Ok(())
    }

    fn record(&self, world: &PreparedWorld, state: &State<T>, segment: Segment) -> Result<Tape<T>, Violation> {
        Ok(self.run(world, state, segment, true)?.0)
    }

    fn reverse(&self, world: &PreparedWorld, mut tape: Tape<T>, adjoint: &mut State<T>, bars: &mut Bars) {
        let Segment { dt, substeps, .. } = tape.segment;
        let states: Vec<Vec<Block<T>>> =
            tape.chunks.iter_mut().map(|chunk| chunk.tape.take().unwrap_or_default()).collect();
        self.for_chunks(&mut tape.chunks, |_, chunk| {
            chunk.blocks = Block::gather(adjoint, &chunk.order);
            chunk.factor_bars = vec![T::zero(); chunk.factors.len()];
        });
        let nodes = tape.extent.nodes();
        let mut grid_bar = vec![[T::zero(); 4]; nodes];
        let mut velocities = grid_bar.clone();
        for i in (0..substeps).rev() {
            // The states of a chunk before and after the substep.
            let before = |c: usize, blocks: usize| &states[c][i * blocks..(i + 1) * blocks];
            let after = |c: usize, blocks: usize| &states[c][(i + 1) * blocks..(i + 2) * blocks];
            let update = world.grid_update(tape.extent, tape.segment.time(i), dt);
            let momenta = &tape.momenta[i * nodes..(i + 1) * nodes];
            velocities.copy_from_slice(momenta);
            self.update_grid(&update, &mut velocities, &mut vec![Impulse::default(); world.colliders.len()]);
            self.for_chunks(&mut tape.chunks, |c, chunk| {
                let n = chunk.blocks.len();
                let step = step(world, chunk.body, dt);
                let (before, after) = (before(c, n), after(c, n));
                T::launch(self.level, G2pAdjoint { step, chunk, before, after, velocities: &velocities });
            });
            self.sum_slabs(&tape.chunks, tape.extent, &mut grid_bar);
            let size = tape.extent.plane();
            self.for_planes(tape.extent, &mut grid_bar, |x, plane| {
                update.adjoint_plane(x, &momenta[x * size..(x + 1) * size], plane);
            });
            self.for_chunks(&mut tape.chunks, |c, chunk| {
                let n = chunk.blocks.len();
                let step = step(world, chunk.body, dt);
                let pass = P2gAdjoint { step, before: before(c, n), grid_bar: &grid_bar, chunk: &mut *chunk };
                let bars = T::launch(self.level, pass);
                chunk.bars += bars;
            });
        }
        self.write_back(&mut tape.chunks, adjoint);
        for chunk in &tape.chunks {
            bars.bodies[chunk.body] += chunk.bars;
            for (p, bar) in chunk.order.iter().zip(&chunk.factor_bars) {
                bars.factors[*p as usize] += bar.to_f64();
            }
        }
        if let Ok(mut spare) = self.spare.lock() {
            spare.push(Buffers { states, momenta: tape.momenta });
        }
    }

    fn is_parallel(&self) -> bool {
        self.parallel
    }

    fn tape_bytes(&self, particles: usize, nodes: usize, substeps: usize) -> usize {
        (State::<T>::bytes(particles) + nodes * size_of::<Node<T>>()) * (substeps + 1)
    }
}

fn step<'a>(world: &'a PreparedWorld, body: usize, dt: f64) -> Step<'a> {
    Step { body: &world.bodies[body], rules: world.rules, spacing: world.spacing, dt }
}

/// The particle that broke the speed limit [m/s]; in case of doubt the fastest.
fn too_fast_particle<T: Machine>(state: &State<T>, limit: f64) -> Violation {
    let slow_enough = |p: &usize| state.velocity_of(*p).length() <= limit;
    let speed = |p: &usize| state.velocity_of(*p).length();
    let first = (0..state.len()).find(|p| !slow_enough(p));
    let fastest = || (0..state.len()).max_by(|a, b| speed(a).total_cmp(&speed(b)));
    Violation::too_fast(state, first.or_else(fastest).unwrap_or(0))
}
