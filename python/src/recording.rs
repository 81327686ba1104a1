//! Gradients of recorded rollouts.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use gic_mpm::{BodyGradient, FrameAdjoint};
use gic_twin::Interrupt;
use glam::DVec3;
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{flat, shaped, vectors};
use crate::waiting::wait;

/// A rollout that can be differentiated; see `gic.Recording`.
#[pyclass(frozen, module = "gic._gic")]
pub(crate) struct Recording {
    recording: Arc<gic_mpm::Recording>,
    /// The flag that the recording looks at.
    interrupt: Interrupt,
    /// Particles of each body.
    sizes: Vec<usize>,
}

impl Recording {
    pub(crate) fn new(recording: gic_mpm::Recording, interrupt: Interrupt, sizes: Vec<usize>) -> Self {
        Self { recording: Arc::new(recording), interrupt, sizes }
    }

    /// Each body's particles among all.
    fn ranges(&self) -> impl Iterator<Item = Range<usize>> + '_ {
        let mut start = 0;
        self.sizes.iter().map(move |size| {
            start += size;
            start - size..start
        })
    }
}

#[pymethods]
impl Recording {
    /// Derivatives of a loss, one dictionary for each body; the arguments are its derivatives with respect to positions
    /// and velocities by frame, shape [n, 3].
    fn gradient<'py>(
        &self,
        py: Python<'py>,
        positions: BTreeMap<usize, PyReadonlyArray2<'py, f64>>,
        velocities: BTreeMap<usize, PyReadonlyArray2<'py, f64>>,
    ) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let frames = positions.keys().chain(velocities.keys()).max().map_or(0, |last| last + 1);
        let mut adjoints = vec![FrameAdjoint::default(); frames];
        for (frame, array) in &positions {
            adjoints[*frame].positions = Some(vectors(array)?);
        }
        for (frame, array) in &velocities {
            adjoints[*frame].velocities = Some(vectors(array)?);
        }
        // An earlier call may have been interrupted.
        self.interrupt.flag().store(false, Ordering::SeqCst);
        let recording = self.recording.clone();
        let gradient = wait(py, &self.interrupt, move || Ok(recording.gradient(&adjoints)?))?;
        gradient.bodies.into_iter().zip(self.ranges()).map(|(body, range)| to_dict(py, body, range.len())).collect()
    }
}

fn to_dict(py: Python<'_>, body: BodyGradient, n: usize) -> PyResult<Bound<'_, PyDict>> {
    let vector = |v: DVec3| shaped(py, v.to_array().to_vec(), &[3]);
    let count = body.material.len();
    let dict = PyDict::new(py);
    dict.set_item("material", shaped(py, body.material, &[count])?)?;
    dict.set_item("density_kg_m3", body.density)?;
    dict.set_item("particle_volume_m3", body.particle_volume)?;
    dict.set_item("volume_factors", shaped(py, body.volume_factors, &[n])?)?;
    dict.set_item("velocity_m_s", vector(body.velocity)?)?;
    dict.set_item("angular_velocity_rad_s", vector(body.angular_velocity)?)?;
    dict.set_item("positions_m", shaped(py, flat(&body.positions).collect(), &[n, 3])?)?;
    dict.set_item("velocities_m_s", shaped(py, flat(&body.velocities).collect(), &[n, 3])?)?;
    Ok(dict)
}
