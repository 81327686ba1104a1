//! What a stage's result was made from: it decides whether the stage has to run again, and why.

use std::path::{Path, PathBuf};

use gic_twin::atomic;
use gic_twin::first_difference;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use sha2::{Digest, Sha256};

use crate::error::{Error, Result};

/// Everything that decides a stage's result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Stamp {
    gic_version: String,
    /// Name of the input and the hash of its content, or of its stamp where it is a stage's result.
    input: (String, String),
    settings: Value,
    /// Wall-clock seconds that the stage took; no part of the comparison.
    #[serde(default)]
    pub(super) seconds: f64,
}

impl Stamp {
    pub(super) fn new(input: (&str, String), settings: &impl Serialize) -> Result<Self> {
        let settings = serde_json::to_value(settings).map_err(|source| Error::Syntax {
            path: PathBuf::from("settings"),
            format: "JSON",
            source: source.into(),
        })?;
        let input = (input.0.to_owned(), input.1);
        Ok(Self { gic_version: gic_twin::VERSION.into(), input, settings, seconds: 0.0 })
    }

    /// The same stamp with the time that the stage took.
    pub(super) fn after(self, seconds: f64) -> Self {
        Self { seconds, ..self }
    }

    /// Hash of everything but the time it took.
    pub(super) fn hash(&self) -> String {
        let text = format!("{} {:?} {}", self.gic_version, self.input, self.settings);
        format!("{:x}", Sha256::digest(text))
    }

    /// What differs from the stamp `wanted`; `None` where the result is up to date.
    pub(super) fn outdated_for(&self, wanted: &Self) -> Option<String> {
        if self.gic_version != wanted.gic_version {
            return Some(format!("made by gic {}, this is {}", self.gic_version, wanted.gic_version));
        }
        if let Some((key, was, is)) = first_difference("", &self.settings, &wanted.settings) {
            return Some(format!("{key} was {was} and is now {is}"));
        }
        (self.input != wanted.input).then(|| format!("the {} changed", wanted.input.0))
    }

    pub(super) fn read(path: &Path) -> Option<Self> {
        // A stamp that cannot be read is no stamp: the stage runs again.
        serde_json::from_slice(&std::fs::read(path).ok()?).ok()
    }

    pub(super) fn write(&self, path: &Path) -> Result<()> {
        Ok(atomic::write_json(path, self)?)
    }
}
