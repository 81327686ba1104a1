//! Lifting: weight sets in, the gripper is raised from a table, and what slides or stays behind is measured.

use std::ops::ControlFlow;

use glam::DVec3;

use crate::contact::{contact_patches, mean_position};
use crate::error::Result;
use crate::grasp::{Grasp, VELOCITY_KEPT};
use crate::pad_simulation::{GraspPhase, GraspState, PadPose};
use crate::report::Lift;

/// Length of a frame while lifting [s].
pub(crate) const LIFT_FRAME_S: f64 = 0.01;
/// Frames in which weight sets in, in which the gripper rises, and in which it stands again.
pub(crate) const LIFT_FRAMES: [usize; 3] = [20, 40, 20];

impl Grasp<'_> {
    /// Lets weight set in, raises the gripper and waits; `None` without gravity.
    pub(crate) fn lift(&mut self, mut state: GraspState, mass: f64) -> Result<Option<Lift>> {
        if self.gravity == DVec3::ZERO {
            return Ok(None);
        }
        let faces = self.faces(&state)?;
        let held = contact_patches(&state, &self.simulation.pads, self.simulation.up, self.spacing, &faces);
        let held: Vec<usize> = held.into_iter().flat_map(|side| side.particles).collect();
        let everything = 0..state.len();
        let (held_before, before) =
            (mean_position(&state, held.iter().copied()), mean_position(&state, everything.clone()));
        let table = self.table(&state);
        let lift = self.request.gripper.lift_m;
        let mut peak: f64 = 0.0;
        let mut carried = Vec::new();
        let up = self.simulation.up;
        for (weight, phase) in self.lift_phases(state.pose, table) {
            let Self { simulation, film, .. } = self;
            let mut index = 0;
            simulation.run(&mut state, &phase, |moment| {
                index += 1;
                if weight == 1.0 && index % 3 == 0 {
                    film.record(moment);
                }
                peak = moment.frame.von_mises_pa.iter().fold(peak, |most, &s| most.max(f64::from(s)));
                carried.push(-(moment.forces[0].force_n + moment.forces[1].force_n).dot(up));
                ControlFlow::Continue(())
            })?;
        }
        // Sliding along the pads; across them the matter only deforms.
        let slide = mean_position(&state, held.iter().copied()) - held_before - up * lift;
        let risen = (mean_position(&state, everything) - before).dot(up);
        let last = &carried[carried.len() - LIFT_FRAMES[2]..];
        Ok(Some(Lift {
            slip_m: slide.reject_from_normalized(DVec3::X).length(),
            dropped: risen < 0.5 * lift
                || state.mean_velocity().dot(up) < -lift / (LIFT_FRAMES[1] as f64 * LIFT_FRAME_S),
            carried_share: last.iter().sum::<f64>() / last.len() as f64 / (mass * self.gravity.length()),
            peak_von_mises_pa: peak,
        }))
    }

    /// The phases of lifting, each with the share of the weight that acts: on the table in steps, up, and standing.
    fn lift_phases(&self, pose: PadPose, table: DVec3) -> Vec<(f64, GraspPhase)> {
        let lift = self.request.gripper.lift_m;
        let [ramp, rise, rest] = LIFT_FRAMES;
        let phase = |weight: f64, frames: usize, path: Vec<(f64, PadPose)>, keep: f64| {
            let gravity_m_s2 = self.gravity * weight;
            (weight, GraspPhase { frame_s: LIFT_FRAME_S, frames, gravity_m_s2, path, keep, table: Some(table) })
        };
        let mut phases: Vec<_> =
            (1..ramp).map(|i| phase(i as f64 / ramp as f64, 1, vec![(0.0, pose)], VELOCITY_KEPT)).collect();
        // Starts and ends without a jerk of the speed.
        let smooth = |i: usize| {
            let t = i as f64 / rise as f64;
            (i as f64 * LIFT_FRAME_S, PadPose { lift_m: lift * t * t * (3.0 - 2.0 * t), ..pose })
        };
        phases.push(phase(1.0, rise + rest, (0..=rise).map(smooth).collect(), 1.0));
        phases
    }

    /// A point of the table that just carries the matter, at rest and as it is now [m].
    fn table(&self, state: &GraspState) -> DVec3 {
        let up = self.simulation.up;
        let rest = self.simulation.world.bodies[0].positions.iter().map(|p| p.dot(up));
        let now = (0..state.len()).map(|p| state.position(p).dot(up));
        up * (rest.chain(now).fold(f64::INFINITY, f64::min) - 0.5 * self.spacing)
    }
}
