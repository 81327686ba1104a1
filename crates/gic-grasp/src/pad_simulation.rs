//! Two rigid pads and what is between them, in the gripper's own frame, step by step.
//!
//! The gripper's frame: x is the direction in which the pads close, y the long side of the pads, z the short one; the
//! origin is half-way between the pads. The pads are boxes of finite size, moved by key frames.

use std::f64::consts::PI;
use std::ops::ControlFlow;

use gic_mpm::{Collider, ColliderPath, Contact, ContactForce, Frame, Options, Primitive, Simulator, Snapshot, World};
use gic_twin::{Interrupt, TwinError};
use glam::{DQuat, DVec3};

use crate::error::{GraspError, Result};

/// First number of a particle's velocity in a snapshot, of its velocity gradient and of its deformation gradient.
const VELOCITY: usize = 3;
const AFFINE: usize = 6;
const DEFORMATION: usize = 15;

/// The two pads.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pads {
    /// Sides of a pad's face along y and z [m].
    pub(super) size_m: [f64; 2],
    /// Thickness [m]: several grid cells, so that no node behind the face is out of the pad.
    pub(super) thickness_m: f64,
    /// Coulomb coefficient of its surface.
    pub(super) friction: f64,
}

/// Where the pads are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PadPose {
    /// Distance of each face from the middle [m].
    pub(super) half_gap_m: f64,
    /// By how much the gripper has been raised [m].
    pub(super) lift_m: f64,
}

/// The pads' path through one phase, and what else acts.
pub(super) struct GraspPhase {
    /// Length of a frame [s].
    pub(super) frame_s: f64,
    /// Number of frames.
    pub(super) frames: usize,
    /// Gravity [m/s^2].
    pub(super) gravity_m_s2: DVec3,
    /// Poses over the time from the start of the phase [s], at least one; straight lines between them.
    pub(super) path: Vec<(f64, PadPose)>,
    /// What is left of the velocities after each frame: below 1, motion dies out and the state tends to rest.
    pub(super) keep: f64,
    /// A point of the table under the matter [m], if there is one.
    pub(super) table: Option<DVec3>,
}

impl GraspPhase {
    /// The pose at a time from the start of the phase [s].
    pub(super) fn pose(&self, time_s: f64) -> PadPose {
        let next = self.path.partition_point(|&(t, _)| t <= time_s);
        match (next.checked_sub(1).map(|i| self.path[i]), self.path.get(next)) {
            (Some((t0, a)), Some(&(t1, b))) => {
                let share = (time_s - t0) / (t1 - t0);
                let mix = |a: f64, b: f64| a + share * (b - a);
                PadPose { half_gap_m: mix(a.half_gap_m, b.half_gap_m), lift_m: mix(a.lift_m, b.lift_m) }
            }
            (Some((_, pose)), None) | (None, Some(&(_, pose))) => pose,
            (None, None) => unreachable!("a phase has at least one pose"),
        }
    }
}

/// The matter and the pads at one moment.
#[derive(Clone)]
pub(super) struct GraspState {
    particles: Snapshot,
    pub(super) pose: PadPose,
}

impl GraspState {
    /// Position of a particle [m].
    pub(super) fn position(&self, particle: usize) -> DVec3 {
        DVec3::from_slice(&self.particles.particles[particle])
    }

    /// Number of particles.
    pub(super) fn len(&self) -> usize {
        self.particles.particles.len()
    }

    /// How much a particle is longer along x than at rest.
    pub(super) fn stretch_x(&self, particle: usize) -> f64 {
        DVec3::from_slice(&self.particles.particles[particle][DEFORMATION..]).length()
    }

    /// Mean velocity of all particles [m/s].
    pub(super) fn mean_velocity(&self) -> DVec3 {
        let all = &self.particles.particles;
        all.iter().map(|p| DVec3::from_slice(&p[VELOCITY..])).sum::<DVec3>() / all.len() as f64
    }

    /// Takes away motion relative to `velocity`.
    fn damp(&mut self, velocity: DVec3, keep: f64) {
        for particle in &mut self.particles.particles {
            for axis in 0..3 {
                let v = &mut particle[VELOCITY + axis];
                *v = velocity[axis] + keep * (*v - velocity[axis]);
            }
            particle[AFFINE..DEFORMATION].iter_mut().for_each(|c| *c *= keep);
        }
    }
}

/// What happens in a phase, frame after frame.
pub(super) struct GraspFrame<'a> {
    pub(super) frame: &'a Frame,
    pub(super) state: &'a GraspState,
    /// Mean forces on the pads over the frame: at negative x, at positive x.
    pub(super) forces: [ContactForce; 2],
}

/// The matter at rest and the gripper around it.
pub(super) struct PadSimulation<'a> {
    /// The matter alone, in the gripper's frame.
    pub(super) world: World,
    pub(super) pads: Pads,
    /// Up, against gravity.
    pub(super) up: DVec3,
    pub(super) interrupt: &'a Interrupt,
}

impl PadSimulation<'_> {
    /// The matter undeformed, with the pads as far apart as given.
    pub(super) fn start(&self, half_gap_m: f64) -> Result<GraspState> {
        let particles = self.simulator(&self.world)?.snapshot();
        Ok(GraspState { particles, pose: PadPose { half_gap_m, lift_m: 0.0 } })
    }

    /// Runs a phase from `state` on; `each` sees every frame and may end the phase after it.
    pub(super) fn run(
        &self,
        state: &mut GraspState,
        phase: &GraspPhase,
        mut each: impl FnMut(&GraspFrame<'_>) -> ControlFlow<()>,
    ) -> Result<()> {
        let mut colliders = vec![self.pad(-1.0, phase), self.pad(1.0, phase)];
        colliders.extend(phase.table.map(|point| Collider::plane(point, self.up, self.contact())));
        let world = World {
            colliders,
            gravity_m_s2: phase.gravity_m_s2,
            frame_rate_hz: 1.0 / phase.frame_s,
            ..self.world.clone()
        };
        let mut simulator = self.simulator(&world)?;
        // The phase begins at the end of frame 1: at time 0 the pads are open, so that the matter at rest is clear of
        // them.
        state.particles.frame = 1;
        simulator.restore(&state.particles).map_err(GraspError::failed)?;
        for i in 1..=phase.frames {
            if self.interrupt.requested() {
                return Err(TwinError::Interrupted {
                    after: "a part of the grasp".into(),
                    resume: "run the same command again; a grasp starts anew".into(),
                }
                .into());
            }
            let frame = simulator.advance_frame().map_err(|source| GraspError::Failed {
                hint: Some("ask for a width that is nearer to the object's own".into()),
                source: source.into(),
            })?;
            let before = state.pose;
            state.particles = simulator.snapshot();
            state.pose = phase.pose(i as f64 * phase.frame_s);
            if phase.keep < 1.0 {
                state.damp(self.up * ((state.pose.lift_m - before.lift_m) / phase.frame_s), phase.keep);
                simulator.restore(&state.particles).map_err(GraspError::failed)?;
            }
            let forces = [frame.contacts[0], frame.contacts[1]];
            if each(&GraspFrame { frame: &frame, state, forces }).is_break() {
                break;
            }
        }
        Ok(())
    }

    fn simulator(&self, world: &World) -> Result<Simulator> {
        Simulator::new(world, &Options::default()).map_err(GraspError::failed)
    }

    /// The pad at negative or positive x.
    fn pad(&self, side: f64, phase: &GraspPhase) -> Collider {
        let centre =
            |pose: PadPose| DVec3::X * (side * (pose.half_gap_m + 0.5 * self.pads.thickness_m)) + self.up * pose.lift_m;
        let start = phase.frame_s;
        let first = phase.pose(0.0);
        let open = PadPose { half_gap_m: self.open_half_gap(), ..first };
        let mut keys = vec![(0.0, centre(open)), (0.5 * start, centre(first))];
        keys.extend(phase.path.iter().map(|&(t, pose)| (start + t, centre(pose))));
        let [long, short] = self.pads.size_m;
        // The pad's face looks along its own x.
        let world_from_collider = if side < 0.0 { DQuat::IDENTITY } else { DQuat::from_rotation_y(PI) };
        Collider {
            primitive: Primitive::Pad { half_size_m: 0.5 * DVec3::new(self.pads.thickness_m, long, short) },
            path: ColliderPath::Keyframed { keys, world_from_collider },
            contact: self.contact(),
        }
    }

    fn contact(&self) -> Contact {
        Contact::Separating { friction: self.pads.friction }
    }

    /// So far apart that the matter at rest is clear of the pads.
    fn open_half_gap(&self) -> f64 {
        let reach = |body: &gic_mpm::Body| body.positions.iter().map(|p| p.x.abs()).fold(0.0, f64::max);
        self.world.bodies.iter().map(reach).fold(0.0, f64::max) + 2.0 * self.world.grid_spacing_m
    }
}
