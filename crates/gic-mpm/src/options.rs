//! How a world is simulated, as opposed to what is.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use gic_simd::Level;
use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::{Budget, Rules, SimulationError};

/// The numbers that a simulation computes with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// Single precision, on SIMD lanes: fast.
    #[default]
    F32,
    /// Double precision, one particle at a time: the oracle.
    F64,
}

/// A ball of space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ball {
    /// Its centre [m].
    pub centre_m: DVec3,
    /// Its radius [m].
    pub radius_m: f64,
}

/// How to compute a simulation. What it computes is in [`crate::World`].
#[derive(Clone, Debug)]
pub struct Options {
    /// Numbers to compute with.
    pub precision: Precision,
    /// SIMD level of the f32 engine; `None` takes [`Level::active`]: the best of the machine, or what `GIC_SIMD` says.
    pub level: Option<Level>,
    /// Computes f32 with the readable one-particle-at-a-time engine, to compare with.
    pub twin: bool,
    /// Whose numerics the laws follow.
    pub rules: Rules,
    /// Most memory [bytes] that the states kept for a gradient may take.
    pub gradient_memory_bytes: usize,
    /// Most that a simulation may take; one that is forecast to take more is refused.
    pub budget: Budget,
    /// Where all particles stay. One that leaves it ends the simulation with [`SimulationError::LeftDomain`]: a body
    /// that flies apart would need an ever larger grid. `None` is everywhere.
    pub domain: Option<Ball>,
    /// Whether a single rollout may use more than one thread. The result does not depend on it.
    pub parallel: bool,
    /// A flag that, once raised, ends rollouts and gradients with [`SimulationError::Interrupted`] at their next frame
    /// or segment.
    pub interrupt: Option<Arc<AtomicBool>>,
}

impl Options {
    /// # Errors
    /// [`SimulationError::Interrupted`] once the flag is raised.
    pub(crate) fn check_interrupt(&self) -> Result<(), SimulationError> {
        let is_raised = self.interrupt.as_ref().is_some_and(|flag| flag.load(Ordering::SeqCst));
        if is_raised { Err(SimulationError::Interrupted) } else { Ok(()) }
    }
}

impl Default for Options {
    fn default() -> Self {
        Self {
            precision: Precision::default(),
            level: None,
            twin: false,
            rules: Rules::default(),
            gradient_memory_bytes: 1 << 30,
            budget: Budget::default(),
            domain: None,
            parallel: true,
            interrupt: None,
        }
    }
}
