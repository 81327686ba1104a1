//! The stream of events of a command. Progress bars, `log.jsonl` and the report read it.

use std::collections::BTreeMap;
use std::sync::Mutex;

use serde::{Deserialize, Serialize};

/// One event, in the form that `log.jsonl` keeps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Event {
    /// A command begins.
    Started {
        /// The command and its main inputs.
        command: String,
        /// Version of gic.
        gic_version: String,
    },
    /// A stage begins.
    StageStarted {
        /// The stage.
        stage: String,
        /// Why it runs: nothing there yet, or what changed.
        reason: String,
    },
    /// A stage is up to date and does not run.
    StageSkipped {
        /// The stage.
        stage: String,
        /// Why not.
        reason: String,
    },
    /// One more step inside a stage.
    Step {
        /// The stage.
        stage: String,
        /// Phase inside the stage, such as `warm-up` or `velocity`; empty where there is only one.
        phase: String,
        /// Steps finished.
        step: u64,
        /// Steps in all, where known.
        of: Option<u64>,
        /// Named numbers: loss, PSNR, parameter values.
        values: BTreeMap<String, f64>,
    },
    /// Something worth knowing.
    Note {
        /// The stage.
        stage: String,
        /// The sentence.
        text: String,
    },
    /// Something that may spoil the result.
    Warning {
        /// The stage.
        stage: String,
        /// The sentence, with the way out.
        text: String,
    },
    /// A stage is finished.
    StageDone {
        /// The stage.
        stage: String,
        /// Wall-clock seconds.
        seconds: f64,
        /// CPU seconds over all threads, where the system counts them.
        cpu_seconds: Option<f64>,
        /// Peak resident memory during the stage [bytes], where the system counts them.
        peak_memory_bytes: Option<u64>,
    },
    /// The command ends in failure.
    Failed {
        /// The error and its causes, one line each.
        causes: Vec<String>,
    },
}

/// A listener.
pub trait Sink: Send {
    /// Receives one event; must not fail, whatever happens to its own output.
    fn receive(&mut self, event: &Event);
}

/// The stream: stages write into it, sinks receive each event in that order.
#[derive(Default)]
pub struct Events {
    sinks: Mutex<Vec<Box<dyn Sink>>>,
}

impl Events {
    /// A stream without listeners.
    pub fn silent() -> Self {
        Self::default()
    }

    /// Adds a listener.
    pub fn add(&self, sink: impl Sink + 'static) {
        self.lock().push(Box::new(sink));
    }

    /// Sends one event to all listeners.
    pub fn send(&self, event: &Event) {
        for sink in self.lock().iter_mut() {
            sink.receive(event);
        }
    }

    /// Sends an [`Event::Note`].
    pub fn note(&self, stage: &str, text: impl Into<String>) {
        self.send(&Event::Note { stage: stage.into(), text: text.into() });
    }

    /// Sends an [`Event::Warning`].
    pub fn warn(&self, stage: &str, text: impl Into<String>) {
        self.send(&Event::Warning { stage: stage.into(), text: text.into() });
    }

    /// Sends an [`Event::Step`].
    pub fn step(&self, stage: &str, phase: &str, step: u64, of: Option<u64>, values: &[(&str, f64)]) {
        self.send(&Event::Step {
            stage: stage.into(),
            phase: phase.into(),
            step,
            of,
            // JSON has no NaN; a value that is not a number is left out rather than written as null.
            values: values.iter().filter(|v| v.1.is_finite()).map(|v| (v.0.to_owned(), v.1)).collect(),
        });
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Vec<Box<dyn Sink>>> {
        // A sink that panicked has lost its own output only; the others go on.
        self.sinks.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}
