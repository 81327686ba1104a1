//! What can go wrong in the pipeline. Every message names the file and the field; [`Error::hint`] says the way out.

use std::io;
use std::path::PathBuf;

use gic_bench::BenchError;
use gic_calibrate::CalibrateError;
use gic_files::{FileError, LockError};
use gic_film::FilmError;
use gic_grasp::GraspError;
use gic_twin::TwinError;
use gic_view::ViewError;

/// A failure of the pipeline.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file that cannot be read, written or understood.
    #[error(transparent)]
    File(#[from] FileError),
    /// A twin, its matter or its simulation.
    #[error(transparent)]
    Twin(#[from] TwinError),
    /// A grasp.
    #[error(transparent)]
    Grasp(#[from] GraspError),
    /// Pictures, pages and recordings.
    #[error(transparent)]
    View(#[from] ViewError),
    /// Films and masks.
    #[error(transparent)]
    Film(#[from] FilmError),
    /// Calibration.
    #[error(transparent)]
    Calibrate(#[from] CalibrateError),
    /// A suite of scenes, or the truth of one.
    #[error(transparent)]
    Bench(#[from] BenchError),
    /// The results could not be printed.
    #[error("cannot write the results to standard output")]
    Print {
        /// The cause.
        source: io::Error,
    },
    /// An output would take the place of an input.
    #[error("{} is {what}; nothing is written over it", path.display())]
    Overwrite {
        /// The output.
        path: PathBuf,
        /// What it is.
        what: &'static str,
    },
    /// A setting has a value that cannot be used, alone or with this scene.
    #[error("settings of {section}")]
    Setting {
        /// The table of `config.toml` that it stands in.
        section: &'static str,
        /// Which one, and why.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// Settings from somewhere have unknown keys or values of the wrong kind.
    #[error("{} does not give settings of gic", origin.display())]
    Settings {
        /// The file or flag.
        origin: PathBuf,
        /// The cause.
        source: toml::de::Error,
    },
    /// A stage of the pipeline failed.
    #[error("{stage} failed")]
    Stage {
        /// The stage.
        stage: &'static str,
        /// What to do about it.
        hint: Option<String>,
        /// The cause.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// Something that the caller asked for cannot be done.
    #[error("{problem}")]
    Usage {
        /// What.
        problem: String,
        /// What to do about it.
        hint: Option<String>,
    },
    /// The user interrupted; what was finished is on disk.
    #[error("interrupted{}", if after.is_empty() { String::new() } else { format!(" after {after}") })]
    Interrupted {
        /// The last thing that was finished.
        after: String,
        /// How to go on.
        resume: String,
    },
}

/// Result of the pipeline.
pub type Result<T> = std::result::Result<T, Error>;

impl From<LockError> for Error {
    fn from(error: LockError) -> Self {
        Self::Twin(error.into())
    }
}

impl Error {
    /// The way out, in one sentence, where there is one.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::Twin(error) => error.hint(),
            Self::Grasp(error) => error.hint(),
            Self::View(error) => error.hint(),
            Self::Film(error) => error.hint(),
            Self::Calibrate(error) => error.hint(),
            Self::Bench(error) => error.hint(),
            Self::File(error) => gic_twin::hint_of_file(error),
            Self::Setting { section, .. } => Some(format!(
                "change it by its flag (--help names them), by --set {section}.KEY=VALUE, or in the file of --config"
            )),
            Self::Settings { .. } => {
                Some("check the name and its value; `gic run --help` explains settings that have a flag".into())
            }
            Self::Print { .. } => Some("send the output to a file or a terminal that can take it".into()),
            Self::Overwrite { .. } => Some("choose another place for the output".into()),
            Self::Stage { hint, .. } | Self::Usage { hint, .. } => hint.clone(),
            Self::Interrupted { resume, .. } => Some(resume.clone()),
        }
    }

    /// Whether the user interrupted.
    pub fn is_interrupt(&self) -> bool {
        match self {
            Self::Twin(error) => error.is_interrupt(),
            Self::Grasp(error) => error.is_interrupt(),
            Self::View(error) => error.is_interrupt(),
            Self::Film(error) => error.is_interrupt(),
            Self::Calibrate(error) => error.is_interrupt(),
            Self::Bench(error) => error.is_interrupt(),
            Self::Interrupted { .. } => true,
            _ => false,
        }
    }

    /// Whether the command was wrong, whatever its files hold.
    pub fn is_usage(&self) -> bool {
        match self {
            Self::Film(error) => error.is_usage(),
            Self::Calibrate(error) => error.is_usage(),
            Self::Bench(error) => error.is_usage(),
            _ => matches!(self, Self::Setting { .. } | Self::Settings { .. }),
        }
    }

    /// An [`Error::Setting`] around another crate's error.
    pub(crate) fn setting<E>(section: &'static str) -> impl FnOnce(E) -> Self
    where
        E: Into<Box<dyn std::error::Error + Send + Sync>>,
    {
        move |source| Self::Setting { section, source: source.into() }
    }

    /// An [`Error::Stage`] around another crate's error.
    pub fn stage<E>(stage: &'static str) -> impl FnOnce(E) -> Self
    where
        E: Into<Box<dyn std::error::Error + Send + Sync>>,
    {
        move |source| Self::Stage { stage, hint: None, source: source.into() }
    }

    /// An [`Error::Stage`] of filling a frame.
    pub(crate) fn filling<E>(frame: usize) -> impl FnOnce(E) -> Self
    where
        E: Into<Box<dyn std::error::Error + Send + Sync>>,
    {
        move |source| Self::Stage {
            stage: "filling",
            hint: Some(format!("this is frame {frame}; look at the scene with `gic inspect`")),
            source: source.into(),
        }
    }
}
