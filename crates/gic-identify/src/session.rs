//! What changes while the stages run: the checkpoint, the clock, who listens, and what the user should know.

use std::ops::ControlFlow;
use std::time::Instant;

use crate::FitError;
use crate::checkpoint::{Checkpoint, Event};
use crate::forward::simulation::RolloutCounts;
use crate::result::{Stage, Step};
use crate::solve::levenberg_marquardt::{Fit, Iterate, Limits, minimise};
use crate::solve::linearisation::Linearisation;
use crate::solve::problem::Problem;
use crate::unknowns::parameter::Parameter;
use crate::unknowns::state::State;

/// Who hears of events and may say stop.
pub(crate) type Listener<'a> = dyn FnMut(Event) -> ControlFlow<()> + 'a;

/// One call of `identify`.
pub(crate) struct Session<'a> {
    checkpoint: Checkpoint,
    listener: &'a mut Listener<'a>,
    rollouts: &'a RolloutCounts,
    clock: Instant,
    /// Seconds of earlier sessions.
    seconds_before: f64,
    warnings: Vec<String>,
}

impl<'a> Session<'a> {
    /// Goes on from `resume`, whose rollouts `rollouts` counts already.
    pub(crate) fn new(resume: Checkpoint, listener: &'a mut Listener<'a>, rollouts: &'a RolloutCounts) -> Session<'a> {
        let seconds_before = resume.seconds.iter().map(|(_, s)| s).sum();
        let (clock, warnings) = (Instant::now(), Vec::new());
        Session { checkpoint: resume, listener, rollouts, clock, seconds_before, warnings }
    }

    /// What the finished stages found.
    pub(crate) fn checkpoint(&self) -> &Checkpoint {
        &self.checkpoint
    }

    /// What the user should know.
    pub(crate) fn warnings(&self) -> &[String] {
        &self.warnings
    }

    pub(crate) fn warn(&mut self, warnings: impl IntoIterator<Item = String>) {
        self.warnings.extend(warnings);
    }

    /// Seconds of work, earlier sessions included.
    fn seconds(&self) -> f64 {
        self.seconds_before + self.clock.elapsed().as_secs_f64()
    }

    /// Seconds since the last stage ended.
    pub(crate) fn unbooked_seconds(&self) -> f64 {
        let booked: f64 = self.checkpoint.seconds.iter().map(|(_, s)| s).sum();
        self.seconds() - booked
    }

    /// A moment at which the listener may say stop.
    ///
    /// # Errors
    /// [`FitError::Interrupted`] where it does.
    pub(crate) fn pause(&mut self) -> Result<(), FitError> {
        heed((self.listener)(Event::Working))
    }

    /// Records an accepted step of `stage`.
    ///
    /// # Errors
    /// [`FitError::Interrupted`] where the listener says stop.
    pub(crate) fn record(&mut self, stage: Stage, parameters: &[Parameter], iterate: &Iterate) -> Result<(), FitError> {
        let step = Step {
            stage,
            iteration: self.checkpoint.trace.iter().filter(|s| s.stage == stage).count(),
            objective: iterate.cost,
            values: parameters.iter().zip(&iterate.state.material).map(|(p, c)| p.value(*c)).collect(),
            velocity_m_s: iterate.state.velocity,
            rollouts: self.rollouts.full(),
            seconds: self.seconds(),
        };
        self.checkpoint.trace.push(step.clone());
        heed((self.listener)(Event::Step(&step)))
    }

    /// Changes the checkpoint and hands it out. The time since the last stage is booked on `stage`, where it is
    /// finished.
    ///
    /// # Errors
    /// [`FitError::Interrupted`] where the listener says stop.
    pub(crate) fn reach(&mut self, stage: Option<Stage>, change: impl FnOnce(&mut Checkpoint)) -> Result<(), FitError> {
        change(&mut self.checkpoint);
        self.checkpoint.rollouts = (self.rollouts.full(), self.rollouts.coarse());
        if let Some(stage) = stage {
            let seconds = self.unbooked_seconds();
            self.checkpoint.seconds.push((stage, seconds));
        }
        heed((self.listener)(Event::Reached(&self.checkpoint)))
    }

    /// Minimises and records each step; ends early at a step that `is_enough`.
    ///
    /// # Errors
    /// Where the start cannot be simulated, or the listener says stop.
    pub(crate) fn minimise(
        &mut self,
        stage: Stage,
        problem: &Problem,
        (start, known): (State, Option<Linearisation>),
        limits: Limits,
        is_enough: &dyn Fn(&Iterate) -> bool,
    ) -> Result<Fit, FitError> {
        minimise(problem, start, known, limits, &mut |iterate| {
            self.record(stage, problem.coordinates.parameters, iterate)?;
            Ok(if is_enough(iterate) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
        })
    }
}

fn heed(answer: ControlFlow<()>) -> Result<(), FitError> {
    if answer.is_break() { Err(FitError::Interrupted) } else { Ok(()) }
}
