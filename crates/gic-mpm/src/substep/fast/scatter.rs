//! Between lanes of particles and rows of nodes.
//!
//! Four nodes in a row along z, each (x, y, z, mass), are 16 numbers: one vector of AVX-512, two of AVX2, four of NEON. A particle
//! touches nine such rows (of the fourth node it touches nothing, its weight is zero). What a particle gives its node (i, j, k) is affine in
//! the node: `weight * (base + i along_x + j along_y + k along_z)`, so a row costs an addition and a multiplication-addition per vector.
//!
//! SAFETY of the pointers here: a stencil's base index is clamped by [`Stencils::set`] so that all nine rows lie in the grid of the
//! [`Window`] that it was made for, whatever the particle's position (also NaN); callers pass grids of at least that size.

use core::array;

use gic_simd::{Lanes, Scalar};

use super::block::BLOCK;
use crate::math::mat3::Mat3;
use crate::substep::stencil;

/// Four numbers per particle, for up to 16 particles, as [`Lanes::transpose`] leaves them. The end is padding: rows are read past a
/// particle's own four numbers.
#[repr(C, align(64))]
pub(super) struct Quads<T>([T; 4 * BLOCK + 4]);

impl<T: Scalar> Quads<T> {
    fn zero() -> Self {
        Self([T::zero(); 4 * BLOCK + 4])
    }

    /// Sets the quads of `LANES` particles; lane l of `rows[q]` is number q of particle l.
    #[inline(always)]
    pub(super) fn set<L: Lanes<Scalar = T>>(&mut self, rows: [L; 4]) {
        for (q, particles) in L::transpose(rows).into_iter().enumerate() {
            particles.store(&mut self.0[q * L::LANES..]);
        }
    }

    /// The quad of a particle.
    #[inline(always)]
    fn of<L: Lanes<Scalar = T>>(&self, particle: usize) -> *const T {
        // Result q of a transpose holds particles 4 g + q in its groups g.
        let at = (particle % 4) * L::LANES + particle / 4 * 4;
        self.0[at..at + 4].as_ptr()
    }
}

/// The part of the grid that a chunk's particles may touch.
#[derive(Clone, Copy, Debug)]
pub(super) struct Window {
    /// First node of the window in the infinite grid.
    pub(super) first: [i32; 3],
    /// Nodes along each axis.
    pub(super) size: [usize; 3],
}

impl Window {
    /// Number of nodes.
    pub(super) fn nodes(&self) -> usize {
        self.size.iter().product()
    }

    /// Index distance of neighbours along x.
    #[inline(always)]
    fn plane(&self) -> usize {
        self.size[1] * self.size[2]
    }

    /// Index of the first node of row (i, j) of a stencil, relative to its base.
    #[inline(always)]
    fn row(&self, row: usize) -> usize {
        row / 3 * self.plane() + row % 3 * self.size[2]
    }
}

/// The stencils of `LANES` particles.
pub(super) struct Stencils<T> {
    /// Index of the first node in the window.
    base: [usize; BLOCK],
    wx: [[T; BLOCK]; 3],
    wy: [[T; BLOCK]; 3],
    /// Weights times the node's offset from the particle.
    mx: [[T; BLOCK]; 3],
    my: [[T; BLOCK]; 3],
    /// Slopes of the weights.
    sx: [[T; BLOCK]; 3],
    sy: [[T; BLOCK]; 3],
    /// Products of the weights along x and y, by row.
    wxy: [[T; BLOCK]; 9],
    wz: Quads<T>,
    sz: Quads<T>,
    /// Offsets along z.
    dz: Quads<T>,
}

impl<T: Scalar> Stencils<T> {
    pub(super) fn new() -> Self {
        Self {
            base: [0; BLOCK],
            wx: [[T::zero(); BLOCK]; 3],
            wy: [[T::zero(); BLOCK]; 3],
            mx: [[T::zero(); BLOCK]; 3],
            my: [[T::zero(); BLOCK]; 3],
            sx: [[T::zero(); BLOCK]; 3],
            sy: [[T::zero(); BLOCK]; 3],
            wxy: [[T::zero(); BLOCK]; 9],
            wz: Quads::zero(),
            sz: Quads::zero(),
            dz: Quads::zero(),
        }
    }

    /// Computes the stencils of particles at `position`. Returns their offsets from the base nodes, in units of dx, and a flag for
    /// each that is set where the stencil lies in the window.
    #[inline(always)]
    pub(super) fn set<L: Lanes<Scalar = T>>(
        &mut self,
        position: [L; 3],
        inverse_dx: L,
        window: &Window,
    ) -> ([L; 3], L::Mask) {
        let mut offset = [L::zero(); 3];
        let mut cell = [L::zero(); 3];
        let mut inside = L::lt(L::zero(), L::one());
        for axis in 0..3 {
            let (base, within) = stencil::base_and_offset(position[axis] * inverse_dx);
            offset[axis] = within;
            cell[axis] = base - L::splat(f64::from(window.first[axis]));
            // Along z, rows of four nodes are read.
            let last = window.size[axis] - if axis == 2 { 4 } else { 3 };
            let within_axis = L::and(L::zero().le(cell[axis]), cell[axis].le(L::splat(last as f64)));
            inside = L::and(inside, within_axis);
        }
        // Exact in f32: windows have at most 2^24 nodes.
        let index = (cell[0] * L::splat(window.size[1] as f64) + cell[1]) * L::splat(window.size[2] as f64) + cell[2];
        let last = window.nodes() - window.row(8) - 4;
        // Clamped, so that also a lost particle reads and writes inside; the order of min and max makes a NaN 0.
        let mut clamped = [T::zero(); BLOCK];
        index.max(L::zero()).min(L::splat(last as f64)).store(&mut clamped);
        for (base, clamped) in self.base.iter_mut().zip(clamped) {
            *base = clamped.to_f64() as usize;
        }

        let [wx, wy, wz] = [stencil::weights(offset[0]), stencil::weights(offset[1]), stencil::weights(offset[2])];
        for i in 0..3 {
            let node = L::splat(i as f64);
            wx[i].store(&mut self.wx[i]);
            wy[i].store(&mut self.wy[i]);
            (wx[i] * (node - offset[0])).store(&mut self.mx[i]);
            (wy[i] * (node - offset[1])).store(&mut self.my[i]);
            for j in 0..3 {
                (wx[i] * wy[j]).store(&mut self.wxy[3 * i + j]);
            }
        }
        self.wz.set([wz[0], wz[1], wz[2], L::zero()]);
        self.dz.set([L::zero() - offset[2], L::one() - offset[2], L::splat(2.0) - offset[2], L::zero()]);
        (offset, inside)
    }

    /// Computes what [`gather_slopes`] needs beside.
    #[inline(always)]
    pub(super) fn set_slopes<L: Lanes<Scalar = T>>(&mut self, offset: [L; 3]) {
        let [sx, sy, sz] = [stencil::slopes(offset[0]), stencil::slopes(offset[1]), stencil::slopes(offset[2])];
        for i in 0..3 {
            sx[i].store(&mut self.sx[i]);
            sy[i].store(&mut self.sy[i]);
        }
        self.sz.set([sz[0], sz[1], sz[2], L::zero()]);
    }
}

/// What `LANES` particles give their nodes, before weighting: `base + i along_x + j along_y + k along_z`.
pub(super) struct P2gRow<T> {
    base: Quads<T>,
    along: [Quads<T>; 3],
}

impl<T: Scalar> P2gRow<T> {
    pub(super) fn new() -> Self {
        Self { base: Quads::zero(), along: array::from_fn(|_| Quads::zero()) }
    }

    /// The gift `(vector + matrix d, fourth)`, with d the node's offset from the particle in units of dx.
    #[inline(always)]
    pub(super) fn set<L: Lanes<Scalar = T>>(&mut self, vector: [L; 3], matrix: &Mat3<L>, fourth: L, offset: [L; 3]) {
        let back = matrix.times_vec(offset);
        self.base.set([vector[0] - back[0], vector[1] - back[1], vector[2] - back[2], fourth]);
        for axis in 0..3 {
            self.along[axis].set([matrix.at(0, axis), matrix.at(1, axis), matrix.at(2, axis), L::zero()]);
        }
    }

    /// The gift to vector `r` of the first row, and its increments along x and y, of a particle.
    #[inline(always)]
    fn first_row<L: Lanes<Scalar = T>>(&self, particle: usize, z: L) -> (L, L, L) {
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

/// Vectors per row.
const fn vectors<L: Lanes>() -> usize {
    4 / L::GROUPS
}

/// The z indices of the nodes in vector `r` of a row.
#[inline(always)]
fn z_index<L: Lanes>(r: usize) -> L {
    L::group_index() + L::splat((r * L::GROUPS) as f64)
}

/// Sums of gifts that are not yet in the grid: those of the particles of one cell, which follow each other.
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

/// Adds the weighted gifts of the first `count` particles to the grid, by way of `pending`.
///
/// # Safety
/// `grid` must hold the nodes of the window that `s` was set for, four numbers each.
#[inline(always)]
pub(super) unsafe fn scatter<L: Lanes>(
    s: &Stencils<L::Scalar>,
    gift: &P2gRow<L::Scalar>,
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
            // SAFETY: the padding of `Quads` makes four numbers readable from any of a quad.
            let wz = unsafe { L::spread_at(s.wz.of::<L>(p).add(r * L::GROUPS)) };
            let (first, along_x, along_y) = gift.first_row(p, z);
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

/// What `LANES` particles receive: four quads each.
#[repr(C, align(64))]
pub(super) struct G2pSums<T>([T; 16 * BLOCK]);

impl<T: Scalar> G2pSums<T> {
    pub(super) fn new() -> Self {
        Self([T::zero(); 16 * BLOCK])
    }

    /// Quad `quad` of all particles, number by number.
    #[inline(always)]
    pub(super) fn lanes<L: Lanes<Scalar = T>>(&self, quad: usize) -> [L; 4] {
        // Particles 4 g + q for each q, then transposed.
        let mut rows = [L::zero(); 4];
        for (q, row) in rows.iter_mut().enumerate() {
            // SAFETY: particle 15, the last that a level has, ends at 16 * BLOCK.
            *row = unsafe { L::strided_quads_at(self.0.as_ptr().add(16 * q + 4 * quad), 64) };
        }
        L::transpose(rows)
    }

    /// The matrix whose columns are the first three numbers of quads 1, 2, 3.
    #[inline(always)]
    pub(super) fn matrix<L: Lanes<Scalar = T>>(&self) -> Mat3<L> {
        let mut m = Mat3::zero();
        for j in 0..3 {
            let column = self.lanes::<L>(1 + j);
            for i in 0..3 {
                m.0[3 * i + j] = column[i];
            }
        }
        m
    }

    /// The sums of the four numbers of quads 0, 1, 2.
    #[inline(always)]
    pub(super) fn sums<L: Lanes<Scalar = T>>(&self) -> [L; 3] {
        let mut sums = [L::zero(); 3];
        for (quad, sum) in sums.iter_mut().enumerate() {
            let [a, b, c, d] = self.lanes::<L>(quad);
            *sum = (a + b) + (c + d);
        }
        sums
    }

    #[inline(always)]
    fn put<L: Lanes<Scalar = T>>(&mut self, particle: usize, rows: [L; 4]) {
        // SAFETY: 16 numbers for each of BLOCK particles.
        unsafe { L::store_group_sums_at(rows, self.0[16 * particle..16 * particle + 16].as_mut_ptr()) }
    }
}

/// Gathers, with n a node's four numbers: sum w n, and sum w n d for d the offset along x, y, z.
///
/// # Safety
/// `grid` must hold the nodes of the window that `s` was set for, four numbers each.
#[inline(always)]
pub(super) unsafe fn gather<L: Lanes>(
    s: &Stencils<L::Scalar>,
    grid: *const L::Scalar,
    window: &Window,
    received: &mut G2pSums<L::Scalar>,
) {
    for p in 0..L::LANES {
        let mut sums = [L::zero(); 4];
        for r in 0..vectors::<L>() {
            // SAFETY: see the module; the padding of `Quads`.
            let (at, wz, dz) = unsafe {
                let skip = r * L::GROUPS;
                let at = grid.add(4 * s.base[p] + r * L::LANES);
                (at, L::spread_at(s.wz.of::<L>(p).add(skip)), L::spread_at(s.dz.of::<L>(p).add(skip)))
            };
            let (mut plain, mut by_x, mut by_y) = (L::zero(), L::zero(), L::zero());
            for i in 0..3 {
                let (mut weighted, mut moment) = (L::zero(), L::zero());
                for j in 0..3 {
                    // SAFETY: see the module.
                    let node = unsafe { L::load_at(at.add(4 * window.row(3 * i + j))) };
                    weighted = node.mul_add(L::of(s.wy[j][p]), weighted);
                    moment = node.mul_add(L::of(s.my[j][p]), moment);
                }
                plain = weighted.mul_add(L::of(s.wx[i][p]), plain);
                by_x = weighted.mul_add(L::of(s.mx[i][p]), by_x);
                by_y = moment.mul_add(L::of(s.wx[i][p]), by_y);
            }
            let plain = plain * wz;
            sums[0] += plain;
            sums[1] = by_x.mul_add(wz, sums[1]);
            sums[2] = by_y.mul_add(wz, sums[2]);
            sums[3] = plain.mul_add(dz, sums[3]);
        }
        received.put(p, sums);
    }
}

/// Gathers, with n a node's four numbers and g those of the gift to it: sum of (slope of w along x, y, z) n * g, number by number, in
/// the first three quads.
///
/// # Safety
/// `grid` must hold the nodes of the window that `s` was set for, four numbers each.
#[inline(always)]
pub(super) unsafe fn gather_slopes<L: Lanes>(
    s: &Stencils<L::Scalar>,
    gift: &P2gRow<L::Scalar>,
    grid: *const L::Scalar,
    window: &Window,
    received: &mut G2pSums<L::Scalar>,
) {
    for p in 0..L::LANES {
        let mut sums = [L::zero(); 4];
        for r in 0..vectors::<L>() {
            // SAFETY: see the module; the padding of `Quads`.
            let (at, wz, sz) = unsafe {
                let skip = r * L::GROUPS;
                let at = grid.add(4 * s.base[p] + r * L::LANES);
                (at, L::spread_at(s.wz.of::<L>(p).add(skip)), L::spread_at(s.sz.of::<L>(p).add(skip)))
            };
            let (mut to, along_x, along_y) = gift.first_row(p, z_index::<L>(r));
            let (mut by_x, mut by_y, mut by_z) = (L::zero(), L::zero(), L::zero());
            for i in 0..3 {
                let (mut weighted, mut sloped) = (L::zero(), L::zero());
                let mut given = to;
                for j in 0..3 {
                    // SAFETY: see the module.
                    let node = unsafe { L::load_at(at.add(4 * window.row(3 * i + j))) };
                    let product = given * node;
                    weighted = product.mul_add(L::of(s.wy[j][p]), weighted);
                    sloped = product.mul_add(L::of(s.sy[j][p]), sloped);
                    given += along_y;
                }
                by_x = weighted.mul_add(L::of(s.sx[i][p]), by_x);
                by_y = sloped.mul_add(L::of(s.wx[i][p]), by_y);
                by_z = weighted.mul_add(L::of(s.wx[i][p]), by_z);
                to += along_x;
            }
            sums[0] = by_x.mul_add(wz, sums[0]);
            sums[1] = by_y.mul_add(wz, sums[1]);
            sums[2] = by_z.mul_add(sz, sums[2]);
        }
        received.put(p, sums);
    }
}
