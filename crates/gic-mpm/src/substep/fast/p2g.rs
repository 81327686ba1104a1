//! Law and particles to grid, and their adjoint.

use gic_simd::{Kernel, Lanes, Scalar};

use super::block::{BLOCK, Block};
use super::chunk::Chunk;
use super::gather::{gather, gather_slopes};
use super::scatter::{Pending, scatter};
use super::stencils::Window;
use super::step::{Measures, Scratch, Step, packs, prefetch_next};
use crate::laws::law::MAX_COEFFICIENTS;
use crate::math::mat3::each;
use crate::substep::engine::BodyBars;
use crate::substep::grid::Node;

/// Law and transfer to the grid of the first `count` particles of pack `at` of block `b`.
#[inline(always)]
pub(super) fn p2g<L: Lanes>(
    step: Step<'_>,
    chunk: &mut Chunk<L::Scalar>,
    b: usize,
    at: usize,
    count: usize,
    scratch: &mut Scratch<L::Scalar>,
    pending: &mut Pending<L>,
) {
    let Scratch { stencils, row, .. } = scratch;
    let Chunk { blocks, factors, window, slab, flags, .. } = chunk;
    let block = &mut blocks[b];
    let (offset, inside) = stencils.set(block.position::<L>(at), L::splat(1.0 / step.spacing), window);
    flags.escaped |= L::any(L::not(inside));

    let c = block.affine::<L>(at);
    let updated = step.law(&c, &block.deformation(at));
    block.set_deformation(at, &updated.f);
    let measures = step.measures(L::load(&factors[b * BLOCK + at..]));
    let (momentum, affine) = measures.momenta(block.velocity(at), &c, &updated.tau);
    row.set(momentum, &affine, measures.mass, offset);
    // SAFETY: the slab holds the window's nodes.
    unsafe { scatter(stencils, row, count, pending, slab.as_flattened_mut().as_mut_ptr(), window) };
}

/// The second pass of the backward direction: from the adjoints of the grid's momenta and masses, and of F', to those
/// of x, v, C, F.
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
        let Chunk { blocks, factors, factor_bars, window, first_node, order, .. } = self.chunk;
        let grid_bar = self.grid_bar[*first_node..*first_node + window.nodes()].as_flattened();
        for b in 0..blocks.len() {
            prefetch_next(blocks, b);
            prefetch_next(self.before, b);
            for (at, count) in packs::<L>(b, order.len()) {
                let factor = L::load(&factors[b * BLOCK + at..]);
                let pack = Pack { step: self.step, before: &self.before[b], factor, at, count };
                // SAFETY: the slice holds the window's nodes.
                let factor_bar =
                    unsafe { pack.adjoint(&mut blocks[b], grid_bar.as_ptr(), window, &mut scratch, &mut lane_bars) };
                let sums = &mut factor_bars[b * BLOCK + at..];
                (L::load(sums) + factor_bar).store(sums);
            }
            if b % BLOCKS_PER_LANE_SUM == BLOCKS_PER_LANE_SUM - 1 {
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
    /// Returns the derivative of the loss with respect to the factors.
    ///
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
    ) -> L {
        let Scratch { stencils, row, sums, slope_sums } = scratch;
        let at = self.at;
        let inverse_dx = L::splat(1.0 / self.step.spacing);
        let measures = self.step.measures(self.factor);
        let Measures { mass, inertia, stress } = measures;
        let (velocity, c, f) =
            (self.before.velocity::<L>(at), self.before.affine::<L>(at), self.before.deformation::<L>(at));

        let (offset, _) = stencils.set(self.before.position::<L>(at), inverse_dx, window);
        // SAFETY: as the caller says.
        unsafe { gather::<L>(stencils, grid_bar, window, sums) };
        let [px, py, pz, mass_bar] = sums.lanes::<L>(0);
        let momentum_bar = [px, py, pz];
        let affine_bar = sums.matrix::<L>();
        let law_bar = self.step.law_adjoint(&c, &f, &adjoint.deformation(at), &(affine_bar * stress));
        adjoint.set_affine(at, &law_bar.c.add_scaled(inertia, &affine_bar));
        adjoint.set_deformation(at, &law_bar.f);
        adjoint.set_velocity(at, each(momentum_bar, |b| b * mass));

        // The weights depend on x, and the offsets do.
        let (momentum, affine) = measures.momenta(velocity, &c, &law_bar.tau);
        stencils.set_slopes(offset);
        row.set(momentum, &affine, mass, offset);
        // SAFETY: as the caller says.
        unsafe { gather_slopes::<L>(stencils, row, grid_bar, window, slope_sums) };
        let through_offset = affine.transpose().times_vec(momentum_bar);
        let by_slope = slope_sums.sums::<L>();
        let position_bar = adjoint.position::<L>(at);
        let position_bar =
            each([0, 1, 2], |i: usize| inverse_dx.mul_add(by_slope[i] - through_offset[i], position_bar[i]));
        adjoint.set_position(at, position_bar);

        let through_inertia = L::splat(self.step.spacing) * affine_bar.double_dot(&c);
        let by_velocity = px * velocity[0] + py * velocity[1] + pz * velocity[2];
        // Lanes beyond the count repeat a particle that has already been counted.
        let real = L::lane_index().lt(L::splat(self.count as f64));
        let by_mass = mass_bar + by_velocity + through_inertia;
        let through_stress = stress * affine_bar.double_dot(&law_bar.tau);
        bars.mass += L::select(real, self.factor * by_mass, L::zero());
        bars.volume_term += L::select(real, through_stress, L::zero());
        for i in 0..MAX_COEFFICIENTS {
            bars.coefficients[i] += L::select(real, law_bar.coefficients[i], L::zero());
        }
        L::splat(self.step.body.mass) * by_mass + through_stress / self.factor
    }
}

/// Blocks whose parameter derivatives are summed lane by lane before they are added up in f64.
const BLOCKS_PER_LANE_SUM: usize = 4;

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
