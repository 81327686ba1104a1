//! Flags: one definition yields parser, help and completions.

mod bench;
mod film;
mod results;
mod run;
mod simulate;

use clap::{Args, Parser, Subcommand};

pub(crate) use self::bench::BenchArgs;
pub(crate) use self::film::{CalibrateArgs, ImportArgs, MasksArgs};
pub(crate) use self::results::{EvalArgs, ExportArgs, ReportArgs};
pub(crate) use self::run::{DemoArgs, FillArgs, IdentifyArgs, InspectArgs, ReconstructArgs, RegisterArgs, RunArgs};
pub(crate) use self::simulate::{BudgetArgs, GradcheckArgs, GraspArgs, RenderArgs, SimulateArgs, ViewArgs};
use super::values::threads;

/// Video in, physical digital twin out.
///
/// gic watches an object fall, bounce, flow or crumble in videos from a few calibrated cameras and finds out what it is
/// made of: its shape, its velocity and the parameters of its material, with error bars. The result, `twin.json`, can
/// be simulated into new futures.
#[derive(Debug, Parser)]
#[command(
    name = "gic",
    version,
    max_term_width = 120,
    propagate_version = true,
    subcommand_required = true,
    arg_required_else_help = true
)]
#[command(after_help = EXIT_CODES)]
pub(crate) struct Cli {
    #[command(flatten)]
    pub(crate) global: Global,
    #[command(subcommand)]
    pub(crate) command: Command,
}

const EXIT_CODES: &str = "\
Exit codes: 0 done, 1 failed, 2 bad usage or settings, 130 interrupted (what was finished is kept; run the same command \
again to go on).
Results go to stdout, everything else to stderr.";

#[derive(Debug, Args)]
#[command(next_display_order = 900)]
pub(crate) struct Global {
    /// Say more: every step with its numbers
    #[arg(short, long, global = true, conflicts_with = "quiet")]
    pub(crate) verbose: bool,
    /// Say less: results, warnings and errors only
    #[arg(short, long, global = true)]
    pub(crate) quiet: bool,
    /// Number of threads [default: one per core]
    #[arg(long, global = true, value_name = "N", value_parser = threads)]
    pub(crate) threads: Option<usize>,
}

// One value in a process: its size does not matter.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    Demo(DemoArgs),
    Import(ImportArgs),
    Calibrate(CalibrateArgs),
    Masks(MasksArgs),
    Inspect(InspectArgs),
    Run(RunArgs),
    Reconstruct(ReconstructArgs),
    Register(RegisterArgs),
    Fill(FillArgs),
    Identify(IdentifyArgs),
    Report(ReportArgs),
    Eval(EvalArgs),
    Bench(BenchArgs),
    Export(ExportArgs),
    Simulate(SimulateArgs),
    Render(RenderArgs),
    View(ViewArgs),
    Grasp(GraspArgs),
    Gradcheck(GradcheckArgs),
    /// Print the completion script of a shell
    ///
    /// For bash: gic completions bash > ~/.local/share/bash-completion/completions/gic
    Completions {
        /// The shell
        shell: clap_complete::Shell,
    },
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    #[test]
    fn the_flags_are_consistent() {
        super::Cli::command().debug_assert();
    }
}
