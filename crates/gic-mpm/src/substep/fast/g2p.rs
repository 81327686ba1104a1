//! Grid to particles, and its adjoint.

use gic_simd::{Kernel, Lanes, Scalar};

use super::block::Block;
use super::chunk::Chunk;
use super::gather::{gather, gather_slopes};
use super::scatter::{Pending, scatter};
use super::step::{Scratch, Step, packs, prefetch_next};
use crate::math::mat3::each;
use crate::substep::grid::Node;

/// From the grid to the particles of pack `at` of block `b`: velocity, affine velocity gradient, position.
#[inline(always)]
pub(super) fn g2p<L: Lanes>(
    step: Step<'_>,
    chunk: &mut Chunk<L::Scalar>,
    b: usize,
    at: usize,
    velocities: &[Node<L::Scalar>],
    scratch: &mut Scratch<L::Scalar>,
) {
    let Scratch { stencils, sums, .. } = scratch;
    let Chunk { blocks, window, first_node, flags, .. } = chunk;
    let block = &mut blocks[b];
    let position = block.position::<L>(at);
    stencils.set(position, L::splat(1.0 / step.spacing), window);
    let velocities = &velocities[*first_node..*first_node + window.nodes()];
    // SAFETY: the slice holds the window's nodes.
    unsafe { gather::<L>(stencils, velocities.as_flattened().as_ptr(), window, sums) };

    let [vx, vy, vz, _] = sums.lanes::<L>(0);
    let velocity = [vx, vy, vz];
    let dt = L::splat(step.dt);
    let apic = L::splat(step.apic_factor());
    let affine = sums.matrix::<L>() * apic;
    block.set_position(at, each([0, 1, 2], |i: usize| dt.mul_add(velocity[i], position[i])));
    block.set_velocity(at, velocity);
    block.set_affine(at, &affine);

    let limit = (step.spacing / step.dt).powi(2);
    let slow_enough = (vx * vx + vy * vy + vz * vz).le(L::splat(limit));
    flags.too_fast |= L::any(L::not(slow_enough));
}

/// The first pass of the backward direction: from the adjoints of x', v', C' to those of the grid velocities, and what
/// of x comes from here.
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
        let Scratch { stencils, row, slope_sums, .. } = &mut scratch;
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
                row.set(velocity_bar, &affine_bar, L::zero(), offset);
                // SAFETY: slab and slice hold the window's nodes.
                unsafe {
                    gather_slopes::<L>(stencils, row, velocities.as_ptr(), window, slope_sums);
                    scatter(stencils, row, count, &mut pending, slab.as_mut_ptr(), window);
                }
                // The offsets depend on x too, and sum w v_i is the new velocity.
                let through_offset = affine_bar.transpose().times_vec(self.after[b].velocity(at));
                let by_slope = slope_sums.sums::<L>();
                let position_bar =
                    each([0, 1, 2], |i: usize| inverse_dx.mul_add(by_slope[i] - through_offset[i], position_bar[i]));
                adjoint.set_position(at, position_bar);
            }
        }
        // SAFETY: the slab holds the window's nodes.
        unsafe { pending.finish(slab.as_mut_ptr(), window) };
    }
}
