//! What became of a task: its evaluation, or why there is none.

use std::path::Path;

use serde::Serialize;

use crate::error::Result;
use crate::evaluation::Evaluation;
use crate::plan::Task;
use crate::record::{Cost, Outcome, outcome};

/// What became of a task.
#[derive(Serialize)]
pub(crate) struct TaskOutcome<'a> {
    #[serde(skip)]
    pub(crate) task: &'a Task,
    scene: &'a str,
    #[serde(skip_serializing_if = "str::is_empty")]
    case: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    seed: Option<u64>,
    /// The evaluation, or why there is none.
    #[serde(flatten)]
    pub(crate) result: std::result::Result<Evaluation, String>,
    /// Times and places do not belong to results.
    #[serde(skip)]
    pub(crate) cost: Option<Cost>,
}

impl<'a> TaskOutcome<'a> {
    /// Of a task of the output folder `out`.
    ///
    /// # Errors
    /// A damaged record.
    pub(crate) fn read(task: &'a Task, out: &Path) -> Result<Self> {
        let (outcome, cost) = outcome(task, out)?;
        let result = match outcome {
            Outcome::Evaluation(evaluation) => Ok(evaluation),
            Outcome::Failure(reason) => Err(reason),
        };
        Ok(TaskOutcome { task, scene: &task.scene, case: &task.case, seed: task.seed, result, cost })
    }
}
