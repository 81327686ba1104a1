//! Small matrices over any [`gic_simd::Real`].

pub(crate) mod eigen;
pub(crate) mod mat3;
