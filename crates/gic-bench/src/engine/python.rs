//! Tasks on Ray or Dask: the Python package starts them, see `gic.bench` there.

use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

use gic_files::FileError;
use gic_twin::{Interrupt, TwinError};
use serde::Serialize;

use super::{Launch, Started};
use crate::error::{BenchError, Result};
use crate::forecast::Forecast;
use crate::plan::Task;

/// What `python -m gic.bench` reads.
#[derive(Serialize)]
struct Order<'a> {
    engine: &'a str,
    program: &'a Path,
    out: &'a Path,
    tasks: Vec<&'a str>,
    threads: usize,
    memory_gb: f64,
    jobs: Option<usize>,
    address: Option<&'a str>,
}

pub(super) fn run(
    engine: &str,
    launch: &Launch,
    tasks: &[&Task],
    out: &Path,
    forecast: &Forecast,
    interrupt: &Interrupt,
) -> Result<Started> {
    let order = Order {
        engine,
        program: &launch.program,
        out,
        tasks: tasks.iter().map(|task| task.folder.as_str()).collect(),
        threads: launch.threads,
        memory_gb: 1e-9 * launch.memory_bytes(forecast),
        jobs: launch.jobs,
        address: launch.address.as_deref(),
    };
    let python = launch.python.clone().unwrap_or("python3".into());
    let no_python = |source| BenchError::Program {
        program: python.display().to_string(),
        hint: "name the Python with --python FILE",
        source,
    };
    let mut command = Command::new(&python);
    command.args(["-m", "gic.bench"]).stdin(Stdio::piped()).stdout(Stdio::null());
    let mut child = command.spawn().map_err(no_python)?;
    let text = serde_json::to_string(&order).unwrap_or_default();
    // A Python that ends at once says more by its status than by the pipe that it closes.
    let _ = child.stdin.take().map(|mut input| input.write_all(text.as_bytes()));
    let status = child.wait().map_err(FileError::read(&python))?;
    if interrupt.requested() {
        return Err(TwinError::Interrupted {
            after: String::new(),
            resume: "run the same command again; tasks go on where they stopped".into(),
        }
        .into());
    }
    if !status.success() {
        return Err(BenchError::Ended {
            program: format!("{} -m gic.bench", python.display()),
            status,
            words: String::new(),
            hint: "its message stands above; that Python needs the package gic, and ray or dask[distributed]",
        });
    }
    Ok(Started::Ended)
}
