//! Which lanes this machine has, and running a kernel on them.

use core::fmt;
use std::sync::OnceLock;

use crate::Lanes;
use crate::packed::Packed;

/// The environment variable that forces a level.
const LEVEL_VARIABLE: &str = "GIC_SIMD";

/// A set of SIMD instructions, ascending in width.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// Four plain `f32`, nothing fused: works everywhere; the twin that the others are tested against.
    Scalar,
    /// Four `f32` with NEON.
    Neon,
    /// Eight `f32` with AVX2 and FMA.
    Avx2,
    /// Sixteen `f32` with AVX-512F.
    Avx512,
}

/// Why a level that was asked for cannot be had.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LevelError {
    /// There is no such level.
    Unknown(String),
    /// This machine does not have the instructions.
    Unsupported(Level),
}

impl fmt::Display for LevelError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            LevelError::Unknown(name) => {
                write!(f, "{LEVEL_VARIABLE}={name}: no such level; choose scalar, neon, avx2 or avx512, or unset it")
            }
            LevelError::Unsupported(level) => {
                let best = Level::detect();
                write!(
                    f,
                    "{LEVEL_VARIABLE}={level}: this machine does not have these instructions; the best it has is {best}"
                )
            }
        }
    }
}

impl core::error::Error for LevelError {}

impl fmt::Display for Level {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Level::Scalar => "scalar",
            Level::Neon => "neon",
            Level::Avx2 => "avx2",
            Level::Avx512 => "avx512",
        })
    }
}

impl Level {
    /// All levels, narrowest first.
    pub const ALL: [Level; 4] = [Level::Scalar, Level::Neon, Level::Avx2, Level::Avx512];

    /// Whether this machine has the instructions.
    pub fn is_supported(self) -> bool {
        match self {
            Level::Scalar => true,
            #[cfg(target_arch = "aarch64")]
            Level::Neon => std::arch::is_aarch64_feature_detected!("neon"),
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma"),
            // The kernels compiled for AVX-512 may also use AVX2 and FMA.
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 => Level::Avx2.is_supported() && std::arch::is_x86_feature_detected!("avx512f"),
            #[allow(unreachable_patterns)]
            _ => false,
        }
    }

    /// The levels that this machine has, narrowest first.
    pub fn supported() -> impl Iterator<Item = Level> {
        Self::ALL.into_iter().filter(|level| level.is_supported())
    }

    /// The widest level that this machine has.
    pub fn detect() -> Level {
        Self::supported().last().unwrap_or(Level::Scalar)
    }

    /// The level that `GIC_SIMD` asks for, or the widest if it is not set.
    ///
    /// # Errors
    /// When the variable's value is no level, or one that this machine does not have.
    pub fn from_env() -> Result<Level, LevelError> {
        match std::env::var_os(LEVEL_VARIABLE) {
            None => Ok(Self::detect()),
            Some(name) => Self::named(&name.to_string_lossy()),
        }
    }

    /// The level that everything in this process uses: [`Level::from_env`] at the first call.
    ///
    /// # Panics
    /// When the environment asks for a level that cannot be had; a program reports the error of [`Level::from_env`]
    /// first.
    pub fn active() -> Level {
        static ACTIVE: OnceLock<Level> = OnceLock::new();
        *ACTIVE.get_or_init(|| Self::from_env().unwrap_or_else(|error| panic!("{error}")))
    }

    fn named(name: &str) -> Result<Level, LevelError> {
        let level = Self::ALL.into_iter().find(|level| level.to_string() == name);
        let level = level.ok_or_else(|| LevelError::Unknown(name.to_owned()))?;
        if level.is_supported() { Ok(level) } else { Err(LevelError::Unsupported(level)) }
    }
}

/// Code that runs over any lanes of `T`; write `run` with `#[inline(always)]`, all that it calls likewise.
pub trait Kernel<T = f32> {
    /// What the kernel returns.
    type Output;
    /// Runs the kernel with lanes `L`.
    fn run<L: Lanes<Scalar = T>>(self) -> Self::Output;
}

/// Runs a kernel with the lanes of a level.
///
/// # Panics
/// If the machine does not have the level; [`Level::active`] and [`Level::supported`] give only those that it has.
#[inline]
pub fn dispatch<K: Kernel>(level: Level, kernel: K) -> K::Output {
    assert!(level.is_supported(), "this machine does not have {level}");
    match level {
        // SAFETY: the machine has the instructions, as was just asserted.
        #[cfg(target_arch = "aarch64")]
        Level::Neon => unsafe { with_neon(kernel) },
        // SAFETY: the machine has the instructions, as was just asserted.
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => unsafe { with_avx2(kernel) },
        // SAFETY: the machine has the instructions, as was just asserted.
        #[cfg(target_arch = "x86_64")]
        Level::Avx512 => unsafe { with_avx512(kernel) },
        _ => kernel.run::<Packed<[f32; 4]>>(),
    }
}

/// Runs a kernel on f64, four at a time without SIMD: what the other levels are measured against.
pub fn oracle<K: Kernel<f64>>(kernel: K) -> K::Output {
    kernel.run::<Packed<[f64; 4]>>()
}

#[cfg(target_arch = "aarch64")]
#[target_feature(enable = "neon")]
fn with_neon<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<Packed<core::arch::aarch64::float32x4_t>>()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn with_avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<Packed<core::arch::x86_64::__m256>>()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,avx512f")]
fn with_avx512<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<Packed<core::arch::x86_64::__m512>>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_level_that_cannot_be_had_is_a_clear_error() {
        assert_eq!(Level::named("scalar"), Ok(Level::Scalar));
        let error = Level::named("sse9").unwrap_err();
        assert!(error.to_string().contains("sse9") && error.to_string().contains("avx2"), "{error}");
        for level in Level::ALL {
            assert_eq!(Level::named(&level.to_string()).is_ok(), level.is_supported());
        }
        // No machine has both.
        assert!(!(Level::Neon.is_supported() && Level::Avx2.is_supported()));
    }

    struct CountLanes;

    impl Kernel for CountLanes {
        type Output = usize;
        fn run<L: Lanes<Scalar = f32>>(self) -> usize {
            L::LANES
        }
    }

    #[test]
    fn the_widest_level_is_detected() {
        let widest = Level::supported().map(|level| dispatch(level, CountLanes)).max();
        assert_eq!(Some(dispatch(Level::detect(), CountLanes)), widest);
    }
}
