//! What every command gets, and where its results go.

use std::io::{ErrorKind, Write};
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use gic_twin::Interrupt;
use gic_twin::events::Events;

use super::flags::Given;
use crate::Error;

/// What a command needs from the outside.
pub(crate) struct Context {
    pub(crate) events: Events,
    pub(crate) interrupt: Interrupt,
    /// What the command line gives to the command.
    pub(crate) given: Given,
    /// The file to call for gic itself.
    pub(crate) program: PathBuf,
    /// Threads, where the command line says so.
    pub(crate) threads: Option<usize>,
    /// Where results go.
    pub(super) output: Output,
}

impl Context {
    /// Prints a result; `-q` does not silence results, only the way there.
    ///
    /// # Errors
    /// What the system says, such as that the disk is full; a closed pipe (`gic ... | head`) is no failure.
    pub(crate) fn print(&self, text: impl std::fmt::Display) -> crate::Result<()> {
        self.output.line(&text.to_string())
    }
}

/// Where results go.
pub(super) enum Output {
    Stdout,
    /// Into a text, for a caller inside the process.
    Text(Mutex<String>),
}

impl Output {
    fn line(&self, line: &str) -> crate::Result<()> {
        match self {
            Self::Stdout => {
                let mut out = std::io::stdout();
                match writeln!(out, "{line}").and_then(|()| out.flush()) {
                    Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(Error::Print { source: error }),
                    _ => Ok(()),
                }
            }
            Self::Text(text) => {
                let mut text = text.lock().unwrap_or_else(PoisonError::into_inner);
                text.push_str(line);
                text.push('\n');
                Ok(())
            }
        }
    }

    /// The text; empty where results went to stdout.
    pub(super) fn into_text(self) -> String {
        match self {
            Self::Stdout => String::new(),
            Self::Text(text) => text.into_inner().unwrap_or_else(PoisonError::into_inner),
        }
    }
}
