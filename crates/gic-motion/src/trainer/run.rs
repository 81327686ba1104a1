//! The training loop: steps, evaluations, checkpoints.

use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

use gic_scene::Scene;

use super::checkpoint;
use super::progress::{Listener, Pace, Phase, Progress};
use super::schedule::Trained;
use super::state::State;
use super::training::Training;
use crate::{DynamicGaussians, MotionError, TrainSettings};

/// Reconstructs a scene: trains Gaussians, and their motion if it has several times, to reproduce its pictures.
///
/// `listener` hears of every step and may end training; what was reached until then is returned. With a `checkpoint`
/// folder the state is saved there from time to time, and training continues from a state found there.
/// The same scene, settings and seed give the same result, bit by bit, whatever the number of threads.
///
/// # Errors
/// Unreadable pictures, settings or checkpoints, a scene without object, or a loss that is not finite.
pub fn train(
    scene: &Scene,
    settings: &TrainSettings,
    seed: u64,
    listener: &mut Listener<'_>,
    checkpoint: Option<&Path>,
) -> Result<DynamicGaussians, MotionError> {
    settings.validate(scene.cameras.len())?;
    let training = Training::new(scene, settings, seed)?;
    let resumed = match checkpoint {
        Some(folder) => checkpoint::load(folder, settings, seed, training.sh_degree)?,
        None => None,
    };
    let mut state = match resumed {
        Some(state) => state,
        None => training.start(scene)?,
    };
    training.run(&mut state, listener, checkpoint)?;
    Ok(training.finish(state))
}

impl Training<'_> {
    fn run(
        &self,
        state: &mut State,
        listener: &mut Listener<'_>,
        checkpoint: Option<&Path>,
    ) -> Result<(), MotionError> {
        let steps = self.settings.steps;
        let (pace, mut saved) = (Pace::from(state.step), Instant::now());
        while state.step < steps {
            // As one of the pool's own threads: from outside, each of the dozens of parallel loops of a step would put
            // this thread to sleep.
            let stepped = rayon::scope(|_| self.step(state, &mut *listener))?;
            let stop = match stepped {
                ControlFlow::Break(()) => true,
                ControlFlow::Continue(psnr) => {
                    let held_out = self.evaluate_if_due(state)?;
                    let (seconds, seconds_left) = pace.seconds(state.step, steps);
                    let progress = Progress {
                        phase: if self.trained_in(state.step - 1) == Trained::Gaussians {
                            Phase::WarmUp
                        } else {
                            Phase::Motion
                        },
                        step: state.step,
                        steps,
                        loss: state.mean_loss,
                        psnr,
                        gaussians: state.parameters.len(),
                        held_out,
                        seconds,
                        seconds_left,
                    };
                    listener(&progress).is_break() || self.out_of_patience(state)
                }
            };
            if let Some(folder) = checkpoint
                && (stop || state.step == steps || saved.elapsed().as_secs_f64() > self.settings.checkpoint_seconds)
            {
                checkpoint::save(folder, state, self.settings, self.seed)?;
                saved = Instant::now();
            }
            if stop {
                break;
            }
        }
        Ok(())
    }
}
