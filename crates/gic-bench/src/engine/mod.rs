//! Where the tasks of a suite run. The output folder is the protocol: an engine starts `gic bench --task NAME OUT` for
//! each task, and looks at nothing but the records that those leave.

mod local;
mod python;
mod slurm;

use std::path::{Path, PathBuf};

use gic_twin::Interrupt;
use gic_twin::events::Events;

use crate::error::{BenchError, Result};
use crate::forecast::Forecast;
use crate::plan::Task;

/// An engine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum On {
    /// This machine.
    #[default]
    Local,
    /// Slurm: one array job.
    Slurm,
    /// Ray, by the Python package.
    Ray,
    /// Dask, by the Python package.
    Dask,
}

/// How tasks are started.
#[derive(Clone, Debug)]
pub struct Launch {
    /// The engine.
    pub on: On,
    /// The file to call for gic, the same on every machine.
    pub program: PathBuf,
    /// Threads of each task.
    pub threads: usize,
    /// Most tasks at the same time.
    pub jobs: Option<usize>,
    /// Memory of each task [GB]; else the forecast's with a margin.
    pub memory_gb: Option<f64>,
    /// Slurm: the partition.
    pub partition: Option<String>,
    /// Slurm: most time of a task, as sbatch takes it; else the forecast's with a margin.
    pub time: Option<String>,
    /// Slurm: wait for the end of the job.
    pub wait: bool,
    /// Ray, Dask: the cluster; without it, this machine.
    pub address: Option<String>,
    /// Ray, Dask: the Python that has them and the package gic.
    pub python: Option<PathBuf>,
}

/// What is left to do after a start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Started {
    /// Nothing: each task has come to an end.
    Ended,
    /// The tasks wait or run elsewhere.
    Submitted,
}

impl Launch {
    /// Refuses what the engine has no use for.
    ///
    /// # Errors
    /// [`BenchError::Usage`].
    pub fn validate(&self) -> Result<()> {
        let python = matches!(self.on, On::Ray | On::Dask);
        let slurm = self.on == On::Slurm;
        let given = [
            ("--partition", self.partition.is_some(), slurm, "slurm"),
            ("--time", self.time.is_some(), slurm, "slurm"),
            ("--wait", self.wait, slurm, "slurm"),
            ("--memory-gb", self.memory_gb.is_some(), slurm || self.on == On::Ray, "slurm or ray"),
            ("--address", self.address.is_some(), python, "ray or dask"),
            ("--python", self.python.is_some(), python, "ray or dask"),
        ];
        match given.iter().find(|(_, given, used, _)| *given && !used) {
            Some((flag, _, _, engines)) => {
                Err(BenchError::usage(format!("{flag} is for --on {engines}"), "leave it out, or choose that engine"))
            }
            None => Ok(()),
        }
    }

    /// Memory to ask a cluster for, for each task [bytes].
    fn memory_bytes(&self, forecast: &Forecast) -> f64 {
        self.memory_gb.map_or_else(|| forecast.memory_with_margin(), |gb| 1e9 * gb)
    }

    /// Starts tasks; those on this machine, on Ray or on Dask have ended when it returns.
    ///
    /// # Errors
    /// An engine that cannot be started, an unwritable folder, an interrupt. A task that fails is no error.
    pub fn start(
        &self,
        tasks: &[&Task],
        out: &Path,
        forecast: &Forecast,
        events: &Events,
        interrupt: &Interrupt,
    ) -> Result<Started> {
        for task in tasks {
            gic_twin::atomic::create_folder(&task.run(out))?;
        }
        match self.on {
            On::Local => local::run(self, tasks, out, events, interrupt),
            On::Slurm => slurm::submit(self, tasks, out, forecast, events),
            On::Ray => python::run("ray", self, tasks, out, forecast, interrupt),
            On::Dask => python::run("dask", self, tasks, out, forecast, interrupt),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(super) fn launch(on: On) -> Launch {
        Launch {
            on,
            program: "/opt/it's/gic".into(),
            threads: 2,
            jobs: None,
            memory_gb: None,
            partition: None,
            time: None,
            wait: false,
            address: None,
            python: None,
        }
    }

    #[test]
    fn flags_of_other_engines_are_refused() {
        launch(On::Local).validate().unwrap();
        let partition = Launch { partition: Some("long".into()), ..launch(On::Ray) };
        assert!(partition.validate().unwrap_err().to_string().contains("--partition is for --on slurm"));
        Launch { memory_gb: Some(2.0), ..launch(On::Ray) }.validate().unwrap();
        assert!(Launch { memory_gb: Some(2.0), ..launch(On::Dask) }.validate().is_err());
    }
}
