//! One step of training: draw, compare, pull back, update.

use std::ops::ControlFlow;

use gic_optimize::decayed;
use rayon::prelude::*;

use super::progress::Listener;
use super::schedule::Trained;
use super::state::State;
use super::training::Training;
use super::view_gradient::ViewGradient;
use crate::base::fit::Freedom;
use crate::gaussians::parameters::ParameterGradient;
use crate::pictures::psnr;
use crate::tuning::{LOSS_AVERAGE_WEIGHT, NETWORK_RISE_STEPS};
use crate::{Deformation, MotionError};

impl Training<'_> {
    /// One step of training; returns the PSNR of what it rendered. The listener may end the tracking that precedes the
    /// first step of motion; the state is then as before.
    pub(super) fn step(
        &self,
        state: &mut State,
        listener: &mut Listener<'_>,
    ) -> Result<ControlFlow<(), f64>, MotionError> {
        let mut rng = self.rng(state.step);
        let trained = self.trained_in(state.step);
        if trained != Trained::Gaussians && self.tracks && state.base.is_none() {
            match self.track_base(state, &mut rng, listener)? {
                ControlFlow::Continue(base) => state.base = Some(base),
                ControlFlow::Break(()) => return Ok(ControlFlow::Break(())),
            }
        }
        let (frame, views) = self.draw_views(state, &mut rng);
        let pose = match trained {
            Trained::Gaussians => None,
            _ => state.base.as_ref().map(|base| base.motion.pose(frame)),
        };
        let deformation = (trained == Trained::Everything).then(|| {
            let time = state.domain.normalised_time(views[0].time);
            state.network.forward(&state.domain.normalised(&state.parameters.positions), time)
        });
        let residuals = state.residuals(pose.as_ref(), deformation.as_ref());
        let mut gaussians = state.parameters.gaussians(residuals.as_deref());
        if let (Some(base), Some(pose)) = (&state.base, &pose) {
            base.motion.shade(pose, &state.parameters.positions, &mut gaussians.sh);
        }
        let degree = state.step / self.settings.sh_interval.max(1);

        let mut rendered: Vec<ViewGradient> =
            views.par_iter().map(|view| self.view_gradient(view, &gaussians, degree)).collect::<Result<_, _>>()?;
        let mut gradient = ParameterGradient::zeros(&state.parameters);
        let mut d_residuals = vec![[0.0f32; 4]; gaussians.len()];
        let (mut loss, mut squared) = (0.0, (0.0, 0));
        for view in &mut rendered {
            loss += view.loss;
            squared = (squared.0 + view.squared.0, squared.1 + view.squared.1);
            state.parameters.pull_back(&gaussians, &mut view.slope, &mut gradient, &mut d_residuals);
            state.screen.add(&view.slope.screen, view.screen_unit);
        }
        loss += self.regularise_scales(state, &gaussians, rendered.len(), &mut gradient, &mut d_residuals);
        loss /= rendered.len() as f64;
        if !loss.is_finite() {
            return Err(MotionError::Diverged { step: state.step });
        }
        state.mean_loss = if state.mean_loss.is_finite() {
            state.mean_loss + LOSS_AVERAGE_WEIGHT * (loss - state.mean_loss)
        } else {
            loss
        };

        let fraction = state.step as f64 / self.settings.steps as f64;
        let size = state.object_size();
        let positions = &state.parameters.positions;
        if let (Some(base), Some(pose)) = (&mut state.base, pose) {
            let slope = base.motion.pull_back(&pose, positions, &d_residuals, &mut gradient.positions);
            let freedom = if trained == Trained::Maps { Freedom::Map } else { Freedom::MapAndBend };
            base.update(frame, slope, freedom, (decayed(self.settings.rates.base, fraction), size));
            let slope = base.motion.shade_back(&pose, &state.parameters, &mut gradient);
            base.update_shade(frame, slope, decayed(self.settings.rates.shade, fraction));
        } else {
            for (g, d) in gradient.positions.iter_mut().zip(&d_residuals) {
                g.iter_mut().zip(d).for_each(|(g, d)| *g += d);
            }
        }
        if let Some(deformation) = deformation {
            self.update_network(state, &deformation, &mut d_residuals, &mut gradient, fraction);
        }
        state.step += 1;
        let (rates, when) = (&self.settings.rates, (state.step, fraction));
        let alike = self.smooth(state, &mut gradient, rendered.len());
        state.moments.update(&mut state.parameters, &gradient, rates, when, (size, alike));
        self.control_density(state, &mut rng);
        self.average(state);
        Ok(ControlFlow::Continue(psnr(squared)))
    }

    fn update_network(
        &self,
        state: &mut State,
        deformation: &Deformation<f32>,
        d_residuals: &mut [[f32; 4]],
        gradient: &mut ParameterGradient,
        fraction: f64,
    ) {
        let extent = state.domain.extent as f32;
        for d in d_residuals.iter_mut() {
            d[..3].iter_mut().for_each(|x| *x *= extent);
        }
        let slope = state.network.backward(deformation, d_residuals);
        for (g, d) in gradient.positions.iter_mut().flatten().zip(slope.positions.iter().flatten()) {
            *g += d / extent;
        }
        state.network_steps += 1;
        // Adam's first steps are as long as any, whatever the gradient: unchecked they would undo the path.
        let rise = (state.network_steps as f64 / NETWORK_RISE_STEPS).min(1.0);
        let rate = rise * decayed(self.settings.rates.network, fraction);
        state.network_moments.update(&mut state.network.parameters, &slope.parameters, rate, state.network_steps);
    }
}
