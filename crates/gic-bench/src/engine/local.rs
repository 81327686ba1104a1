//! Tasks on this machine: processes of their own, so that each has its own peak of memory and one that dies harms no
//! other.

use std::collections::VecDeque;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use gic_files::FileError;
use gic_twin::events::Events;
use gic_twin::{Interrupt, TwinError};

use super::{Launch, Started};
use crate::STAGE;
use crate::error::{BenchError, Result};
use crate::plan::Task;

pub(super) fn run(
    launch: &Launch,
    tasks: &[&Task],
    out: &Path,
    events: &Events,
    interrupt: &Interrupt,
) -> Result<Started> {
    let jobs = launch.jobs.unwrap_or(1);
    let mut waiting: VecDeque<&Task> = tasks.iter().copied().collect();
    let mut running: Vec<(&Task, Child)> = Vec::new();
    let mut done = 0;
    while !(waiting.is_empty() && running.is_empty()) {
        while running.len() < jobs && !interrupt.requested() {
            let Some(task) = waiting.pop_front() else { break };
            running.push((task, start(launch, task, out)?));
        }
        std::thread::sleep(Duration::from_millis(50));
        let mut still = Vec::new();
        for (task, mut child) in running {
            match child.try_wait().map_err(FileError::read(&launch.program))? {
                None => still.push((task, child)),
                Some(status) => {
                    done += 1;
                    events.step(STAGE, "", done, Some(tasks.len() as u64), &[]);
                    let end = if status.success() { "done" } else { "FAILED" };
                    events.note(STAGE, format!("{} {end}", task.label()));
                }
            }
        }
        running = still;
        // The tasks get the same Ctrl-C; each saves its state and ends.
        if interrupt.requested() && running.is_empty() {
            return Err(TwinError::Interrupted {
                after: format!("{done} of {} tasks", tasks.len()),
                resume: "run the same command again; tasks go on where they stopped".into(),
            }
            .into());
        }
    }
    Ok(Started::Ended)
}

fn start(launch: &Launch, task: &Task, out: &Path) -> Result<Child> {
    let messages = task.messages(out);
    let file = std::fs::File::create(&messages).map_err(gic_twin::TwinError::write(&messages))?;
    Command::new(&launch.program)
        .args(["--threads", &launch.threads.to_string(), "bench", "--task", &task.folder])
        .arg(out)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(file)
        .spawn()
        .map_err(|source| BenchError::Program {
            program: launch.program.display().to_string(),
            hint: "put the program gic into the path",
            source,
        })
}
