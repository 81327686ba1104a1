//! Stage 4: material, velocity, rotation where there is one, and the body's shape together.
//!
//! Errors of free flight and of the shape then do not bias the material, and the intervals know of them. The Gaussians
//! keep the size that free flight gives them: wider ones would fit a smaller body as well (decision 89). The fit starts
//! from the best minimum of the material, with blurred masks, in which steps reach further. That is all that carries a
//! body on. Where intervals are wanted, it goes on to sharp masks and looks at the other minima of the material, too:
//! with the body as it is now one of them may explain the video better. They are fitted roughly, for all but the best
//! only tell what the video leaves open: each is taken to cost what its quadratic model promises.

use std::collections::{BTreeMap, BTreeSet};

use crate::FitError;
use crate::IdentifyError;
use crate::forward::simulation::Simulation;
use crate::forward::trajectories::FrameSelection;
use crate::result::Stage;
use crate::session::Session;
use crate::settings::Optimizer;
use crate::solve::levenberg_marquardt::{Fit, Limits};
use crate::solve::linearisation::Linearisation;
use crate::solve::prior::Prior;
use crate::solve::problem::Problem;
use crate::solve::residual_block::{ResidualBlock, Weights};
use crate::stages::basin::Basin;
use crate::stages::identification::Identification;
use crate::stages::minima::Minima;
use crate::stages::neighbours::{moved, where_minima_may_begin};
use crate::tuning::MaterialTuning;
use crate::unknowns::state::{State, Unknown};

/// Other minima, with how much more they cost.
type OtherMinima = Vec<(f64, State)>;

/// The end of the joint stage, and the linearisation there where it was measured rather than carried there. The state
/// goes into the checkpoint.
///
/// # Errors
/// Where the start cannot be simulated, and interruption.
pub(crate) fn fit_jointly(
    identification: &Identification,
    session: &mut Session,
    starts: Vec<State>,
) -> Result<(State, Option<Linearisation>), IdentifyError> {
    // The paper stops after its material stage.
    let (state, linearisation, others) = match identification.settings.optimizer {
        Optimizer::LevenbergMarquardt => fit(identification, session, starts).map_err(|error| error.of_stage(1))?,
        Optimizer::Adam => (starts[0].clone(), None, Vec::new()),
    };
    let reached = session.reach(Some(Stage::Joint), |checkpoint| {
        checkpoint.joint = Some(state.clone());
        checkpoint.other_minima = others;
    });
    reached.map_err(|error| error.of_stage(1))?;
    Ok((state, linearisation))
}

fn fit(
    identification: &Identification,
    session: &mut Session,
    starts: Vec<State>,
) -> Result<(State, Option<Linearisation>, OtherMinima), FitError> {
    let (simulation, prior) = (identification.simulation(), prior(identification));
    let (tuning, iterations) = (identification.tuning, identification.settings.iterations);
    let mut starts = starts.into_iter();
    let first = starts.next().ok_or(FitError::NoIteration)?;
    let blurred = problem(identification, (&simulation, &prior), tuning.masks.blur_pooling);
    let mut here = Linearisation::measure(&blurred, &first)?;
    let weights = noise_weights(identification, session, &blurred, (&first, &mut here))?;
    let limits = Limits::rough(iterations, &tuning.descent);
    let start = (first, Some(here));
    let rough = session.minimise(Stage::Joint, &blurred.weighted_by(&weights), start, limits, &|_| false)?;
    if !identification.settings.stages.contains(&Stage::Intervals) {
        return Ok((rough.state, None, Vec::new()));
    }
    let sharp = problem(identification, (&simulation, &prior), 1);
    // Where the rough fit ended, its tangents are good enough for weights, and for a first step.
    let mut here = rough.linearisation.drawn_anew();
    let weights = noise_weights(identification, session, &sharp, (&rough.state, &mut here))?;
    let sharp = sharp.weighted_by(&weights);
    // The cost is in units of chi-squared: what matters is the absolute gain.
    let to_the_end = Limits::to_the_end(iterations, tuning.joint.least_gain);
    let fit = session.minimise(Stage::Joint, &sharp, (rough.state, Some(here)), to_the_end, &|_| false)?;
    let fitted_to_the_end = fit.state.clone();
    let mut minima = Minima::new(Stage::Joint, &sharp, limits);
    minima.keep(fit);
    look_at_others(session, &mut minima, (starts.as_slice(), &tuning.material))?;
    let mut fits = minima.into_fits().into_iter();
    let mut best = fits.next().ok_or(FitError::NoIteration)?;
    if best.state != fitted_to_the_end {
        let start = (best.state, Some(best.linearisation));
        best = session.minimise(Stage::Joint, &sharp, start, to_the_end, &|_| false)?;
    }
    let others =
        fits.map(|mut other| ((promised_cost(&sharp, &mut other) - best.cost).max(0.0), other.state)).collect();
    Ok((best.state, Some(best.linearisation).filter(Linearisation::is_fresh), others))
}

/// The cost at the end of a fit, less what its quadratic model promises to gain there yet.
fn promised_cost(problem: &Problem, fit: &mut Fit) -> f64 {
    let normal = problem.normal(fit.linearisation.blocks(problem), &fit.state);
    fit.cost - problem.largest_decrease(&normal, &fit.state).unwrap_or(0.0)
}

/// The weights of the noise at a state. Refinement's fits weigh anew from one to the next. An identification from
/// search to intervals at once weighs by what a step leaves: it starts too far off to take all it misses for noise.
fn noise_weights(
    identification: &Identification,
    session: &mut Session,
    problem: &Problem,
    (state, here): (&State, &mut Linearisation),
) -> Result<Weights, FitError> {
    session.pause()?;
    let (blocks, unknowns) = (here.blocks(problem), problem.unknowns.len());
    let weights = identification.weights_at(blocks, unknowns);
    let stages = &identification.settings.stages;
    if !(stages.contains(&Stage::Material) && stages.contains(&Stage::Intervals)) {
        return Ok(weights);
    }
    Ok(identification.weights_at(&after_a_step(&problem.weighted_by(&weights), state, blocks), unknowns))
}

/// The blocks after the step that those of the other observations want: what these do not explain is noise.
fn after_a_step(problem: &Problem, state: &State, blocks: &[ResidualBlock]) -> Vec<ResidualBlock> {
    let step_of_others = |observation: usize| {
        let others: Vec<ResidualBlock> = blocks.iter().filter(|b| b.observation != observation).cloned().collect();
        problem.step(&problem.normal(&others, state), state, 0.0, Vec::new())
    };
    let observations: BTreeSet<usize> = blocks.iter().map(|block| block.observation).collect();
    let steps: BTreeMap<usize, _> = observations.into_iter().map(|o| (o, step_of_others(o))).collect();
    let moved = |block: &ResidualBlock| match &steps[&block.observation] {
        Some(step) => block.moved(step),
        None => block.clone(),
    };
    blocks.iter().map(moved).collect()
}

/// Adds the minima that may begin at the material and the cells of `others`.
fn look_at_others(
    session: &mut Session,
    minima: &mut Minima,
    (others, tuning): (&[State], &MaterialTuning),
) -> Result<(), FitError> {
    let (problem, Some(best)) = (minima.problem, minima.best()) else { return Ok(()) };
    let places: Vec<State> = others.iter().filter_map(|other| moved_to(problem, best, other)).collect();
    let begins = where_minima_may_begin(session, problem, best, (&places, tuning))?;
    minima.seek_from_each(session, begins.into_iter().map(|place| places[place].clone()).collect())?;
    Ok(())
}

/// Material, cells and contact of a start, everything else where the quadratic model of a minimum has it then; `None`
/// where that is the minimum itself.
fn moved_to(problem: &Problem, basin: &Basin, start: &State) -> Option<State> {
    let is_of_start = |(_, unknown): &(usize, &Unknown)| matches!(unknown, Unknown::Material(_) | Unknown::Cell);
    let length = |(k, unknown): (usize, &Unknown)| (k, start.get(*unknown) - basin.state.get(*unknown));
    let lengths: Vec<(usize, f64)> = problem.unknowns.iter().enumerate().filter(is_of_start).map(length).collect();
    let of_other_contact = || (start.sticks != basin.state.sticks).then(|| basin.state.clone());
    let state = moved(problem, basin, &lengths).or_else(of_other_contact)?;
    Some(State { sticks: start.sticks, ..state })
}

/// The joint stage's search, of masks of which so many pixels to a side are averaged, weighted by the noise of free
/// flight.
pub(crate) fn problem<'a>(
    identification: &'a Identification,
    (simulation, prior): (&'a Simulation, &'a Prior),
    pooling: usize,
) -> Problem<'a> {
    Problem {
        forward: simulation,
        objective: identification.objective(),
        unknowns: unknowns(identification),
        coordinates: identification.coordinates(),
        descent: &identification.tuning.descent,
        selection: FrameSelection { pooling, ..identification.all_frames() },
        prior: Some(prior),
    }
}

/// The position stays that of free flight: free, it is traded for the velocity.
fn unknowns(identification: &Identification) -> Vec<Unknown> {
    let mut unknowns = identification.free_materials();
    unknowns.extend(&identification.flight.motion);
    unknowns.extend(identification.unknowns_of_world_and_grid());
    if !identification.video.frames[0].views.is_empty() {
        unknowns.extend(&identification.devices.unknowns);
        unknowns.extend((0..identification.shape.count()).map(Unknown::Shape));
    }
    unknowns
}

/// What is known of the joint stage's unknowns besides the pictures: of the shape, of the world, the grid and the
/// devices and, by the outlines, of the motion.
pub(crate) fn prior(identification: &Identification) -> Prior {
    let components = unknowns(identification).into_iter().filter(|u| matches!(u, Unknown::Shape(_)));
    let shape = Prior::independent(components.map(|component| (component, 0.0, 1.0)));
    let devices = &identification.devices;
    // The motion is as sure as the outlines say where the devices are as they are said to be.
    let motion = identification.motion_by_outlines.as_ref().filter(|_| devices.unknowns.is_empty());
    let known = [motion, identification.world_and_grid.as_ref(), Some(devices)];
    known.into_iter().flatten().fold(shape, |all, prior| all.and(prior.clone()))
}
