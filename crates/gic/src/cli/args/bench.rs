//! Suites of scenes.

use std::path::PathBuf;

use clap::Args;

use crate::cli::values::{positive, positive_number};

/// Run every scene of a folder, here or on a cluster, and write the paper's table
///
/// Each scene needs a gt folder; of it, only the material's model is given to the runs. OUT keeps all: suite.json (the
/// tasks), a run folder for each with result.json, and the tables results.md, .csv, .json, costs.json and suite.html
/// (sortable). A finished task is not run again, every other goes on where it stopped: run the same command again, with
/// the same or another --on. More scenes or another --filter add to what is there. `gic bench --collect OUT` makes the
/// tables of what is there.
#[derive(Debug, Args)]
#[command(after_help = "Examples: gic bench SUITE -o OUT --jobs 2 -- --steps 400\n          \
    gic bench SUITE -o OUT --on slurm --partition long --threads 4\n          \
    gic bench SUITE -o OUT --matrix identify.target=masks,surfaces --cameras '0,4,8;all' --repeat 3")]
pub(crate) struct BenchArgs {
    /// The folder that holds the scenes' folders; with --collect and --task the output folder
    #[arg(value_name = "SUITE_DIR|OUT")]
    pub(crate) suite: PathBuf,
    /// Folder for the runs and the tables
    #[arg(short, long, value_name = "OUT", required_unless_present_any = ["collect", "task"])]
    pub(crate) out: Option<PathBuf>,
    /// Only scenes whose name contains this
    #[arg(long, value_name = "TEXT", conflicts_with_all = ["collect", "task"])]
    pub(crate) filter: Option<String>,
    #[command(flatten)]
    pub(crate) sweep: SweepArgs,
    #[command(flatten)]
    pub(crate) engine: EngineArgs,
    /// Say what the tasks will take, and start nothing
    #[arg(long, conflicts_with_all = ["collect", "task", "export_suite"])]
    pub(crate) forecast: bool,
    /// Make the tables of what is in the output folder, and start nothing
    #[arg(long, conflicts_with_all = ["out", "task", "export_suite"])]
    pub(crate) collect: bool,
    /// Results of other methods: a folder that holds their output folders, called as the scenes are; may be repeated
    #[arg(long, value_name = "DIR", conflicts_with_all = ["task", "export_suite"])]
    pub(crate) others: Vec<PathBuf>,
    /// Write the scenes as the released code of another method reads them, with a script that runs it
    #[arg(long, value_enum, value_name = "METHOD", conflicts_with = "task")]
    pub(crate) export_suite: Option<gic_bench::others::Method>,
    /// Run one task of an output folder, by the name in its suite.json: what the engines call
    #[arg(long, value_name = "TASK", conflicts_with = "out")]
    pub(crate) task: Option<String>,
    /// Further arguments for `gic run`, after --
    #[arg(last = true, conflicts_with_all = ["collect", "task", "export_suite"])]
    pub(crate) arguments: Vec<String>,
}

/// Several ways of running every scene: all combinations
#[derive(Debug, Args)]
pub(crate) struct SweepArgs {
    /// A setting of config.toml and its alternatives, with semicolons between values that hold commas; may be repeated
    #[arg(long, value_name = "KEY=V,V", conflicts_with_all = ["collect", "task", "export_suite"])]
    pub(crate) matrix: Vec<gic_bench::sweep::Variation>,
    /// Sets of cameras; `all` for all
    #[arg(long, value_name = "A,B;all", conflicts_with_all = ["collect", "task"])]
    pub(crate) cameras: Option<String>,
    /// Run each so often, with seeds one after the other
    #[arg(long, value_name = "N", value_parser = positive, conflicts_with_all = ["collect", "task", "export_suite"])]
    pub(crate) repeat: Option<usize>,
    /// The first seed
    #[arg(long, value_name = "N", conflicts_with_all = ["collect", "task", "export_suite"])]
    pub(crate) seed: Option<u64>,
}

/// Where the tasks run
#[derive(Debug, Args)]
#[command(group = clap::ArgGroup::new("engine").multiple(true).conflicts_with_all(["collect", "task", "export_suite"]))]
pub(crate) struct EngineArgs {
    /// Where the tasks run; the suite and OUT must lie where all machines find them by the same path
    #[arg(long, value_enum, default_value_t, group = "engine")]
    pub(crate) on: gic_bench::engine::On,
    /// Most tasks at the same time [default: one here, what there is room for on a cluster]
    #[arg(long, value_name = "N", value_parser = positive, group = "engine")]
    pub(crate) jobs: Option<usize>,
    /// Slurm, Ray: memory of a task [GB] [default: twice the forecast]
    #[arg(long, value_name = "GB", value_parser = positive_number, group = "engine")]
    pub(crate) memory_gb: Option<f64>,
    /// Slurm: the partition
    #[arg(long, value_name = "NAME", group = "engine")]
    pub(crate) partition: Option<String>,
    /// Slurm: most time of a task, as sbatch takes it [default: five times the forecast]
    #[arg(long, value_name = "TIME", group = "engine")]
    pub(crate) time: Option<String>,
    /// Slurm: wait for the end of the job and make the tables
    #[arg(long, group = "engine")]
    pub(crate) wait: bool,
    /// Ray, Dask: the cluster's address; without it a cluster on this machine
    #[arg(long, value_name = "ADDRESS", group = "engine")]
    pub(crate) address: Option<String>,
    /// Ray, Dask: the Python that has them and the package gic; by default python3 of the path
    #[arg(long, value_name = "FILE", group = "engine")]
    pub(crate) python: Option<PathBuf>,
}
