//! What takes part in each step, and which pictures it is shown.

use rand::{Rng, RngExt};

use super::state::State;
use super::training::Training;
use crate::pictures::Target;

/// What takes part in a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Trained {
    /// The Gaussians alone.
    Gaussians,
    /// Gaussians and affine maps, on the frames that these explain.
    Maps,
    /// Gaussians and the whole base motion, on all frames.
    BaseMotion,
    /// Everything.
    Everything,
}

impl Training<'_> {
    /// What takes part in `step` (counted from 0).
    pub(super) fn trained_in(&self, step: usize) -> Trained {
        if self.is_static || step < self.settings.warm_up_steps {
            Trained::Gaussians
        } else if self.tracks && step < self.settings.warm_up_steps + self.settings.mapped_steps {
            Trained::Maps
        } else if step < self.network_start() {
            Trained::BaseMotion
        } else {
            Trained::Everything
        }
    }

    /// The first step in which the network takes part.
    pub(super) fn network_start(&self) -> usize {
        let base_steps = if self.tracks { self.settings.mapped_steps + self.settings.bent_steps } else { 0 };
        self.settings.warm_up_steps + base_steps
    }

    /// Views of one step: of one frame (which is told when the step knows motion), a few cameras.
    pub(super) fn draw_views(&self, state: &State, rng: &mut impl Rng) -> (usize, Vec<&Target>) {
        let explained = state.base.as_ref().map_or(1, |base| base.explained);
        let frames = match self.trained_in(state.step) {
            Trained::Gaussians if !self.synchronous => {
                return (0, self.choose(state.step, self.frames.concat(), rng, self.settings.views_per_step));
            }
            Trained::Gaussians => 1,
            Trained::Maps => explained,
            Trained::BaseMotion => self.frames.len(),
            Trained::Everything if state.base.is_some() => self.frames.len(),
            Trained::Everything => {
                let grown = (state.step - self.network_start() + 1) as f64 / self.settings.growth_steps.max(1) as f64;
                (grown * self.frames.len() as f64).ceil() as usize
            }
        };
        let frame = self.draw_frame(frames.clamp(1, self.frames.len()), rng);
        (frame, self.choose(state.step, self.frames[frame].clone(), rng, self.settings.views_per_step))
    }

    /// One of the first `frames`, each as likely as it has pictures.
    fn draw_frame(&self, frames: usize, rng: &mut impl Rng) -> usize {
        let pictures = self.frames[..frames].iter().map(Vec::len);
        let drawn = rng.random_range(0..pictures.clone().sum());
        let ends = pictures.scan(0, |end, count| {
            *end += count;
            Some(*end)
        });
        ends.take_while(|end| *end <= drawn).count()
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
