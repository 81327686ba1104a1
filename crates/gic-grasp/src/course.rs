//! The course of a grasp: at each width the pads close and hold, and the object is lifted.

use gic_mpm::{Forecast, World};
use gic_twin::simulate::over_budget_hint;

use crate::error::{GraspError, Result};
use crate::grasp::Grasp;
use crate::lift::{LIFT_FRAME_S, LIFT_FRAMES};
use crate::report::GraspReport;
use crate::request::STAGE;
use crate::squeeze::AVERAGING_FRAMES;

impl Grasp<'_> {
    /// What closing, holding and lifting take at least: forces may need more windows until they are steady.
    ///
    /// # Errors
    /// More than the budget.
    pub(crate) fn forecast(&self, widths: &[f64]) -> Result<Forecast> {
        let narrowest = widths.iter().copied().fold(f64::INFINITY, f64::min);
        let closing = 0.5 * (self.object_width - narrowest) / self.speed / self.frame_s;
        let lifting = LIFT_FRAMES.iter().sum::<usize>() as f64 * LIFT_FRAME_S / self.frame_s;
        let frames = closing + widths.len() as f64 * (2.0 * AVERAGING_FRAMES as f64 + lifting);
        let world = World { frame_rate_hz: 1.0 / self.frame_s, ..self.simulation.world.clone() };
        let forecast = Forecast::of(&world, frames.ceil() as usize);
        let checked = forecast.and_then(|forecast| forecast.check(&self.request.budget).map(|()| forecast));
        checked.map_err(|source| {
            let hint = over_budget_hint(&source);
            GraspError::Failed { hint, source: source.into() }
        })
    }

    pub(crate) fn run(&mut self, widths: &[f64]) -> Result<GraspReport> {
        let body = &self.simulation.world.bodies[0];
        let (mass, material, particles) = (body.masses_kg().iter().sum(), body.material, self.yielded.len());
        let mut state = self.simulation.start(0.5 * self.object_width + 2.5 * self.simulation.world.grid_spacing_m)?;
        let mut squeezes = Vec::new();
        for (done, &width) in widths.iter().enumerate() {
            self.close(&mut state, width, widths[widths.len() - 1])?;
            let mut squeeze = self.measure(&mut state, width)?;
            squeeze.lift = self.lift(state.clone(), mass)?;
            let values = [("width_m", width), ("force_n", squeeze.force_n)];
            self.events.step(STAGE, "", done as u64 + 1, Some(widths.len() as u64), &values);
            squeezes.push(squeeze);
        }
        Ok(GraspReport {
            schema: "gic.grasp/1".into(),
            gic_version: gic_twin::VERSION.into(),
            axis: self.request.axis.name().into(),
            axis_direction: self.gripper_frame.world_from_gripper.x_axis.to_array(),
            centre_m: self.gripper_frame.origin.to_array(),
            object_width_m: self.object_width,
            pad_m: self.request.gripper.pad_m,
            friction: self.request.gripper.friction,
            lift_m: self.request.gripper.lift_m,
            mass_kg: mass,
            material: material.model().into(),
            yield_von_mises_pa: material.yield_von_mises_pa(),
            grid_spacing_m: self.simulation.world.grid_spacing_m,
            particle_spacing_m: self.spacing,
            particles,
            widths: squeezes,
        })
    }
}
