//! The program's commands: as the command `gic`, and called from Python.

use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use gic_twin::Interrupt;
use gic_twin::events::{Event, Events, Sink};
use pyo3::prelude::*;

use crate::waiting::wait;

/// Runs the command `gic` with these words, the first of which is the program's file, and returns the exit code.
#[pyfunction]
pub(crate) fn cli(py: Python<'_>, words: Vec<OsString>) -> u8 {
    let program = words.first().map(PathBuf::from).unwrap_or_else(|| "gic".into());
    py.detach(|| gic::cli::main(words, program))
}

/// Runs a command and returns what the terminal would show on stdout. `on_event` gets every event as JSON, in the form
/// of `log.jsonl`.
#[pyfunction]
#[pyo3(signature = (words, on_event=None))]
pub(crate) fn call(py: Python<'_>, words: Vec<OsString>, on_event: Option<Py<PyAny>>) -> PyResult<String> {
    let (events, interrupt) = (Events::default(), Interrupt::default());
    let failure = Arc::new(Mutex::new(None));
    if let Some(callback) = on_event {
        events.add(Callback { callback, failure: failure.clone(), interrupt: interrupt.clone() });
    }
    let flag = interrupt.clone();
    let done = wait(py, &interrupt, move || gic::cli::call(words, events, flag));
    let failed = failure.lock().unwrap_or_else(PoisonError::into_inner).take();
    failed.map_or(done, Err)
}

/// A Python function that listens to events. Where it raises, the command stops, and the call raises the same.
struct Callback {
    callback: Py<PyAny>,
    failure: Arc<Mutex<Option<PyErr>>>,
    interrupt: Interrupt,
}

impl Sink for Callback {
    fn receive(&mut self, event: &Event) {
        // An event is made of texts and finite numbers.
        let Ok(text) = gic_twin::json::text(event) else { return };
        if let Err(error) = Python::attach(|py| self.callback.call1(py, (text,))) {
            self.failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
            self.interrupt.request();
        }
    }
}
