//! Twins: their files, and the worlds that they are simulated in.

use std::path::{Path, PathBuf};

use gic::pipeline::twin_file;
use gic_twin::json;
use gic_twin::simulate::{Companion, Scenario, SharedWorld};
use gic_twin::twin::{Setting, Twin};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::body::Body;
use crate::errors::exception;
use crate::waiting::wait_briefly;

/// A twin as JSON with every default filled in; a run folder stands for the twin in it. Also the twin's file.
#[pyfunction]
pub(crate) fn read_twin(py: Python<'_>, path: PathBuf) -> PyResult<(String, PathBuf)> {
    wait_briefly(py, move || {
        let file = twin_file(&path)?;
        Ok((json::text(&Twin::read(&file, &[])?)?, file))
    })
}

/// The world of a twin with `settings` (KEY=VALUE), further obstacles (a JSON list) and companions (twin, shift [m]),
/// as the arguments of a simulator.
#[pyfunction]
pub(crate) fn twin_world<'py>(
    py: Python<'py>,
    path: PathBuf,
    settings: Vec<String>,
    colliders: String,
    companions: Vec<(PathBuf, [f64; 3])>,
) -> PyResult<Bound<'py, PyDict>> {
    let shared = wait_briefly(py, move || {
        let settings = settings.iter().map(|text| text.parse()).collect::<Result<Vec<Setting>, _>>()?;
        let obstacles = Twin::obstacles_of(Path::new("colliders"), &serde_json::from_str(&colliders)?)?;
        let companion = |(twin, shift_m): (PathBuf, _)| anyhow::Ok(Companion { twin: twin_file(&twin)?, shift_m });
        let companions = companions.into_iter().map(companion).collect::<anyhow::Result<_>>()?;
        Ok(SharedWorld::read(&Scenario { twin: twin_file(&path)?, settings, obstacles, companions })?)
    })?;
    let obstacles = json::text(&shared.twin.colliders).map_err(|error| exception(py, &error.into()))?;
    let stepping = shared.world.stepping;
    let world = PyDict::new(py);
    let bodies: Vec<Body> = shared.world.bodies.into_iter().map(Body).collect();
    world.set_item("bodies", bodies)?;
    world.set_item("colliders", obstacles)?;
    world.set_item("grid_spacing_m", shared.world.grid_spacing_m)?;
    world.set_item("gravity_m_s2", shared.world.gravity_m_s2.to_array())?;
    world.set_item("frame_rate_hz", shared.world.frame_rate_hz)?;
    world.set_item("least_substeps_per_frame", stepping.least_substeps_per_frame)?;
    world.set_item("courant", stepping.courant)?;
    world.set_item("frames", shared.twin.frames)?;
    Ok(world)
}
