//! What identification is given, and what makes it usable.

use gic_mpm::Collider;
use gic_scene::{CalibrationError, Camera, CameraOffset};
use glam::DVec3;

use crate::IdentifyError;
use crate::unknowns::state::WORLD_UNKNOWNS;

/// The observed coverage of the object in one picture.
#[derive(Clone, Debug)]
pub struct View {
    /// Index into [`Input::cameras`].
    pub camera: usize,
    /// Coverage in [0, 1], row-major, shape [height * width] of that camera.
    pub mask: Vec<f32>,
}

/// Everything observed at one time.
#[derive(Clone, Debug, Default)]
pub struct Observation {
    /// Time from the first frame [s].
    pub time_s: f64,
    /// Points on the extracted surface [m], shape [n]; empty where none was extracted.
    pub surface: Vec<DVec3>,
    /// How much each of them is in doubt, in [0, 1], shape [n]; empty where none is. What no view sees was put where it
    /// was expected, and does not count after contact.
    pub surface_doubts: Vec<f32>,
    /// Masks; cameras may be missing.
    pub views: Vec<View>,
}

/// How well the world around the body is known: standard deviations, zero of what is known. Where cameras are not
/// where they are said to be, what all their errors have in common is one of the world: the ground is as much too high,
/// and lengths are as much too long as gravity seems too strong.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WorldDoubt {
    /// The ground: a plane at rest, by its index into [`Input::colliders`].
    pub collider: usize,
    /// Of its height below the body [m].
    pub height_m: f64,
    /// Of its tilt about each of two axes in it [rad].
    pub tilt_rad: f64,
    /// Of the logarithm of its friction.
    pub log_friction: f64,
    /// Whether it may also hold what touches it. Not a deviation: one of the two is so.
    pub may_stick: bool,
    /// Of the logarithm of gravity in the lengths that the cameras see.
    pub log_gravity: f64,
    /// Of gravity's tilt about each of two axes at right angles to it [rad].
    pub gravity_tilt_rad: f64,
}

impl WorldDoubt {
    /// The same in the order of the unknowns: height, tilts, friction, gravity, its tilts.
    pub(crate) fn deviations(&self) -> [f64; WORLD_UNKNOWNS] {
        let (tilt, of_gravity) = (self.tilt_rad, self.gravity_tilt_rad);
        [self.height_m, tilt, tilt, self.log_friction, self.log_gravity, of_gravity, of_gravity]
    }
}

/// How well a device that takes pictures is known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DeviceDoubt {
    /// What was found to be wrong with its calibration, which its cameras are without.
    pub mended: CalibrationError,
    /// What may be wrong with its calibration as it is said to be, and with the times of its pictures, standard
    /// deviations: zero of what is exact, infinite of what nothing tells. One clock at least is exact: the motion's.
    pub deviation: CameraOffset,
}

/// The Gaussian-informed continuum at the first frame and the video.
#[derive(Clone, Debug)]
pub struct Input {
    /// Particles at time 0 [m], shape [n].
    pub positions: Vec<DVec3>,
    /// Rest volume of one particle [m^3].
    pub particle_volume_m3: f64,
    /// Rest volume of each particle in units of that, shape [n]; empty where all are 1.
    pub volume_factors: Vec<f64>,
    /// Opacity of each particle's Gaussian (the density attribute of paper eq. 7), in [0, 1), shape [n].
    pub opacities: Vec<f32>,
    /// Standard deviation of each particle's Gaussian [m], shape [n].
    pub scales: Vec<f32>,
    /// How much the surface at each particle is in doubt, in [0, 1], shape [n]: 1 where no picture tells where it is;
    /// empty where none is.
    pub doubts: Vec<f32>,
    /// How far the surface is off where it is not in doubt, as a standard deviation [m].
    pub surface_error_m: f64,
    /// Cameras of the views.
    pub cameras: Vec<Camera>,
    /// Which device each of them is: one that lags stands elsewhere in each frame of the flight. Empty where each is
    /// its own.
    pub devices: Vec<usize>,
    /// How well each device is known, shape [devices]; empty where all are as they are said to be.
    pub device_doubts: Vec<DeviceDoubt>,
    /// Frames, ascending in time; the first is at time 0.
    pub observations: Vec<Observation>,
    /// Frames per second.
    pub frame_rate_hz: f64,
    /// Gravity [m/s^2].
    pub gravity_m_s2: DVec3,
    /// Obstacles.
    pub colliders: Vec<Collider>,
    /// What of the world is sought with the material; `None` where it is as it is said to be.
    pub world_doubt: Option<WorldDoubt>,
    /// Whether something real was filmed, which no simulator made on a grid: then other cells than these are not
    /// sought, but widen the intervals.
    pub was_filmed: bool,
    /// Density [kg/m^3], given: a video determines only the ratio of stress to density.
    pub density_kg_m3: f64,
    /// Side of a cell of the simulation grid [m].
    pub grid_spacing_m: f64,
    /// Substeps per frame.
    pub substeps_per_frame: usize,
}

impl Input {
    /// Checks shapes and values; everything later relies on it.
    pub fn validate(&self) -> Result<(), IdentifyError> {
        let n = self.positions.len();
        if n < 8 {
            return Err(IdentifyError::input(
                "particles",
                format!("{n} particles are no continuum"),
                "check the filling",
            ));
        }
        for (field, length) in [("opacities", self.opacities.len()), ("scales", self.scales.len())] {
            if length != n {
                return Err(IdentifyError::input(field, format!("{length} values for {n} particles"), "give one each"));
            }
        }
        if !self.volume_factors.is_empty() && self.volume_factors.len() != n {
            let count = self.volume_factors.len();
            return Err(IdentifyError::input(
                "volume_factors",
                format!("{count} values for {n} particles"),
                "give one each, or none",
            ));
        }
        validate_doubts(&self.doubts, (n, "particles"), "doubts".into())?;
        if let Some(i) = self.volume_factors.iter().position(|f| !(*f > 0.0 && f.is_finite())) {
            let problem = format!("that of particle {i} is {}", self.volume_factors[i]);
            return Err(IdentifyError::input("volume_factors", problem, "they must be positive"));
        }
        if let Some(i) = self.positions.iter().position(|p| !p.is_finite()) {
            return Err(IdentifyError::input("particles", format!("particle {i} is not finite"), "check the filling"));
        }
        for (field, value) in [
            ("particle_volume_m3", self.particle_volume_m3),
            ("surface_error_m", self.surface_error_m),
            ("density_kg_m3", self.density_kg_m3),
            ("grid_spacing_m", self.grid_spacing_m),
            ("frame_rate_hz", self.frame_rate_hz),
            ("substeps_per_frame", self.substeps_per_frame as f64),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(IdentifyError::input(field, format!("is {value}"), "it must be positive"));
            }
        }
        if !self.gravity_m_s2.is_finite() {
            return Err(IdentifyError::input("gravity_m_s2", "is not finite", "give three numbers"));
        }
        self.validate_world()?;
        self.validate_observations()
    }

    fn validate_world(&self) -> Result<(), IdentifyError> {
        let Some(doubt) = self.world_doubt else { return Ok(()) };
        let is_plane = |c: &Collider| matches!(c.primitive, gic_mpm::Primitive::HalfSpace { .. });
        if !self.colliders.get(doubt.collider).is_some_and(is_plane) {
            return Err(IdentifyError::input("world_doubt", "names no plane", "give the index of a half space"));
        }
        let deviations = doubt.deviations();
        let are_deviations = deviations.iter().all(|deviation| *deviation >= 0.0 && deviation.is_finite());
        if !are_deviations || deviations == [0.0; WORLD_UNKNOWNS] && !doubt.may_stick {
            let way_out = "give standard deviations, one of them positive, or `may_stick`";
            return Err(IdentifyError::input("world_doubt", "is none, or endless", way_out));
        }
        Ok(())
    }

    fn validate_observations(&self) -> Result<(), IdentifyError> {
        if self.observations.len() < 2 {
            return Err(IdentifyError::input(
                "frames",
                format!("{} frame(s) show no motion", self.observations.len()),
                "give at least two, better ten",
            ));
        }
        let starts_at_zero = self.observations[0].time_s.abs() < 0.25 / self.frame_rate_hz;
        if !starts_at_zero {
            return Err(IdentifyError::input("frames", "the first is not at time 0", "subtract its time from all"));
        }
        for (f, pair) in self.observations.windows(2).enumerate() {
            if self.frame_of(&pair[1]) <= self.frame_of(&pair[0]) {
                return Err(IdentifyError::input(
                    "frames",
                    format!("frame {} is not later than frame {f}", f + 1),
                    "sort them, and check frame_rate_hz",
                ));
            }
        }
        let mut anything = false;
        for (f, observation) in self.observations.iter().enumerate() {
            anything |= f > 0 && !(observation.surface.is_empty() && observation.views.is_empty());
            for view in &observation.views {
                let camera = self.cameras.get(view.camera).ok_or_else(|| {
                    IdentifyError::input(
                        format!("view of frame {f}"),
                        format!("names camera {} of {}", view.camera, self.cameras.len()),
                        "check the camera list",
                    )
                })?;
                if view.mask.len() != camera.width * camera.height || !view.mask.iter().all(|m| (0.0..=1.0).contains(m))
                {
                    return Err(IdentifyError::input(
                        format!("mask of camera {} in frame {f}", view.camera),
                        format!("is not {}x{} values in [0, 1]", camera.width, camera.height),
                        "check the mask file",
                    ));
                }
            }
            if let Some(i) = observation.surface.iter().position(|p| !p.is_finite()) {
                return Err(IdentifyError::input(
                    format!("surface of frame {f}"),
                    format!("point {i} is not finite"),
                    "check the reconstruction",
                ));
            }
            let (doubts, points) = (&observation.surface_doubts, observation.surface.len());
            validate_doubts(doubts, (points, "points"), format!("surface_doubts of frame {f}"))?;
        }
        if !anything {
            return Err(IdentifyError::input("frames", "no surface and no mask after frame 0", "give either"));
        }
        Ok(())
    }

    /// Number of the simulated frame nearest to a time [s].
    pub fn frame_at(&self, time_s: f64) -> usize {
        (time_s * self.frame_rate_hz).round().max(0.0) as usize
    }

    /// Number of the simulated frame at an observation's time.
    pub(crate) fn frame_of(&self, observation: &Observation) -> usize {
        self.frame_at(observation.time_s)
    }

    /// The device that a camera is.
    pub(crate) fn device_of(&self, camera: usize) -> usize {
        self.devices.get(camera).copied().unwrap_or(camera)
    }

    /// How many cameras see the body. One that moves has an index of its own in each frame.
    pub(crate) fn camera_count(&self) -> usize {
        self.observations.iter().map(|observation| observation.views.len()).max().unwrap_or(0)
    }

    /// Particles that far apart in free space, which nothing observes.
    #[cfg(test)]
    pub(crate) fn of_body(positions: Vec<DVec3>, spacing_m: f64) -> Input {
        let count = positions.len();
        Input {
            positions,
            doubts: Vec::new(),
            particle_volume_m3: spacing_m.powi(3),
            volume_factors: Vec::new(),
            opacities: vec![0.9; count],
            scales: vec![0.5 * spacing_m as f32; count],
            surface_error_m: 0.5 * spacing_m,
            cameras: Vec::new(),
            devices: Vec::new(),
            device_doubts: Vec::new(),
            observations: Vec::new(),
            frame_rate_hz: 24.0,
            gravity_m_s2: DVec3::ZERO,
            colliders: Vec::new(),
            world_doubt: None,
            was_filmed: false,
            density_kg_m3: 1000.0,
            grid_spacing_m: 2.0 * spacing_m,
            substeps_per_frame: 200,
        }
    }

    /// Centre of mass of the particles [m].
    pub(crate) fn centre(&self) -> DVec3 {
        let factor = |i: usize| self.volume_factors.get(i).copied().unwrap_or(1.0);
        let (moment, volume) = self
            .positions
            .iter()
            .enumerate()
            .fold((DVec3::ZERO, 0.0), |(moment, volume), (i, p)| (moment + *p * factor(i), volume + factor(i)));
        moment / volume
    }
}

/// Checks that doubts are numbers between 0 and 1, one for each of so many things, or none at all.
fn validate_doubts(doubts: &[f32], (count, what): (usize, &str), field: String) -> Result<(), IdentifyError> {
    let is_doubt = |doubt: &f32| (0.0..=1.0).contains(doubt);
    if (doubts.is_empty() || doubts.len() == count) && doubts.iter().all(is_doubt) {
        return Ok(());
    }
    let problem = format!("has {} values for {count} {what}, or one that is not between 0 and 1", doubts.len());
    Err(IdentifyError::input(field, problem, format!("give one value for each of the {what}, or none at all")))
}
