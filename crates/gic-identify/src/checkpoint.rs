//! What finished stages of identification leave behind, so that an interrupted one goes on to the same answer.

use serde::{Deserialize, Serialize};

use crate::result::{Stage, Step};
use crate::unknowns::state::State;

/// Results of the finished stages. A stage depends on those before it only through what is in here and on the input, so
/// that going on from a checkpoint ends at the same numbers as not stopping.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Checkpoint {
    /// Starting points that the search found, best first.
    pub(crate) starts: Option<Vec<State>>,
    /// Fits of the material from each of the starts so far: cost and state, `None` where it could not be simulated.
    pub(crate) fits: Vec<Option<(f64, State)>>,
    /// Ends of the material stage, the best first.
    pub(crate) material: Option<Vec<State>>,
    /// End of the joint stage.
    pub(crate) joint: Option<State>,
    /// Other minima that the joint stage found, and by how much more they cost.
    pub(crate) other_minima: Vec<(f64, State)>,
    /// All steps so far.
    pub(crate) trace: Vec<Step>,
    /// Rollouts so far, on the full and on the coarse grid.
    pub(crate) rollouts: (usize, usize),
    /// Seconds of each finished stage.
    pub(crate) seconds: Vec<(Stage, f64)>,
}

/// What a listener hears while identification runs.
#[derive(Debug)]
pub enum Event<'a> {
    /// A step was made.
    Step(&'a Step),
    /// A stage was finished, or a part of one that is worth keeping.
    Reached(&'a Checkpoint),
    /// Still at work: a moment at which it can be stopped.
    Working,
}
