//! The training loop, static and dynamic.

mod checkpoint;
mod follow;
mod judge;
mod regularise;
mod schedule;
mod start;
mod view_gradient;

use std::collections::{BTreeMap, BTreeSet};
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

use gic_optimize::{Moments, decayed};
use gic_scene::Scene;
use gic_splat::Gaussians;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::base::Pose;
use crate::base::fit::{Base, Freedom};
use crate::gaussians::parameters::{Gradient, ParameterMoments, Parameters, ScreenGradients};
use crate::gaussians::smoothing::Anchors;
use crate::pictures::{self, Target};
use crate::settings::MIN_SYNCHRONOUS;
use crate::{BaseMotion, Deformation, Domain, DynamicGaussians, MotionError, MotionNetwork, TrainSettings, ViewScore};
use schedule::Stage;
use start::MIN_GAUSSIANS;
use view_gradient::ViewGradient;

/// Length of the network's unit, in radii of the object's ball at the first frame.
const EXTENT_RADII: f64 = 2.0;
/// Weight of the newest step in the moving average of the loss.
const AVERAGE: f64 = 0.02;
/// Steps over which the network's learning rate rises to its full value.
const NETWORK_RISE_STEPS: f64 = 100.0;

/// What training is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Static Gaussians on the first frame, or on all pictures of a static scene.
    WarmUp,
    /// Gaussians and motion together.
    Motion,
}

/// One step of training, told to the callback.
#[derive(Clone, Debug)]
pub struct Progress {
    /// What training is doing.
    pub phase: Phase,
    /// Steps done.
    pub step: usize,
    /// Steps in all.
    pub steps: usize,
    /// Moving average of the loss (paper eq. 5).
    pub loss: f64,
    /// PSNR [dB] over the windows rendered in this step.
    pub psnr: f64,
    /// Number of Gaussians.
    pub gaussians: usize,
    /// Mean scores of the held-out views, when they were just measured.
    pub held_out: Option<ViewScore>,
    /// Seconds since training (or its continuation) started.
    pub seconds: f64,
    /// Seconds left, at the present pace.
    pub seconds_left: f64,
}

/// Everything that changes during training; what a checkpoint holds.
#[derive(Clone, Debug)]
pub(crate) struct State {
    pub(crate) step: usize,
    pub(crate) domain: Domain,
    /// Spacing of the first points [m].
    pub(crate) spacing: f64,
    pub(crate) parameters: Parameters,
    pub(crate) moments: ParameterMoments,
    pub(crate) network: MotionNetwork<f32>,
    pub(crate) network_moments: Moments,
    pub(crate) network_steps: usize,
    pub(crate) screen: ScreenGradients,
    /// What smoothing goes by.
    pub(crate) anchors: Anchors,
    pub(crate) base: Option<Base>,
    pub(crate) mean_loss: f64,
    pub(crate) lowest_loss: Option<f64>,
    pub(crate) best: Option<Best>,
    /// Evaluations since the best.
    pub(crate) stale: usize,
}

/// The best state by the held-out views so far.
#[derive(Clone, Debug)]
pub(crate) struct Best {
    pub(crate) psnr: f64,
    pub(crate) parameters: Parameters,
    pub(crate) network: Vec<f32>,
    pub(crate) base: Option<BaseMotion>,
}

struct Trainer<'a> {
    settings: &'a TrainSettings,
    seed: u64,
    targets: Vec<Target>,
    /// The same at half their size, if training starts with them.
    halved: Vec<Target>,
    held_out: Vec<Target>,
    /// Indices into `targets` of each trained frame, in the order of time.
    frames: Vec<Vec<usize>>,
    is_static: bool,
    max_gaussians: usize,
    sh_degree: usize,
    /// The warm-up uses the first frame (several cameras see it), not all of them (one moving camera).
    synchronous: bool,
    /// There will be a base motion.
    follows: bool,
}

/// Reconstructs a scene: trains Gaussians, and their motion if it has several times, to reproduce its pictures.
///
/// `callback` hears of every step and may end training; what was reached until then is returned. With a `checkpoint`
/// folder the state is saved there from time to time, and training continues from a state found there.
/// The same scene, settings and seed give the same result, bit by bit, whatever the number of threads.
///
/// # Errors
/// Unreadable pictures, settings or checkpoints, a scene without object, or a loss that is not finite.
pub fn train(
    scene: &Scene,
    settings: &TrainSettings,
    seed: u64,
    callback: &mut dyn FnMut(&Progress) -> ControlFlow<()>,
    checkpoint: Option<&Path>,
) -> Result<DynamicGaussians, MotionError> {
    check(scene, settings)?;
    let trainer = Trainer::new(scene, settings, seed)?;
    let resumed = match checkpoint {
        Some(folder) => checkpoint::load(folder, settings, seed, trainer.sh_degree)?,
        None => None,
    };
    let mut state = match resumed {
        Some(state) => state,
        None => trainer.start(scene)?,
    };
    trainer.run(&mut state, callback, checkpoint)?;
    Ok(trainer.finish(state))
}

fn check(scene: &Scene, settings: &TrainSettings) -> Result<(), MotionError> {
    let positive = |setting, value: f64| match value > 0.0 && value.is_finite() {
        true => Ok(()),
        false => Err(MotionError::Setting { setting, reason: format!("{value} must be above zero") }),
    };
    if !(0.0..=1.0).contains(&settings.half_size) {
        let reason = format!("{} is no share of the steps, 0 to 1", settings.half_size);
        return Err(MotionError::Setting { setting: "half_size", reason });
    }
    let spacing = settings.network.node_spacing;
    if !(spacing >= 0.0 && spacing.is_finite()) {
        let reason = format!("{spacing} must be above zero, or 0 to ask the network at each point");
        return Err(MotionError::Setting { setting: "network.node_spacing", reason });
    }
    positive("initial_spacing_px", settings.initial_spacing_px)?;
    positive("views_per_step", settings.views_per_step as f64)?;
    positive("steps", settings.steps as f64)?;
    positive("gaussians_per_pixel", settings.gaussians_per_pixel)?;
    let r = &settings.rates;
    for (name, ends) in [
        ("rates.position", r.position),
        ("rates.feature", r.feature),
        ("rates.opacity", r.opacity),
        ("rates.scale", r.scale),
        ("rates.network", r.network),
    ] {
        positive(name, ends.0)?;
        positive(name, ends.1)?;
    }
    if let Some(degree) = settings.sh_degree.filter(|&degree| degree > 3) {
        let reason = format!("{degree} is above 3, the highest degree supported");
        return Err(MotionError::Setting { setting: "sh_degree", reason });
    }
    if let Some(camera) = settings.held_out.iter().find(|&&c| c >= scene.cameras.len()) {
        let reason = format!("there is no camera {camera}; the scene's are 0 to {}", scene.cameras.len() - 1);
        return Err(MotionError::Setting { setting: "held_out", reason });
    }
    Ok(())
}

impl<'a> Trainer<'a> {
    fn new(scene: &Scene, settings: &'a TrainSettings, seed: u64) -> Result<Self, MotionError> {
        let targets = pictures::training(scene, &settings.held_out)?;
        let held_out = match settings.evaluate_every {
            0 => Vec::new(),
            _ if settings.held_out.is_empty() => Vec::new(),
            _ => pictures::held_out(scene, &settings.held_out)?,
        };
        if targets.iter().all(|t| t.area == 0.0) {
            let reason = match targets.is_empty() {
                true => "every camera is held out",
                false => "no mask shows the object; check the masks with `gic inspect`",
            };
            return Err(MotionError::NothingToTrain(reason.into()));
        }
        let mut by_frame: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (i, target) in targets.iter().enumerate() {
            by_frame.entry(target.frame).or_default().push(i);
        }
        let frames: Vec<Vec<usize>> = by_frame.into_values().collect();
        let synchronous = frames[0].len() >= MIN_SYNCHRONOUS;
        let seen: Vec<f64> = targets.iter().map(|t| t.area).filter(|&area| area > 0.0).collect();
        let mean_area = seen.iter().sum::<f64>() / seen.len() as f64;
        let max_gaussians = (settings.gaussians_per_pixel * mean_area).max(MIN_GAUSSIANS as f64) as usize;
        let cameras: BTreeSet<usize> = targets.iter().map(|t| t.camera_index).collect();
        let sh_degree = settings.sh_degree.unwrap_or(match cameras.len() {
            50.. => 3,
            20.. => 1,
            _ => 0,
        });
        let is_static = frames.len() == 1;
        let mut trainer = Trainer {
            settings,
            seed,
            halved: if settings.half_size > 0.0 {
                targets.par_iter().map(Target::halved).collect()
            } else {
                Vec::new()
            },
            targets,
            held_out,
            frames,
            is_static,
            max_gaussians,
            sh_degree,
            synchronous,
            follows: false,
        };
        let time = |frame: &Vec<usize>| trainer.targets[frame[0]].time;
        let ascending = trainer.frames.windows(2).all(|pair| time(&pair[0]) < time(&pair[1]));
        trainer.follows = !is_static && ascending && settings.affine_steps > 0 && trainer.centres().is_some();
        Ok(trainer)
    }

    /// Random numbers of one step, so that a resumed run draws the same as an uninterrupted one.
    fn rng(&self, step: usize) -> ChaCha8Rng {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(step as u64 + 1);
        rng
    }

    fn run(
        &self,
        state: &mut State,
        callback: &mut dyn FnMut(&Progress) -> ControlFlow<()>,
        checkpoint: Option<&Path>,
    ) -> Result<(), MotionError> {
        let steps = self.settings.steps;
        let (started, first) = (Instant::now(), state.step);
        let mut saved = Instant::now();
        while state.step < steps {
            // As one of the pool's own threads: from outside, each of the dozens of parallel loops of a step would put this thread to sleep.
            let psnr = rayon::scope(|_| self.step(state))?;
            let held_out = self.judge(state)?;
            let seconds = started.elapsed().as_secs_f64();
            let progress = Progress {
                phase: if self.stage(state.step - 1) == Stage::Still { Phase::WarmUp } else { Phase::Motion },
                step: state.step,
                steps,
                loss: state.mean_loss,
                psnr,
                gaussians: state.parameters.len(),
                held_out,
                seconds,
                seconds_left: seconds / (state.step - first) as f64 * (steps - state.step) as f64,
            };
            let stop = callback(&progress).is_break() || self.is_stale(state);
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

    /// One step of training; returns the PSNR of what it rendered.
    fn step(&self, state: &mut State) -> Result<f64, MotionError> {
        let mut rng = self.rng(state.step);
        let stage = self.stage(state.step);
        if stage != Stage::Still && self.follows && state.base.is_none() {
            state.base = Some(self.follow(state, &mut rng)?);
        }
        let (frame, views) = self.draw_views(state, &mut rng);
        let pose = match stage {
            Stage::Still => None,
            _ => state.base.as_ref().map(|base| base.motion.pose(frame)),
        };
        let deformation = (stage == Stage::Network).then(|| {
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
        let mut gradient = Gradient::zeros(&state.parameters);
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
        state.mean_loss =
            if state.mean_loss.is_finite() { state.mean_loss + AVERAGE * (loss - state.mean_loss) } else { loss };

        let fraction = state.step as f64 / self.settings.steps as f64;
        let size = 2.0 * state.domain.extent / EXTENT_RADII;
        let positions = &state.parameters.positions;
        if let (Some(base), Some(pose)) = (&mut state.base, pose) {
            let slope = base.motion.pull_back(&pose, positions, &d_residuals, &mut gradient.positions);
            let freedom = if stage == Stage::Mapped { Freedom::Map } else { Freedom::MapAndBend };
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
        Ok(-10.0 * (squared.0 / squared.1.max(1) as f64).log10())
    }

    fn update_network(
        &self,
        state: &mut State,
        deformation: &Deformation<f32>,
        d_residuals: &mut [[f32; 4]],
        gradient: &mut Gradient,
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

impl State {
    /// Displacements [m] and changes of the logarithm of the scale; `None` where nothing moves.
    fn residuals(&self, pose: Option<&Pose>, deformation: Option<&Deformation<f32>>) -> Option<Vec<[f32; 4]>> {
        let mut residuals = match deformation {
            Some(deformation) => self.domain.residuals(&deformation.residuals),
            None if pose.is_none() => return None,
            None => vec![[0.0; 4]; self.parameters.len()],
        };
        if let (Some(base), Some(pose)) = (&self.base, pose) {
            add_displacements(&mut residuals, &self.parameters.positions, &base.motion, pose);
        }
        Some(residuals)
    }

    /// The canonical Gaussians moved by a pose alone.
    fn posed(&self, motion: &BaseMotion, pose: &Pose) -> Gaussians {
        let mut residuals = vec![[0.0; 4]; self.parameters.len()];
        add_displacements(&mut residuals, &self.parameters.positions, motion, pose);
        self.parameters.gaussians(Some(&residuals))
    }
}

fn add_displacements(residuals: &mut [[f32; 4]], positions: &[[f32; 3]], motion: &BaseMotion, pose: &Pose) {
    for (residual, &x) in residuals.iter_mut().zip(positions) {
        let moved = motion.moved(pose, x);
        for axis in 0..3 {
            residual[axis] += moved[axis] - x[axis];
        }
    }
}
