//! What can go wrong in training, saving and loading.

use std::path::Path;

use gic_files::FileError;
use gic_metrics::MetricError;
use gic_scene::SceneError;

/// An error of this crate.
#[derive(Debug, thiserror::Error)]
pub enum MotionError {
    /// The scene could not be read.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// Pictures could not be compared.
    #[error(transparent)]
    Metric(#[from] MetricError),
    /// Gaussians could not be written or read.
    #[error(transparent)]
    Ply(#[from] gic_splat::PlyError),
    /// A setting has no meaning.
    #[error("setting `{setting}`: {reason}")]
    Setting {
        /// Name of the setting.
        setting: &'static str,
        /// What is wrong, and the way out.
        reason: String,
    },
    /// The scene has nothing to train on.
    #[error("nothing to train on: {0}")]
    NothingToTrain(String),
    /// Training left the finite numbers.
    #[error("training diverged at step {step}: the loss is not finite; lower the learning rates (`rates`)")]
    Diverged {
        /// The step.
        step: usize,
    },
    /// A file that cannot be read, written or understood.
    #[error(transparent)]
    File(#[from] FileError),
}

impl MotionError {
    /// A [`FileError::Content`] of `path`; the reason names the way out.
    pub(crate) fn content(path: &Path, reason: impl ToString) -> MotionError {
        FileError::Content { path: path.to_owned(), problem: reason.to_string(), hint: None }.into()
    }
}
