//! The simulator as a function of a hypothesis: MPM rollouts of all particles, or of a thinned body on a coarser grid.
//!
//! Free flight without rotation is known in closed form, so the rollout starts at its last frame.

use std::sync::atomic::{AtomicUsize, Ordering};

use gic_mpm::{Body, MaterialKind, Options, Stepping, World, rollout};
use glam::DVec3;

use crate::forward::drawing::Drawing;
use crate::forward::flight::{fall, placed, substep, volume_factors};
use crate::forward::shape::ShapeModes;
use crate::forward::splat_widths::SplatWidths;
use crate::forward::trajectories::{ForwardModel, FrameSelection, Trajectories};
use crate::forward::world::{colliders, gravity};
use crate::observe::video::ObservedVideo;
use crate::unknowns::parameter::{material_of, sought};
use crate::unknowns::state::State;
use crate::{FitError, Input};

/// How many rollouts were made, on the full grid and on the coarse one.
#[derive(Debug)]
pub(crate) struct RolloutCounts {
    pub full: AtomicUsize,
    pub coarse: AtomicUsize,
}

impl RolloutCounts {
    /// Goes on from `(full, coarse)`.
    pub(crate) fn new((full, coarse): (usize, usize)) -> RolloutCounts {
        RolloutCounts { full: AtomicUsize::new(full), coarse: AtomicUsize::new(coarse) }
    }

    /// Those on the full grid.
    pub(crate) fn full(&self) -> usize {
        self.full.load(Ordering::Relaxed)
    }

    /// Those on the coarse grid.
    pub(crate) fn coarse(&self) -> usize {
        self.coarse.load(Ordering::Relaxed)
    }
}

/// Which particles are simulated, on which grid.
#[derive(Clone, Debug)]
pub(crate) struct Resolution {
    /// Indices of the simulated particles; `None` for all. The others move with none: they are not compared either.
    pub thinning: Option<Vec<usize>>,
    /// Factor on the grid spacing.
    pub spacing_factor: f64,
    /// Substeps per frame.
    pub substeps_per_frame: usize,
}

/// Rollouts of the input's particles.
pub(crate) struct Simulation<'a> {
    pub input: &'a Input,
    pub video: &'a ObservedVideo,
    pub shape: &'a ShapeModes,
    pub kind: MaterialKind,
    pub options: Options,
    pub resolution: Resolution,
    /// Leading observations that are free flight: computed in closed form, the rollout starts at the last of them.
    pub free: usize,
    pub rollouts: &'a AtomicUsize,
    /// Widths of the simulated particles' Gaussians.
    pub splat_widths: &'a SplatWidths,
}

impl Simulation<'_> {
    /// The material of a state.
    pub(crate) fn material(&self, state: &State) -> gic_mpm::Material {
        let values: Vec<f64> = sought(self.kind).iter().zip(&state.material).map(|(p, c)| p.value(*c)).collect();
        material_of(self.kind, &values)
    }

    /// Side of a cell of a state's grid [m].
    pub(crate) fn cell_m(&self, state: &State) -> f64 {
        self.input.grid_spacing_m * self.resolution.spacing_factor * state.log_cell.exp()
    }

    /// Substeps per frame of a state: the more, the finer its grid.
    pub(crate) fn substeps_per_frame(&self, state: &State) -> usize {
        (self.resolution.substeps_per_frame as f64 * (-state.log_cell).exp()).ceil() as usize
    }

    /// Half of the time of free flight [s].
    pub(crate) fn halfway_s(&self) -> f64 {
        let last = self.video.frames[self.free.max(1) - 1].simulated_frame;
        0.5 * last as f64 / self.input.frame_rate_hz
    }

    /// Initial velocity of a state [m/s].
    pub(crate) fn velocity(&self, state: &State) -> DVec3 {
        state.velocity + self.halfway_s() * (self.input.gravity_m_s2 - gravity(self.input, state))
    }

    /// How far the body has flown at a simulated frame [m].
    fn flown(&self, state: &State, frame: usize) -> DVec3 {
        let time = frame as f64 / self.input.frame_rate_hz;
        self.velocity(state) * time + fall(gravity(self.input, state), time, substep(self.input))
    }

    /// The world of a state, starting at simulated frame `from`; before it the body flies freely without rotation.
    fn world(&self, state: &State, from: usize) -> World {
        let input = self.input;
        let (all, _) = placed(input, self.shape, state);
        let time = from as f64 / input.frame_rate_hz;
        let (shift, gravity_m_s2) = (self.flown(state, from), gravity(input, state));
        let factors = volume_factors(input, self.shape, state);
        let (positions, volume_factors, share): (Vec<DVec3>, Vec<f64>, f64) = match &self.resolution.thinning {
            None => (all.iter().map(|p| *p + shift).collect(), factors, 1.0),
            Some(ids) => {
                // Whose own volumes say little about the cells that they stand for.
                let share = factors.iter().sum::<f64>() / ids.len() as f64;
                (ids.iter().map(|i| all[*i] + shift).collect(), Vec::new(), share)
            }
        };
        World {
            bodies: vec![Body {
                material: self.material(state),
                density_kg_m3: input.density_kg_m3,
                particle_volume_m3: input.particle_volume_m3 * share,
                volume_factors,
                positions,
                velocity_m_s: self.velocity(state) + gravity_m_s2 * time,
                angular_velocity_rad_s: state.angular,
                own_velocities_m_s: Vec::new(),
            }],
            colliders: colliders(input, state),
            gravity_m_s2,
            grid_spacing_m: self.cell_m(state),
            frame_rate_hz: input.frame_rate_hz,
            stepping: Stepping::at_least(self.substeps_per_frame(state)),
        }
    }

    /// The world of a state and the simulated frame at which it starts.
    pub(crate) fn world_and_start(&self, state: &State) -> (World, usize) {
        let from = self.start(state);
        (self.world(state, from), from)
    }

    /// Counts one rollout.
    pub(crate) fn count(&self) {
        self.rollouts.fetch_add(1, Ordering::Relaxed);
    }

    /// The first frame of the rollout. It is the last free one where nothing but a translation happens before and no
    /// obstacle moves (the rollout's clock would start late), and 0 elsewhere.
    fn start(&self, state: &State) -> usize {
        let still = self.input.colliders.iter().all(|c| match &c.path {
            gic_mpm::ColliderPath::Uniform { velocity_m_s, angular_velocity_rad_s, .. } => {
                *velocity_m_s == DVec3::ZERO && *angular_velocity_rad_s == DVec3::ZERO
            }
            gic_mpm::ColliderPath::Keyframed { keys, .. } => keys.len() <= 1,
        });
        if still && state.angular == DVec3::ZERO { self.video.frames[self.free.max(1) - 1].simulated_frame } else { 0 }
    }
}

impl ForwardModel for Simulation<'_> {
    fn trajectories(&self, state: &State, selection: &FrameSelection) -> Result<Trajectories, FitError> {
        self.count();
        let end = selection.end.min(self.video.frames.len());
        let (world, from) = self.world_and_start(state);
        let mut positions = vec![Vec::new(); self.video.frames.len()];
        let keeps_velocities = self.input.device_doubts.iter().any(|doubt| doubt.deviation.late_s > 0.0);
        let mut velocities = vec![Vec::new(); if keeps_velocities { self.video.frames.len() } else { 0 }];
        let centre = self.input.centre() + state.offset + self.flown(state, from);
        let mut scales = vec![self.splat_widths.rest_scales().to_vec(); self.video.frames.len()];
        let single = |p: &DVec3| p.as_vec3().to_array();
        for (o, observed) in self.video.frames.iter().enumerate().take(end) {
            if o < selection.first || observed.simulated_frame > from {
                continue;
            }
            // Free flight, seen from where the rollout starts.
            let back = self.flown(state, observed.simulated_frame) - self.flown(state, from);
            positions[o] = world.bodies[0].positions.iter().map(|p| single(&(*p + back))).collect();
            if keeps_velocities {
                let time = observed.simulated_frame as f64 / self.input.frame_rate_hz;
                let velocity = self.velocity(state) + gravity(self.input, state) * time;
                let turning = |p: &DVec3| single(&(velocity + state.angular.cross(*p - centre)));
                velocities[o] = world.bodies[0].positions.iter().map(turning).collect();
            }
        }
        let last = self.video.frames[..end].last().map_or(0, |observed| observed.simulated_frame);
        let frames = (last + 1).saturating_sub(from);
        if frames > 1 {
            rollout(&world, &self.options, frames, |frame| {
                let Some(o) =
                    self.video.frames.iter().position(|observed| observed.simulated_frame == frame.index + from)
                else {
                    return;
                };
                if frame.index > 0 && o >= selection.first && o < end {
                    positions[o] = frame.positions.iter().map(single).collect();
                    if keeps_velocities {
                        velocities[o] = frame.velocities.iter().map(single).collect();
                    }
                    if !self.video.frames[o].views.is_empty() {
                        scales[o] = self.splat_widths.scales(&frame.positions);
                    }
                }
            })?;
        }
        if positions.iter().flatten().flatten().any(|x| !x.is_finite()) {
            return Err(FitError::NotFinite);
        }
        let outward_displacements = self.shape.outward_displacements(&state.shape);
        let drawing = Drawing::of(state);
        Ok(Trajectories { positions, velocities, scales, drawing, outward_displacements })
    }
}
