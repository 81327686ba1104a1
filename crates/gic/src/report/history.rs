//! What `log.jsonl` says about the last time that each stage ran.

use std::collections::BTreeMap;
use std::path::Path;

use gic_files::FileError;
use gic_twin::events::Event;
use serde_json::Value;

use crate::error::Result;

/// Values of a stage's steps, in their order: phase, number, values.
type Steps = Vec<(String, u64, BTreeMap<String, f64>)>;

/// The log, by stage.
#[derive(Default)]
pub(crate) struct History {
    pub(super) steps: BTreeMap<String, Steps>,
    pub(crate) costs: BTreeMap<String, Cost>,
    warnings: Vec<(String, String)>,
}

/// What a stage took.
pub(crate) struct Cost {
    pub(crate) seconds: f64,
    pub(crate) cpu_seconds: Option<f64>,
    pub(crate) peak_memory_bytes: Option<u64>,
}

impl History {
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(FileError::read(path))?;
        let mut history = Self::default();
        text.lines().filter_map(event).for_each(|event| history.take(event));
        Ok(history)
    }

    fn take(&mut self, event: Event) {
        match event {
            Event::Step { stage, phase, step, values, .. } => {
                let steps = self.steps.entry(stage).or_default();
                // A stage that goes on from its checkpoint repeats the steps since then.
                let again = steps.iter().position(|(p, n, _)| *p == phase && *n >= step);
                steps.truncate(again.unwrap_or(steps.len()));
                steps.push((phase, step, values));
            }
            Event::StageStarted { stage, reason } => {
                self.warnings.retain(|(of, _)| *of != stage);
                if reason.starts_with("runs again") {
                    self.steps.remove(&stage);
                }
            }
            Event::StageDone { stage, seconds, cpu_seconds, peak_memory_bytes } => {
                self.costs.insert(stage, Cost { seconds, cpu_seconds, peak_memory_bytes });
            }
            Event::Warning { stage, text } => self.warnings.push((stage, text)),
            _ => (),
        }
    }

    /// Warnings of the stages that made the run, those `known` left out, each once.
    pub(super) fn warnings(&self, known: &[String]) -> Vec<String> {
        let mut found: Vec<String> = Vec::new();
        for (_, text) in self.warnings.iter().filter(|(stage, _)| !["report", "eval", "view"].contains(&stage.as_str()))
        {
            if !known.contains(text) && !found.contains(text) {
                found.push(text.clone());
            }
        }
        found
    }
}

/// A line of the log; one that was cut off by a crash says nothing.
fn event(line: &str) -> Option<Event> {
    // By way of a value: older logs have a second `seconds`, of which the last counts.
    serde_json::from_value(serde_json::from_str::<Value>(line).ok()?).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn history(lines: &[&str]) -> History {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.jsonl");
        std::fs::write(&path, lines.join("\n")).unwrap();
        History::read(&path).unwrap()
    }

    #[test]
    fn costs_are_read_from_logs_of_both_forms() {
        let old = r#"{"seconds":9.5,"event":"stage_done","stage":"fill","seconds":17.25,"cpu_seconds":18.0,"peak_memory_bytes":1048576}"#;
        let new = r#"{"elapsed_s":9.5,"event":"stage_done","stage":"predict","seconds":2.5,"cpu_seconds":null,"peak_memory_bytes":null}"#;
        let history = history(&[old, new, r#"{"elapsed_s":9.6,"event":"st"#]);
        assert_eq!(history.costs["fill"].seconds, 17.25);
        assert_eq!(history.costs["predict"].seconds, 2.5);
    }

    #[test]
    fn steps_that_are_done_again_count_once() {
        let step = |n: usize| {
            format!(r#"{{"event":"step","stage":"reconstruct","phase":"motion","step":{n},"of":9,"values":{{}}}}"#)
        };
        let lines: Vec<String> = [1, 2, 3, 2, 3, 4].into_iter().map(step).collect();
        let history = history(&lines.iter().map(String::as_str).collect::<Vec<_>>());
        let numbers: Vec<u64> = history.steps["reconstruct"].iter().map(|(_, n, _)| *n).collect();
        assert_eq!(numbers, [1, 2, 3, 4]);
    }

    #[test]
    fn warnings_are_those_of_the_last_time() {
        let started = r#"{"event":"stage_started","stage":"fill","reason":"runs again: x"}"#;
        let warning = |text: &str| format!(r#"{{"event":"warning","stage":"fill","text":"{text}"}}"#);
        let history = history(&[&warning("old"), started, &warning("new"), &warning("new"), &warning("known")]);
        assert_eq!(history.warnings(&["known".into()]), ["new"]);
    }
}
