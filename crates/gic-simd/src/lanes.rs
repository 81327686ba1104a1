//! Lanes that load, store, and work on groups of four.

use crate::{Real, Scalar};

/// The most lanes that a level has: the size for buffers that must fit every level.
pub const MAX_LANES: usize = 16;

/// Code over lanes that is compiled as a function of its own; write `run` with `#[inline(always)]`, all that it calls
/// likewise.
pub trait Call {
    /// What it returns.
    type Output;
    /// Runs it.
    fn run(self) -> Self::Output;
}

/// A fixed number of numbers at once, which also know memory and groups of four.
///
/// The lanes are seen in two ways: as [`Real::LANES`] independent numbers, or as [`Lanes::GROUPS`] groups ("quads") of
/// four neighbours. Particles go through the first, grid nodes (momentum x, y, z and mass) through the second;
/// [`Lanes::transpose`] turns one into the other.
pub trait Lanes: Real {
    /// What one lane holds.
    type Scalar: Scalar;
    /// Number of groups of four, 1, 2 or 4: `LANES / 4`.
    const GROUPS: usize;

    /// Runs `call` in a function of its own with the instructions of these lanes. For long code: a kernel that has
    /// several such pieces, or uses one in several places, compiles in a fraction of the time and keeps its own
    /// registers.
    fn outlined<C: Call>(call: C) -> C::Output;

    /// The same number in every lane.
    fn of(value: Self::Scalar) -> Self;

    /// Loads `LANES` numbers.
    ///
    /// # Safety
    /// `from` must be readable for `LANES` numbers; it need not be aligned beyond a number's own alignment.
    unsafe fn load_at(from: *const Self::Scalar) -> Self;

    /// Stores `LANES` numbers.
    ///
    /// # Safety
    /// `to` must be writable for `LANES` numbers; it need not be aligned beyond a number's own alignment.
    unsafe fn store_at(self, to: *mut Self::Scalar);

    /// The four numbers at `from`, in every group.
    ///
    /// # Safety
    /// `from` must be readable for 4 numbers.
    unsafe fn quad_at(from: *const Self::Scalar) -> Self;

    /// Group g filled with the number at `from + g`.
    ///
    /// # Safety
    /// `from` must be readable for 4 numbers, whatever `GROUPS` is.
    unsafe fn spread_at(from: *const Self::Scalar) -> Self;

    /// Group g is the four numbers at `from + g * stride`.
    ///
    /// # Safety
    /// `from + g * stride` must be readable for 4 numbers, for each group g.
    unsafe fn strided_quads_at(from: *const Self::Scalar, stride: usize) -> Self;

    /// Transposes the 4x4 block of each group: element k of group g of result q is element q of group g of row k.
    ///
    /// With rows of particles (x, y, z, m), group g of result q holds (x, y, z, m) of particle `4 g + q`. Its own
    /// inverse.
    fn transpose(rows: [Self; 4]) -> [Self; 4];

    /// Sums over the groups: numbers 4 q .. 4 q + 4 of the result are the sum of the groups of `rows[q]`.
    ///
    /// # Safety
    /// `to` must be writable for 16 numbers.
    unsafe fn store_group_sums_at(rows: [Self; 4], to: *mut Self::Scalar);

    /// Loads from the start of a slice.
    ///
    /// # Panics
    /// If it has fewer than `LANES` numbers.
    #[inline(always)]
    fn load(from: &[Self::Scalar]) -> Self {
        assert!(from.len() >= Self::LANES, "slice shorter than the lanes");
        // SAFETY: the slice has LANES numbers.
        unsafe { Self::load_at(from.as_ptr()) }
    }

    /// Stores at the start of a slice.
    ///
    /// # Panics
    /// If it has room for fewer than `LANES` numbers.
    #[inline(always)]
    fn store(self, to: &mut [Self::Scalar]) {
        assert!(to.len() >= Self::LANES, "slice shorter than the lanes");
        // SAFETY: the slice has room for LANES numbers.
        unsafe { self.store_at(to.as_mut_ptr()) }
    }

    /// Loads what a slice has, up to `LANES` numbers; `missing` in the other lanes.
    #[inline(always)]
    fn load_partial(from: &[Self::Scalar], missing: Self::Scalar) -> Self {
        let mut all = [missing; MAX_LANES];
        let count = from.len().min(Self::LANES);
        all[..count].copy_from_slice(&from[..count]);
        Self::load(&all)
    }

    /// Stores the first lanes, as many as the slice holds.
    #[inline(always)]
    fn store_partial(self, to: &mut [Self::Scalar]) {
        let mut all = [Self::Scalar::default(); MAX_LANES];
        self.store(&mut all);
        let count = to.len().min(Self::LANES);
        to[..count].copy_from_slice(&all[..count]);
    }

    /// Group g filled with `from[g]`.
    #[inline(always)]
    fn spread(from: &[Self::Scalar; 4]) -> Self {
        // SAFETY: the array has four numbers.
        unsafe { Self::spread_at(from.as_ptr()) }
    }

    /// The lanes' own numbers 0, 1, 2 ...
    #[inline(always)]
    fn lane_index() -> Self {
        let mut index = [Self::Scalar::default(); MAX_LANES];
        for (i, to) in index.iter_mut().enumerate() {
            *to = Self::Scalar::from_f64(i as f64);
        }
        Self::load(&index)
    }

    /// The groups' own numbers: 0 four times, 1 four times ...
    #[inline(always)]
    fn group_index() -> Self {
        Self::spread(&[0.0, 1.0, 2.0, 3.0].map(Self::Scalar::from_f64))
    }
}
