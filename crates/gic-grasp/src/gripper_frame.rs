//! The gripper's frame: which way it closes, and how the matter lies in it.

use std::str::FromStr;

use gic_mpm::Body;
use glam::{DMat3, DVec3};

use super::antipodal::{self, GripLine};
use crate::error::{GraspError, Result};
use crate::gripper::Gripper;

/// Which way the gripper closes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AxisChoice {
    /// Along the best antipodal pair of the surface.
    #[default]
    Auto,
    /// Along x (0), y (1) or z (2) of the world, through the centre of mass.
    World(usize),
}

/// A text that is no [`AxisChoice`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is no axis; give auto, x, y or z")]
pub struct AxisError(String);

impl FromStr for AxisChoice {
    type Err = AxisError;

    fn from_str(text: &str) -> std::result::Result<Self, AxisError> {
        match text {
            "auto" => Ok(Self::Auto),
            "x" => Ok(Self::World(0)),
            "y" => Ok(Self::World(1)),
            "z" => Ok(Self::World(2)),
            _ => Err(AxisError(text.into())),
        }
    }
}

impl AxisChoice {
    /// Its name on the command line.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::World(axis) => ["x", "y", "z"][axis],
        }
    }
}

/// The gripper's frame in the world.
#[derive(Clone, Copy, Debug)]
pub(super) struct GripperFrame {
    /// Half-way between the pads before they are raised [m].
    pub(super) origin: DVec3,
    /// The gripper's x (closing), y (long side of the pads) and z in the world.
    pub(super) world_from_gripper: DMat3,
}

impl GripperFrame {
    /// Chooses the frame; `positions` [m] of particles `spacing` [m] apart, `widest` the largest width asked for [m].
    pub(super) fn choose(
        choice: AxisChoice,
        positions: &[DVec3],
        spacing: f64,
        up: DVec3,
        gripper: &Gripper,
        widest: f64,
    ) -> Result<Self> {
        let reach = 0.5 * gripper.pad_m[0].max(gripper.pad_m[1]);
        let line = match choice {
            AxisChoice::World(axis) => {
                let middle = positions.iter().sum::<DVec3>() / positions.len().max(1) as f64;
                GripLine { middle, direction: DVec3::AXES[axis] }
            }
            AxisChoice::Auto => antipodal::search(positions, spacing, up, gripper.friction, widest, reach)
                .ok_or_else(|| no_antipodal_pair(widest, gripper.friction))?,
        };
        let x = line.direction;
        let y = up.reject_from_normalized(x).try_normalize().unwrap_or_else(|| x.any_orthonormal_vector());
        Ok(Self { origin: line.middle, world_from_gripper: DMat3::from_cols(x, y, x.cross(y)) })
    }

    /// A direction of the world in the gripper's frame.
    pub(super) fn direction_to_gripper(&self, v: DVec3) -> DVec3 {
        self.world_from_gripper.transpose() * v
    }

    /// A point of the gripper's frame in the world [m].
    pub(super) fn point_to_world(&self, p: DVec3) -> DVec3 {
        self.origin + self.world_from_gripper * p
    }

    /// The body at rest in the gripper's frame, each particle cut into `refine`^3; `spacing` [m] is that of the
    /// particles.
    pub(super) fn body(&self, body: &Body, spacing: f64, refine: usize) -> Body {
        let step = spacing / refine as f64;
        let offset = |i: usize| (i as f64 - 0.5 * (refine as f64 - 1.0)) * step;
        let mut parts = Vec::with_capacity(refine.pow(3));
        for i in 0..refine {
            for j in 0..refine {
                parts.extend((0..refine).map(|k| DVec3::new(offset(i), offset(j), offset(k))));
            }
        }
        let local = |p: &DVec3| self.world_from_gripper.transpose() * (*p - self.origin);
        Body {
            positions: body.positions.iter().flat_map(|p| parts.iter().map(move |part| local(&(*p + *part)))).collect(),
            particle_volume_m3: body.particle_volume_m3 / parts.len() as f64,
            volume_factors: body.volume_factors.iter().flat_map(|f| std::iter::repeat_n(*f, parts.len())).collect(),
            velocity_m_s: DVec3::ZERO,
            angular_velocity_rad_s: DVec3::ZERO,
            own_velocities_m_s: Vec::new(),
            ..body.clone()
        }
    }
}

fn no_antipodal_pair(width: f64, friction: f64) -> GraspError {
    GraspError::Usage {
        problem: format!(
            "no two places of the surface, at least {width} m apart on a level line, face each other within the \
             friction cone of {friction}"
        ),
        hint: Some("ask for smaller widths, raise --friction, or choose --axis x, y or z yourself".into()),
    }
}
