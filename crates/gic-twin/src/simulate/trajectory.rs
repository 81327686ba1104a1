//! `trajectory.json`: what was simulated, and a line of numbers per frame. No clock times: same input, same bytes.

use std::path::Path;

use gic_files::FileError;
use gic_mpm::{Frame, Options};
use gic_simd::Level;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::shared_world::SharedWorld;
use crate::atomic;
use crate::error::{Result, TwinError};
use crate::json::{self, Unwritable};
use crate::json_difference::first_difference;
use crate::twin::{MatterSource, Twin};

const FILE: &str = "trajectory.json";

/// The content of `trajectory.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trajectory {
    /// Always `gic.trajectory/1`.
    pub schema: String,
    /// Version of gic that simulated.
    pub gic_version: String,
    /// SIMD level that simulated; levels differ in the last bits.
    pub simd: String,
    /// The twin with every setting applied and every default filled in; paths start at the trajectory's folder.
    pub twin: Value,
    /// SHA-256 of the initial positions, hexadecimal.
    pub particles_sha256: String,
    /// Number of particles.
    pub particles: usize,
    /// Number of particles of each body: the twin's, then its companions', in the order of the files.
    #[serde(default)]
    pub bodies: Vec<usize>,
    /// Names of the obstacles, in the order of the contact forces.
    pub colliders: Vec<String>,
    /// The frames.
    pub frames: Vec<FrameSummary>,
}

/// One frame in numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameSummary {
    /// Number, from 0.
    pub frame: usize,
    /// Time from frame 0 [s].
    pub time_s: f64,
    /// File of its particles.
    pub file: String,
    /// Substeps that it took.
    pub substeps: usize,
    /// Centre of mass [m].
    pub centre_of_mass_m: [f64; 3],
    /// Velocity of the centre of mass [m/s].
    pub velocity_m_s: [f64; 3],
    /// Smallest coordinates [m].
    pub low_m: [f64; 3],
    /// Largest coordinates [m].
    pub high_m: [f64; 3],
    /// Momentum of all particles [kg m/s].
    #[serde(default)]
    pub momentum_kg_m_s: [f64; 3],
    /// Speed of the fastest particle [m/s].
    pub largest_speed_m_s: f64,
    /// Kinetic energy of the particles' velocities [J].
    pub kinetic_energy_j: f64,
    /// Largest von Mises stress [Pa].
    pub largest_von_mises_pa: f64,
    /// Smallest and largest relative volume J.
    pub jacobian: [f64; 2],
    /// Mean force on each obstacle since the frame before [N].
    pub contact_forces_n: Vec<[f64; 3]>,
    /// Mean torque on each obstacle about its origin since the frame before [N m].
    pub contact_torques_n_m: Vec<[f64; 3]>,
}

impl Trajectory {
    /// A trajectory without frames, for `folder`.
    ///
    /// # Errors
    /// A twin with a number that is not finite.
    pub(super) fn new(shared: &SharedWorld, options: &Options, folder: &Path) -> Result<Self> {
        let positions = || shared.world.bodies.iter().flat_map(|body| &body.positions);
        let failed = |reason: Unwritable| TwinError::write(&folder.join(FILE))(reason.into());
        Ok(Self {
            schema: "gic.trajectory/1".into(),
            gic_version: crate::VERSION.into(),
            simd: simd_level(options),
            twin: world_json(shared, folder).map_err(failed)?,
            particles_sha256: hash_of_particles(positions().copied()),
            particles: positions().count(),
            bodies: shared.world.bodies.iter().map(|body| body.positions.len()).collect(),
            colliders: shared.twin.colliders.iter().enumerate().map(|(i, o)| o.label(i)).collect(),
            frames: Vec::new(),
        })
    }

    /// Reads the one of a folder, if there is one.
    pub fn read(folder: &Path) -> Result<Option<Self>> {
        let path = folder.join(FILE);
        let text = match gic_files::input::read_to_string(&path) {
            Ok(text) => text,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(TwinError::read(&path)(e)),
        };
        Ok(serde_json::from_str(&text).map(Some).map_err(FileError::syntax(&path, "gic.trajectory/1"))?)
    }

    pub(super) fn write(&self, folder: &Path) -> Result<()> {
        atomic::write_json(&folder.join(FILE), self)
    }

    /// The twin that was simulated; `folder` is the trajectory's own.
    ///
    /// # Errors
    /// A twin with companions, which are bodies of their own; a damaged twin.
    pub fn single_twin(&self, folder: &Path) -> Result<Twin> {
        let path = folder.join(FILE);
        if self.bodies.len() > 1 {
            return Err(TwinError::File(FileError::Content {
                path,
                problem: format!("holds {} bodies where one is expected", self.bodies.len()),
                hint: Some("simulate each twin by itself".into()),
            }));
        }
        Twin::of_value(&path, &self.twin)
    }

    /// Whether the simulation began with these particles [m]: those of the twin, then those of its companions.
    pub fn began_with(&self, particles: impl Iterator<Item = DVec3>) -> bool {
        hash_of_particles(particles) == self.particles_sha256
    }

    /// Hash of all that decides the frames.
    pub(super) fn identity(&self) -> [u8; 32] {
        let inputs = (&self.gic_version, &self.simd, without_places(&self.twin).to_string(), &self.particles_sha256);
        Sha256::digest(format!("{inputs:?}")).into()
    }

    /// What decides the frames and is not the same in `other`.
    pub(super) fn difference(&self, other: &Self) -> Option<String> {
        let was = |name: &str, a: &dyn std::fmt::Display, b: &dyn std::fmt::Display| {
            Some(format!("{name} was {a} and is now {b}"))
        };
        if self.gic_version != other.gic_version {
            return was("gic's version", &self.gic_version, &other.gic_version);
        }
        if self.simd != other.simd {
            return was("the SIMD level", &self.simd, &other.simd);
        }
        if let Some((key, a, b)) = first_difference("", &without_places(&self.twin), &without_places(&other.twin)) {
            return was(&format!("`{key}`"), &a, &b);
        }
        (self.particles_sha256 != other.particles_sha256).then(|| "the particles of the continuum changed".into())
    }
}

/// SHA-256 of positions [m], hexadecimal.
fn hash_of_particles(positions: impl Iterator<Item = DVec3>) -> String {
    let mut hash = Sha256::new();
    for coordinate in positions.flat_map(|p| p.to_array()) {
        hash.update(coordinate.to_le_bytes());
    }
    format!("{:x}", hash.finalize())
}

/// The twin and its companions as JSON.
fn world_json(shared: &SharedWorld, folder: &Path) -> std::result::Result<Value, Unwritable> {
    let mut value = physics_json(&shared.twin, folder)?;
    if let (Some(map), false) = (value.as_object_mut(), shared.companions.is_empty()) {
        let companion = |(twin, shift_m): &(Twin, _)| {
            let twin = physics_json(twin, folder)?;
            json::value(&CompanionJson { shift_m: *shift_m, twin })
        };
        let companions: std::result::Result<Value, _> = shared.companions.iter().map(companion).collect();
        map.insert("companions".into(), companions?);
    }
    Ok(value)
}

/// A second twin as JSON.
#[derive(Serialize)]
struct CompanionJson {
    /// How far it is moved [m].
    shift_m: [f64; 3],
    twin: Value,
}

/// The same JSON without the files of matter: where they lie decides nothing, and what they hold is hashed.
fn without_places(twin: &Value) -> Value {
    let mut value = twin.clone();
    if let Some(map) = value.as_object_mut() {
        if map.get("continuum").is_some_and(Value::is_string) {
            map.remove("continuum");
        }
        for companion in map.get_mut("companions").and_then(Value::as_array_mut).into_iter().flatten() {
            companion["twin"] = without_places(&companion["twin"]);
        }
    }
    value
}

/// The twin as JSON without what has no influence on the frames, with the way from `folder` to its matter.
fn physics_json(twin: &Twin, folder: &Path) -> std::result::Result<Value, Unwritable> {
    let mut twin = twin.clone();
    if let MatterSource::File(path) = &mut twin.continuum {
        *path = gic_files::relative_path(folder, path);
    }
    let mut value = json::value(&twin)?;
    if let Some(map) = value.as_object_mut() {
        for key in ["frames", "intervals_95", "identifiable", "loss", "seed", "gic_version", "seconds"] {
            map.remove(key);
        }
    }
    Ok(value)
}

impl FrameSummary {
    /// The numbers of a frame; `masses` [kg] are those of the particles.
    pub(super) fn new(frame: &Frame, file: String, frame_rate_hz: f64, masses: &[f64]) -> Self {
        let total: f64 = masses.iter().sum();
        let weighted = |v: &[DVec3]| v.iter().zip(masses).map(|(v, mass)| *v * *mass).sum::<DVec3>();
        let momentum = weighted(&frame.velocities);
        let squares = || frame.velocities.iter().map(|v| v.length_squared());
        let low = frame.positions.iter().fold(DVec3::INFINITY, |low, &p| low.min(p));
        let high = frame.positions.iter().fold(DVec3::NEG_INFINITY, |high, &p| high.max(p));
        let jacobian =
            frame.jacobian.iter().fold([f32::INFINITY, f32::NEG_INFINITY], |[l, h], &j| [l.min(j), h.max(j)]);
        Self {
            frame: frame.index,
            time_s: frame.index as f64 / frame_rate_hz,
            file,
            substeps: frame.substeps,
            centre_of_mass_m: (weighted(&frame.positions) / total).to_array(),
            velocity_m_s: (momentum / total).to_array(),
            momentum_kg_m_s: momentum.to_array(),
            low_m: low.to_array(),
            high_m: high.to_array(),
            largest_speed_m_s: squares().fold(0.0, f64::max).sqrt(),
            kinetic_energy_j: 0.5 * squares().zip(masses).map(|(square, mass)| square * mass).sum::<f64>(),
            largest_von_mises_pa: frame.von_mises_pa.iter().copied().fold(0.0, f32::max).into(),
            jacobian: jacobian.map(f64::from),
            contact_forces_n: frame.contacts.iter().map(|c| c.force_n.to_array()).collect(),
            contact_torques_n_m: frame.contacts.iter().map(|c| c.torque_n_m.to_array()).collect(),
        }
    }
}

/// The level that the simulator computes with.
fn simd_level(options: &Options) -> String {
    options.level.unwrap_or_else(Level::active).to_string()
}
