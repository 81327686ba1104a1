//! Levenberg-Marquardt on Jacobians from independent forward runs, in parallel, kept up to date by secants in between.

use std::ops::ControlFlow;

use rayon::prelude::*;

use crate::forward::trajectories::Trajectories;
use crate::solve::linearisation::{Linearisation, Tangents};
use crate::solve::normal_equations::Normal;
use crate::solve::problem::Problem;
use crate::solve::residual_block::ResidualBlock;
use crate::unknowns::state::State;

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
        let linearised = blocks.get_or_insert_with(|| tangents.blocks(problem, &fit.trajectories));
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
                _ if !tangents.is_fresh() && !worth_measuring => break 'steps,
                // The direction itself may be stale.
                _ if !tangents.is_fresh() => break None,
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
        let trusted = tangents.is_fresh() || gain >= TRUSTED_GAIN * predicted_decrease;
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
