//! One grasp in progress: the object between the pads, and what happens to it at each width.

use gic_mpm::{Stepping, World};
use gic_twin::Interrupt;
use gic_twin::events::Events;
use gic_twin::twin::Twin;
use glam::DVec3;

use crate::contact::ContactFaces;
use crate::error::{GraspError, Result};
use crate::film::GraspFilm;
use crate::gripper_frame::{AxisChoice, GripperFrame};
use crate::pad_grid::{check_pads, least_refinement};
use crate::pad_simulation::{GraspPhase, GraspState, PadPose, PadSimulation, Pads};
use crate::request::GraspRequest;

/// Speed of each pad while closing, over the speed of waves in a bar: slow enough that inertia adds little force.
const CLOSING_WAVE_SPEEDS: f64 = 0.005;
/// Length of a frame while closing and holding, over the time that such a wave takes across the object.
const FRAME_WAVE_TIMES: f64 = 0.25;
/// What is left of the velocities after each such frame.
pub(crate) const VELOCITY_KEPT: f64 = 0.6;

/// One grasp in progress.
pub(crate) struct Grasp<'a> {
    pub(crate) request: &'a GraspRequest,
    pub(crate) events: &'a Events,
    pub(crate) gripper_frame: GripperFrame,
    pub(crate) simulation: PadSimulation<'a>,
    /// Distance of neighbouring particles [m].
    pub(crate) spacing: f64,
    /// Width of the object at rest [m].
    pub(crate) object_width: f64,
    /// Length of a frame while closing and holding [s].
    pub(crate) frame_s: f64,
    /// Speed of a pad while closing [m/s].
    pub(crate) speed: f64,
    /// Gravity in the gripper's frame [m/s^2].
    pub(crate) gravity: DVec3,
    /// Which particles have been at the yield stress.
    pub(crate) yielded: Vec<bool>,
    pub(crate) film: GraspFilm,
}

impl<'a> Grasp<'a> {
    pub(crate) fn new(
        request: &'a GraspRequest,
        twin: &Twin,
        world: &World,
        widest: f64,
        events: &'a Events,
        interrupt: &'a Interrupt,
    ) -> Result<Self> {
        let body = &world.bodies[0];
        let coarse = twin.particle_spacing_m.unwrap_or(body.particle_volume_m3.cbrt());
        let refine = request.refine.unwrap_or_else(|| least_refinement(&request.gripper, world.grid_spacing_m));
        let (grid, spacing) = (world.grid_spacing_m / refine as f64, coarse / refine as f64);
        check_pads(&request.gripper, grid, events)?;
        let up = (-world.gravity_m_s2).normalize_or(DVec3::Y);
        let mut gripper_frame =
            GripperFrame::choose(request.axis, &body.positions, coarse, up, &request.gripper, widest)?;
        let [short, long] = request.gripper.pad_m;
        let pads = Pads { size_m: [long, short], thickness_m: 6.0 * grid, friction: request.gripper.friction };
        let mut simulation = PadSimulation {
            world: World {
                bodies: vec![gripper_frame.body(body, coarse, refine)],
                colliders: Vec::new(),
                gravity_m_s2: DVec3::ZERO,
                grid_spacing_m: grid,
                frame_rate_hz: 1.0,
                stepping: Stepping::STABLE,
            },
            pads,
            up: gripper_frame.direction_to_gripper(up),
            interrupt,
        };
        let faces = ContactFaces::of(&simulation.start(0.0)?, &pads, simulation.up, spacing)
            .ok_or_else(|| nothing_there(request.axis))?;
        let object_width = faces.width();
        if widest >= object_width {
            return Err(GraspError::Usage {
                problem: format!(
                    "the object is {object_width:.4} m wide between the pads, so closing to {widest} m does not touch \
                     it"
                ),
                hint: Some("ask for widths below that, or choose another --axis".into()),
            });
        }
        let middle = 0.5 * (faces.x_m[0] + faces.x_m[1]);
        simulation.world.bodies[0].positions.iter_mut().for_each(|p| p.x -= middle);
        gripper_frame.origin += gripper_frame.world_from_gripper.x_axis * middle;
        let modulus = body.material.elastic_moduli().map_or(0.0, |[young, _]| young);
        let wave_speed = (modulus / body.density_kg_m3).sqrt();
        let film = GraspFilm::new(&simulation.world.bodies[0], spacing);
        Ok(Self {
            request,
            events,
            gripper_frame,
            spacing,
            object_width,
            frame_s: FRAME_WAVE_TIMES * object_width / wave_speed,
            speed: CLOSING_WAVE_SPEEDS * wave_speed,
            gravity: gripper_frame.direction_to_gripper(world.gravity_m_s2),
            yielded: vec![false; simulation.world.bodies[0].positions.len()],
            film,
            simulation,
        })
    }

    pub(crate) fn faces(&self, state: &GraspState) -> Result<ContactFaces> {
        ContactFaces::of(state, &self.simulation.pads, self.simulation.up, self.spacing).ok_or_else(|| {
            GraspError::Usage {
                problem: "the object was pushed out from between the pads".into(),
                hint: Some("choose another --axis, larger pads, or a width nearer to the object's own".into()),
            }
        })
    }

    /// A phase without weight along a path.
    pub(crate) fn weightless(&self, frames: usize, path: Vec<(f64, PadPose)>) -> GraspPhase {
        GraspPhase { frame_s: self.frame_s, frames, gravity_m_s2: DVec3::ZERO, path, keep: VELOCITY_KEPT, table: None }
    }
}

fn nothing_there(axis: AxisChoice) -> GraspError {
    GraspError::Usage {
        problem: format!("there is no matter between the pads along the axis {}", axis.name()),
        hint: Some("choose another --axis, or larger pads with --pad".into()),
    }
}
