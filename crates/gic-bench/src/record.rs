//! `result.json` in a run folder: what became of a task. A finished task is not run again.

use std::path::Path;

use gic_twin::atomic;
use serde::{Deserialize, Serialize};

use crate::error::Result;
use crate::evaluation::Evaluation;
use crate::plan::Task;

const FILE: &str = "result.json";
/// Characters of the last message that a failure repeats.
const LAST_WORDS: usize = 300;

/// What a task left.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Version of gic.
    pub gic_version: String,
    /// The task's arguments.
    pub arguments: Vec<String>,
    /// The evaluation, or why there is none.
    #[serde(flatten)]
    pub outcome: Outcome,
    /// What it took.
    pub cost: Cost,
}

/// How a task ended.
// One value a scene: its size does not matter.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// With a twin, which was compared with the truth.
    Evaluation(Evaluation),
    /// With an error.
    Failure(String),
}

/// What a task took.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    /// Wall-clock time of the stages [s].
    pub wall_s: f64,
    /// CPU time of the stages [s].
    pub cpu_s: Option<f64>,
    /// Most resident memory of a stage [bytes].
    pub peak_memory_bytes: Option<u64>,
    /// Threads.
    pub threads: usize,
    /// SIMD instructions that were used.
    pub simd: String,
}

/// `task.json`: what a run folder was begun with.
#[derive(PartialEq, Serialize, Deserialize)]
struct Begun {
    arguments: Vec<String>,
}

/// Prepares the run folder of a task. A run folder remembers the settings that it was begun with; where those were of
/// other arguments, it forgets them, so that the result does not depend on what else ran there.
///
/// # Errors
/// An unwritable folder.
pub fn begin(task: &Task, out: &Path) -> Result<()> {
    let (folder, begun) = (task.run(out), Begun { arguments: task.arguments.clone() });
    atomic::create_folder(&folder)?;
    let (path, settings) = (folder.join("task.json"), folder.join("config.toml"));
    let same = path.is_file() && atomic::read_json::<Begun>(&path)? == begun;
    if !same && settings.is_file() {
        std::fs::remove_file(&settings).map_err(gic_twin::TwinError::write(&settings))?;
    }
    Ok(atomic::write_json(&path, &begun)?)
}

impl Record {
    /// The record of a task in an output folder; `None` where it did not come to an end.
    ///
    /// # Errors
    /// A damaged file.
    pub fn of(task: &Task, out: &Path) -> Result<Option<Self>> {
        let path = task.run(out).join(FILE);
        if path.is_file() { Ok(Some(atomic::read_json(&path)?)) } else { Ok(None) }
    }

    /// Keeps the record in the run folder.
    ///
    /// # Errors
    /// An unwritable folder.
    pub fn write(&self, task: &Task, out: &Path) -> Result<()> {
        Ok(atomic::write_json(&task.run(out).join(FILE), self)?)
    }

    /// Whether the task ended with an evaluation, by this version and with these arguments.
    pub fn is_finished(&self, task: &Task) -> bool {
        self.is_of(task) && matches!(self.outcome, Outcome::Evaluation(_))
    }

    /// Whether the record is of the task as it is now.
    pub fn is_of(&self, task: &Task) -> bool {
        self.gic_version == gic_twin::VERSION && self.arguments == task.arguments
    }
}

/// The tasks that have to run, in their order.
///
/// # Errors
/// A damaged record.
pub fn unfinished<'a>(tasks: &'a [Task], out: &Path) -> Result<Vec<&'a Task>> {
    let mut found = Vec::new();
    for task in tasks {
        if !Record::of(task, out)?.is_some_and(|record| record.is_finished(task)) {
            found.push(task);
        }
    }
    Ok(found)
}

/// What a task has come to: the evaluation, or why there is none.
///
/// # Errors
/// A damaged record.
pub(crate) fn outcome(task: &Task, out: &Path) -> Result<(Outcome, Option<Cost>)> {
    Ok(match Record::of(task, out)? {
        Some(record) if record.is_of(task) => (record.outcome, Some(record.cost)),
        Some(_) => (Outcome::Failure("was not run again since its settings changed".into()), None),
        None => (Outcome::Failure(silent_end(task, out)), None),
    })
}

/// Why a task left no record: it waits, works, or was killed. Says nothing of where and when.
fn silent_end(task: &Task, out: &Path) -> String {
    let Ok(messages) = std::fs::read_to_string(task.messages(out)) else { return "has not begun".into() };
    let last = messages.lines().rev().map(str::trim).find(|line| !line.is_empty()).unwrap_or_default();
    let last: String = last.chars().take(LAST_WORDS).collect();
    format!("has not ended, or was killed; {}/messages.txt ends with \"{last}\"", task.folder)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::tests::task;

    #[test]
    fn a_run_folder_forgets_the_settings_of_other_arguments() {
        let folder = tempfile::tempdir().unwrap();
        let (before, now) = (task("a"), Task { arguments: vec!["--steps".into(), "7".into()], ..task("a") });
        let settings = before.run(folder.path()).join("config.toml");
        for (task, kept) in [(&before, false), (&before, true), (&now, false), (&now, true)] {
            std::fs::create_dir_all(task.run(folder.path())).unwrap();
            std::fs::write(&settings, "seed = 1").unwrap();
            begin(task, folder.path()).unwrap();
            assert_eq!(settings.is_file(), kept);
        }
    }

    #[test]
    fn a_finished_task_is_not_run_again_and_every_other_is() {
        let folder = tempfile::tempdir().unwrap();
        let tasks = ["done", "failed", "killed", "waiting", "changed"].map(task);
        let record = |task: &Task, outcome: Outcome| {
            let cost = Cost::default();
            let arguments = task.arguments.clone();
            let record = Record { gic_version: gic_twin::VERSION.into(), arguments, outcome, cost };
            std::fs::create_dir_all(task.run(folder.path())).unwrap();
            record.write(task, folder.path()).unwrap();
        };
        let found = Outcome::Evaluation(crate::evaluation::tests::evaluation(&[]));
        record(&tasks[0], found.clone());
        record(&tasks[1], Outcome::Failure("no ground".into()));
        record(&Task { arguments: Vec::new(), ..tasks[4].clone() }, found);
        std::fs::create_dir_all(tasks[2].run(folder.path())).unwrap();
        std::fs::write(tasks[2].messages(folder.path()), "reconstruct 5\nidentify 3\n\n").unwrap();
        let names = unfinished(&tasks, folder.path()).unwrap();
        assert_eq!(
            names.iter().map(|t| t.folder.as_str()).collect::<Vec<_>>(),
            ["failed", "killed", "waiting", "changed"]
        );
        let words = |i: usize| match outcome(&tasks[i], folder.path()).unwrap().0 {
            Outcome::Failure(reason) => reason,
            Outcome::Evaluation(_) => "evaluated".into(),
        };
        assert_eq!([words(0), words(1), words(3)], ["evaluated", "no ground", "has not begun"]);
        assert!(words(2).contains("killed/messages.txt ends with \"identify 3\""), "{}", words(2));
        assert!(words(4).contains("settings changed"));
    }
}
