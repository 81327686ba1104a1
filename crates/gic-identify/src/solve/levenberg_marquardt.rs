//! Levenberg-Marquardt on Jacobians from independent forward runs, in parallel, kept up to date by secants in between.

use std::ops::ControlFlow;

use rayon::prelude::*;

use crate::normal::{Normal, ResidualBlock};
use crate::solve::objective::{Problem, Trajectories};
use crate::unknowns::state::{State, Unknown};

/// A Jacobian that was carried along from earlier states is computed anew when a step gains less than this share of what it
/// predicted_decrease.
const TRUSTED_GAIN: f64 = 0.5;

/// Not worth a step: less than this share of what a step must gain for others to follow.
const LEAST_PROMISE: f64 = 0.1;

/// What a Jacobian that was carried along promises is so uncertain that up to this many times the least gain are not worth a new one.
const NOT_WORTH: f64 = 4.0;

/// When to stop.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limits {
    /// Most steps.
    pub iterations: usize,
    /// Converged when every unknown moves by less than this many finite-difference steps.
    pub step_tolerance: f64,
    /// Converged when the cost falls by less than this share, or cannot fall by a tenth of it.
    pub gain_tolerance: f64,
    /// Converged when the cost falls by less than this, or cannot fall by more.
    pub least_gain: f64,
    /// Whether forward runs are dear, so that Jacobians are carried along by secants rather than measured at every step.
    pub secants: bool,
}

impl Limits {
    /// Of stages that only have to hand over a good start, without any steps.
    pub(crate) const ROUGH: Limits =
        Limits { iterations: 0, step_tolerance: 0.05, gain_tolerance: 0.01, least_gain: 0.0, secants: true };
}

/// One accepted step, for traces.
#[derive(Clone, Debug)]
pub(crate) struct Iterate {
    /// How many steps led here.
    pub steps: usize,
    pub state: State,
    pub cost: f64,
}

/// Where the search ended.
#[derive(Clone, Debug)]
pub(crate) struct Fit {
    pub state: State,
    pub cost: f64,
    pub trajectories: Trajectories,
    /// At `state`, measured or carried there; `None` where no step was asked for.
    pub tangents: Option<Tangents>,
    /// Those of `motion` and `tangents`, where they were needed.
    pub blocks: Option<Vec<ResidualBlock>>,
}

impl Fit {
    /// What a further search from here need not work out again; `None` where no step was asked for.
    pub(crate) fn known(self) -> Option<Linearisation> {
        let (trajectories, blocks) = (self.trajectories, self.blocks);
        self.tangents.map(|tangents| Linearisation { trajectories, tangents, blocks })
    }
}

/// What is known at the start of a search, so that it need not be worked out again.
pub(crate) struct Linearisation {
    pub trajectories: Trajectories,
    pub tangents: Tangents,
    /// Those of `motion` and `tangents`, where they were needed.
    pub blocks: Option<Vec<ResidualBlock>>,
}

/// How the motion changes with each unknown: one perturbed motion and its step per unknown.
#[derive(Clone, Debug)]
pub(crate) struct Tangents {
    pub perturbed: Vec<Trajectories>,
    pub steps: Vec<f64>,
    /// Whether they belong to the present state rather than being carried along.
    fresh: bool,
}

impl Tangents {
    /// Whether they were measured where they are, rather than carried there.
    pub(crate) fn is_fresh(&self) -> bool {
        self.fresh
    }

    /// One forward run per unknown from `state`, whose own `motion` is known. A perturbation that fails is tried in the other direction.
    pub(crate) fn measure(problem: &Problem, state: &State, trajectories: &Trajectories) -> Result<Tangents, String> {
        Tangents::runs(problem, state).map(|runs| Tangents::of_runs(runs, trajectories))
    }

    /// The motion at `state` and its tangents: one forward run more than there are unknowns, all side by side.
    pub(crate) fn measure_with_motion(
        problem: &Problem,
        state: &State,
    ) -> (Result<Trajectories, String>, Result<Tangents, String>) {
        let (trajectories, runs) =
            rayon::join(|| problem.forward.trajectories(state, &problem.selection), || Tangents::runs(problem, state));
        let tangents = trajectories.as_ref().map_err(Clone::clone).and_then(|m| Ok(Tangents::of_runs(runs?, m)));
        (trajectories, tangents)
    }

    /// A perturbed motion and its step per unknown; no motion where only the drawing changes.
    fn runs(problem: &Problem, state: &State) -> Result<Vec<(Option<Trajectories>, f64)>, String> {
        let run = |unknown: &Unknown| {
            let step = unknown.difference_step(problem.parameters);
            if *unknown == Unknown::Splat {
                return Ok((None, step));
            }
            let (_, high) = unknown.limits(problem.parameters);
            let forward = if state.get(*unknown) + step <= high { step } else { -step };
            let run = |step: f64| {
                let moved = state.moved(&[*unknown], &[step], problem.parameters);
                problem.forward.trajectories(&moved, &problem.selection).map(|m| (Some(m), step))
            };
            run(forward).or_else(|_| run(-forward))
        };
        problem.unknowns.par_iter().with_max_len(1).map(run).collect()
    }

    fn of_runs(runs: Vec<(Option<Trajectories>, f64)>, trajectories: &Trajectories) -> Tangents {
        let drawn =
            |(run, step): (Option<Trajectories>, f64)| (run.unwrap_or_else(|| trajectories.drawn_wider(step)), step);
        let (perturbed, steps) = runs.into_iter().map(drawn).unzip();
        Tangents { perturbed, steps, fresh: true }
    }

    /// Carries the tangents from `old` to `new`, `delta` away, and corrects them by what the step showed (Broyden's rank-one
    /// update, on the particles' positions): an iteration then costs one forward run instead of one per unknown.
    pub(crate) fn carry(&mut self, problem: &Problem, old: &Trajectories, new: &Trajectories, delta: &[f64]) {
        // In units of the difference steps; the drawing's own unknown moves no particle.
        let moved: Vec<f64> = (problem.unknowns.iter().zip(delta).zip(&self.steps))
            .map(|((unknown, d), step)| if *unknown == Unknown::Splat { 0.0 } else { d / step })
            .collect();
        let square: f64 = moved.iter().map(|u| u * u).sum();
        let gains: Vec<f32> = moved.iter().map(|u| if square > 0.0 { (u / square) as f32 } else { 0.0 }).collect();
        let moved: Vec<f32> = moved.iter().map(|u| *u as f32).collect();
        for o in 0..new.positions.len() {
            for i in 0..new.positions[o].len() {
                for axis in 0..3 {
                    let (was, is) = (old.positions[o][i][axis], new.positions[o][i][axis]);
                    let mut rest = is - was;
                    for (trajectories, u) in self.perturbed.iter().zip(&moved) {
                        rest -= u * (trajectories.positions[o][i][axis] - was);
                    }
                    for (trajectories, gain) in self.perturbed.iter_mut().zip(&gains) {
                        let slot = &mut trajectories.positions[o][i][axis];
                        *slot = is + (*slot - was) + gain * rest;
                    }
                }
            }
            for i in 0..new.scales[o].len() {
                let (was, is) = (old.scales[o][i], new.scales[o][i]);
                for trajectories in &mut self.perturbed {
                    trajectories.scales[o][i] = (trajectories.scales[o][i] - was + is).max(0.1 * is);
                }
            }
        }
        for ((trajectories, unknown), step) in self.perturbed.iter_mut().zip(&problem.unknowns).zip(&self.steps) {
            trajectories.splat_factor = new.splat_factor;
            trajectories.outward_displacements =
                sum_of(&new.outward_displacements, &trajectories.outward_displacements, &old.outward_displacements);
            if *unknown == Unknown::Splat {
                *trajectories = new.drawn_wider(*step);
            }
        }
        self.fresh = false;
    }
}

/// a + b - c; those that are missing are zero.
fn sum_of(a: &[f32], b: &[f32], c: &[f32]) -> Vec<f32> {
    let at = |v: &[f32], i: usize| v.get(i).copied().unwrap_or(0.0);
    (0..a.len().max(b.len()).max(c.len())).map(|i| at(a, i) + at(b, i) - at(c, i)).collect()
}

/// Minimises from `start`, where much may be known already; fails only where the start itself cannot be simulated.
///
/// A failed forward run is a rejected step: the damping grows until the step stays where the simulator works. `accepted` hears of every step and
/// may end the search there.
pub(crate) fn minimise(
    problem: &Problem,
    start: State,
    known: Option<Linearisation>,
    limits: Limits,
    accepted: &mut dyn FnMut(&Iterate) -> Result<ControlFlow<()>, String>,
) -> Result<Fit, String> {
    let (trajectories, tangents, mut blocks) = match known {
        Some(Linearisation { trajectories, tangents, blocks }) => (trajectories, Some(tangents), blocks),
        None if limits.iterations == 0 => (problem.forward.trajectories(&start, &problem.selection)?, None, None),
        None => {
            let (trajectories, tangents) = Tangents::measure_with_motion(problem, &start);
            (trajectories?, Some(tangents?), None)
        }
    };
    let cost = problem.cost(&start, &trajectories);
    let mut fit = Fit { cost, state: start, trajectories, tangents: None, blocks: None };
    let mut tangents = match tangents {
        Some(tangents) if limits.iterations > 0 => tangents,
        tangents => return Ok(Fit { tangents, blocks, ..fit }),
    };
    let mut lambda = 1e-3;
    let mut iteration = 0;
    'steps: while iteration < limits.iterations {
        let linearised = blocks.get_or_insert_with(|| problem.blocks(&fit.trajectories, &tangents));
        let normal = problem.normal(linearised, &fit.state);
        let most = normal.largest_predicted_decrease();
        if most < limits.least_gain.max(LEAST_PROMISE * limits.gain_tolerance * fit.cost) {
            break;
        }
        let worth_measuring = most >= NOT_WORTH * limits.least_gain;
        let step = loop {
            // Two dampings at once: the second core would idle otherwise.
            let trials: Vec<Option<Trial>> = [lambda, lambda * 30.0]
                .into_par_iter()
                .map(|damping| try_step(problem, &fit.state, &normal, damping))
                .collect();
            let best = trials.into_iter().flatten().min_by(|a, b| a.cost.total_cmp(&b.cost));
            match best {
                Some(trial) if trial.cost < fit.cost => break Some(trial),
                _ if !tangents.fresh && !worth_measuring => break 'steps,
                // The direction itself may be stale.
                _ if !tangents.fresh => break None,
                _ => lambda *= 900.0,
            }
            if lambda >= 1e6 {
                break 'steps;
            }
        };
        let Some(Trial { state, cost, trajectories, damping, delta, predicted_decrease }) = step else {
            (tangents, blocks) = (Tangents::measure(problem, &fit.state, &fit.trajectories)?, None);
            continue;
        };
        (iteration, blocks) = (iteration + 1, None);
        let gain = fit.cost - cost;
        let share = gain / fit.cost.max(f64::MIN_POSITIVE);
        let size = problem
            .unknowns
            .iter()
            .zip(&delta)
            .map(|(u, d)| d.abs() / u.difference_step(problem.parameters))
            .fold(0.0, f64::max);
        lambda = if damping > lambda { damping } else { (lambda * 0.1).max(1e-6) };
        let heard = accepted(&Iterate { steps: iteration, state: state.clone(), cost })?;
        let trusted = tangents.fresh || gain >= TRUSTED_GAIN * predicted_decrease;
        if limits.secants {
            tangents.carry(problem, &fit.trajectories, &trajectories, &delta);
        }
        (fit.state, fit.cost, fit.trajectories) = (state, cost, trajectories);
        // A small gain along a stale direction says little about what is left.
        let arrived = share < limits.gain_tolerance || gain < limits.least_gain && (trusted || !worth_measuring);
        if size < limits.step_tolerance || arrived || heard.is_break() {
            break;
        }
        if iteration < limits.iterations && !(limits.secants && trusted) {
            tangents = Tangents::measure(problem, &fit.state, &fit.trajectories)?;
        }
    }
    Ok(Fit { tangents: Some(tangents), blocks, ..fit })
}

/// A damped step that could be simulated.
struct Trial {
    state: State,
    cost: f64,
    trajectories: Trajectories,
    damping: f64,
    /// Where the limits let it end.
    delta: Vec<f64>,
    /// How much cheaper the linear model said that it would be.
    predicted_decrease: f64,
}

fn try_step(problem: &Problem, state: &State, normal: &Normal, damping: f64) -> Option<Trial> {
    let mut step = normal.step(damping)?;
    // The direction is kept when one coordinate asks for more than its largest step.
    let shrink = problem.unknowns.iter().zip(step.iter()).fold(1.0f64, |s, (unknown, d)| {
        s.min(unknown.largest_step(problem.parameters) / d.abs().max(f64::MIN_POSITIVE))
    });
    step *= shrink;
    let (moved, delta) = problem.moved(state, step.as_slice());
    let trajectories = problem.forward.trajectories(&moved, &problem.selection).ok()?;
    let cost = problem.cost(&moved, &trajectories);
    let predicted_decrease = normal.predicted_decrease(&delta);
    cost.is_finite().then_some(Trial { state: moved, cost, trajectories, damping, delta, predicted_decrease })
}
