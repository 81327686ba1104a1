//! `twin.json`, schema `gic.twin/1`: the contract between identification, simulation and every other tool.
//!
//! Lengths in metres, angles in degrees, everything else in SI units; the world frame is the scene's. Required are
//! `schema`, `material` and `continuum`; every other key has the default stated at its field. Unknown keys are
//! errors.

mod json_object;
mod read;
mod setting;
mod world;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use gic_mpm::{Collider, ColliderPath, Contact, Material, Primitive};
use glam::DVec3;
use serde::Serialize;

pub use setting::{Setting, SettingError};

use crate::error::Result;
use crate::matter::Solid;
use crate::rotation;

/// The schema that this version reads and writes.
pub const SCHEMA: &str = "gic.twin/1";

/// A physical digital twin: matter, its laws, its surroundings.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Twin {
    /// Always [`SCHEMA`].
    pub schema: String,
    /// Constitutive law and its parameters.
    pub material: Material,
    /// 95 % interval of each identified parameter; empty by default.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub intervals_95: BTreeMap<String, [f64; 2]>,
    /// Whether the video determines a parameter; empty by default.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub identifiable: BTreeMap<String, bool>,
    /// Velocity of the whole body at time 0 [m/s]; default 0.
    pub initial_velocity_m_s: [f64; 3],
    /// Angular velocity about the centre of mass at time 0 [rad/s]; default 0.
    pub initial_angular_velocity_rad_s: [f64; 3],
    /// Density at rest [kg/m^3]; default 1000.
    pub density_kg_m3: f64,
    /// Gravity [m/s^2]; default (0, -9.8, 0).
    pub gravity_m_s2: [f64; 3],
    /// Obstacles; none by default.
    pub colliders: Vec<Obstacle>,
    /// Side of a grid cell [m]; by default twice `particle_spacing_m`, else 1/16 of the object's largest side.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub grid_spacing_m: Option<f64>,
    /// Distance of neighbouring particles at rest [m]; its cube is a particle's volume. By default half of
    /// `grid_spacing_m`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub particle_spacing_m: Option<f64>,
    /// Frames per second; default 24.
    pub frame_rate_hz: f64,
    /// How many frames a simulation gives, the initial state included; default 24.
    pub frames: usize,
    /// Substeps per frame, at least; by default as many as stability needs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub substeps_per_frame: Option<usize>,
    /// The matter at time 0.
    pub continuum: MatterSource,
    /// Loss at the estimate, where the twin was identified.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub loss: Option<f64>,
    /// Seed of everything random; default 0.
    pub seed: u64,
    /// Version of gic that wrote the twin.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gic_version: Option<String>,
    /// Wall-clock seconds per stage, where the twin was identified.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub seconds: BTreeMap<String, f64>,
}

/// Where the matter of a twin comes from.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum MatterSource {
    /// A PLY of particles (number and order kept) or a watertight OBJ, PLY or STL mesh; a relative path starts at the
    /// twin's folder.
    File(PathBuf),
    /// A shape filled with particles.
    Solid(Solid),
}

/// An obstacle as written in a twin.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Obstacle {
    /// What it is and where.
    #[serde(flatten)]
    pub shape: ObstacleShape,
    /// What happens at its surface.
    pub contact: ContactKind,
    /// Coulomb coefficient of slip and separating contact; default 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    /// Rotation about the world's x, then y, then z axis [degrees]; default 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rotation_deg: Option<[f64; 3]>,
    /// Velocity [m/s]; default 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub velocity_m_s: Option<[f64; 3]>,
    /// Angular velocity about its centre [rad/s]; default 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angular_velocity_rad_s: Option<[f64; 3]>,
    /// A path instead of a velocity; empty by default.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub keyframes: Vec<Keyframe>,
}

/// Where an obstacle is at one time; between keyframes it moves in a straight line.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Keyframe {
    /// Time from the first frame [s].
    pub time_s: f64,
    /// Position of its centre, or of a point of a half space [m].
    pub position_m: [f64; 3],
}

/// The shapes that an obstacle may have.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "shape", rename_all = "snake_case")]
pub enum ObstacleShape {
    /// Everything behind a plane.
    HalfSpace {
        /// A point of the plane [m]; default the origin.
        point_m: [f64; 3],
        /// Direction away from the solid side; any length.
        normal: [f64; 3],
    },
    /// A ball.
    Sphere {
        /// Centre [m].
        centre_m: [f64; 3],
        /// Radius [m].
        radius_m: f64,
    },
    /// A box.
    Box {
        /// Centre [m].
        centre_m: [f64; 3],
        /// Whole sides before rotation [m].
        size_m: [f64; 3],
    },
    /// A cylinder along y before rotation.
    Cylinder {
        /// Centre [m].
        centre_m: [f64; 3],
        /// Radius [m].
        radius_m: f64,
        /// Whole height [m].
        height_m: f64,
    },
    /// A cylinder along y with round ends, before rotation.
    Capsule {
        /// Centre [m].
        centre_m: [f64; 3],
        /// Radius [m].
        radius_m: f64,
        /// Distance of the centres of its round ends [m].
        height_m: f64,
    },
}

/// Contact laws by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ContactKind {
    /// No relative motion.
    Sticky,
    /// Sliding along the surface, never off it.
    Slip,
    /// Sliding along the surface, free to leave it.
    Separating,
}

impl Twin {
    /// A twin of `material` and `continuum` with the default of every other key.
    pub fn new(material: Material, continuum: MatterSource) -> Self {
        Self {
            schema: SCHEMA.into(),
            material,
            intervals_95: BTreeMap::new(),
            identifiable: BTreeMap::new(),
            initial_velocity_m_s: [0.0; 3],
            initial_angular_velocity_rad_s: [0.0; 3],
            density_kg_m3: 1000.0,
            gravity_m_s2: [0.0, -9.8, 0.0],
            colliders: Vec::new(),
            grid_spacing_m: None,
            particle_spacing_m: None,
            frame_rate_hz: 24.0,
            frames: 24,
            substeps_per_frame: None,
            continuum,
            loss: None,
            seed: 0,
            gic_version: None,
            seconds: BTreeMap::new(),
        }
    }

    /// Reads a twin and applies `settings` to it as if they stood in the file.
    pub fn read(path: &Path, settings: &[Setting]) -> Result<Self> {
        read::twin(path, settings)
    }

    /// A twin from JSON; paths start at the folder of `origin`, which is also what messages call its place.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn of_value(origin: &Path, value: &serde_json::Value) -> Result<Self> {
        read::from_value(origin, value)
    }

    /// Reads a file with a list of obstacles, in the form of a twin's `colliders`.
    pub fn read_obstacles(path: &Path) -> Result<Vec<Obstacle>> {
        read::obstacle_list(path)
    }

    /// Obstacles from a JSON list in the form of a twin's `colliders`; `origin` is what messages call its place.
    ///
    /// # Errors
    /// What is wrong with the list.
    pub fn obstacles_of(origin: &Path, list: &serde_json::Value) -> Result<Vec<Obstacle>> {
        read::obstacles_of(origin, list)
    }

    /// A material from JSON in the form of a twin's `material`; `origin` is what messages call its place.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn material_of(origin: &Path, material: &serde_json::Value) -> Result<Material> {
        read::material_of(origin, material)
    }

    /// Writes the twin, atomically.
    pub fn write(&self, path: &Path) -> Result<()> {
        crate::atomic::write_json(path, self)
    }
}

impl Obstacle {
    /// A resting obstacle without rotation.
    pub fn new(shape: ObstacleShape, contact: ContactKind) -> Self {
        Self {
            shape,
            contact,
            friction: None,
            rotation_deg: None,
            velocity_m_s: None,
            angular_velocity_rad_s: None,
            keyframes: Vec::new(),
        }
    }

    /// The simulator's form of it.
    pub fn to_collider(&self) -> Collider {
        let (primitive, position_m) = match self.shape {
            ObstacleShape::HalfSpace { point_m, normal } => {
                (Primitive::HalfSpace { normal: DVec3::from(normal).normalize() }, point_m)
            }
            ObstacleShape::Sphere { centre_m, radius_m } => (Primitive::Sphere { radius_m }, centre_m),
            ObstacleShape::Box { centre_m, size_m } => {
                (Primitive::Box { half_size_m: DVec3::from(size_m) / 2.0 }, centre_m)
            }
            ObstacleShape::Cylinder { centre_m, radius_m, height_m } => {
                (Primitive::Cylinder { radius_m, half_height_m: height_m / 2.0 }, centre_m)
            }
            ObstacleShape::Capsule { centre_m, radius_m, height_m } => {
                (Primitive::Capsule { radius_m, half_height_m: height_m / 2.0 }, centre_m)
            }
        };
        let world_from_collider = rotation(self.rotation_deg.unwrap_or_default());
        let path = if self.keyframes.is_empty() {
            ColliderPath::Uniform {
                position_m: position_m.into(),
                world_from_collider,
                velocity_m_s: self.velocity_m_s.unwrap_or_default().into(),
                angular_velocity_rad_s: self.angular_velocity_rad_s.unwrap_or_default().into(),
            }
        } else {
            ColliderPath::Keyframed {
                keys: self.keyframes.iter().map(|k| (k.time_s, k.position_m.into())).collect(),
                world_from_collider,
            }
        };
        let friction = self.friction.unwrap_or(0.0);
        let contact = match self.contact {
            ContactKind::Sticky => Contact::Sticky,
            ContactKind::Slip => Contact::Slip { friction },
            ContactKind::Separating => Contact::Separating { friction },
        };
        Collider { primitive, path, contact }
    }

    /// Whether it does not stay where it is.
    pub fn moves(&self) -> bool {
        !self.keyframes.is_empty() || self.velocity_m_s.is_some() || self.angular_velocity_rad_s.is_some()
    }

    /// What a user calls it: `colliders[1] (half_space)`.
    pub fn label(&self, index: usize) -> String {
        let shape = match self.shape {
            ObstacleShape::HalfSpace { .. } => "half_space",
            ObstacleShape::Sphere { .. } => "sphere",
            ObstacleShape::Box { .. } => "box",
            ObstacleShape::Cylinder { .. } => "cylinder",
            ObstacleShape::Capsule { .. } => "capsule",
        };
        format!("colliders[{index}] ({shape})")
    }
}
