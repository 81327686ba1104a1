//! What takes part in each step, and which pictures it is shown.

use rand::{Rng, RngExt};

use super::state::State;
use super::training::Training;
use crate::pictures::Target;

/// What takes part in a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stage {
    /// The Gaussians alone.
    Still,
    /// Gaussians and affine maps, on the frames that these explain.
    Mapped,
    /// Gaussians and the whole base motion, on all frames.
    Bent,
    /// Everything.
    Network,
}

impl Training<'_> {
    /// What takes part in `step` (counted from 0).
    pub(super) fn stage(&self, step: usize) -> Stage {
        if self.is_static || step < self.settings.warm_up_steps {
            Stage::Still
        } else if self.follows && step < self.settings.warm_up_steps + self.settings.mapped_steps {
            Stage::Mapped
        } else if step < self.network_start() {
            Stage::Bent
        } else {
            Stage::Network
        }
    }

    /// The first step in which the network takes part.
    pub(super) fn network_start(&self) -> usize {
        let base_steps = if self.follows { self.settings.mapped_steps + self.settings.bent_steps } else { 0 };
        self.settings.warm_up_steps + base_steps
    }

    /// Views of one step: of one frame (which is told when the step knows motion), a few cameras.
    pub(super) fn draw_views(&self, state: &State, rng: &mut impl Rng) -> (usize, Vec<&Target>) {
        let explained = state.base.as_ref().map_or(1, |base| base.explained);
        let frames = match self.stage(state.step) {
            Stage::Still if !self.synchronous => {
                return (0, self.choose(state.step, self.frames.concat(), rng, self.settings.views_per_step));
            }
            Stage::Still => 1,
            Stage::Mapped => explained,
            Stage::Bent => self.frames.len(),
            Stage::Network if state.base.is_some() => self.frames.len(),
            Stage::Network => {
                let grown = (state.step - self.network_start() + 1) as f64 / self.settings.growth_steps.max(1) as f64;
                (grown * self.frames.len() as f64).ceil() as usize
            }
        };
        let frame = rng.random_range(0..frames.clamp(1, self.frames.len()));
        (frame, self.choose(state.step, self.frames[frame].clone(), rng, self.settings.views_per_step))
    }

    /// A random few of the targets in `pool`, as `step` shows them.
    pub(super) fn choose(&self, step: usize, mut pool: Vec<usize>, rng: &mut impl Rng, count: usize) -> Vec<&Target> {
        let count = count.min(pool.len());
        for i in 0..count {
            let j = rng.random_range(i..pool.len());
            pool.swap(i, j);
        }
        let half_sized = step < (self.settings.half_size * self.settings.steps as f64) as usize;
        let targets = if half_sized { &self.halved } else { &self.targets };
        pool[..count].iter().map(|&i| &targets[i]).collect()
    }
}
