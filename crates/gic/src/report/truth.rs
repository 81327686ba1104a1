//! The truth of a run's scene, where it comes with one: shown beside the estimate, which has not seen it.

use gic_twin::atomic;
use gic_twin::events::Events;

use super::STAGE;
use crate::error::Result;
use crate::pipeline::{IdentifyRecord, Run};
use gic_bench::{Evaluation, Truth};

/// What is true of a run's object.
pub(super) struct RunTruth {
    /// Values by the keys of a twin.
    parameters: Vec<(String, f64)>,
    /// Initial velocity [m/s].
    pub(super) velocity_m_s: [f64; 3],
}

impl RunTruth {
    #[cfg(test)]
    pub(super) fn of(parameters: &[(&str, f64)], velocity_m_s: [f64; 3]) -> Self {
        let parameters = parameters.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
        Self { parameters, velocity_m_s }
    }

    /// The true value of a parameter.
    pub(super) fn value(&self, name: &str) -> Option<f64> {
        self.parameters.iter().find(|(known, _)| known == name).map(|(_, value)| *value)
    }
}

/// From the scene's folder `gt`, or from what `gic eval` wrote about this very estimate; `None` where there is neither.
///
/// # Errors
/// A damaged `eval.json`.
pub(super) fn of_run(run: &Run, found: &IdentifyRecord, events: &Events) -> Result<Option<RunTruth>> {
    let folder = run.video().root.join("gt");
    if folder.join("params.json").exists() {
        return Ok(match Truth::read(&folder) {
            // Parameters of another law say nothing about this one's.
            Ok(truth) if truth.material.model() == found.model => {
                let names = truth.material.parameter_names().iter().map(|name| (*name).to_owned());
                let parameters = names.zip(truth.material.parameters()).collect();
                Some(RunTruth { parameters, velocity_m_s: truth.velocity_m_s })
            }
            Ok(_) => None,
            Err(error) => {
                events.warn(STAGE, format!("without the truth: {error}"));
                None
            }
        });
    }
    let file = run.folder().join("eval.json");
    if !file.exists() {
        return Ok(None);
    }
    let evaluation: Evaluation = atomic::read_json(&file)?;
    let same = |name: &str, value: f64| found.estimates.iter().any(|e| e.name == name && e.value == value);
    if !evaluation.parameters.iter().all(|p| same(&p.name, p.estimate)) {
        return Ok(None);
    }
    let parameters = evaluation.parameters.iter().map(|p| (p.name.clone(), p.truth)).collect();
    Ok(Some(RunTruth { parameters, velocity_m_s: evaluation.velocity.truth_m_s }))
}
