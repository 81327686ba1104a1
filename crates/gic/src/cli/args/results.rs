//! What is made of a finished run.

use std::path::PathBuf;

use clap::Args;

use super::run::SceneElsewhere;

/// Write report.html of a finished run anew
#[derive(Debug, Args)]
pub(crate) struct ReportArgs {
    /// The run folder
    pub(crate) run: PathBuf,
    #[command(flatten)]
    pub(crate) elsewhere: SceneElsewhere,
}

/// Compare a run with ground truth: parameters, velocity, shape in every frame
#[derive(Debug, Args)]
pub(crate) struct EvalArgs {
    /// The run folder
    pub(crate) run: PathBuf,
    #[command(flatten)]
    pub(crate) elsewhere: SceneElsewhere,
    /// The truth: a folder with params.json and particles_N.npz
    #[arg(long, value_name = "SCENE/gt")]
    pub(crate) truth: PathBuf,
}

/// Hand a twin to other programs: meshes, Gaussians, simulators
///
/// Every format describes the same body, the twin's particles, and states the same mass.
#[derive(Debug, Args)]
pub(crate) struct ExportArgs {
    /// A run folder, the folder of a simulation, or a twin.json
    #[arg(value_name = "TWIN")]
    pub(crate) source: PathBuf,
    /// What to write
    #[arg(long, value_enum)]
    pub(crate) format: crate::export::Export,
    /// The file, or folder of a sequence [default: in the folder of the twin]
    #[arg(short, long, value_name = "FILE")]
    pub(crate) out: Option<PathBuf>,
    /// Turn everything so that this axis points up [default: as it is]
    #[arg(long, value_enum, value_name = "AXIS")]
    pub(crate) up: Option<Up>,
    /// Where the format lacks the twin's law, take the nearest: MuJoCo's bodies are elastic
    #[arg(long)]
    pub(crate) approximate: bool,
}

/// An axis that points up.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub(crate) enum Up {
    Y,
    Z,
}

impl From<Up> for gic_twin::interchange::UpAxis {
    fn from(up: Up) -> Self {
        match up {
            Up::Y => Self::Y,
            Up::Z => Self::Z,
        }
    }
}
