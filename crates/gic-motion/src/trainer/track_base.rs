//! The first base motion, from frame to frame, before training uses it.

use std::ops::ControlFlow;

use gic_optimize::decayed;
use rand::Rng;
use rayon::prelude::*;

use super::progress::{Listener, Pace, Phase, Progress};
use super::state::State;
use super::training::Training;
use super::view_gradient::ViewGradient;
use crate::base::fit::{BaseFit, Freedom, PoseMoments};
use crate::pictures::psnr;
use crate::tuning::{EXPLAINED_LOSS_RATIO, TRACKING_BEND_RATE, TRACKING_MAP_RATE, TRACKING_VIEWS_PER_STEP};
use crate::{BaseMotion, Lattice, MotionError};

impl Training<'_> {
    /// The first base motion: the pose of every frame, each fitted from where the last two lead. Frames bend from the
    /// first one on that no affine map explains. The listener may end it.
    pub(super) fn track_base(
        &self,
        state: &State,
        rng: &mut impl Rng,
        listener: &mut Listener<'_>,
    ) -> Result<ControlFlow<(), BaseFit>, MotionError> {
        let Some(centres) = self.centres() else { unreachable!("only a scene with centres is followed") };
        let times = self.frames.iter().map(|frame| self.targets[frame[0]].time).collect();
        let lattice = Lattice::around(&state.parameters.positions);
        let first_loss = self.posed_loss(state, &BaseMotion::still(centres[0], Vec::new(), lattice), 0)?;
        let first = PoseMoments::new(&lattice);
        let mut base = BaseFit::new(BaseMotion::still(centres[0], times, lattice), vec![first], 1);
        let mut teller = Teller::new(listener, (self.frames.len() - 1) * self.steps_per_frame(), state);
        for frame in 1..self.frames.len() {
            base.push(centres[frame] - centres[0]);
            teller.step = (frame - 1) * self.steps_per_frame();
            if self.fit_pose(state, &mut base, (frame, Freedom::Map), rng, &mut teller)?.is_break() {
                return Ok(ControlFlow::Break(()));
            }
            if base.explained == frame
                && self.posed_loss(state, &base.motion, frame)? <= EXPLAINED_LOSS_RATIO * first_loss
            {
                base.explained += 1;
            } else if self.fit_pose(state, &mut base, (frame, Freedom::MapAndBend), rng, &mut teller)?.is_break() {
                return Ok(ControlFlow::Break(()));
            }
        }
        // The history of these fits, at other rates and with other Gaussians, is no guide from here on.
        base.fits = vec![PoseMoments::new(&lattice); self.frames.len()];
        Ok(ControlFlow::Continue(base))
    }

    /// Most steps that a frame's pose takes.
    fn steps_per_frame(&self) -> usize {
        self.settings.affine_steps + self.settings.bend_steps
    }

    /// Fits one frame's pose to its pictures.
    fn fit_pose(
        &self,
        state: &State,
        base: &mut BaseFit,
        (frame, freedom): (usize, Freedom),
        rng: &mut impl Rng,
        teller: &mut Teller<'_, '_>,
    ) -> Result<ControlFlow<()>, MotionError> {
        let size = state.object_size();
        let (steps, rates) = match freedom {
            Freedom::Map => (self.settings.affine_steps, TRACKING_MAP_RATE),
            Freedom::MapAndBend => (self.settings.bend_steps, TRACKING_BEND_RATE),
        };
        for step in 0..steps {
            let pose = base.motion.pose(frame);
            let gaussians = state.posed(&base.motion, &pose);
            let views = self.choose(state.step, self.frames[frame].clone(), rng, TRACKING_VIEWS_PER_STEP);
            let rendered: Vec<ViewGradient> =
                views.par_iter().map(|view| self.view_gradient(view, &gaussians, 0)).collect::<Result<_, _>>()?;
            let mut slope = vec![[0.0f32; 4]; gaussians.len()];
            for view in &rendered {
                for (s, g) in slope.iter_mut().zip(&view.slope.positions) {
                    s.iter_mut().zip(g).for_each(|(s, g)| *s += g);
                }
            }
            let points = &state.parameters.positions;
            let slope = base.motion.pull_back(&pose, points, &slope, &mut vec![[0.0; 3]; points.len()]);
            base.update(frame, slope, freedom, (decayed(rates, step as f64 / steps as f64), size));
            if teller.tell(&rendered).is_break() {
                return Ok(ControlFlow::Break(()));
            }
        }
        Ok(ControlFlow::Continue(()))
    }

    /// Mean loss over all views of a frame that the base motion alone explains.
    fn posed_loss(&self, state: &State, motion: &BaseMotion, frame: usize) -> Result<f64, MotionError> {
        let gaussians = state.posed(motion, &motion.pose(frame));
        let views = &self.frames[frame];
        let losses: Vec<f64> = views
            .par_iter()
            .map(|&i| self.view_gradient(&self.targets[i], &gaussians, 0).map(|view| view.loss))
            .collect::<Result<_, _>>()?;
        Ok(losses.iter().sum::<f64>() / views.len() as f64)
    }
}

/// Tells the listener of the steps of tracking.
struct Teller<'a, 'b> {
    listener: &'a mut Listener<'b>,
    pace: Pace,
    /// Steps done; those that a frame does not need count as done.
    step: usize,
    /// Steps in all, at most.
    steps: usize,
    gaussians: usize,
}

impl<'a, 'b> Teller<'a, 'b> {
    fn new(listener: &'a mut Listener<'b>, steps: usize, state: &State) -> Self {
        Self { listener, pace: Pace::from(0), step: 0, steps, gaussians: state.parameters.len() }
    }

    fn tell(&mut self, rendered: &[ViewGradient]) -> ControlFlow<()> {
        self.step += 1;
        let (seconds, seconds_left) = self.pace.seconds(self.step, self.steps);
        let squared = rendered.iter().map(|view| view.squared).fold((0.0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        (self.listener)(&Progress {
            phase: Phase::Tracking,
            step: self.step,
            steps: self.steps,
            loss: rendered.iter().map(|view| view.loss).sum::<f64>() / rendered.len() as f64,
            psnr: psnr(squared),
            gaussians: self.gaussians,
            held_out: None,
            seconds,
            seconds_left,
        })
    }
}
