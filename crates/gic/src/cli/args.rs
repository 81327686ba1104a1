//! Flags: one definition yields parser, help and completions.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};
use gic::twin::Setting;

/// Video in, physical digital twin out.
///
/// gic watches an object fall, bounce, flow or crumble in videos from a few calibrated cameras and finds out what it is
/// made of: its shape, its velocity and the parameters of its material, with error bars. The result, `twin.json`, can be
/// simulated into new futures.
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
Exit codes: 0 done, 1 failed, 2 bad usage, 130 interrupted (what was finished is kept; run the same command again to go on).
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
    #[arg(long, global = true, value_name = "N", value_parser = positive)]
    pub(crate) threads: Option<usize>,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    Simulate(SimulateArgs),
    Gradcheck(GradcheckArgs),
    /// Print the completion script of a shell
    ///
    /// For bash: gic completions bash > ~/.local/share/bash-completion/completions/gic
    Completions {
        /// The shell
        shell: clap_complete::Shell,
    },
}

/// Simulate a twin: what happens to this matter from here on
///
/// Writes particles_NNNN.ply (binary; position, velocity, von Mises stress, J = relative volume) for every frame from 0,
/// the initial state, and trajectory.json. Run the same command again after an interruption, or with more --frames, and it
/// goes on where it stopped, with the same bytes as without interruption.
#[derive(Debug, Args)]
#[command(after_help = "Example: gic simulate examples/elastic.json -o /tmp/elastic --set youngs_modulus_pa=2e5")]
pub(crate) struct SimulateArgs {
    /// The twin (schema gic.twin/1)
    #[arg(value_name = "TWIN.json")]
    pub(crate) twin: PathBuf,
    /// Folder for the frames
    #[arg(short, long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Number of frames, the initial state included [default: the twin's]
    #[arg(long, value_name = "N", value_parser = positive)]
    pub(crate) frames: Option<usize>,
    /// Change a value of the twin: youngs_modulus_pa=2e5, gravity_m_s2=0,-1.62,0, colliders.0.contact=slip
    #[arg(long, value_name = "KEY=VALUE")]
    pub(crate) set: Vec<Setting>,
    /// Start anew, even if the folder holds frames of another twin or other settings
    #[arg(long)]
    pub(crate) restart: bool,
}

/// Check the simulator's gradients: adjoint against finite differences in f64
///
/// Prints one line per parameter, density, velocity and a few positions, for a block that hits a sticky floor within 50
/// substeps. Fails when one of them differs by more than 1e-3.
#[derive(Debug, Args)]
pub(crate) struct GradcheckArgs {
    /// Only this material
    #[arg(long, value_name = "MODEL")]
    pub(crate) material: Option<Model>,
}

/// The material models, by the names of `twin.json`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Model {
    Elastic,
    Plasticine,
    Sand,
    Newtonian,
    NonNewtonian,
}

impl Model {
    /// Its name in `twin.json`.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Elastic => "elastic",
            Self::Plasticine => "plasticine",
            Self::Sand => "sand",
            Self::Newtonian => "newtonian",
            Self::NonNewtonian => "non-newtonian",
        }
    }
}

fn positive(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(n) if n >= 1 => Ok(n),
        _ => Err("must be a whole number of at least 1".into()),
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    #[test]
    fn the_flags_are_consistent() {
        super::Cli::command().debug_assert();
    }
}
