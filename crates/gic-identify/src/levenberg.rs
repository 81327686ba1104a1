//! Levenberg-Marquardt on Jacobians from independent forward runs, in parallel.

use rayon::prelude::*;

use crate::normal::{Cluster, Normal};
use crate::objective::{Motion, Problem};
use crate::state::{State, Unknown};

/// When to stop.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limits {
    /// Most Jacobians.
    pub iterations: usize,
    /// Converged when every unknown moves by less than this many finite-difference steps.
    pub step_tolerance: f64,
    /// Converged when the cost falls by less than this share.
    pub gain_tolerance: f64,
}

/// One accepted step, for traces.
#[derive(Clone, Debug)]
pub(crate) struct Iterate {
    pub state: State,
    pub cost: f64,
}

/// Where the search ended.
#[derive(Clone, Debug)]
pub(crate) struct Fit {
    pub state: State,
    pub cost: f64,
    pub motion: Motion,
    /// Clusters of the last Jacobian, evaluated at the last state but one step when the last step was tiny.
    pub clusters: Vec<Cluster>,
    pub trace: Vec<Iterate>,
    pub motions: usize,
    pub converged: bool,
}

/// One perturbed motion and its step per unknown. A perturbation that fails is tried in the other direction.
pub(crate) fn perturbed(problem: &Problem, state: &State, motion: &Motion) -> Result<(Vec<Motion>, Vec<f64>), String> {
    let attempts: Result<Vec<(Motion, f64)>, String> = problem
        .unknowns
        .par_iter()
        .with_max_len(1)
        .map(|unknown| {
            let step = unknown.difference_step(problem.parameters);
            if *unknown == Unknown::Splat {
                // Only the drawing changes: no rollout.
                let factor = motion.splat_factor * step.exp() as f32;
                return Ok((Motion { splat_factor: factor, ..motion.clone() }, step));
            }
            let (_, high) = unknown.limits(problem.parameters);
            let forward = if state.get(*unknown) + step <= high { step } else { -step };
            let run = |step: f64| {
                let moved = state.moved(&[*unknown], &[step], problem.parameters);
                problem.forward.motion(&moved, &problem.level).map(|m| (m, step))
            };
            run(forward).or_else(|_| run(-forward))
        })
        .collect();
    Ok(attempts?.into_iter().unzip())
}

/// Clusters of the normal equations at `state`, whose motion is known.
pub(crate) fn linearise(problem: &Problem, state: &State, motion: &Motion) -> Result<Vec<Cluster>, String> {
    let (motions, steps) = perturbed(problem, state, motion)?;
    Ok(problem.objective.clusters(motion, &motions, &steps, &problem.level))
}

/// Minimises from `start`; fails only where the start itself cannot be simulated.
///
/// A failed forward run is a rejected step: the damping grows until the step stays where the simulator works.
pub(crate) fn minimise(
    problem: &Problem,
    start: State,
    limits: Limits,
    accepted: &mut dyn FnMut(&Iterate),
) -> Result<Fit, String> {
    let count = problem.unknowns.len();
    let mut motion = problem.forward.motion(&start, &problem.level)?;
    let mut fit = Fit {
        cost: problem.objective.cost(&motion, &problem.level),
        state: start,
        motion: motion.clone(),
        clusters: Vec::new(),
        trace: Vec::new(),
        motions: 1,
        converged: false,
    };
    fit.trace.push(Iterate { state: fit.state.clone(), cost: fit.cost });
    let mut lambda = 1e-3;
    for _ in 0..limits.iterations {
        fit.clusters = linearise(problem, &fit.state, &motion)?;
        fit.motions += count;
        let normal = Normal::sum(&fit.clusters, problem.objective.weights, count);
        let mut improved = false;
        while lambda < 1e6 {
            // Two dampings at once: the second core would idle otherwise.
            let trials: Vec<Option<Trial>> = [lambda, lambda * 30.0]
                .into_par_iter()
                .map(|damping| try_step(problem, &fit.state, &normal, damping))
                .collect();
            fit.motions += trials.len();
            let best = trials.into_iter().flatten().min_by(|a, b| a.cost.total_cmp(&b.cost));
            match best {
                Some(Trial { state, cost, motion: moved, damping, size }) if cost < fit.cost => {
                    let gain = (fit.cost - cost) / fit.cost.max(f64::MIN_POSITIVE);
                    (fit.state, fit.cost, motion) = (state, cost, moved);
                    lambda = if damping > lambda { damping } else { (lambda * 0.1).max(1e-6) };
                    improved = true;
                    fit.converged = size < limits.step_tolerance || gain < limits.gain_tolerance;
                    let iterate = Iterate { state: fit.state.clone(), cost };
                    accepted(&iterate);
                    fit.trace.push(iterate);
                    break;
                }
                _ => lambda *= 900.0,
            }
        }
        if !improved {
            fit.converged = true;
        }
        if fit.converged {
            break;
        }
    }
    fit.motion = motion;
    Ok(fit)
}

/// A damped step that could be simulated.
struct Trial {
    state: State,
    cost: f64,
    motion: Motion,
    damping: f64,
    /// Largest move of an unknown in finite-difference steps.
    size: f64,
}

fn try_step(problem: &Problem, state: &State, normal: &Normal, damping: f64) -> Option<Trial> {
    let mut delta = normal.step(damping)?;
    // The direction is kept when one coordinate asks for more than its largest step.
    let shrink = problem.unknowns.iter().zip(delta.iter()).fold(1.0f64, |s, (unknown, d)| {
        s.min(unknown.largest_step(problem.parameters) / d.abs().max(f64::MIN_POSITIVE))
    });
    delta *= shrink;
    let moved = state.moved(&problem.unknowns, delta.as_slice(), problem.parameters);
    let size = problem
        .unknowns
        .iter()
        .map(|u| (moved.get(*u) - state.get(*u)).abs() / u.difference_step(problem.parameters))
        .fold(0.0, f64::max);
    let motion = problem.forward.motion(&moved, &problem.level).ok()?;
    let cost = problem.objective.cost(&motion, &problem.level);
    cost.is_finite().then_some(Trial { state: moved, cost, motion, damping, size })
}
