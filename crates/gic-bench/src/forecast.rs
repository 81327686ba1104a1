//! What a suite will take, before it starts: from its finished tasks, or by a rule.

use std::fmt;
use std::path::Path;

use gic_scene::Scene;

use crate::error::{BenchError, Result};
use crate::plan::{Plan, Task};
use crate::record::{Outcome, Record};
use crate::tuning::{
    BUSY_SHARE, CPU_S_PER_MEGAPIXEL, LEAST_MEMORY_BYTES, LEAST_MINUTES, MEMORY_BYTES_PER_MEGAPIXEL, MEMORY_MARGIN,
    TASK_CPU_S, TASK_MEMORY_BYTES, TIME_MARGIN,
};

/// Where a forecast comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// This many finished tasks of the same output folder.
    Finished(usize),
    /// The rule.
    Rule,
}

/// What the tasks of a suite will take.
#[derive(Clone, Debug, PartialEq)]
pub struct Forecast {
    /// Tasks to run.
    pub tasks: usize,
    /// Tasks that are finished.
    pub finished: usize,
    /// At the same time; `None` where a cluster decides.
    pub jobs: Option<usize>,
    /// Threads of each.
    pub threads: usize,
    /// CPU time of all [s].
    pub cpu_s: f64,
    /// Wall-clock time of the longest task [s].
    pub longest_s: f64,
    /// Wall-clock time of all with `jobs` at a time [s].
    pub wall_s: Option<f64>,
    /// Memory of the largest task [bytes].
    pub memory_bytes: f64,
    /// Where the figures come from.
    pub source: Source,
}

/// CPU time [s] and memory [bytes] of a task.
type Need = (f64, f64);

impl Forecast {
    /// Memory to ask a cluster for [bytes].
    pub(crate) fn memory_with_margin(&self) -> f64 {
        (MEMORY_MARGIN * self.memory_bytes).max(LEAST_MEMORY_BYTES)
    }

    /// Time to ask a cluster for [minutes].
    pub(crate) fn minutes_with_margin(&self) -> f64 {
        (TIME_MARGIN * self.longest_s / 60.0).max(LEAST_MINUTES)
    }

    /// Of those tasks of a plan that wait: each takes what the finished ones of its case took in the mean, or those of
    /// all cases where its own has none.
    ///
    /// # Errors
    /// A scene or a record that cannot be read.
    pub fn of(plan: &Plan, waiting: &[&Task], out: &Path, jobs: Option<usize>, threads: usize) -> Result<Self> {
        let known = finished(plan, out)?;
        let mut needs = Vec::new();
        for task in waiting {
            needs.push(match mean_need(&known, task) {
                Some(need) => need,
                None => by_rule(megapixels(task)?),
            });
        }
        let wall = |cpu_s: f64| cpu_s / (BUSY_SHARE * threads as f64);
        let cpu_s: f64 = needs.iter().map(|(cpu_s, _)| cpu_s).sum();
        let longest_s = needs.iter().map(|(cpu_s, _)| wall(*cpu_s)).fold(0.0, f64::max);
        Ok(Self {
            tasks: waiting.len(),
            finished: known.len(),
            jobs,
            threads,
            cpu_s,
            longest_s,
            wall_s: jobs.map(|jobs| (wall(cpu_s) / jobs as f64).max(longest_s)),
            memory_bytes: needs.iter().map(|(_, memory)| *memory).fold(0.0, f64::max),
            source: if known.is_empty() { Source::Rule } else { Source::Finished(known.len()) },
        })
    }
}

impl fmt::Display for Forecast {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} tasks to run, {} finished: ", self.tasks, self.finished)?;
        match (self.wall_s, self.jobs) {
            (Some(wall_s), Some(jobs)) => write!(f, "{} with {jobs} at a time, ", duration(wall_s))?,
            _ => write!(f, "{} for the longest, ", duration(self.longest_s))?,
        }
        write!(
            f,
            "{} threads each; {} of CPU time in all, {:.2} GB of memory for the largest. ",
            self.threads,
            duration(self.cpu_s),
            self.memory_bytes / 1e9
        )?;
        match self.source {
            Source::Finished(count) => write!(f, "From what the {count} finished tasks took."),
            Source::Rule => write!(
                f,
                "By rule, since none is finished: {:.0} s of CPU time and {:.0} more for each megapixel of pictures.",
                TASK_CPU_S, CPU_S_PER_MEGAPIXEL
            ),
        }
    }
}

fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 100.0 => format!("{s:.0} s"),
        s if s < 6000.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

/// Finished tasks: case and what they took.
fn finished(plan: &Plan, out: &Path) -> Result<Vec<(String, Need)>> {
    let mut found = Vec::new();
    for task in &plan.tasks {
        let record = Record::of(task, out)?.filter(|record| matches!(record.outcome, Outcome::Evaluation(_)));
        if let Some(cost) = record.map(|record| record.cost) {
            let cpu_s = cost.cpu_s.unwrap_or(cost.wall_s * cost.threads as f64);
            found.push((task.case.clone(), (cpu_s, cost.peak_memory_bytes.unwrap_or_default() as f64)));
        }
    }
    Ok(found)
}

fn mean_need(known: &[(String, Need)], task: &Task) -> Option<Need> {
    let own: Vec<Need> = known.iter().filter(|(case, _)| *case == task.case).map(|(_, need)| *need).collect();
    let needs = if own.is_empty() { known.iter().map(|(_, need)| *need).collect() } else { own };
    let largest = needs.iter().map(|(_, memory)| *memory).reduce(f64::max)?;
    Some((needs.iter().map(|(cpu_s, _)| cpu_s).sum::<f64>() / needs.len() as f64, largest))
}

fn by_rule(megapixels: f64) -> Need {
    (TASK_CPU_S + CPU_S_PER_MEGAPIXEL * megapixels, TASK_MEMORY_BYTES + MEMORY_BYTES_PER_MEGAPIXEL * megapixels)
}

/// Pixels of the pictures that a task looks at [megapixels].
fn megapixels(task: &Task) -> Result<f64> {
    let scene = Scene::open(&task.scene_path).map_err(BenchError::scene(&task.scene_path))?;
    let pixels = |camera: usize| (scene.cameras[camera].width * scene.cameras[camera].height) as f64;
    let all: f64 = scene.views.iter().map(|view| pixels(view.camera)).sum();
    let chosen = task.arguments.iter().position(|word| word == "--cameras").map(|at| &task.arguments[at + 1]);
    let share = chosen.map_or(1.0, |list| list.split(',').count() as f64 / scene.cameras.len().max(1) as f64);
    Ok(1e-6 * all * share)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::tests::task;

    #[test]
    fn the_finished_tasks_of_a_case_come_first() {
        let known = [("a".to_owned(), (100.0, 1e8)), ("b".to_owned(), (300.0, 3e8)), ("b".to_owned(), (500.0, 2e8))];
        let of = |case: &str| mean_need(&known, &Task { case: case.into(), ..task("x") });
        assert_eq!(of("b"), Some((400.0, 3e8)));
        assert_eq!(of("c"), Some((300.0, 3e8)));
        assert_eq!(mean_need(&[], &task("x")), None);
    }

    #[test]
    fn forecasts_say_where_they_come_from() {
        let forecast = Forecast {
            tasks: 45,
            finished: 0,
            jobs: Some(2),
            threads: 1,
            cpu_s: 9000.0,
            longest_s: 300.0,
            wall_s: Some(5000.0),
            memory_bytes: 4.1e8,
            source: Source::Rule,
        };
        let text = forecast.to_string();
        assert!(text.contains("45 tasks to run") && text.contains("83 min with 2 at a time"), "{text}");
        assert!(text.contains("By rule"), "{text}");
        let text = Forecast { source: Source::Finished(9), jobs: None, wall_s: None, ..forecast }.to_string();
        assert!(text.contains("9 finished tasks") && text.contains("5 min for the longest"), "{text}");
    }
}
