//! What a stage's result was made from and what it is: they decide whether the stage has to run again, and why.

use std::collections::BTreeMap;
use std::io;
use std::path::Path;

use gic_files::FileError;
use gic_twin::atomic;
use gic_twin::first_difference;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use sha2::{Digest, Sha256};

use crate::error::{Error, Result};

/// SHA-256 of files, hexadecimal, by their way from the run folder.
pub(super) type Hashes = BTreeMap<String, String>;

/// Everything that decides a stage's result. A stage leaves it as `begun` while it works.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Recipe {
    gic_version: String,
    /// Name of the input and the hash of its content, or of its recipe where it is a stage's result.
    input: (String, String),
    settings: Value,
    /// The files of the stages before it, as the stage read them.
    read: Hashes,
}

/// What a finished stage leaves. A recipe alone does not read as one: it promises no files.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Stamp {
    #[serde(flatten)]
    pub(super) recipe: Recipe,
    /// The files that the stage left.
    pub(super) written: Hashes,
    /// Wall-clock seconds that the stage took.
    pub(super) seconds: f64,
}

impl Recipe {
    pub(super) fn new(input: (&str, String), settings: &impl Serialize) -> Result<Self> {
        let settings = gic_twin::json::value(settings).map_err(FileError::syntax(Path::new("settings"), "JSON"))?;
        let input = (input.0.to_owned(), input.1);
        Ok(Self { gic_version: gic_twin::VERSION.into(), input, settings, read: Hashes::new() })
    }

    /// The same recipe of a stage that reads these files.
    pub(super) fn reading(self, read: Hashes) -> Self {
        Self { read, ..self }
    }

    /// Hash of the settings, of this stage and of those before it.
    pub(super) fn hash(&self) -> String {
        let text = format!("{} {:?} {}", self.gic_version, self.input, self.settings);
        format!("{:x}", Sha256::digest(text))
    }

    /// Hash of the scene, where that is the input.
    pub(super) fn input_hash(&self) -> &str {
        &self.input.1
    }

    /// Whether the work that left the recipe `begun` was on the same, so that it can go on.
    ///
    /// # Errors
    /// A damaged file.
    pub(super) fn goes_on(&self, begun: &Path) -> Result<bool> {
        Ok(read::<Self>(begun)?.is_some_and(|found| found.outdated_for(self).is_none()))
    }

    /// What differs from the recipe `wanted`; `None` where the result is up to date.
    pub(super) fn outdated_for(&self, wanted: &Self) -> Option<String> {
        if self.gic_version != wanted.gic_version {
            return Some(format!("made by gic {}, this is {}", self.gic_version, wanted.gic_version));
        }
        if let Some((key, was, is)) = first_difference("", &self.settings, &wanted.settings) {
            return Some(format!("{key} was {was} and is now {is}"));
        }
        if self.input != wanted.input {
            return Some(format!("the {} changed", wanted.input.0));
        }
        let mut files = self.read.keys().chain(wanted.read.keys());
        let changed = files.find(|file| self.read.get(*file) != wanted.read.get(*file));
        changed.map(|file| format!("{file} is another than the one it was made from"))
    }

    /// The first file that the stage read and that is another one now.
    pub(super) fn changed_input(&self, now: &Hashes) -> Option<&str> {
        let changed = |(file, read): &(&String, &String)| now.get(*file).is_some_and(|hash| hash != *read);
        self.read.iter().find(changed).map(|(file, _)| file.as_str())
    }

    pub(super) fn write(&self, path: &Path) -> Result<()> {
        Ok(atomic::write_json(path, self)?)
    }
}

impl Stamp {
    /// The stamp in a file; `None` where there is none.
    ///
    /// # Errors
    /// A damaged stamp: whether hours of work are up to date is not guessed.
    pub(super) fn read(path: &Path) -> Result<Option<Self>> {
        read(path)
    }

    pub(super) fn write(&self, path: &Path) -> Result<()> {
        Ok(atomic::write_json(path, self)?)
    }
}

fn read<T: DeserializeOwned>(path: &Path) -> Result<Option<T>> {
    let bytes = match gic_files::input::read(path) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(FileError::read(path)(error).into()),
    };
    serde_json::from_slice(&bytes).map(Some).map_err(|error| {
        Error::File(FileError::Content {
            path: path.to_owned(),
            problem: format!("is damaged, so that nobody knows what the stage was made from ({error})"),
            hint: Some("restore it from a copy, or remove it to have the stage run again".into()),
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recipe(read: &[(&str, &str)]) -> Recipe {
        let read = read.iter().map(|(file, hash)| ((*file).to_owned(), (*hash).to_owned())).collect();
        Recipe::new(("scene", "s".into()), &serde_json::json!({ "steps": 3 })).unwrap().reading(read)
    }

    #[test]
    fn a_file_that_changed_under_a_stage_is_named() {
        let made = recipe(&[("a.ply", "1"), ("b.ply", "2")]);
        assert_eq!(made.outdated_for(&made.clone()), None);
        let changed = made.outdated_for(&recipe(&[("a.ply", "1"), ("b.ply", "3")])).unwrap();
        assert!(changed.starts_with("b.ply"), "{changed}");
        assert!(made.outdated_for(&recipe(&[("a.ply", "1")])).is_some());
    }

    #[test]
    fn a_damaged_stamp_is_no_missing_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("fill.json");
        assert_eq!(Stamp::read(&path).unwrap(), None);
        let stamp = Stamp { recipe: recipe(&[]), written: recipe(&[("a.ply", "1")]).read, seconds: 5.0 };
        stamp.write(&path).unwrap();
        assert_eq!(Stamp::read(&path).unwrap(), Some(stamp));
        std::fs::write(&path, b"{\"gic_version\"").unwrap();
        let refused = Stamp::read(&path).unwrap_err();
        assert!(refused.to_string().contains("fill.json"), "{refused}");
        assert!(refused.hint().is_some());
    }

    #[test]
    fn work_that_has_begun_is_no_finished_stage() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("fill.begun.json");
        let recipe = recipe(&[("a.ply", "1")]);
        recipe.write(&path).unwrap();
        assert!(recipe.goes_on(&path).unwrap());
        assert!(Stamp::read(&path).is_err());
    }
}
