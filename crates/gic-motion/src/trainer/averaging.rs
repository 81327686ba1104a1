//! The mean of the last steps (Polyak & Juditsky 1992): what the few pictures of a step change back and forth cancels.

use super::state::{Learned, Mean, State};
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
                mean.learned.parameters.mix(parameters, share);
                mix(&mut mean.learned.network, network, share);
            }
            None => {
                let learned = Learned { parameters: parameters.clone(), network: network.clone() };
                state.mean = Some(Mean { learned, steps: 1 });
            }
        }
    }
}
