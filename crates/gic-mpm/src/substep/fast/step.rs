//! The passes over a chunk of particles: laws and transfers, forward beside backward. The equations are in [`crate::substep::scalar`].
//!
//! Forward, a pass takes the particles from the grid of one substep to that of the next (g2p, then law and p2g) while they are in
//! cache. Backward there are two passes, one on each side of the grid.

use gic_simd::{Call, Kernel, Lanes, Scalar, prefetch};

use super::block::{BLOCK, Block};
use super::scatter::{G2pSums, P2gRow, Pending, Stencils, Window, gather, gather_slopes, scatter};
use crate::laws::law::{Law, LawAdjoint, MAX_COEFFICIENTS, Rules, Updated};
use crate::math::mat3::{Mat3, each};
use crate::substep::grid_update::Node;
use crate::substep::prepared_world::{BodyBars, PreparedBody, with_law};

/// Consecutive sorted particles of one body.
pub(super) struct Chunk<T> {
    /// Number of the body.
    pub(super) body: usize,
    /// The particles, in the order of the blocks.
    pub(super) order: Vec<u32>,
    pub(super) blocks: Vec<Block<T>>,
    /// Factors on their masses and volumes, as many as the blocks have room for.
    pub(super) factors: Vec<T>,
    /// The nodes that the chunk may touch: all of the grid's along y and z, some planes along x.
    pub(super) window: Window,
    /// Index in the grid of the window's first node.
    pub(super) first_node: usize,
    /// What the chunk's particles scatter, shape [window's nodes].
    pub(super) slab: Vec<Node<T>>,
    pub(super) flags: Flags,
    /// The states between the substeps, one after the other, if they are to be kept.
    pub(super) tape: Option<Vec<Block<T>>>,
    /// What the reverse pass has summed so far.
    pub(super) bars: BodyBars,
}

/// What went wrong in a chunk.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Flags {
    /// |v| dt > dx or NaN.
    pub(super) too_fast: bool,
    /// A stencil reaches out of the window.
    pub(super) escaped: bool,
}

/// What the passes over all chunks of a substep share.
#[derive(Clone, Copy)]
pub(super) struct Step<'a> {
    pub(super) body: &'a PreparedBody,
    pub(super) rules: Rules,
    /// Grid spacing [m].
    pub(super) spacing: f64,
    /// Length of the substep [s].
    pub(super) dt: f64,
}

impl Step<'_> {
    /// The factor from tau to its part of A, times dx because offsets are in units of dx.
    fn stress_factor(&self) -> f64 {
        -self.dt * self.body.volume * 4.0 / self.spacing
    }

    /// The factor from C to its part of A, times dx likewise.
    fn inertia_factor(&self) -> f64 {
        self.body.mass * self.spacing
    }

    /// D dx = 4 / dx.
    fn apic_factor(&self) -> f64 {
        4.0 / self.spacing
    }

    /// The law over lanes. The match on the material is inside the loops over particles, where it costs nothing, so that all
    /// laws share the compiled transfers.
    #[inline(always)]
    fn law<L: Lanes>(&self, c: &Mat3<L>, f: &Mat3<L>) -> Updated<L> {
        let (dt, coefficients, rules) = (L::splat(self.dt), &self.body.coefficients, self.rules);
        with_law!(self.body.material, AnyLaw => {
            let call = Update { law: AnyLaw::<L>::new(coefficients, rules), dt, c, f };
            if <AnyLaw<L> as Law<L>>::LONG { L::outlined(call) } else { call.run() }
        })
    }

    /// The adjoint of the law over lanes.
    #[inline(always)]
    fn law_adjoint<L: Lanes>(&self, c: &Mat3<L>, f: &Mat3<L>, f_bar: &Mat3<L>, tau_bar: &Mat3<L>) -> LawAdjoint<L> {
        let (dt, coefficients, rules) = (L::splat(self.dt), &self.body.coefficients, self.rules);
        with_law!(self.body.material, AnyLaw => {
            let call = UpdateAdjoint { law: AnyLaw::<L>::new(coefficients, rules), dt, c, f, f_bar, tau_bar };
            if <AnyLaw<L> as Law<L>>::LONG { L::outlined(call) } else { call.run() }
        })
    }

    /// The mass of particles, and the factors from C and tau to their parts of A dx.
    #[inline(always)]
    fn measures<L: Lanes>(&self, factor: L) -> Measures<L> {
        Measures {
            mass: L::splat(self.body.mass) * factor,
            inertia: L::splat(self.inertia_factor()) * factor,
            stress: L::splat(self.stress_factor()) * factor,
        }
    }
}

/// What a particle's mass and volume weigh.
struct Measures<L> {
    mass: L,
    inertia: L,
    stress: L,
}

impl<L: Lanes> Measures<L> {
    /// `m v` and `A dx`.
    #[inline(always)]
    fn momenta(&self, velocity: [L; 3], c: &Mat3<L>, tau: &Mat3<L>) -> ([L; 3], Mat3<L>) {
        let affine = (*c * self.inertia).add_scaled(self.stress, tau);
        (each(velocity, |v| v * self.mass), affine)
    }
}

/// A call of [`Law::update`].
struct Update<'a, L, A> {
    law: A,
    dt: L,
    c: &'a Mat3<L>,
    f: &'a Mat3<L>,
}

impl<L: Lanes, A: Law<L>> Call for Update<'_, L, A> {
    type Output = Updated<L>;

    #[inline(always)]
    fn run(self) -> Updated<L> {
        self.law.update(self.dt, self.c, self.f)
    }
}

/// A call of [`Law::update_adjoint`].
struct UpdateAdjoint<'a, L, A> {
    law: A,
    dt: L,
    c: &'a Mat3<L>,
    f: &'a Mat3<L>,
    f_bar: &'a Mat3<L>,
    tau_bar: &'a Mat3<L>,
}

impl<L: Lanes, A: Law<L>> Call for UpdateAdjoint<'_, L, A> {
    type Output = LawAdjoint<L>;

    #[inline(always)]
    fn run(self) -> LawAdjoint<L> {
        self.law.update_adjoint(self.dt, self.c, self.f, self.f_bar, self.tau_bar)
    }
}

/// Buffers between lanes and rows.
struct Scratch<T> {
    stencils: Stencils<T>,
    gift: P2gRow<T>,
    received: G2pSums<T>,
    received_slopes: G2pSums<T>,
}

impl<T: Scalar> Scratch<T> {
    fn new() -> Self {
        Self {
            stencils: Stencils::new(),
            gift: P2gRow::new(),
            received: G2pSums::new(),
            received_slopes: G2pSums::new(),
        }
    }
}

/// Where the packs (lanes) of a block start and how many of their particles are real.
#[inline(always)]
fn packs<L: Lanes>(block: usize, particles: usize) -> impl Iterator<Item = (usize, usize)> {
    let left = particles - (block * BLOCK).min(particles);
    (0..BLOCK).step_by(L::LANES).take_while(move |&at| at < left).map(move |at| (at, (left - at).min(L::LANES)))
}

/// Asks for the block after `b`, which comes from main memory.
#[inline(always)]
fn prefetch_next<T>(blocks: &[Block<T>], b: usize) {
    if let Some(next) = blocks.get(b + 1) {
        prefetch(next);
    }
}

/// One pass of the forward direction over a chunk.
pub(super) struct Forward<'a, T> {
    pub(super) step: Step<'a>,
    pub(super) chunk: &'a mut Chunk<T>,
    /// Velocities of the grid, to gather from; none in the first pass of a segment.
    pub(super) velocities: Option<&'a [Node<T>]>,
    /// Whether to go on to the law and the scattering; not in the last pass of a segment.
    pub(super) scatter: bool,
}

impl<T: Scalar> Kernel<T> for Forward<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes<Scalar = T>>(mut self) {
        let mut scratch = Scratch::new();
        let mut pending = Pending::<L>::none();
        let particles = self.chunk.order.len();
        if self.scatter {
            self.chunk.slab.fill([T::zero(); 4]);
        }
        for b in 0..self.chunk.blocks.len() {
            prefetch_next(&self.chunk.blocks, b);
            if let Some(velocities) = self.velocities {
                for (at, _) in packs::<L>(b, particles) {
                    self.g2p::<L>(b, at, velocities, &mut scratch);
                }
            }
            if let Some(tape) = &mut self.chunk.tape {
                tape.push(self.chunk.blocks[b]);
            }
            if self.scatter {
                for (at, count) in packs::<L>(b, particles) {
                    self.p2g(b, at, count, &mut scratch, &mut pending);
                }
            }
        }
        let Chunk { slab, window, .. } = self.chunk;
        // SAFETY: the slab holds the window's nodes.
        unsafe { pending.finish(slab.as_flattened_mut().as_mut_ptr(), window) };
    }
}

impl<T: Scalar> Forward<'_, T> {
    #[inline(always)]
    fn g2p<L: Lanes<Scalar = T>>(&mut self, b: usize, at: usize, velocities: &[Node<T>], scratch: &mut Scratch<T>) {
        let Scratch { stencils, received, .. } = scratch;
        let Chunk { blocks, window, first_node, flags, .. } = &mut *self.chunk;
        let block = &mut blocks[b];
        let position = block.position::<L>(at);
        stencils.set(position, L::splat(1.0 / self.step.spacing), window);
        let velocities = &velocities[*first_node..*first_node + window.nodes()];
        // SAFETY: the slice holds the window's nodes.
        unsafe { gather::<L>(stencils, velocities.as_flattened().as_ptr(), window, received) };

        let [vx, vy, vz, _] = received.lanes::<L>(0);
        let velocity = [vx, vy, vz];
        let dt = L::splat(self.step.dt);
        let apic = L::splat(self.step.apic_factor());
        let affine = received.matrix::<L>() * apic;
        block.set_position(at, each([0, 1, 2], |i: usize| dt.mul_add(velocity[i], position[i])));
        block.set_velocity(at, velocity);
        block.set_affine(at, &affine);

        let limit = (self.step.spacing / self.step.dt).powi(2);
        let slow_enough = (vx * vx + vy * vy + vz * vz).le(L::splat(limit));
        flags.too_fast |= L::any(L::not(slow_enough));
    }

    #[inline(always)]
    fn p2g<L: Lanes<Scalar = T>>(
        &mut self,
        b: usize,
        at: usize,
        count: usize,
        scratch: &mut Scratch<T>,
        pending: &mut Pending<L>,
    ) {
        let Scratch { stencils, gift, .. } = scratch;
        let Chunk { blocks, factors, window, slab, flags, .. } = &mut *self.chunk;
        let block = &mut blocks[b];
        let (offset, inside) = stencils.set(block.position::<L>(at), L::splat(1.0 / self.step.spacing), window);
        flags.escaped |= L::any(L::not(inside));

        let c = block.affine::<L>(at);
        let updated = self.step.law(&c, &block.deformation(at));
        block.set_deformation(at, &updated.f);
        let measures = self.step.measures(L::load(&factors[b * BLOCK + at..]));
        let (momentum, affine) = measures.momenta(block.velocity(at), &c, &updated.tau);
        gift.set(momentum, &affine, measures.mass, offset);
        // SAFETY: the slab holds the window's nodes.
        unsafe { scatter(stencils, gift, count, pending, slab.as_flattened_mut().as_mut_ptr(), window) };
    }
}

/// The first pass of the backward direction: from the adjoints of x', v', C' to those of the grid velocities, and what of x comes from here.
pub(super) struct G2pAdjoint<'a, T> {
    pub(super) step: Step<'a>,
    /// Its blocks hold the adjoint; its slab receives the adjoint of the velocities.
    pub(super) chunk: &'a mut Chunk<T>,
    /// States at the start and at the end of the substep.
    pub(super) before: &'a [Block<T>],
    pub(super) after: &'a [Block<T>],
    /// Velocities of the grid.
    pub(super) velocities: &'a [Node<T>],
}

impl<T: Scalar> Kernel<T> for G2pAdjoint<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes<Scalar = T>>(self) {
        let mut scratch = Scratch::new();
        let mut pending = Pending::<L>::none();
        let Chunk { blocks, window, first_node, slab, order, .. } = self.chunk;
        let velocities = self.velocities[*first_node..*first_node + window.nodes()].as_flattened();
        let inverse_dx = L::splat(1.0 / self.step.spacing);
        let dt = L::splat(self.step.dt);
        slab.fill([T::zero(); 4]);
        let slab = slab.as_flattened_mut();
        let Scratch { stencils, gift, received_slopes, .. } = &mut scratch;
        for b in 0..blocks.len() {
            prefetch_next(blocks, b);
            prefetch_next(self.before, b);
            for (at, count) in packs::<L>(b, order.len()) {
                let adjoint = &mut blocks[b];
                let (offset, _) = stencils.set(self.before[b].position::<L>(at), inverse_dx, window);
                stencils.set_slopes(offset);
                let position_bar = adjoint.position::<L>(at);
                let velocity_bar = adjoint.velocity::<L>(at);
                let velocity_bar = each([0, 1, 2], |i: usize| dt.mul_add(position_bar[i], velocity_bar[i]));
                let affine_bar = adjoint.affine::<L>(at) * L::splat(self.step.apic_factor());
                gift.set(velocity_bar, &affine_bar, L::zero(), offset);
                // SAFETY: slab and slice hold the window's nodes.
                unsafe {
                    gather_slopes::<L>(stencils, gift, velocities.as_ptr(), window, received_slopes);
                    scatter(stencils, gift, count, &mut pending, slab.as_mut_ptr(), window);
                }
                // The offsets depend on x too, and sum w v_i is the new velocity.
                let through_offset = affine_bar.transpose().times_vec(self.after[b].velocity(at));
                let by_slope = received_slopes.sums::<L>();
                let position_bar =
                    each([0, 1, 2], |i: usize| inverse_dx.mul_add(by_slope[i] - through_offset[i], position_bar[i]));
                adjoint.set_position(at, position_bar);
            }
        }
        // SAFETY: the slab holds the window's nodes.
        unsafe { pending.finish(slab.as_mut_ptr(), window) };
    }
}

/// The second pass of the backward direction: from the adjoints of the grid's momenta and masses, and of F', to those of x, v, C, F.
pub(super) struct P2gAdjoint<'a, T> {
    pub(super) step: Step<'a>,
    /// Its blocks hold the adjoint.
    pub(super) chunk: &'a mut Chunk<T>,
    /// State at the start of the substep.
    pub(super) before: &'a [Block<T>],
    /// Adjoint of the grid's momenta and masses.
    pub(super) grid_bar: &'a [Node<T>],
}

impl<T: Scalar> Kernel<T> for P2gAdjoint<'_, T> {
    type Output = BodyBars;

    #[inline(always)]
    fn run<L: Lanes<Scalar = T>>(self) -> BodyBars {
        let mut scratch = Scratch::new();
        let mut bars = BodyBars::default();
        let mut lane_bars = LaneBars::<L>::zero();
        let Chunk { blocks, factors, window, first_node, order, .. } = self.chunk;
        let grid_bar = self.grid_bar[*first_node..*first_node + window.nodes()].as_flattened();
        for b in 0..blocks.len() {
            prefetch_next(blocks, b);
            prefetch_next(self.before, b);
            for (at, count) in packs::<L>(b, order.len()) {
                let factor = L::load(&factors[b * BLOCK + at..]);
                let pack = Pack { step: self.step, before: &self.before[b], factor, at, count };
                // SAFETY: the slice holds the window's nodes.
                unsafe { pack.adjoint(&mut blocks[b], grid_bar.as_ptr(), window, &mut scratch, &mut lane_bars) };
            }
            if b % BLOCKS_PER_SUM == BLOCKS_PER_SUM - 1 {
                lane_bars.flush(self.step.body.volume, &mut bars);
            }
        }
        lane_bars.flush(self.step.body.volume, &mut bars);
        bars
    }
}

/// The particles of one pack of lanes at the start of a substep.
struct Pack<'a, L: Lanes> {
    step: Step<'a>,
    before: &'a Block<L::Scalar>,
    factor: L,
    at: usize,
    count: usize,
}

impl<L: Lanes> Pack<'_, L> {
    /// # Safety
    /// `grid_bar` must hold the window's nodes, four numbers each.
    #[inline(always)]
    unsafe fn adjoint(
        &self,
        adjoint: &mut Block<L::Scalar>,
        grid_bar: *const L::Scalar,
        window: &Window,
        scratch: &mut Scratch<L::Scalar>,
        bars: &mut LaneBars<L>,
    ) {
        let Scratch { stencils, gift, received, received_slopes } = scratch;
        let at = self.at;
        let inverse_dx = L::splat(1.0 / self.step.spacing);
        let measures = self.step.measures(self.factor);
        let Measures { mass, inertia, stress } = measures;
        let (velocity, c, f) =
            (self.before.velocity::<L>(at), self.before.affine::<L>(at), self.before.deformation::<L>(at));

        let (offset, _) = stencils.set(self.before.position::<L>(at), inverse_dx, window);
        // SAFETY: as the caller says.
        unsafe { gather::<L>(stencils, grid_bar, window, received) };
        let [px, py, pz, mass_bar] = received.lanes::<L>(0);
        let momentum_bar = [px, py, pz];
        let affine_bar = received.matrix::<L>();
        let law_bar = self.step.law_adjoint(&c, &f, &adjoint.deformation(at), &(affine_bar * stress));
        adjoint.set_affine(at, &law_bar.c.add_scaled(inertia, &affine_bar));
        adjoint.set_deformation(at, &law_bar.f);
        adjoint.set_velocity(at, each(momentum_bar, |b| b * mass));

        // The weights depend on x, and the offsets do.
        let (momentum, affine) = measures.momenta(velocity, &c, &law_bar.tau);
        stencils.set_slopes(offset);
        gift.set(momentum, &affine, mass, offset);
        // SAFETY: as the caller says.
        unsafe { gather_slopes::<L>(stencils, gift, grid_bar, window, received_slopes) };
        let through_offset = affine.transpose().times_vec(momentum_bar);
        let by_slope = received_slopes.sums::<L>();
        let position_bar = adjoint.position::<L>(at);
        let position_bar =
            each([0, 1, 2], |i: usize| inverse_dx.mul_add(by_slope[i] - through_offset[i], position_bar[i]));
        adjoint.set_position(at, position_bar);

        let through_inertia = L::splat(self.step.spacing) * affine_bar.double_dot(&c);
        let by_velocity = px * velocity[0] + py * velocity[1] + pz * velocity[2];
        // Lanes beyond the count repeat a particle that has already been counted.
        let real = L::lane_index().lt(L::splat(self.count as f64));
        bars.mass += L::select(real, self.factor * (mass_bar + by_velocity + through_inertia), L::zero());
        bars.volume_term += L::select(real, stress * affine_bar.double_dot(&law_bar.tau), L::zero());
        for i in 0..MAX_COEFFICIENTS {
            bars.coefficients[i] += L::select(real, law_bar.coefficients[i], L::zero());
        }
    }
}

/// Blocks whose parameter derivatives are summed lane by lane before they are added up in f64.
const BLOCKS_PER_SUM: usize = 4;

/// [`BodyBars`] of a few blocks, lane by lane.
struct LaneBars<L> {
    coefficients: [L; MAX_COEFFICIENTS],
    mass: L,
    /// The rest volume times the derivative with respect to it.
    volume_term: L,
}

impl<L: Lanes> LaneBars<L> {
    #[inline(always)]
    fn zero() -> Self {
        Self { coefficients: [L::zero(); MAX_COEFFICIENTS], mass: L::zero(), volume_term: L::zero() }
    }

    /// Adds the sums to `bars` and starts over; `volume` is a particle's rest volume [m^3].
    #[inline(always)]
    fn flush(&mut self, volume: f64, bars: &mut BodyBars) {
        for i in 0..MAX_COEFFICIENTS {
            bars.coefficients[i] += self.coefficients[i].sum_lanes();
        }
        bars.mass += self.mass.sum_lanes();
        bars.volume += self.volume_term.sum_lanes() / volume;
        *self = Self::zero();
    }
}
