//! Closing the pads to a width, and holding there until the forces are steady.

use std::ops::ControlFlow;

use gic_mpm::World;

use crate::contact::contact_patches;
use crate::error::{GraspError, Result};
use crate::grasp::Grasp;
use crate::pad_simulation::{GraspFrame, GraspState, PadPose};
use crate::percentile::percentile;
use crate::report::Squeeze;

/// Frames over which forces are averaged.
pub(crate) const AVERAGING_FRAMES: usize = 24;
/// Forces are steady when the means of two windows differ by less than this share.
const STEADY_RELATIVE_CHANGE: f64 = 2e-3;
/// Most windows to wait for that.
const MAX_AVERAGING_WINDOWS: usize = 40;
/// Matter is taken to yield from this share of the yield stress on: f32 rounding.
const YIELD_SHARE: f64 = 0.999;

impl Grasp<'_> {
    /// Closes the pads to `width`; `narrowest` [m] is the last width to come.
    pub(crate) fn close(&mut self, state: &mut GraspState, width: f64, narrowest: f64) -> Result<()> {
        let start = state.pose;
        let end = PadPose { half_gap_m: 0.5 * width, ..start };
        let seconds = (start.half_gap_m - end.half_gap_m) / self.speed;
        let frames = (seconds / self.frame_s).ceil() as usize;
        let phase = self.weightless(frames, vec![(0.0, start), (seconds, end)]);
        // About forty pictures from the first touch to the narrowest width.
        let every = (self.object_width - narrowest) / 80.0 / self.speed / self.frame_s;
        let Self { simulation, yielded, film, .. } = self;
        let mut passed = f64::INFINITY;
        simulation.run(state, &phase, |moment| {
            mark_yielded(yielded, moment, &simulation.world);
            passed += 1.0;
            if passed >= every {
                passed = 0.0;
                film.record(moment);
            }
            ControlFlow::Continue(())
        })?;
        state.pose = end;
        Ok(())
    }

    /// Holds until the forces are steady, and measures.
    pub(crate) fn measure(&mut self, state: &mut GraspState, width: f64) -> Result<Squeeze> {
        let phase = self.weightless(MAX_AVERAGING_WINDOWS * AVERAGING_FRAMES, vec![(0.0, state.pose)]);
        let mut forces: Vec<[f64; 2]> = Vec::new();
        let mut stresses = Vec::new();
        let Self { simulation, yielded, film, .. } = self;
        simulation.run(state, &phase, |moment| {
            mark_yielded(yielded, moment, &simulation.world);
            forces.push([-moment.forces[0].force_n.x, moment.forces[1].force_n.x]);
            if !(forces.len().is_multiple_of(AVERAGING_FRAMES) && is_steady(&forces)) {
                return ControlFlow::Continue(());
            }
            film.hold(moment);
            stresses = moment.frame.von_mises_pa.clone();
            ControlFlow::Break(())
        })?;
        if stresses.is_empty() {
            return Err(GraspError::Failed {
                hint: Some("ask for a width that is nearer to the object's own, or larger pads".into()),
                source: format!("the forces on the pads do not become steady at a width of {width} m").into(),
            });
        }
        let window = &forces[forces.len() - AVERAGING_FRAMES..];
        let mean = |side: usize| window.iter().map(|f| f[side]).sum::<f64>() / AVERAGING_FRAMES as f64;
        let forces_n = [mean(0), mean(1)];
        let force_n = 0.5 * (forces_n[0] + forces_n[1]);
        let of_both = |f: &[f64; 2]| 0.5 * (f[0] + f[1]) - force_n;
        let faces = self.faces(state)?;
        let contact_patches = contact_patches(state, &self.simulation.pads, self.simulation.up, self.spacing, &faces);
        let yields = self.simulation.world.bodies[0].material.yield_von_mises_pa().is_some();
        Ok(Squeeze {
            width_m: width,
            measured_width_m: faces.width(),
            standoff_m: state.pose.half_gap_m - 0.5 * faces.width(),
            forces_n,
            force_n,
            imbalance: (forces_n[0] - forces_n[1]) / force_n.abs().max(f64::MIN_POSITIVE),
            force_spread_n: (window.iter().map(|f| of_both(f).powi(2)).sum::<f64>() / AVERAGING_FRAMES as f64).sqrt(),
            contact_areas_m2: [contact_patches[0].area_m2, contact_patches[1].area_m2],
            peak_von_mises_pa: percentile(&stresses, 1.0),
            p99_von_mises_pa: percentile(&stresses, 0.99),
            yielded_share: yields
                .then(|| self.yielded.iter().filter(|y| **y).count() as f64 / self.yielded.len() as f64),
            lift: None,
        })
    }
}

fn mark_yielded(yielded: &mut [bool], moment: &GraspFrame<'_>, world: &World) {
    let Some(limit) = world.bodies[0].material.yield_von_mises_pa() else { return };
    let frame = moment.frame;
    for ((yielded, &stress), &j) in yielded.iter_mut().zip(&frame.von_mises_pa).zip(&frame.jacobian) {
        // Cauchy times J is Kirchhoff.
        *yielded |= f64::from(stress) * f64::from(j) >= YIELD_SHARE * limit;
    }
}

/// Whether the forces of the last window are those of the one before.
fn is_steady(forces: &[[f64; 2]]) -> bool {
    if forces.len() < 2 * AVERAGING_FRAMES {
        return false;
    }
    let mean = |end: usize, side: usize| {
        forces[end - AVERAGING_FRAMES..end].iter().map(|f| f[side]).sum::<f64>() / AVERAGING_FRAMES as f64
    };
    (0..2).all(|side| {
        let (now, before) = (mean(forces.len(), side), mean(forces.len() - AVERAGING_FRAMES, side));
        (now - before).abs() <= STEADY_RELATIVE_CHANGE * now.abs()
    })
}
