//! Stage 4: material, velocity, rotation where there is one, the Gaussians' size and the body's shape together.
//!
//! Errors of free flight and of the shape then do not bias the material, and the intervals know of them. The noise of
//! the frames after contact is known only once they are explained, so a short fit precedes the weights of the long one.
//! With another shape another material may explain the video best: the fit looks over the walls of its minimum again.
//! This stage alone does not: it carries the shape of a body on whose material is known.

use nalgebra::{DMatrix, DVector};

use crate::FitError;
use crate::IdentifyError;
use crate::forward::simulation::Simulation;
use crate::result::Stage;
use crate::session::Session;
use crate::settings::Optimizer;
use crate::solve::levenberg_marquardt::Limits;
use crate::solve::linearisation::Linearisation;
use crate::solve::objective::Objective;
use crate::solve::prior::Prior;
use crate::solve::problem::Problem;
use crate::stages::identification::Identification;
use crate::stages::neighbours::Walls;
use crate::unknowns::state::{State, Unknown};

/// Minima that were left for a better one, and those that a fit from a neighbour found, with how much more they cost.
type OtherMinima = Vec<(f64, State)>;

/// The end of the joint stage, and the linearisation there where it was measured rather than carried there. The state
/// goes into the checkpoint.
///
/// # Errors
/// Where the start cannot be simulated, and interruption.
pub(crate) fn fit_jointly(
    identification: &Identification,
    session: &mut Session,
    start: State,
) -> Result<(State, Option<Linearisation>), IdentifyError> {
    // The paper stops after its material stage.
    let (state, linearisation, others) = match identification.settings.optimizer {
        Optimizer::LevenbergMarquardt => fit(identification, session, start).map_err(|error| error.of_stage(1))?,
        Optimizer::Adam => (start, None, Vec::new()),
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
    start: State,
) -> Result<(State, Option<Linearisation>, OtherMinima), FitError> {
    let (simulation, prior) = (identification.simulation(), prior(identification));
    let most = identification.settings.iterations;
    let is_alone = identification.settings.stages == (Stage::Joint..=Stage::Joint);
    let (mut state, mut known, mut others) = (start, None, Vec::new());
    for (iterations, is_last) in [(identification.tuning.descent.short_iterations.min(most), false), (most, true)] {
        let problem = problem(identification, &simulation, &prior);
        // Where the first fit ended, its tangents are good enough for weights, and for a first step.
        let mut here = match known {
            Some(known) => known,
            None => Linearisation::measure(&problem, &state)?,
        };
        session.pause()?;
        let weights = identification.weights_at(here.blocks(&problem), problem.unknowns.len());
        let problem = Problem { objective: Objective { weights: &weights, ..problem.objective }, ..problem };
        // The cost is in units of chi-squared: what matters is the absolute gain.
        let least_gain = identification.tuning.joint.least_gain;
        let limits = Limits::to_the_end(iterations, least_gain);
        let mut fit = session.minimise(Stage::Joint, &problem, (state, Some(here)), limits, &|_| false)?;
        if is_last && !is_alone {
            let tuning = &identification.tuning.material;
            let walls = Walls { stage: Stage::Joint, problem: &problem, limits, tuning };
            let (best, left) = walls.look_over(session, fit)?;
            others = left.into_iter().map(|other| (other.cost - best.cost, other.state)).collect();
            fit = best;
        }
        (state, known) = (fit.state, Some(fit.linearisation));
    }
    Ok((state, known.filter(Linearisation::is_fresh), others))
}

/// The joint stage's search, weighted by the noise of free flight.
pub(crate) fn problem<'a>(
    identification: &'a Identification,
    simulation: &'a Simulation,
    prior: &'a Prior,
) -> Problem<'a> {
    Problem {
        forward: simulation,
        objective: identification.objective(),
        unknowns: unknowns(identification),
        coordinates: identification.coordinates(),
        descent: &identification.tuning.descent,
        selection: identification.all_frames(),
        prior: Some(prior),
    }
}

/// The position stays that of free flight: free, it is traded for the velocity.
fn unknowns(identification: &Identification) -> Vec<Unknown> {
    let mut unknowns = identification.free_materials();
    let has_masks = !identification.video.frames[0].views.is_empty();
    if has_masks {
        unknowns.push(Unknown::Splat);
    }
    unknowns.extend(&identification.flight.motion);
    unknowns.extend(identification.unknowns_of_world_and_grid());
    if has_masks {
        unknowns.extend((0..identification.shape.count()).map(Unknown::Shape));
    }
    unknowns
}

/// What is known of the joint stage's unknowns besides the pictures: of the Gaussians' size, of the shape, of the
/// world and the grid and, by the outlines, of the motion.
pub(crate) fn prior(identification: &Identification) -> Prior {
    let is_nuisance = |u: &Unknown| u.is_of_drawing() || matches!(u, Unknown::Shape(_));
    let unknowns: Vec<Unknown> = unknowns(identification).into_iter().filter(is_nuisance).collect();
    let tuning = &identification.tuning.joint;
    let deviation = |u: &Unknown| match u {
        Unknown::Splat => tuning.splat_deviation,
        _ => 1.0,
    };
    let information = DVector::from_iterator(unknowns.len(), unknowns.iter().map(|u| deviation(u).powi(-2)));
    let means = unknowns.iter().map(|u| identification.flight.state.get(*u));
    let nuisances = Prior {
        information: DMatrix::from_diagonal(&information),
        mean: DVector::from_iterator(unknowns.len(), means),
        unknowns,
    };
    let known = [&identification.motion_by_outlines, &identification.world_and_grid];
    known.into_iter().flatten().fold(nuisances, |all, prior| all.and(prior.clone()))
}
