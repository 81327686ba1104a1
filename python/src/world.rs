//! A world: rollouts, recordings and Jacobians.

use std::mem::discriminant;
use std::path::Path;

use gic_mpm::{Deformation, Doubt, Frame, Options, Precision, Simulator, Stepping, Unknown, jacobian};
use gic_twin::Interrupt;
use gic_twin::simulate::usual_budget;
use gic_twin::twin::Twin;
use glam::DVec3;
use numpy::PyArrayDyn;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{flat, shaped};
use crate::body::Body;
use crate::errors::exception;
use crate::recording::Recording;
use crate::waiting::wait;

/// What is simulated and how; see `gic.Simulator`.
#[pyclass(frozen, module = "gic._gic")]
pub(crate) struct World {
    world: gic_mpm::World,
    options: Options,
}

#[pymethods]
impl World {
    /// `stepping`: least substeps per frame, and the Courant number.
    #[new]
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        bodies: Vec<PyRef<'_, Body>>,
        colliders: &str,
        grid_spacing: f64,
        gravity: [f64; 3],
        frame_rate: f64,
        stepping: (usize, f64),
        precision: &str,
        gradient_memory_bytes: usize,
        parallel: bool,
    ) -> PyResult<Self> {
        let precision = match precision {
            "f32" => Precision::F32,
            "f64" => Precision::F64,
            _ => return Err(PyValueError::new_err("precision must be \"f32\" or \"f64\"")),
        };
        let obstacles = || anyhow::Ok(Twin::obstacles_of(Path::new("Simulator"), &serde_json::from_str(colliders)?)?);
        let obstacles = obstacles().map_err(|error| exception(py, &error))?;
        let world = gic_mpm::World {
            bodies: bodies.iter().map(|body| body.0.clone()).collect(),
            colliders: obstacles.iter().map(|obstacle| obstacle.to_collider()).collect(),
            gravity_m_s2: DVec3::from(gravity),
            grid_spacing_m: grid_spacing,
            frame_rate_hz: frame_rate,
            stepping: Stepping { least_substeps_per_frame: stepping.0, courant: stepping.1 },
        };
        world.validate().map_err(|error| exception(py, &error.into()))?;
        let options =
            Options { precision, gradient_memory_bytes, parallel, budget: usual_budget(), ..Options::default() };
        Ok(Self { world, options })
    }

    /// Simulates `frames` frames and returns the arrays of those in `kept`, of all by default.
    fn rollout<'py>(
        &self,
        py: Python<'py>,
        frames: usize,
        kept: Option<Vec<usize>>,
        deformation: bool,
    ) -> PyResult<Bound<'py, PyDict>> {
        let (interrupt, options) = self.interruptible();
        let world = self.world.clone();
        let flag = interrupt.clone();
        let arrays = wait(py, &interrupt, move || {
            let mut arrays = Frames::new(kept, &world, deformation);
            let mut simulator = Simulator::for_frames(&world, &options, frames)?;
            for index in 0..frames {
                if flag.requested() {
                    return Err(gic_mpm::SimulationError::Interrupted.into());
                }
                let frame = if index == 0 { simulator.frame() } else { simulator.advance_frame()? };
                arrays.take(&frame, || simulator.deformation());
            }
            Ok(arrays)
        })?;
        arrays.into_dict(py)
    }

    /// Simulates `frames` frames in a way that can be differentiated; the arrays are those of the frames in `kept`.
    fn record<'py>(
        &self,
        py: Python<'py>,
        frames: usize,
        kept: Option<Vec<usize>>,
    ) -> PyResult<(Recording, Bound<'py, PyDict>)> {
        let (interrupt, options) = self.interruptible();
        let world = self.world.clone();
        let (recording, arrays) = wait(py, &interrupt, move || {
            let mut arrays = Frames::new(kept, &world, false);
            let recording =
                gic_mpm::Recording::new(&world, &options, frames, &mut |frame| arrays.take(&frame, || unreachable!()))?;
            Ok((recording, arrays))
        })?;
        let sizes = self.world.bodies.iter().map(|body| body.positions.len()).collect();
        Ok((Recording::new(recording, interrupt, sizes), arrays.into_dict(py)?))
    }

    /// Derivatives of positions and velocities in `frames` with respect to `unknowns` (kind, body, number), shape
    /// [unknowns, frames, n, 3] each.
    #[allow(clippy::type_complexity)]
    fn jacobian<'py>(
        &self,
        py: Python<'py>,
        frames: Vec<usize>,
        unknowns: Vec<(String, usize, usize)>,
    ) -> PyResult<(Bound<'py, PyArrayDyn<f64>>, Bound<'py, PyArrayDyn<f64>>)> {
        let unknowns: Vec<Unknown> = unknowns.into_iter().map(unknown).collect::<PyResult<_>>()?;
        let shape = [unknowns.len(), frames.len(), particles(&self.world), 3];
        let (interrupt, options) = self.interruptible();
        let world = self.world.clone();
        let tangents = wait(py, &interrupt, move || Ok(jacobian(&world, &options, &frames, &unknowns)?))?;
        let positions = tangents.iter().flat_map(|tangent| &tangent.positions).flat_map(|frame| flat(frame)).collect();
        let velocities =
            tangents.iter().flat_map(|tangent| &tangent.velocities).flat_map(|frame| flat(frame)).collect();
        Ok((shaped(py, positions, &shape)?, shaped(py, velocities, &shape)?))
    }
}

impl World {
    /// The options with a flag of the call's own.
    fn interruptible(&self) -> (Interrupt, Options) {
        let interrupt = Interrupt::default();
        let options = Options { interrupt: Some(interrupt.flag().clone()), ..self.options.clone() };
        (interrupt, options)
    }
}

fn particles(world: &gic_mpm::World) -> usize {
    world.bodies.iter().map(|body| body.positions.len()).sum()
}

fn unknown((kind, body, number): (String, usize, usize)) -> PyResult<Unknown> {
    match kind.as_str() {
        "material" => Ok(Unknown::Material { body, parameter: number }),
        "density" => Ok(Unknown::Density { body }),
        "velocity" => Ok(Unknown::Velocity { body, axis: number }),
        "angular_velocity" => Ok(Unknown::AngularVelocity { body, axis: number }),
        _ => Err(PyValueError::new_err(format!("no unknown is called {kind}"))),
    }
}

/// What is kept of a rollout, frame after frame.
struct Frames {
    /// Which are kept; `None` for all.
    wanted: Option<Vec<usize>>,
    kept: Vec<usize>,
    particles: usize,
    colliders: usize,
    has_deformation: bool,
    positions: Vec<f64>,
    velocities: Vec<f64>,
    von_mises_pa: Vec<f32>,
    volume_ratios: Vec<f32>,
    contact_forces_n: Vec<f64>,
    contact_torques_n_m: Vec<f64>,
    deformation_gradients: Vec<f64>,
    cauchy_stress_pa: Vec<f64>,
    substeps: Vec<usize>,
    /// Each kind of doubt, by the first frame that shows it.
    doubts: Vec<Doubt>,
}

impl Frames {
    fn new(wanted: Option<Vec<usize>>, world: &gic_mpm::World, has_deformation: bool) -> Self {
        Self {
            wanted,
            kept: Vec::new(),
            particles: particles(world),
            colliders: world.colliders.len(),
            has_deformation,
            positions: Vec::new(),
            velocities: Vec::new(),
            von_mises_pa: Vec::new(),
            volume_ratios: Vec::new(),
            contact_forces_n: Vec::new(),
            contact_torques_n_m: Vec::new(),
            deformation_gradients: Vec::new(),
            cauchy_stress_pa: Vec::new(),
            substeps: Vec::new(),
            doubts: world.doubts(),
        }
    }

    fn take(&mut self, frame: &Frame, deformation: impl FnOnce() -> Deformation) {
        for doubt in frame.doubts() {
            if !self.doubts.iter().any(|known| discriminant(known) == discriminant(&doubt)) {
                self.doubts.push(doubt);
            }
        }
        if self.wanted.as_ref().is_some_and(|wanted| !wanted.contains(&frame.index)) {
            return;
        }
        self.kept.push(frame.index);
        self.positions.extend(flat(&frame.positions));
        self.velocities.extend(flat(&frame.velocities));
        self.von_mises_pa.extend(&frame.von_mises_pa);
        self.volume_ratios.extend(&frame.jacobian);
        self.contact_forces_n.extend(frame.contacts.iter().flat_map(|contact| contact.force_n.to_array()));
        self.contact_torques_n_m.extend(frame.contacts.iter().flat_map(|contact| contact.torque_n_m.to_array()));
        self.substeps.push(frame.substeps);
        if self.has_deformation {
            let Deformation { gradients, cauchy_stress_pa } = deformation();
            self.deformation_gradients.extend(gradients.as_flattened().as_flattened());
            self.cauchy_stress_pa.extend(cauchy_stress_pa.as_flattened().as_flattened());
        }
    }

    fn into_dict(self, py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
        let (f, n, c) = (self.kept.len(), self.particles, self.colliders);
        let arrays = PyDict::new(py);
        arrays.set_item("positions_m", shaped(py, self.positions, &[f, n, 3])?)?;
        arrays.set_item("velocities_m_s", shaped(py, self.velocities, &[f, n, 3])?)?;
        arrays.set_item("von_mises_pa", shaped(py, self.von_mises_pa, &[f, n])?)?;
        arrays.set_item("volume_ratios", shaped(py, self.volume_ratios, &[f, n])?)?;
        arrays.set_item("contact_forces_n", shaped(py, self.contact_forces_n, &[f, c, 3])?)?;
        arrays.set_item("contact_torques_n_m", shaped(py, self.contact_torques_n_m, &[f, c, 3])?)?;
        if self.has_deformation {
            arrays.set_item("deformation_gradients", shaped(py, self.deformation_gradients, &[f, n, 3, 3])?)?;
            arrays.set_item("cauchy_stress_pa", shaped(py, self.cauchy_stress_pa, &[f, n, 3, 3])?)?;
        }
        arrays.set_item("frames", self.kept)?;
        arrays.set_item("substeps", self.substeps)?;
        arrays.set_item("doubts", self.doubts.iter().map(ToString::to_string).collect::<Vec<_>>())?;
        Ok(arrays)
    }
}
