//! Particles to rows of nodes: the inner loop of p2g.
//!
//! What a particle gives its node (i, j, k) is affine in the node: `weight * (base + i along_x + j along_y + k
//! along_z)`, so a row costs an addition and a multiplication-addition per vector. SAFETY of the pointers: see
//! [`super::stencils`].

use core::array;

use gic_simd::{Lanes, Scalar};

use super::stencils::{Quads, Stencils, Window, vectors, z_index};
use crate::math::mat3::Mat3;

/// What `LANES` particles give their nodes, before weighting: `base + i along_x + j along_y + k along_z`.
pub(super) struct P2gRow<T> {
    base: Quads<T>,
    along: [Quads<T>; 3],
}

impl<T: Scalar> P2gRow<T> {
    pub(super) fn new() -> Self {
        Self { base: Quads::zero(), along: array::from_fn(|_| Quads::zero()) }
    }

    /// The row of `(vector + matrix d, fourth)`, with d the node's offset from the particle in units of dx.
    #[inline(always)]
    pub(super) fn set<L: Lanes<Scalar = T>>(&mut self, vector: [L; 3], matrix: &Mat3<L>, fourth: L, offset: [L; 3]) {
        let back = matrix.times_vec(offset);
        self.base.set([vector[0] - back[0], vector[1] - back[1], vector[2] - back[2], fourth]);
        for axis in 0..3 {
            self.along[axis].set([matrix.at(0, axis), matrix.at(1, axis), matrix.at(2, axis), L::zero()]);
        }
    }

    /// What goes to vector `r` of the first row, and its increments along x and y, of a particle.
    #[inline(always)]
    pub(super) fn first_row<L: Lanes<Scalar = T>>(&self, particle: usize, z: L) -> (L, L, L) {
        // SAFETY: a quad has four numbers.
        unsafe {
            let base = L::quad_at(self.base.of::<L>(particle));
            let along_x = L::quad_at(self.along[0].of::<L>(particle));
            let along_y = L::quad_at(self.along[1].of::<L>(particle));
            let along_z = L::quad_at(self.along[2].of::<L>(particle));
            (z.mul_add(along_z, base), along_x, along_y)
        }
    }
}

/// Sums of what particles give that are not yet in the grid: those of the particles of one cell, which follow each
/// other.
pub(super) struct Pending<L> {
    rows: [[L; 9]; 4],
    /// Base index of the cell; `usize::MAX` for none.
    cell: usize,
}

impl<L: Lanes> Pending<L> {
    pub(super) fn none() -> Self {
        Self { rows: [[L::zero(); 9]; 4], cell: usize::MAX }
    }

    /// Adds what is left to the grid.
    ///
    /// # Safety
    /// `grid` must hold the window's nodes, four numbers each.
    #[inline(always)]
    pub(super) unsafe fn finish(&mut self, grid: *mut L::Scalar, window: &Window) {
        for r in 0..vectors::<L>() {
            // SAFETY: as the caller says.
            unsafe { add_rows(&self.rows[r], self.cell, r, grid, window) };
        }
        *self = Self::none();
    }
}

/// Adds vector `r` of nine rows to the grid.
#[inline(always)]
unsafe fn add_rows<L: Lanes>(rows: &[L; 9], cell: usize, r: usize, grid: *mut L::Scalar, window: &Window) {
    if cell == usize::MAX {
        return;
    }
    for row in 0..9 {
        // SAFETY: see the module.
        unsafe {
            let at = grid.add(4 * (cell + window.row(row)) + r * L::LANES);
            (L::load_at(at) + rows[row]).store_at(at);
        }
    }
}

/// Adds what the first `count` particles give, weighted, to the grid, by way of `pending`.
///
/// # Safety
/// `grid` must hold the nodes of the window that `s` was set for, four numbers each.
#[inline(always)]
pub(super) unsafe fn scatter<L: Lanes>(
    s: &Stencils<L::Scalar>,
    p2g_row: &P2gRow<L::Scalar>,
    count: usize,
    pending: &mut Pending<L>,
    grid: *mut L::Scalar,
    window: &Window,
) {
    let mut cell = pending.cell;
    for r in 0..vectors::<L>() {
        // One vector of the rows at a time, so that the nine sums stay in registers.
        let mut rows = pending.rows[r];
        cell = pending.cell;
        let z = z_index::<L>(r);
        for p in 0..count.min(L::LANES) {
            if s.base[p] != cell {
                // SAFETY: as the caller says.
                unsafe { add_rows(&rows, cell, r, grid, window) };
                rows = [L::zero(); 9];
                cell = s.base[p];
            }
            let wz = s.wz.along_row::<L>(p, r);
            let (first, along_x, along_y) = p2g_row.first_row(p, z);
            let (mut to, along_x, along_y) = (first * wz, along_x * wz, along_y * wz);
            for i in 0..3 {
                let next = to + along_y;
                let last = next + along_y;
                rows[3 * i] = L::of(s.wxy[3 * i][p]).mul_add(to, rows[3 * i]);
                rows[3 * i + 1] = L::of(s.wxy[3 * i + 1][p]).mul_add(next, rows[3 * i + 1]);
                rows[3 * i + 2] = L::of(s.wxy[3 * i + 2][p]).mul_add(last, rows[3 * i + 2]);
                to += along_x;
            }
        }
        pending.rows[r] = rows;
    }
    pending.cell = cell;
}
