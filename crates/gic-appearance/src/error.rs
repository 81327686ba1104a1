//! What can go wrong when colours are trained or a scan is registered.

use gic_metrics::MetricError;
use gic_scene::SceneError;

/// An error of this crate.
#[derive(Debug, thiserror::Error)]
pub enum AppearanceError {
    /// The scene could not be read.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// Pictures could not be compared.
    #[error(transparent)]
    Metric(#[from] MetricError),
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
    /// A scan cannot be placed in the video.
    #[error("the scan cannot be registered: {0}")]
    Unregistrable(String),
    /// Training left the finite numbers.
    #[error("training diverged at step {step}: the loss is not finite; lower the learning rates")]
    Diverged {
        /// The step.
        step: usize,
    },
}
