//! Tables and page of what an output folder holds, whoever ran it.

use std::path::{Path, PathBuf};

use gic_scene::{Format, Scene};
use gic_twin::atomic;
use serde::Serialize;

use crate::error::Result;
use crate::evaluation::Evaluation;
use crate::others::{OtherResult, read_others};
use crate::outcome::TaskOutcome;
use crate::page;
use crate::plan::{Plan, Task};
use crate::record::Cost;
use crate::states::{self, SceneColumn, StateRow};
use crate::tables::{Coverage, ParameterRow, parameter_rows};
use crate::text::{csv, markdown, table_text};

/// The content of `results.json`.
#[derive(Serialize)]
struct SuiteJson<'a> {
    scenes: &'a [TaskOutcome<'a>],
    states: &'a [StateRow],
    table: &'a [ParameterRow],
    coverage: Coverage,
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    others: &'a [OtherResult],
}

/// A line of `costs.json`.
#[derive(Serialize)]
struct CostLine<'a> {
    task: &'a str,
    #[serde(flatten)]
    cost: &'a Cost,
}

/// The tables of a suite, as text for a terminal, and what has no result.
pub struct Collected {
    /// The tables.
    pub text: String,
    /// Tasks without a result, each with why.
    pub failures: Vec<(String, String)>,
    /// Number of tasks.
    pub tasks: usize,
}

/// Writes `results.md`, `results.csv`, `results.json`, `costs.json` and `suite.html` of what an output folder holds,
/// beside the results of other methods in the folders `others`. Only `costs.json` and the page depend on where and when
/// tasks ran.
///
/// # Errors
/// No plan there, damaged records, results of others without their scene, an unwritable folder.
pub fn collect(out: &Path, others: &[PathBuf]) -> Result<Collected> {
    let plan = Plan::read(out)?;
    let mut outcomes = Vec::new();
    for task in &plan.tasks {
        outcomes.push(TaskOutcome::read(task, out)?);
    }
    let others = read_others(&plan, others)?;
    let runs: Vec<(&Task, &Evaluation)> =
        outcomes.iter().filter_map(|o| Some((o.task, o.result.as_ref().ok()?))).collect();
    let rows = parameter_rows(&runs, &others);
    let coverage = Coverage::of(runs.iter().map(|(_, evaluation)| *evaluation));
    let labels: Vec<String> = plan.tasks.iter().map(Task::label).collect();
    let columns: Vec<SceneColumn> = labels.iter().zip(&outcomes).map(|(label, o)| column(label, o)).collect();
    let states = states::rows(&columns);
    let states_text = states::markdown(&states, &columns);
    let text = markdown(&rows, &coverage, &outcomes) + &states_text;
    atomic::write(&out.join("results.md"), text.as_bytes())?;
    atomic::write(&out.join("results.csv"), csv(&outcomes).as_bytes())?;
    let all = SuiteJson { scenes: &outcomes, states: &states, table: &rows, coverage, others: &others };
    atomic::write_json(&out.join("results.json"), &all)?;
    let cost = |o: &'_ TaskOutcome| o.cost.clone();
    let costs: Vec<(&str, Cost)> = outcomes.iter().filter_map(|o| Some((o.task.folder.as_str(), cost(o)?))).collect();
    let lines: Vec<CostLine> = costs.iter().map(|(task, cost)| CostLine { task, cost }).collect();
    atomic::write_json(&out.join("costs.json"), &lines)?;
    atomic::write(&out.join("suite.html"), page::page(&rows, &coverage, &outcomes)?.as_bytes())?;
    let failed = |o: &TaskOutcome| Some((o.task.label(), o.result.as_ref().err()?.clone()));
    Ok(Collected {
        text: table_text(&rows, &coverage) + &states_text,
        failures: outcomes.iter().filter_map(failed).collect(),
        tasks: outcomes.len(),
    })
}

fn column<'a>(label: &'a str, outcome: &'a TaskOutcome) -> SceneColumn<'a> {
    let format = Scene::open(&outcome.task.scene_path).map(|scene| scene.format);
    SceneColumn {
        name: label,
        spring_gaus: format.is_ok_and(|format| format == Format::SpringGausSynthetic),
        evaluation: outcome.result.as_ref().ok(),
    }
}
