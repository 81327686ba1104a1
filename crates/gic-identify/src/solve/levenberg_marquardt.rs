//! Levenberg-Marquardt (Marquardt 1963) with Broyden's secants (Broyden 1965).
//!
//! A hypothesis x has residuals r(x), weighted, and a prior with information P around m. The cost is `1/2 r^T r + 1/2
//! (x - m)^T P (x - m)`. A step solves `(H + lambda diag H) d = -g` with `H = J^T J + P` and `g = J^T r + P (x - m)`.
//! The Jacobian J comes from finite differences of the trajectories, one rollout per unknown. A step only corrects them
//! by what it showed (a rank-one update), so that most steps cost two rollouts. They are measured anew when a step
//! gains much less than the quadratic model predicts, and less per rollout than the last did whose Jacobian was
//! measured: along a bent valley with many unknowns no model holds for long, but a step along an old one costs next to
//! nothing. A failed rollout is a rejected step; where the Jacobian cannot be measured anew, the fit has ended.

use std::ops::ControlFlow;

use gic_optimize::{DAMPING_FACTOR, FIRST_DAMPING};
use rayon::prelude::*;

use crate::FitError;
use crate::forward::trajectories::Trajectories;
use crate::solve::linearisation::Linearisation;
use crate::solve::normal_equations::Normal;
use crate::solve::problem::Problem;
use crate::tuning::DescentTuning;
use crate::unknowns::state::State;

/// Dampings that a step tries at once. Budget: the second core would idle otherwise.
const TRIALS: usize = 2;

/// When to stop.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limits {
    /// Most steps.
    pub iterations: usize,
    /// Converged when the cost falls by less than this share.
    pub gain_tolerance: f64,
    /// Converged when the cost falls by less than this, or cannot fall by more.
    pub least_gain: f64,
    /// Whether forward runs are dear, so that Jacobians are carried along by secants rather than measured at every
    /// step.
    pub secants: bool,
}

impl Limits {
    /// Of a fit that goes on while the cost falls by `least_gain`.
    pub(crate) fn to_the_end(iterations: usize, least_gain: f64) -> Limits {
        Limits { iterations, gain_tolerance: 0.0, least_gain, secants: true }
    }

    /// Of a fit that only has to hand over a good start.
    pub(crate) fn rough(iterations: usize, tuning: &DescentTuning) -> Limits {
        Limits { gain_tolerance: tuning.gain_tolerance, ..Limits::to_the_end(iterations, 0.0) }
    }

    /// The least gain that counts at a cost.
    pub(crate) fn least_gain_at(&self, cost: f64) -> f64 {
        self.least_gain.max(self.gain_tolerance * cost)
    }
}

/// One accepted step, for traces.
#[derive(Clone, Debug)]
pub(crate) struct Iterate {
    pub state: State,
    pub cost: f64,
}

/// Where a fit ended.
#[derive(Clone, Debug)]
pub(crate) struct Fit {
    pub state: State,
    pub cost: f64,
    /// At `state`, measured or carried there.
    pub linearisation: Linearisation,
}

impl Fit {
    /// Where it ended, as a step.
    pub(crate) fn end(&self) -> Iterate {
        Iterate { state: self.state.clone(), cost: self.cost }
    }

    /// Measures the Jacobian where it ended; whether that can be. Elsewhere it stays as it was carried there.
    fn measure_anew(&mut self, problem: &Problem) -> bool {
        let measured = Linearisation::around(problem, &self.state, self.linearisation.trajectories.clone());
        measured.map(|measured| self.linearisation = measured).is_ok()
    }
}

/// Minimises from `start`, around which `known` is known already.
///
/// `accepted` hears of every step and may end the fit there.
///
/// # Errors
/// Where the start or, if nothing is `known` of them, one of its neighbours cannot be simulated, and what `accepted`
/// returns.
pub(crate) fn minimise(
    problem: &Problem,
    start: State,
    known: Option<Linearisation>,
    limits: Limits,
    accepted: &mut dyn FnMut(&Iterate) -> Result<ControlFlow<()>, FitError>,
) -> Result<Fit, FitError> {
    let linearisation = match known {
        Some(known) => known,
        None => Linearisation::measure(problem, &start)?,
    };
    let cost = problem.cost(&start, &linearisation.trajectories);
    let mut fit = Fit { state: start, cost, linearisation };
    let tuning = problem.descent;
    let (mut damping, mut steps) = (FIRST_DAMPING, 0);
    // What a rollout gained when the Jacobian was measured last.
    let mut measured_rate = f64::INFINITY;
    while steps < limits.iterations {
        let normal = problem.normal(fit.linearisation.blocks(problem), &fit.state);
        let largest_decrease = problem.largest_decrease(&normal, &fit.state).unwrap_or(f64::INFINITY);
        if largest_decrease < limits.least_gain {
            break;
        }
        let worth_measuring = tuning.trusted_gain_share * largest_decrease >= limits.least_gain;
        let was_fresh = fit.linearisation.is_fresh();
        let Some(trial) = find_decrease(problem, &fit, &normal, (&mut damping, limits.least_gain_at(fit.cost))) else {
            if was_fresh || !worth_measuring {
                break;
            }
            // The direction itself may be stale.
            if fit.measure_anew(problem) {
                continue;
            }
            break;
        };
        let (cost, gain) = (fit.cost, fit.cost - trial.cost);
        if was_fresh && gain < limits.least_gain {
            // Not worth leaving the place where the Jacobian is known.
            break;
        }
        steps += 1;
        damping = if trial.damping > damping { trial.damping } else { damping / DAMPING_FACTOR };
        let answer = accepted(&Iterate { state: trial.state.clone(), cost: trial.cost })?;
        let trusted = was_fresh || gain >= tuning.trusted_gain_share * trial.predicted_decrease;
        let rate = gain / (TRIALS + if was_fresh { problem.unknowns.len() } else { 0 }) as f64;
        if was_fresh {
            measured_rate = rate;
        }
        fit = trial.accept(problem, fit, limits.secants)?;
        // A small gain along a stale direction says little about what is left.
        let converged =
            gain < limits.gain_tolerance * cost || gain < limits.least_gain && (trusted || !worth_measuring);
        if converged || answer.is_break() {
            break;
        }
        let pays = rate >= measured_rate && gain >= limits.least_gain;
        if limits.secants && !trusted && !pays && steps < limits.iterations && !fit.measure_anew(problem) {
            break;
        }
    }
    Ok(fit)
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

impl Trial {
    /// The fit at the trial, with the linearisation carried there from `fit` by a secant, or measured.
    fn accept(self, problem: &Problem, fit: Fit, secants: bool) -> Result<Fit, FitError> {
        let linearisation = if secants {
            fit.linearisation.carried(self.trajectories, &self.delta)
        } else {
            Linearisation::around(problem, &self.state, self.trajectories)?
        };
        Ok(Fit { state: self.state, cost: self.cost, linearisation })
    }
}

/// A step that lowers the cost, from `damping` on upwards; `None` where none that promises the least gain does, or
/// where the tangents may be to blame.
fn find_decrease(
    problem: &Problem,
    fit: &Fit,
    normal: &Normal,
    (damping, least_gain): (&mut f64, f64),
) -> Option<Trial> {
    loop {
        let dampings: [f64; TRIALS] = [*damping, *damping * DAMPING_FACTOR];
        let tried = dampings.into_par_iter().map(|damping| try_step(problem, &fit.state, normal, damping));
        let trials: Vec<Option<Trial>> = tried.collect();
        let best = trials.into_iter().flatten().min_by(|a, b| a.cost.total_cmp(&b.cost));
        if let Some(trial) = best.filter(|trial| trial.cost < fit.cost) {
            return Some(trial);
        }
        if !fit.linearisation.is_fresh() {
            return None;
        }
        *damping *= DAMPING_FACTOR * DAMPING_FACTOR;
        let step = problem.step(normal, &fit.state, *damping, Vec::new())?;
        if normal.predicted_decrease(step.as_slice()) < least_gain {
            return None;
        }
    }
}

fn try_step(problem: &Problem, state: &State, normal: &Normal, damping: f64) -> Option<Trial> {
    let mut step = problem.step(normal, state, damping, Vec::new())?;
    // The direction is kept when one coordinate asks for more than its largest step.
    let shrink = problem.unknowns.iter().zip(step.iter()).fold(1.0f64, |s, (unknown, d)| {
        s.min(problem.coordinates.largest_step(*unknown) / d.abs().max(f64::MIN_POSITIVE))
    });
    step *= shrink;
    let (moved, delta) = problem.moved(state, step.as_slice());
    let trajectories = problem.forward.trajectories(&moved, &problem.selection).ok()?;
    let cost = problem.cost(&moved, &trajectories);
    let predicted_decrease = normal.predicted_decrease(&delta);
    cost.is_finite().then_some(Trial { state: moved, cost, trajectories, damping, delta, predicted_decrease })
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, Ordering};

    use glam::{DMat3, DVec3};

    use super::*;
    use crate::forward::drawing::Drawing;
    use crate::forward::silhouette::coverage;
    use crate::forward::trajectories::{ForwardModel, FrameSelection};
    use crate::input::Input;
    use crate::observe::mask_view::MaskView;
    use crate::observe::test_camera::test_camera;
    use crate::observe::video::{ObservedFrame, ObservedVideo};
    use crate::solve::objective::Objective;
    use crate::solve::residual_block::Weights;
    use crate::solve::surface_residuals::SurfaceComparison;
    use crate::tuning::Tuning;
    use crate::unknowns::coordinates::Coordinates;
    use crate::unknowns::state::Unknown;

    const SPACING: f64 = 0.01;
    const PARTICLES: i32 = 6 * 6 * 6;
    const TRUTH: DVec3 = DVec3::new(0.02, -0.015, 0.01);

    /// A cube where a state's offset puts it, until nothing can be simulated any more.
    #[derive(Default)]
    struct Cube {
        has_failed: AtomicBool,
    }

    impl ForwardModel for Cube {
        fn trajectories(&self, state: &State, _: &FrameSelection) -> Result<Trajectories, FitError> {
            if self.has_failed.load(Ordering::Relaxed) {
                return Err(FitError::NotFinite);
            }
            let place = |i: i32| DVec3::new(f64::from(i % 6), f64::from(i / 6 % 6), f64::from(i / 36)) * SPACING;
            let positions = (0..PARTICLES).map(|i| (place(i) + state.offset).as_vec3().to_array()).collect();
            Ok(Trajectories {
                positions: vec![positions],
                velocities: Vec::new(),
                scales: vec![vec![0.6 * SPACING as f32; PARTICLES as usize]],
                drawing: Drawing::of(state),
                outward_displacements: Vec::new(),
            })
        }
    }

    /// How far off the cube's offset is that is found by two masks; no rollout succeeds after so many `steps`.
    fn error_m_after(steps: usize) -> f64 {
        let cube = Cube::default();
        let selection = FrameSelection { first: 0, end: 1, pooling: 1 };
        let input = Input::of_body(vec![DVec3::ZERO; PARTICLES as usize], SPACING);
        let seen = cube.trajectories(&State { offset: TRUTH, ..State::new(Vec::new()) }, &selection).unwrap();
        let views = [0.0, 1.3].map(|turn| {
            let turn = DMat3::from_rotation_y(turn);
            let camera = test_camera(80, 200.0, turn, DVec3::splat(2.5 * SPACING) - turn.z_axis);
            MaskView::new(0, &camera, &coverage(seen.gaussians(0, &input.opacities), &camera), 1)
        });
        let frame = ObservedFrame { simulated_frame: 0, time_s: 0.0, views: views.to_vec(), surface: None };
        let video = ObservedVideo { frames: vec![frame] };
        let (tuning, weights) = (Tuning::default(), Weights::uniform(1e4, 1.0, 1));
        let comparison = SurfaceComparison::new(&input, None, &tuning);
        let problem = Problem {
            forward: &cube,
            objective: Objective {
                video: &video,
                opacities: &input.opacities,
                surface_comparison: &comparison,
                weights: &weights,
            },
            unknowns: (0..3).map(Unknown::Offset).collect(),
            coordinates: Coordinates { parameters: &[], tuning: &tuning.descent },
            descent: &tuning.descent,
            selection,
            prior: None,
        };
        let mut taken = 0;
        let mut accepted = |_: &Iterate| {
            taken += 1;
            cube.has_failed.store(taken == steps, Ordering::Relaxed);
            Ok(ControlFlow::Continue(()))
        };
        let limits = Limits::to_the_end(30, 1e-6);
        let fit = minimise(&problem, State::new(Vec::new()), None, limits, &mut accepted).expect("a fit");
        fit.state.offset.distance(TRUTH)
    }

    #[test]
    fn a_fit_ends_where_nothing_around_it_can_be_simulated() {
        let (after_a_step, at_the_end) = (error_m_after(1), error_m_after(usize::MAX));
        println!("{after_a_step} {at_the_end}");
        assert!(at_the_end < 1e-5 && (1e-3..TRUTH.length()).contains(&after_a_step));
    }
}
