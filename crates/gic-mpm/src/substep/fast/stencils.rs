//! Between lanes of particles and rows of nodes.
//!
//! Four nodes in a row along z, each (x, y, z, mass), are 16 numbers: one vector of AVX-512, two of AVX2, four of NEON.
//! A particle touches nine such rows (of the fourth node it touches nothing, its weight is zero).
//!
//! SAFETY of the pointers in this folder: a stencil's base index is clamped by [`Stencils::set`] so that all nine rows
//! lie in the grid of the [`Window`] that it was made for, whatever the particle's position (also NaN); callers pass
//! grids of at least that size.

use gic_simd::{Lanes, Scalar};

use super::block::BLOCK;
use crate::substep::stencil;

/// Four numbers per particle, for up to 16 particles, as [`Lanes::transpose`] leaves them. The end is padding: rows are
/// read past a particle's own four numbers.
#[repr(C, align(64))]
pub(super) struct Quads<T>([T; 4 * BLOCK + 4]);

impl<T: Scalar> Quads<T> {
    pub(super) fn zero() -> Self {
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
    pub(super) fn of<L: Lanes<Scalar = T>>(&self, particle: usize) -> *const T {
        // Result q of a transpose holds particles 4 g + q in its groups g.
        let at = (particle % 4) * L::LANES + particle / 4 * 4;
        self.0[at..at + 4].as_ptr()
    }

    /// The quad of a particle as the nodes of vector `r` of a row see it: group g is filled with number
    /// `r * GROUPS + g`.
    #[inline(always)]
    pub(super) fn along_row<L: Lanes<Scalar = T>>(&self, particle: usize, r: usize) -> L {
        debug_assert!(r < vectors::<L>());
        // SAFETY: the padding makes four numbers readable from any of a quad.
        unsafe { L::spread_at(self.of::<L>(particle).add(r * L::GROUPS)) }
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
    pub(super) fn row(&self, row: usize) -> usize {
        row / 3 * self.plane() + row % 3 * self.size[2]
    }
}

/// The stencils of `LANES` particles.
pub(super) struct Stencils<T> {
    /// Index of the first node in the window.
    pub(super) base: [usize; BLOCK],
    pub(super) wx: [[T; BLOCK]; 3],
    pub(super) wy: [[T; BLOCK]; 3],
    /// Weights times the node's offset from the particle.
    pub(super) mx: [[T; BLOCK]; 3],
    pub(super) my: [[T; BLOCK]; 3],
    /// Slopes of the weights.
    pub(super) sx: [[T; BLOCK]; 3],
    pub(super) sy: [[T; BLOCK]; 3],
    /// Products of the weights along x and y, by row.
    pub(super) wxy: [[T; BLOCK]; 9],
    pub(super) wz: Quads<T>,
    pub(super) sz: Quads<T>,
    /// Offsets along z.
    pub(super) dz: Quads<T>,
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

    /// Computes the stencils of particles at `position`. Returns their offsets from the base nodes, in units of dx, and
    /// a flag for each that is set where the stencil lies in the window.
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

/// Vectors per row.
pub(super) const fn vectors<L: Lanes>() -> usize {
    4 / L::GROUPS
}

/// The z indices of the nodes in vector `r` of a row.
#[inline(always)]
pub(super) fn z_index<L: Lanes>(r: usize) -> L {
    L::group_index() + L::splat((r * L::GROUPS) as f64)
}
