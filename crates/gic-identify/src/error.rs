//! What can go wrong, and the way out.

use gic_mpm::SimulationError;
use thiserror::Error;

/// Why a fit ended without a result.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum FitError {
    /// The simulator refused the hypothesis, or gave up.
    #[error(transparent)]
    Simulation(#[from] SimulationError),
    /// Some particle is nowhere.
    #[error("the rollout is not finite")]
    NotFinite,
    /// Nothing was tried.
    #[error("no iteration was asked for")]
    NoIteration,
    /// The caller asked to stop.
    #[error("identification was interrupted")]
    Interrupted,
}

impl FitError {
    /// The error of a stage that went on from `starts` starting points.
    pub(crate) fn of_stage(self, starts: usize) -> IdentifyError {
        match self {
            FitError::Interrupted => IdentifyError::Interrupted,
            reason => IdentifyError::NoStart { starts, reason },
        }
    }
}

/// Why nothing could be identified.
#[derive(Debug, Error)]
pub enum IdentifyError {
    /// The input cannot be used.
    #[error("{field}: {problem}; {way_out}")]
    Input {
        /// Which part of the input.
        field: String,
        /// What is wrong with it.
        problem: String,
        /// What to change.
        way_out: String,
    },
    /// A parameter that the material does not have.
    #[error("unknown parameter '{name}'; there are {known}")]
    UnknownParameter {
        /// The name as given.
        name: String,
        /// The names that exist.
        known: String,
    },
    /// No start led to a rollout that ran.
    #[error(
        "none of {starts} starting points could be simulated (last reason: {reason}); \
         give a start near the expected material or more substeps per frame"
    )]
    NoStart {
        /// How many were tried.
        starts: usize,
        /// The last failure.
        reason: FitError,
    },
    /// The caller asked to stop.
    #[error("identification was interrupted")]
    Interrupted,
}

impl IdentifyError {
    pub(crate) fn input(field: impl Into<String>, problem: impl Into<String>, way_out: impl Into<String>) -> Self {
        IdentifyError::Input { field: field.into(), problem: problem.into(), way_out: way_out.into() }
    }
}
