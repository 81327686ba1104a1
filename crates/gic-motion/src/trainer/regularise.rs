//! What holds the Gaussians together besides the pictures, and how many there are.

use gic_splat::Gaussians;
use rand::Rng;

use super::state::State;
use super::training::Training;
use crate::gaussians::density::{ScreenGradients, control_density, reset_opacity};
use crate::gaussians::parameters::ParameterGradient;
use crate::gaussians::smoothing::SmoothingGraph;

impl Training<'_> {
    /// Shares the pull on each point with its neighbours; false when that is over.
    pub(super) fn smooth(&self, state: &mut State, gradient: &mut ParameterGradient, views: usize) -> bool {
        let (first, last) = self.settings.smoothing;
        let over = state.step as f64 / self.network_start().max(1) as f64;
        let reach = first + (last - first) * over.min(1.0);
        if reach <= 0.0 {
            return false;
        }
        if state.smoothing_graph.positions().len() != state.parameters.len() {
            state.smoothing_graph = SmoothingGraph::new(state.parameters.positions.clone(), state.spacing);
        }
        let graph = state.smoothing_graph.graph();
        let weight = self.settings.loss.tension * views as f64;
        graph.tension(weight, &state.parameters.positions, state.spacing, &mut gradient.positions);
        graph.smooth(reach, &mut gradient.positions);
        true
    }

    /// Adds the L1 norm of the scales (paper eq. 5's last term) for every rendered view.
    pub(super) fn regularise_scales(
        &self,
        state: &State,
        gaussians: &Gaussians,
        views: usize,
        gradient: &mut ParameterGradient,
        d_residuals: &mut [[f32; 4]],
    ) -> f64 {
        let (scales, axes) = (gaussians.shape.flat_scales(), state.parameters.axes());
        let weight = self.settings.loss.scale * views as f64 / (scales.len().max(1) as f64 * state.spacing);
        let mut sum = 0.0;
        for (i, &scale) in scales.iter().enumerate() {
            sum += f64::from(scale);
            // Scales are positive, so their L1 norm is their sum; the factor is d scale / d log scale.
            let d = weight as f32 * scale;
            gradient.log_scales[i] += d;
            d_residuals[i / axes][3] += d;
        }
        weight * sum
    }

    pub(super) fn control_density(&self, state: &mut State, rng: &mut impl Rng) {
        let d = &self.settings.density;
        let until = (d.until * self.settings.steps as f64) as usize;
        // A followed surface was sampled densely from its hull, and its points' neighbourhoods are what holds it
        // together.
        if self.tracks
            || d.every == 0
            || state.step < d.from
            || state.step > until
            || !state.step.is_multiple_of(d.every)
        {
            return;
        }
        let extent = state.object_size();
        let limits = (extent, self.max_gaussians);
        control_density(&mut state.parameters, &mut state.moments, &state.screen, d, limits, rng);
        if d.opacity_reset_every > 0 && state.step.is_multiple_of(d.opacity_reset_every) {
            reset_opacity(&mut state.parameters, &mut state.moments, 2.0 * d.min_opacity);
        }
        state.screen = ScreenGradients::zeros(state.parameters.len());
    }
}
