//! Rows of nodes to particles: the inner loop of g2p and of both adjoints. SAFETY of the pointers: see
//! [`super::stencils`].

use gic_simd::{Lanes, Scalar};

use super::block::BLOCK;
use super::scatter::P2gRow;
use super::stencils::{Stencils, Window, vectors, z_index};
use crate::math::mat3::Mat3;

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
    particle_sums: &mut G2pSums<L::Scalar>,
) {
    for p in 0..L::LANES {
        let mut sums = [L::zero(); 4];
        for r in 0..vectors::<L>() {
            // SAFETY: see the module.
            let at = unsafe { grid.add(4 * s.base[p] + r * L::LANES) };
            let (wz, dz) = (s.wz.along_row(p, r), s.dz.along_row(p, r));
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
        particle_sums.put(p, sums);
    }
}

/// Gathers, with n a node's four numbers and g those of the P2G row at it: sum of (slope of w along x, y, z) n * g,
/// number by number, in the first three quads.
///
/// # Safety
/// `grid` must hold the nodes of the window that `s` was set for, four numbers each.
#[inline(always)]
pub(super) unsafe fn gather_slopes<L: Lanes>(
    s: &Stencils<L::Scalar>,
    p2g_row: &P2gRow<L::Scalar>,
    grid: *const L::Scalar,
    window: &Window,
    particle_sums: &mut G2pSums<L::Scalar>,
) {
    for p in 0..L::LANES {
        let mut sums = [L::zero(); 4];
        for r in 0..vectors::<L>() {
            // SAFETY: see the module.
            let at = unsafe { grid.add(4 * s.base[p] + r * L::LANES) };
            let (wz, sz) = (s.wz.along_row(p, r), s.sz.along_row(p, r));
            let (mut to, along_x, along_y) = p2g_row.first_row(p, z_index::<L>(r));
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
        particle_sums.put(p, sums);
    }
}
