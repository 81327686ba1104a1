//! Stage 5: how sure the estimates are.
//!
//! The covariance of the joint fit, with what its few components of the shape do not tell.

use nalgebra::DMatrix;

use crate::FitError;
use crate::forward::trajectories::Trajectories;
use crate::session::Session;
use crate::solve::linearisation::{Linearisation, Tangents};
use crate::solve::prior::Prior;
use crate::solve::problem::Problem;
use crate::stages::identification::Identification;
use crate::stages::joint;
use crate::tuning::NoiseTuning;
use crate::uncertainty::interval::{Curvature, half_width, tells_apart, united};
use crate::unknowns::state::{State, Unknown};

/// Covariance of the joint stage's unknowns.
pub(crate) struct Uncertainty<'a> {
    tuning: &'a NoiseTuning,
    unknowns: Vec<Unknown>,
    /// `None` where it could not be measured.
    covariance: Option<DMatrix<f64>>,
    /// What the covariance would be if all residuals were independent.
    independent: Option<DMatrix<f64>>,
    /// Other minima, and by how much more they cost.
    other_minima: Vec<(f64, State)>,
}

impl Uncertainty<'_> {
    /// Half-width of the 95 % interval, in the unknown's coordinate.
    pub(crate) fn half_width(&self, unknown: Unknown) -> Option<f64> {
        let k = self.place(unknown)?;
        self.covariance.as_ref().map(|c| half_width(c[(k, k)], self.tuning))
    }

    /// The 95 % interval about an unknown's coordinate, with those about other minima that the video does not tell from
    /// the fit.
    pub(crate) fn interval(&self, unknown: Unknown, coordinate: f64) -> Option<(f64, f64)> {
        let half_width = self.half_width(unknown)?;
        let alike = self.other_minima.iter().filter(|(more_cost, _)| !self.tells_apart(unknown, *more_cost));
        let others: Vec<f64> = alike.map(|(_, state)| state.get(unknown)).collect();
        Some(united(coordinate, half_width, &others))
    }

    /// Whether the video tells the fit from a minimum that costs so much more, as far as an unknown goes.
    fn tells_apart(&self, unknown: Unknown, more_cost: f64) -> bool {
        let variance = |of: &Option<DMatrix<f64>>| Some(of.as_ref()?[(self.place(unknown)?, self.place(unknown)?)]);
        let known = variance(&self.covariance).zip(variance(&self.independent));
        known.is_some_and(|(robust, independent)| tells_apart(more_cost, robust, independent, self.tuning))
    }

    fn place(&self, unknown: Unknown) -> Option<usize> {
        self.unknowns.iter().position(|u| *u == unknown)
    }
}

/// The trajectories at `state` and how sure it is; `known` was measured there before.
///
/// # Errors
/// Where the state cannot be simulated, and interruption.
pub(crate) fn uncertainty<'a>(
    identification: &'a Identification,
    session: &mut Session,
    state: &State,
    known: Option<Linearisation>,
) -> Result<(Trajectories, Uncertainty<'a>), FitError> {
    let (simulation, prior) = (identification.simulation(), joint::prior(identification));
    let problem = joint::problem(identification, &simulation, &prior);
    let measured = match known.map(Linearisation::into_parts) {
        Some((trajectories, tangents)) => Ok((trajectories, Ok(tangents))),
        None => Tangents::measure_with_trajectories(&problem, state),
    };
    let (trajectories, tangents) = measured?;
    session.pause()?;
    let uncertainty = match tangents {
        Ok(tangents) => Uncertainty {
            other_minima: session.checkpoint().other_minima.clone(),
            ..of_tangents(identification, (&problem, &prior), &trajectories, &tangents)
        },
        Err(reason) => {
            session.warn([format!("no intervals: {reason}")]);
            let tuning = &identification.tuning.noise;
            Uncertainty {
                tuning,
                unknowns: problem.unknowns,
                covariance: None,
                independent: None,
                other_minima: Vec::new(),
            }
        }
    };
    Ok((trajectories, uncertainty))
}

fn of_tangents<'a>(
    identification: &'a Identification,
    (problem, prior): (&Problem, &Prior),
    trajectories: &Trajectories,
    tangents: &Tangents,
) -> Uncertainty<'a> {
    let (count, tuning) = (problem.unknowns.len(), &identification.tuning.noise);
    let blocks = tangents.blocks(problem, trajectories);
    let weights = identification.weights_at(&blocks, count);
    let curvature = Curvature::measure(&blocks, &weights, prior.information_of(&problem.unknowns));
    let is_component = |k: &usize| matches!(problem.unknowns[*k], Unknown::Shape(_));
    let components: Vec<usize> = (0..count).filter(is_component).collect();
    let covariance = curvature.as_ref().and_then(|curvature| {
        let of_fit = curvature.covariance(&blocks, &weights, tuning)?;
        Some(of_fit + curvature.shape_prior_covariance(&components))
    });
    Uncertainty {
        tuning,
        unknowns: problem.unknowns.clone(),
        covariance,
        independent: curvature.map(Curvature::into_independent_covariance),
        other_minima: Vec::new(),
    }
}

/// Half-width of an unknown's interval from free flight alone, by the outlines, or from the fit, where the position is
/// uncertain, too; `None` where it was not fitted or cannot be measured.
pub(crate) fn flight_half_width(identification: &Identification, unknown: Unknown) -> Option<f64> {
    let by_outlines = identification.motion_by_outlines.as_ref();
    if let Some(deviation) = by_outlines.and_then(|motion| motion.deviation_of(unknown)) {
        return Some(half_width(deviation * deviation, &identification.tuning.noise));
    }
    let (flight, weights, tuning) = (&identification.flight, &identification.weights, &identification.tuning.noise);
    let place = flight.unknowns.iter().position(|u| *u == unknown);
    let count = flight.unknowns.len();
    let curvature = Curvature::measure(&flight.blocks, weights, DMatrix::zeros(count, count));
    let covariance = curvature.and_then(|curvature| curvature.covariance(&flight.blocks, weights, tuning));
    place.zip(covariance).map(|(k, c)| half_width(c[(k, k)], tuning))
}
