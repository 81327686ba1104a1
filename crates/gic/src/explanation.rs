//! An error as a user is told of it.

use std::error::Error as StdError;

use gic_mpm::SimulationError;
use gic_scene::SceneError;
use gic_twin::TwinError;
use gic_view::ViewError;

use crate::Error;

/// What went wrong, why, and the way out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Explanation {
    /// The error.
    pub message: String,
    /// Its causes, the nearest first, but for those that the message before repeats.
    pub causes: Vec<String>,
    /// The way out, where one is known.
    pub hint: Option<String>,
    /// Whether the user interrupted.
    pub is_interrupt: bool,
    /// Whether the command was wrong, whatever its files hold.
    pub is_usage: bool,
}

impl Explanation {
    /// Of an error with its causes.
    pub fn of(error: &anyhow::Error) -> Self {
        let message = error.to_string();
        let mut last = message.clone();
        let mut causes = Vec::new();
        for cause in error.chain().skip(1).map(ToString::to_string) {
            // Some libraries repeat their cause in their own message.
            if !last.contains(&cause) {
                causes.push(cause.clone());
            }
            last = cause;
        }
        let is_interrupt = error.chain().any(is_interrupt);
        let is_usage = error.chain().any(is_usage);
        Self { message, causes, hint: error.chain().find_map(hint), is_interrupt, is_usage }
    }
}

/// Whether the user interrupted.
fn is_interrupt(error: &(dyn StdError + 'static)) -> bool {
    error.downcast_ref::<Error>().is_some_and(Error::is_interrupt)
        || error.downcast_ref::<TwinError>().is_some_and(TwinError::is_interrupt)
        || error.downcast_ref::<ViewError>().is_some_and(ViewError::is_interrupt)
        || error.downcast_ref::<SimulationError>().is_some_and(|error| *error == SimulationError::Interrupted)
}

/// Whether the command was wrong, whatever its files hold.
fn is_usage(error: &(dyn StdError + 'static)) -> bool {
    error.downcast_ref::<Error>().is_some_and(Error::is_usage)
        || error.downcast_ref::<SceneError>().is_some_and(|error| matches!(error, SceneError::Setting { .. }))
}

/// The way out of an error, where it knows one.
fn hint(error: &(dyn StdError + 'static)) -> Option<String> {
    let pipeline = error.downcast_ref::<Error>().and_then(Error::hint);
    let twin = || error.downcast_ref::<TwinError>().and_then(TwinError::hint);
    let view = || error.downcast_ref::<ViewError>().and_then(ViewError::hint);
    pipeline.or_else(twin).or_else(view)
}
