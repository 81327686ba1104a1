//! The mean of the last steps (Polyak & Juditsky 1992): what the few pictures of a step change back and forth cancels.

use super::state::{Mean, State};
use super::training::Training;
use crate::gaussians::parameters::mix;

impl Training<'_> {
    /// Takes the step that was just made into the mean, where it is one of those that count.
    pub(super) fn average(&self, state: &mut State) {
        let first = (1.0 - self.settings.averaged) * self.settings.steps as f64;
        if state.step as f64 <= first {
            return;
        }
        let (parameters, network) = (&state.parameters, &state.network.parameters);
        match &mut state.mean {
            Some(mean) => {
                mean.steps += 1;
                let share = 1.0 / mean.steps as f32;
                mean.parameters.mix(parameters, share);
                mix(&mut mean.network, network, share);
            }
            None => state.mean = Some(Mean { parameters: parameters.clone(), network: network.clone(), steps: 1 }),
        }
    }
}
