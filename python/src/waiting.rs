//! Long calls: on a thread of their own, while the calling one watches for signals.

use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

use gic::Explanation;
use gic_twin::Interrupt;
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;

use crate::errors::{exception, panicked};
use crate::float_environment::set_usual;

/// How often signals are looked for.
const SIGNAL_INTERVAL: Duration = Duration::from_millis(50);

/// Runs `work` without the interpreter's lock. A signal, such as Ctrl-C, raises `interrupt`, and the call returns once
/// `work` has stopped at its next safe point; with a second one it returns at once, and `work` goes on to its safe
/// point alone.
///
/// # Errors
/// The exception of `work`'s error, or of the signal.
pub(crate) fn wait<T: Send + 'static>(
    py: Python<'_>,
    interrupt: &Interrupt,
    work: impl FnOnce() -> anyhow::Result<T> + Send + 'static,
) -> PyResult<T> {
    let (sender, mut receiver) = channel();
    thread::Builder::new().name("gic".into()).spawn(move || {
        set_usual();
        // Where nobody waits any more, the result is not wanted.
        let _ = sender.send(work());
    })?;
    let mut signal = None;
    loop {
        let waiting = &mut receiver;
        match py.detach(move || waiting.recv_timeout(SIGNAL_INTERVAL)) {
            Ok(done) => return finish(py, done, signal),
            Err(RecvTimeoutError::Disconnected) => return Err(panicked()),
            Err(RecvTimeoutError::Timeout) => {
                if let Err(raised) = py.check_signals() {
                    if signal.replace(raised.clone_ref(py)).is_some() {
                        return Err(raised);
                    }
                    interrupt.request();
                }
            }
        }
    }
}

/// As [`wait`], for work that takes too short to be interrupted.
pub(crate) fn wait_briefly<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce() -> anyhow::Result<T> + Send + 'static,
) -> PyResult<T> {
    wait(py, &Interrupt::default(), work)
}

fn finish<T>(py: Python<'_>, done: anyhow::Result<T>, signal: Option<PyErr>) -> PyResult<T> {
    match (done, signal) {
        (Ok(value), None) => Ok(value),
        (Err(error), None) => Err(exception(py, &error)),
        (Err(error), Some(signal))
            if signal.is_instance_of::<PyKeyboardInterrupt>(py) && Explanation::of(&error).is_interrupt =>
        {
            Err(exception(py, &error))
        }
        (_, Some(signal)) => Err(signal),
    }
}
