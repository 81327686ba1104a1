//! The native half of the Python package `gic`: the engine's own functions behind NumPy arrays.
//!
//! Arguments are arrays of the right type, shape and order: the Python half sees to that, and names what is wrong.
//! Whatever takes long runs on a thread of its own without the interpreter's lock (`waiting`).

mod arrays;
mod body;
mod command;
mod errors;
mod float_environment;
mod recording;
mod splat;
mod twin;
mod waiting;
mod world;

use mimalloc::MiMalloc;
use pyo3::prelude::*;

/// As in the program: training and gradients allocate large blocks in every step.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

/// The native half of `gic`.
#[pymodule]
mod _gic {
    #[pymodule_export]
    use super::body::Body;
    #[pymodule_export]
    use super::command::{call, cli};
    #[pymodule_export]
    use super::recording::Recording;
    #[pymodule_export]
    use super::splat::{Rendered, read_ply, render, write_ply};
    #[pymodule_export]
    use super::twin::{read_twin, twin_world};
    #[pymodule_export]
    use super::world::World;
    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", gic_twin::VERSION)
    }
}
