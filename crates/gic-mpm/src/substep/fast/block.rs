//! Blocks of particles: 16 of them, number by number, so that lanes load what they need in one piece.

use core::array;
use core::marker::PhantomData;

use gic_simd::{Lanes, MAX_LANES, Scalar};

use crate::math::mat3::Mat3;
use crate::substep::state::{NUMBERS_PER_PARTICLE, State};

/// Particles per block, on every level.
pub(super) const BLOCK: usize = MAX_LANES;

/// The numbers of 16 particles (or their adjoints): x, v, C, F, each for all 16.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct Block<T>([[T; BLOCK]; NUMBERS_PER_PARTICLE]);

/// Where each number of a particle starts.
const VELOCITY: usize = 3;
const AFFINE: usize = 6;
const DEFORMATION: usize = 15;

impl<T: Scalar> Block<T> {
    pub(super) fn zero() -> Self {
        Self([[T::zero(); BLOCK]; NUMBERS_PER_PARTICLE])
    }

    /// Lanes of number `number`, from particle `at` of the block on.
    #[inline(always)]
    fn get<L: Lanes<Scalar = T>>(&self, number: usize, at: usize) -> L {
        L::load(&self.0[number][at..])
    }

    #[inline(always)]
    fn put<L: Lanes<Scalar = T>>(&mut self, number: usize, at: usize, value: L) {
        value.store(&mut self.0[number][at..]);
    }

    #[inline(always)]
    fn get_vector<L: Lanes<Scalar = T>>(&self, first: usize, at: usize) -> [L; 3] {
        [self.get(first, at), self.get(first + 1, at), self.get(first + 2, at)]
    }

    #[inline(always)]
    fn put_vector<L: Lanes<Scalar = T>>(&mut self, first: usize, at: usize, value: [L; 3]) {
        for i in 0..3 {
            self.put(first + i, at, value[i]);
        }
    }

    #[inline(always)]
    fn get_matrix<L: Lanes<Scalar = T>>(&self, first: usize, at: usize) -> Mat3<L> {
        let mut m = Mat3::zero();
        for i in 0..9 {
            m.0[i] = self.get(first + i, at);
        }
        m
    }

    #[inline(always)]
    fn put_matrix<L: Lanes<Scalar = T>>(&mut self, first: usize, at: usize, value: &Mat3<L>) {
        for i in 0..9 {
            self.put(first + i, at, value.0[i]);
        }
    }

    #[inline(always)]
    pub(super) fn position<L: Lanes<Scalar = T>>(&self, at: usize) -> [L; 3] {
        self.get_vector(0, at)
    }

    #[inline(always)]
    pub(super) fn set_position<L: Lanes<Scalar = T>>(&mut self, at: usize, value: [L; 3]) {
        self.put_vector(0, at, value);
    }

    #[inline(always)]
    pub(super) fn velocity<L: Lanes<Scalar = T>>(&self, at: usize) -> [L; 3] {
        self.get_vector(VELOCITY, at)
    }

    #[inline(always)]
    pub(super) fn set_velocity<L: Lanes<Scalar = T>>(&mut self, at: usize, value: [L; 3]) {
        self.put_vector(VELOCITY, at, value);
    }

    #[inline(always)]
    pub(super) fn affine<L: Lanes<Scalar = T>>(&self, at: usize) -> Mat3<L> {
        self.get_matrix(AFFINE, at)
    }

    #[inline(always)]
    pub(super) fn set_affine<L: Lanes<Scalar = T>>(&mut self, at: usize, value: &Mat3<L>) {
        self.put_matrix(AFFINE, at, value);
    }

    #[inline(always)]
    pub(super) fn deformation<L: Lanes<Scalar = T>>(&self, at: usize) -> Mat3<L> {
        self.get_matrix(DEFORMATION, at)
    }

    #[inline(always)]
    pub(super) fn set_deformation<L: Lanes<Scalar = T>>(&mut self, at: usize, value: &Mat3<L>) {
        self.put_matrix(DEFORMATION, at, value);
    }

    /// Copies the particles `order` of a state (or adjoint) into blocks; the places left in the last block repeat the
    /// last particle.
    pub(super) fn gather(state: &State<T>, order: &[u32]) -> Vec<Self> {
        let mut blocks = vec![Self::zero(); order.len().div_ceil(BLOCK)];
        for (chunk, block) in order.chunks(BLOCK).zip(&mut blocks) {
            for at in 0..BLOCK {
                block.set_particle(at, state, chunk[at.min(chunk.len() - 1)] as usize);
            }
        }
        blocks
    }

    fn set_particle(&mut self, at: usize, state: &State<T>, p: usize) {
        for i in 0..3 {
            self.0[i][at] = state.position[p][i];
            self.0[VELOCITY + i][at] = state.velocity[p][i];
        }
        for i in 0..9 {
            self.0[AFFINE + i][at] = state.affine[p].0[i];
            self.0[DEFORMATION + i][at] = state.deformation[p].0[i];
        }
    }

    /// The reverse of [`Self::gather`].
    ///
    /// # Safety
    /// `order` must hold particles of the state that no other thread is writing.
    pub(super) unsafe fn scatter(blocks: &[Self], order: &[u32], state: &SharedState<T>) {
        for (slot, &particle) in order.iter().enumerate() {
            let (block, at, p) = (&blocks[slot / BLOCK], slot % BLOCK, particle as usize);
            let vector = |first: usize| array::from_fn(|i| block.0[first + i][at]);
            let matrix = |first: usize| Mat3(array::from_fn(|i| block.0[first + i][at]));
            // SAFETY: as the caller says.
            unsafe {
                *state.position.add(p) = vector(0);
                *state.velocity.add(p) = vector(VELOCITY);
                *state.affine.add(p) = matrix(AFFINE);
                *state.deformation.add(p) = matrix(DEFORMATION);
            }
        }
    }
}

/// A state that several threads write, each the particles that it owns.
pub(super) struct SharedState<'a, T> {
    position: *mut [T; 3],
    velocity: *mut [T; 3],
    affine: *mut Mat3<T>,
    deformation: *mut Mat3<T>,
    borrowed: PhantomData<&'a mut State<T>>,
}

// SAFETY: writing through it is left to callers of unsafe functions.
unsafe impl<T: Send> Sync for SharedState<'_, T> {}

impl<'a, T> SharedState<'a, T> {
    pub(super) fn new(state: &'a mut State<T>) -> Self {
        Self {
            position: state.position.as_mut_ptr(),
            velocity: state.velocity.as_mut_ptr(),
            affine: state.affine.as_mut_ptr(),
            deformation: state.deformation.as_mut_ptr(),
            borrowed: PhantomData,
        }
    }
}
