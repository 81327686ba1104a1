//! A body of a simulation.

use std::path::Path;

use gic_twin::twin::Twin;
use glam::DVec3;
use numpy::{PyArrayDyn, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::arrays::{flat, shaped, vectors};
use crate::errors::exception;

/// Particles of one material; see `gic.Body`.
#[pyclass(frozen, module = "gic._gic")]
pub(crate) struct Body(pub(crate) gic_mpm::Body);

#[pymethods]
impl Body {
    #[new]
    #[pyo3(signature = (
        material, positions, density, particle_volume, volume_factors, velocity, angular_velocity, own_velocities
    ))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        material: &str,
        positions: PyReadonlyArray2<'_, f64>,
        density: f64,
        particle_volume: f64,
        volume_factors: Option<PyReadonlyArray1<'_, f64>>,
        velocity: [f64; 3],
        angular_velocity: [f64; 3],
        own_velocities: Option<PyReadonlyArray2<'_, f64>>,
    ) -> PyResult<Self> {
        let parsed =
            || -> anyhow::Result<_> { Ok(Twin::material_of(Path::new("Body"), &serde_json::from_str(material)?)?) };
        Ok(Self(gic_mpm::Body {
            material: parsed().map_err(|error| exception(py, &error))?,
            density_kg_m3: density,
            particle_volume_m3: particle_volume,
            volume_factors: volume_factors
                .map(|array| array.as_slice().map(<[f64]>::to_vec))
                .transpose()?
                .unwrap_or_default(),
            positions: vectors(&positions)?,
            velocity_m_s: DVec3::from(velocity),
            angular_velocity_rad_s: DVec3::from(angular_velocity),
            own_velocities_m_s: own_velocities.map(|array| vectors(&array)).transpose()?.unwrap_or_default(),
        }))
    }

    /// The material as JSON.
    #[getter]
    fn material(&self) -> PyResult<String> {
        gic_twin::json::text(&self.0.material)
            .map_err(|error| pyo3::exceptions::PyValueError::new_err(error.to_string()))
    }

    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        shaped(py, flat(&self.0.positions).collect(), &[self.0.positions.len(), 3])
    }

    #[getter]
    fn density(&self) -> f64 {
        self.0.density_kg_m3
    }

    #[getter]
    fn particle_volume(&self) -> f64 {
        self.0.particle_volume_m3
    }

    /// `None` where all are 1.
    #[getter]
    fn volume_factors<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArrayDyn<f64>>>> {
        let factors = &self.0.volume_factors;
        (!factors.is_empty()).then(|| shaped(py, factors.clone(), &[factors.len()])).transpose()
    }

    #[getter]
    fn velocity(&self) -> [f64; 3] {
        self.0.velocity_m_s.to_array()
    }

    #[getter]
    fn angular_velocity(&self) -> [f64; 3] {
        self.0.angular_velocity_rad_s.to_array()
    }
}
