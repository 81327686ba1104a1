//! The program's errors as exceptions of `gic.errors`.

use gic::Explanation;
use gic_mpm::SimulationError;
use gic_scene::SceneError;
use gic_splat::{GaussiansError, PlyError};
use gic_twin::TwinError;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

/// The exception of an error: its class by what failed, its text the program's, with the way out as `hint`.
pub(crate) fn exception(py: Python<'_>, error: &anyhow::Error) -> PyErr {
    let Explanation { message, causes, hint, is_interrupt, .. } = Explanation::of(error);
    let class = if is_interrupt { "Interrupted" } else { class(error) };
    let text = [vec![message], causes].concat().join(": ");
    let text = text.strip_prefix("error: ").unwrap_or(&text);
    raised(py, class, text.trim_end(), hint).unwrap_or_else(|failed| failed)
}

fn raised(py: Python<'_>, class: &str, text: &str, hint: Option<String>) -> PyResult<PyErr> {
    let instance = py.import("gic.errors")?.getattr(class)?.call1((text, hint))?;
    Ok(PyErr::from_value(instance))
}

/// The name of an error's class, by the first of its causes that tells.
fn class(error: &anyhow::Error) -> &'static str {
    if error.chain().any(|cause| cause.is::<SimulationError>()) {
        "SimulationError"
    } else if error.chain().any(|cause| cause.is::<SceneError>()) {
        "SceneError"
    } else if error.chain().any(|cause| cause.is::<GaussiansError>() || cause.is::<PlyError>()) {
        "SplatError"
    } else {
        error.chain().find_map(class_of_cause).unwrap_or("GicError")
    }
}

fn class_of_cause(cause: &(dyn std::error::Error + 'static)) -> Option<&'static str> {
    let is_usage = cause.is::<clap::Error>()
        || cause.downcast_ref().is_some_and(gic::Error::is_usage)
        || matches!(cause.downcast_ref(), Some(gic::Error::Usage { .. } | gic::Error::Overwrite { .. }))
        || matches!(cause.downcast_ref(), Some(gic::Error::Grasp(error)) if error.is_usage())
        || matches!(cause.downcast_ref(), Some(TwinError::Usage { .. }));
    let is_twin = cause.is::<TwinError>() || matches!(cause.downcast_ref(), Some(gic::Error::Twin(_)));
    match (is_usage, is_twin, cause.is::<gic::Error>()) {
        (true, ..) => Some("UsageError"),
        (_, true, _) => Some("TwinError"),
        (.., true) => Some("RunError"),
        _ => None,
    }
}

/// The exception of a thread that panicked, which is a defect of gic.
pub(crate) fn panicked() -> PyErr {
    PyRuntimeError::new_err("gic failed in a way that it should not; its message is on stderr")
}
