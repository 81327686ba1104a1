//! A request to stop, seen by long computations at their next safe point.

use std::fmt::Display;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::error::{Result, TwinError};

/// A flag that a signal handler raises and that stages poll between steps. Clones share the flag.
#[derive(Clone, Debug, Default)]
pub struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Requests a stop.
    pub fn request(&self) {
        self.0.store(true, Ordering::SeqCst);
    }

    /// Whether a stop is requested.
    pub fn requested(&self) -> bool {
        self.0.load(Ordering::SeqCst)
    }

    /// Ends work that a repeated command does anew.
    ///
    /// # Errors
    /// [`TwinError::Interrupted`] after `after`, the last part that was finished, where a stop is requested.
    pub fn check(&self, after: impl Display) -> Result<()> {
        if !self.requested() {
            return Ok(());
        }
        Err(TwinError::Interrupted { after: after.to_string(), resume: "run the same command again".into() })
    }

    /// The flag itself, for crates that poll an atomic.
    pub fn flag(&self) -> &Arc<AtomicBool> {
        &self.0
    }
}
