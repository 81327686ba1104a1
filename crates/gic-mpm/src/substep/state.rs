//! The state of all particles between two substeps; also the shape of its adjoint.

use core::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use crate::math::mat3::Mat3;
use gic_simd::Scalar;

/// Particles in input order. As an adjoint: the derivative of the loss with respect to each number.
#[derive(Clone, Debug)]
pub(crate) struct State<R> {
    /// Positions [m].
    pub(crate) position: Vec<[R; 3]>,
    /// Velocities [m/s].
    pub(crate) velocity: Vec<[R; 3]>,
    /// Affine velocity gradients C [1/s].
    pub(crate) affine: Vec<Mat3<R>>,
    /// (Elastic) deformation gradients F.
    pub(crate) deformation: Vec<Mat3<R>>,
}

/// Numbers per particle: x, v, C, F.
pub(crate) const NUMBERS_PER_PARTICLE: usize = 24;

impl<R: Scalar> State<R> {
    /// All zeros, as an adjoint starts.
    pub(crate) fn zeros(particles: usize) -> Self {
        Self {
            position: vec![[R::zero(); 3]; particles],
            velocity: vec![[R::zero(); 3]; particles],
            affine: vec![Mat3::zero(); particles],
            deformation: vec![Mat3::zero(); particles],
        }
    }

    /// The numbers of a particle: x, v, C, F.
    pub(crate) fn to_numbers(&self, particle: usize) -> [f64; NUMBERS_PER_PARTICLE] {
        let mut numbers = [0.0; NUMBERS_PER_PARTICLE];
        let (c, f) = (&self.affine[particle].0, &self.deformation[particle].0);
        let all = self.position[particle].iter().chain(&self.velocity[particle]).chain(c).chain(f);
        for (number, x) in numbers.iter_mut().zip(all) {
            *number = x.lane(0);
        }
        numbers
    }

    /// The reverse of [`Self::to_numbers`].
    pub(crate) fn set_numbers(&mut self, particle: usize, numbers: &[f64; NUMBERS_PER_PARTICLE]) {
        let (c, f) = (&mut self.affine[particle].0, &mut self.deformation[particle].0);
        let all = self.position[particle].iter_mut().chain(&mut self.velocity[particle]).chain(c).chain(f);
        for (x, &number) in all.zip(numbers) {
            *x = R::splat(number);
        }
    }

    /// Number of particles.
    pub(crate) fn len(&self) -> usize {
        self.position.len()
    }

    /// Bytes of a state of that many particles.
    pub(crate) fn bytes(particles: usize) -> usize {
        particles * NUMBERS_PER_PARTICLE * size_of::<R>()
    }

    /// Position of a particle [m].
    pub(crate) fn position_of(&self, particle: usize) -> DVec3 {
        double(self.position[particle])
    }

    /// Velocity of a particle [m/s].
    pub(crate) fn velocity_of(&self, particle: usize) -> DVec3 {
        double(self.velocity[particle])
    }
}

/// `f` of each particle, on several threads if asked for.
pub(crate) fn map_particles<U: Send>(
    parallel: bool,
    particles: Range<usize>,
    f: impl Fn(usize) -> U + Send + Sync,
) -> Vec<U> {
    if parallel { particles.into_par_iter().map(f).collect() } else { particles.map(f).collect() }
}

pub(crate) fn vector<R: Scalar>(v: DVec3) -> [R; 3] {
    v.to_array().map(R::splat)
}

pub(crate) fn double<R: Scalar>(v: [R; 3]) -> DVec3 {
    DVec3::from_array(v.map(|x| x.lane(0)))
}
