//! When training is good enough, and what it leaves.

use super::schedule::Trained;
use super::state::{Best, Learned, State};
use super::training::Training;
use crate::gaussians::parameters::Parameters;
use crate::tuning::{MIN_PROGRESS_DB, MIN_PROGRESS_LOSS};
use crate::{BaseMotion, Displacement, Domain, DynamicGaussians, MotionError, MotionNetwork, ViewScore, evaluate};

impl Training<'_> {
    /// Measures the held-out views when it is time, and remembers the best state.
    pub(super) fn evaluate_if_due(&self, state: &mut State) -> Result<Option<ViewScore>, MotionError> {
        let every = self.settings.evaluate_every;
        let now = every > 0 && (state.step.is_multiple_of(every) || state.step == self.settings.steps);
        if !now || (!self.is_static && self.trained_in(state.step) == Trained::Gaussians) {
            return Ok(None);
        }
        if self.held_out.is_empty() {
            self.compare_mean_loss(state);
            return Ok(None);
        }
        let base = state.base.as_ref().map(|base| &base.motion);
        let (parameters, network) = state.result();
        let model = self.model(parameters, network, base, state.domain);
        let score = ViewScore::mean(&evaluate::score_targets(&self.held_out, |time| model.at(time))?);
        let best = state.best.as_ref().map_or(f64::NEG_INFINITY, |best| best.psnr);
        if score.psnr > best {
            let learned = Learned { parameters: parameters.clone(), network: network.to_vec() };
            state.best = Some(Best { psnr: score.psnr, learned, base: base.cloned() });
        }
        state.stale = if score.psnr > best + MIN_PROGRESS_DB { 0 } else { state.stale + 1 };
        Ok(Some(score))
    }

    /// Without held-out views: progress is a moving average of the loss lower than ever before.
    pub(super) fn compare_mean_loss(&self, state: &mut State) {
        if state.lowest_loss.is_none_or(|lowest| state.mean_loss < (1.0 - MIN_PROGRESS_LOSS) * lowest) {
            state.lowest_loss = Some(state.mean_loss);
            state.stale = 0;
        } else {
            state.stale += 1;
        }
    }

    pub(super) fn out_of_patience(&self, state: &State) -> bool {
        self.settings.patience > 0 && state.stale >= self.settings.patience
    }

    pub(super) fn finish(&self, state: State) -> DynamicGaussians {
        if let Some(best) = &state.best {
            let Learned { parameters, network } = &best.learned;
            return self.model(parameters, network, best.base.as_ref(), state.domain);
        }
        let (parameters, network) = state.result();
        self.model(parameters, network, state.base.as_ref().map(|base| &base.motion), state.domain)
    }

    pub(super) fn model(
        &self,
        parameters: &Parameters,
        weights: &[f32],
        given: Option<&BaseMotion>,
        domain: Domain,
    ) -> DynamicGaussians {
        let base = |base: &BaseMotion| match &self.flight {
            Some(flight) => base.with_flight(flight),
            None => base.clone(),
        };
        let motion = || {
            let mut network = MotionNetwork::zeros(self.settings.network);
            network.parameters = weights.to_vec();
            Displacement { network, domain, base: given.map(base) }
        };
        DynamicGaussians { canonical: parameters.gaussians(None), motion: (!self.is_static).then(motion) }
    }
}
