//! Stage 5: how sure the estimates are.
//!
//! The covariance of the joint fit, with what its few components of the shape do not tell, and how far each parameter
//! may go until the pictures object.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::FitError;
use crate::forward::trajectories::{ForwardModel, Trajectories};
use crate::session::Session;
use crate::solve::linearisation::{Linearisation, Tangents};
use crate::solve::normal_equations::Normal;
use crate::solve::prior::Prior;
use crate::solve::problem::Problem;
use crate::solve::residual_block::{ResidualBlock, Weights};
use crate::stages::identification::Identification;
use crate::stages::joint;
use crate::uncertainty::interval::{Curvature, told, united};
use crate::uncertainty::profile::reach;
use crate::uncertainty::variance::{Covariance, Variance};
use crate::unknowns::state::{State, Unknown};

/// Covariance of the joint stage's unknowns.
pub(crate) struct Uncertainty {
    unknowns: Vec<Unknown>,
    /// `None` where they could not be measured.
    covariances: Option<Covariances>,
    /// How far the interval of each parameter of the material that is sought reaches below and above the fit.
    reaches: Vec<(Unknown, (f64, f64))>,
    /// Other minima, and by how much more they cost.
    other_minima: Vec<(f64, State)>,
}

/// What the fit's residuals tell of how sure it is.
struct Covariances {
    /// Covariance of the unknowns.
    robust: Covariance,
    /// What it would be if all residuals were independent.
    independent: DMatrix<f64>,
    /// The quadratic model about the fit.
    normal: Normal,
    /// The noise of the residuals, inverted.
    weights: Weights,
    /// How the fit's trajectories change with the unknowns.
    tangents: Tangents,
}

impl Covariances {
    /// How far the video tells the fit from a state that costs so much `more`, as far as the `k`-th unknown goes; 1 at
    /// the end of the interval.
    fn told(&self, k: usize, more: f64) -> f64 {
        told(more, self.robust.variance(k), self.independent[(k, k)])
    }
}

impl Uncertainty {
    /// Half-width of the 95 % interval, in the unknown's coordinate.
    pub(crate) fn half_width(&self, unknown: Unknown) -> Option<f64> {
        let k = self.place(unknown)?;
        self.covariances.as_ref().map(|c| c.robust.variance(k).half_width())
    }

    /// Covariance of some unknowns' coordinates.
    pub(crate) fn covariance_of(&self, unknowns: &[Unknown]) -> Option<Covariance> {
        let places: Vec<usize> = unknowns.iter().map(|unknown| self.place(*unknown)).collect::<Option<_>>()?;
        self.covariances.as_ref().map(|c| c.robust.of(&places))
    }

    /// The weights that the fit's residuals give.
    pub(crate) fn weights(&self) -> Option<&Weights> {
        self.covariances.as_ref().map(|c| &c.weights)
    }

    /// A state with some of the `problem`'s unknowns `to` values of their coordinates, the others where the quadratic
    /// model about the `fit` has them then; and the linearisation carried there. `None` where the state cannot be
    /// simulated.
    pub(crate) fn moved(
        &self,
        problem: &Problem,
        (fit, trajectories): (&State, &Trajectories),
        to: &[(Unknown, f64)],
    ) -> Option<(State, Linearisation)> {
        let covariances = self.covariances.as_ref()?;
        let length = |(unknown, value): &(Unknown, f64)| Some((self.place(*unknown)?, value - fit.get(*unknown)));
        let lengths: Vec<(usize, f64)> = to.iter().map(length).collect::<Option<_>>()?;
        let step = problem.step(&covariances.normal, fit, 0.0, lengths)?;
        let (moved, delta) = problem.moved(fit, step.as_slice());
        let there = problem.forward.trajectories(&moved, &problem.selection).ok()?;
        let here = Linearisation::of_parts(trajectories.clone(), covariances.tangents.clone());
        Some((moved, here.carried(there, &delta)))
    }

    /// The 95 % interval about an unknown's coordinate in the `fit`, with those about what the video does not tell from
    /// it: the `middle` of what it leaves open, and other minima.
    pub(crate) fn interval(&self, unknown: Unknown, fit: &State, middle: &State) -> Option<(f64, f64)> {
        let (_, reaches) = self.reaches.iter().find(|(reaching, _)| *reaching == unknown)?;
        let alike = self.other_minima.iter().filter(|(more_cost, _)| !self.tells_apart(unknown, *more_cost));
        let others = alike.map(|(_, state)| state).chain([middle]).map(|state| state.get(unknown));
        Some(united(fit.get(unknown), *reaches, &others.collect::<Vec<f64>>()))
    }

    /// Whether the video tells the fit from a state that costs so much more, as far as an unknown goes.
    pub(crate) fn tells_apart(&self, unknown: Unknown, more_cost: f64) -> bool {
        let places = self.place(unknown).zip(self.covariances.as_ref());
        places.is_some_and(|(k, covariances)| covariances.told(k, more_cost) >= 1.0)
    }

    fn place(&self, unknown: Unknown) -> Option<usize> {
        self.unknowns.iter().position(|u| *u == unknown)
    }
}

/// The trajectories at `state` and how sure it is; `known` was measured there before.
///
/// # Errors
/// Where the state cannot be simulated, and interruption.
pub(crate) fn uncertainty(
    identification: &Identification,
    session: &mut Session,
    state: &State,
    known: Option<Linearisation>,
) -> Result<(Trajectories, Uncertainty), FitError> {
    let (simulation, prior) = (identification.simulation(), joint::prior(identification));
    let problem = joint::problem(identification, (&simulation, &prior), 1);
    let (measured, on_other_cells) = rayon::join(
        || match known.map(Linearisation::into_parts) {
            Some((trajectories, tangents)) => Ok((trajectories, Ok(tangents))),
            None => Tangents::measure_with_trajectories(&problem, state),
        },
        || on_other_cells(identification, state),
    );
    let (trajectories, tangents) = measured?;
    session.pause()?;
    let covariances = match tangents {
        Ok(tangents) => covariances(identification, (&problem, &prior), (&trajectories, tangents), on_other_cells),
        Err(reason) => {
            session.warn([format!("no intervals: {reason}")]);
            None
        }
    };
    let (unknowns, of_fit) = (problem.unknowns.clone(), (state, &trajectories));
    let reaches = covariances.as_ref().map_or_else(Vec::new, |covariances| profiled(&problem, of_fit, covariances));
    session.pause()?;
    let other_minima = session.checkpoint().other_minima.clone();
    Ok((trajectories, Uncertainty { unknowns, covariances, reaches, other_minima }))
}

/// How far the interval of each parameter of the material reaches below and above the fit, by the profile of the
/// likelihood: the others follow a parameter that is moved.
fn profiled(
    problem: &Problem,
    (state, trajectories): (&State, &Trajectories),
    covariances: &Covariances,
) -> Vec<(Unknown, (f64, f64))> {
    let problem = problem.weighted_by(&covariances.weights);
    let least = problem.cost(state, trajectories);
    let told = |k: usize, length: f64| {
        let step = problem.step(&covariances.normal, state, 0.0, vec![(k, length)])?;
        let (moved, _) = problem.moved(state, step.as_slice());
        let moved_cost = problem.cost(&moved, &problem.forward.trajectories(&moved, &problem.selection).ok()?);
        Some(covariances.told(k, moved_cost - least))
    };
    let sides = |k: usize| {
        let (at, (low, high)) = (state.get(problem.unknowns[k]), problem.coordinates.limits(problem.unknowns[k]));
        let half_width = covariances.robust.variance(k).half_width();
        rayon::join(
            || reach(half_width, at - low, &|distance| told(k, -distance)),
            || reach(half_width, high - at, &|distance| told(k, distance)),
        )
    };
    let unknowns = problem.unknowns.par_iter().enumerate();
    let materials = unknowns.filter(|(_, unknown)| matches!(unknown, Unknown::Material(_)));
    materials.map(|(k, unknown)| (*unknown, sides(k))).collect()
}

/// The trajectories of `state` on cells that are coarser by a deviation, where cells are neither given nor sought;
/// `None` where it cannot be simulated there.
fn on_other_cells(identification: &Identification, state: &State) -> Option<Trajectories> {
    let is_known = identification.settings.grid_spacing_m.is_some();
    if is_known || identification.seeks_cells() {
        return None;
    }
    let coarser = State { log_cell: identification.tuning.resolution.log_cell_deviation, ..state.clone() };
    identification.simulation().trajectories(&coarser, &identification.all_frames()).ok()
}

/// How sure a fit with these trajectories and tangents is; `None` where that is not finite. What the fit held, the
/// cells, stands in a column behind those of the unknowns, and counts as components of the shape do.
fn covariances(
    identification: &Identification,
    (problem, prior): (&Problem, &Prior),
    (trajectories, mut tangents): (&Trajectories, Tangents),
    on_other_cells: Option<Trajectories>,
) -> Option<Covariances> {
    let count = problem.unknowns.len();
    on_other_cells.into_iter().for_each(|other| tangents.push(other));
    let blocks: &[ResidualBlock] = &tangents.blocks(problem, trajectories);
    let weights = identification.weights_at(blocks, count);
    let columns = blocks.first()?.gradient.len();
    let mut known = DMatrix::identity(columns, columns);
    known.view_mut((0, 0), (count, count)).copy_from(&prior.information_of(&problem.unknowns));
    let curvature = Curvature::measure(blocks, &weights, known)?;
    let is_component = |k: &usize| problem.unknowns.get(*k).is_none_or(|u| matches!(u, Unknown::Shape(_)));
    let components: Vec<usize> = (0..columns).filter(is_component).collect();
    let tuning = &identification.tuning.noise;
    let mut parts = curvature.parts(tuning)?;
    parts.push((curvature.prior_covariance(&components), tuning.freedom));
    let robust = Covariance::sum(&parts)?;
    // At a minimum nothing pulls.
    let normal = Normal { cost: 0.0, gradient: DVector::zeros(count), hessian: curvature.hessian(count) };
    let independent = curvature.into_independent_covariance();
    let tangents = tangents.of_unknowns(|k| k < count);
    Some(Covariances { robust, independent, normal, weights, tangents })
}

/// Half-width of an unknown's interval from free flight alone, by the outlines, given what the flight does not seek, or
/// from the fit, where the position is uncertain, too; `None` where it was not fitted or cannot be measured.
pub(crate) fn flight_half_width(identification: &Identification, unknown: Unknown) -> Option<f64> {
    let (flight, weights, tuning) = (&identification.flight, &identification.weights, &identification.tuning.noise);
    if let Some(motion) = &identification.motion_by_outlines {
        let place = flight.motion.iter().position(|u| *u == unknown)?;
        let value = motion.information_of(&flight.motion).try_inverse()?[(place, place)];
        return Some(Variance { value, freedom: tuning.freedom }.half_width());
    }
    let (place, count) = (flight.unknowns.iter().position(|u| *u == unknown)?, flight.unknowns.len());
    let curvature = Curvature::measure(&flight.blocks, weights, DMatrix::zeros(count, count))?;
    Some(Covariance::sum(&curvature.parts(tuning)?)?.variance(place).half_width())
}
