//! One substep, forward and backward.
//!
//! [`scalar`] is the readable engine, with the equations; [`fast`] is the same over SIMD lanes and threads.

pub(crate) mod engine;
pub(crate) mod fast;
pub(crate) mod grid;
pub(crate) mod grid_update;
pub(crate) mod prepared_world;
pub(crate) mod scalar;
pub(crate) mod state;
pub(crate) mod stencil;
#[cfg(test)]
mod tests;
pub(crate) mod violation;

/// Runs an expression with `$engine` bound to the engine that the options ask for.
macro_rules! with_engine {
    ($options:expr, $engine:ident => $body:expr) => {
        match $options.precision {
            crate::options::Precision::F64 => {
                let $engine = crate::substep::scalar::ScalarEngine::<f64>::new();
                $body
            }
            crate::options::Precision::F32 if $options.twin => {
                let $engine = crate::substep::scalar::ScalarEngine::<f32>::new();
                $body
            }
            crate::options::Precision::F32 => {
                let level = $options.level.unwrap_or_else(gic_simd::Level::active);
                let $engine = crate::substep::fast::FastEngine::<f32>::new(level, $options.parallel);
                $body
            }
        }
    };
}
pub(crate) use with_engine;
