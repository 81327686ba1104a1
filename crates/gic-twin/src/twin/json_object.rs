//! Strict reading of JSON objects: unknown keys are errors, every message names file and field.

use std::path::Path;

use gic_files::FileError;
use serde_json::{Map, Value};

use crate::error::{Result, TwinError};

/// A JSON object together with its place, for messages.
pub(crate) struct JsonObject<'a> {
    file: &'a Path,
    place: String,
    map: &'a Map<String, Value>,
}

impl<'a> JsonObject<'a> {
    /// Wraps a value that must be an object; `place` is empty for the top of the file.
    pub(crate) fn new(file: &'a Path, place: &str, value: &'a Value) -> Result<Self> {
        match value {
            Value::Object(map) => Ok(Self { file, place: place.to_owned(), map }),
            other => Err(TwinError::File(FileError::Field {
                path: file.to_owned(),
                field: if place.is_empty() { "(top level)".into() } else { place.to_owned() },
                problem: format!("must be an object, found {}", kind(other)),
                hint: None,
            })),
        }
    }

    /// Refuses every key outside `valid`, and names the nearest valid one.
    pub(crate) fn allow_only(&self, valid: &[&str]) -> Result<()> {
        match self.map.keys().find(|key| !valid.contains(&key.as_str())) {
            None => Ok(()),
            Some(key) => Err(TwinError::UnknownKey {
                path: self.file.to_owned(),
                key: self.field(key),
                nearest: nearest(key, valid),
                valid: valid.iter().map(|k| (*k).to_owned()).collect(),
            }),
        }
    }

    /// The full name of a key of this object.
    pub(crate) fn field(&self, key: &str) -> String {
        if self.place.is_empty() { key.to_owned() } else { format!("{}.{key}", self.place) }
    }

    /// An error about a key of this object.
    pub(crate) fn problem(&self, key: &str, problem: impl Into<String>, hint: Option<&str>) -> TwinError {
        TwinError::File(FileError::Field {
            path: self.file.to_owned(),
            field: self.field(key),
            problem: problem.into(),
            hint: hint.map(str::to_owned),
        })
    }

    pub(crate) fn get(&self, key: &str) -> Option<&'a Value> {
        self.map.get(key)
    }

    pub(crate) fn entries(&self) -> impl Iterator<Item = (&'a String, &'a Value)> {
        self.map.iter()
    }

    pub(crate) fn require(&self, key: &str, hint: &str) -> Result<&'a Value> {
        self.get(key).ok_or_else(|| self.problem(key, "is missing", Some(hint)))
    }

    pub(crate) fn object(&self, key: &str, hint: &str) -> Result<JsonObject<'a>> {
        JsonObject::new(self.file, &self.field(key), self.require(key, hint)?)
    }

    pub(crate) fn string(&self, key: &str, hint: &str) -> Result<&'a str> {
        let value = self.require(key, hint)?;
        value.as_str().ok_or_else(|| self.wrong_kind(key, "a string", value))
    }

    pub(crate) fn array(&self, key: &str) -> Result<&'a [Value]> {
        match self.get(key) {
            None => Ok(&[]),
            Some(Value::Array(items)) => Ok(items),
            Some(other) => Err(self.wrong_kind(key, "a list", other)),
        }
    }

    /// A finite number, or `None` when the key is absent.
    pub(crate) fn number(&self, key: &str) -> Result<Option<f64>> {
        match self.get(key) {
            None => Ok(None),
            Some(value) => value
                .as_f64()
                .filter(|v| v.is_finite())
                .map(Some)
                .ok_or_else(|| self.wrong_kind(key, "a number", value)),
        }
    }

    /// A number above zero, or `None` when the key is absent.
    pub(crate) fn positive(&self, key: &str) -> Result<Option<f64>> {
        match self.number(key)? {
            Some(v) if v > 0.0 => Ok(Some(v)),
            None => Ok(None),
            Some(v) => Err(self.problem(
                key,
                format!("is {v}; it must be greater than 0"),
                Some("give a positive number in SI units"),
            )),
        }
    }

    /// A number of at least zero, or `None` when the key is absent.
    pub(crate) fn non_negative(&self, key: &str) -> Result<Option<f64>> {
        match self.number(key)? {
            Some(v) if v >= 0.0 => Ok(Some(v)),
            None => Ok(None),
            Some(v) => Err(self.problem(key, format!("is {v}; it must not be negative"), None)),
        }
    }

    /// A whole number of at least one, or `None` when the key is absent.
    pub(crate) fn count(&self, key: &str) -> Result<Option<usize>> {
        match self.get(key) {
            None => Ok(None),
            Some(value) => match value.as_u64().map(usize::try_from) {
                Some(Ok(n)) if n >= 1 => Ok(Some(n)),
                _ => Err(self.wrong_kind(key, "a whole number of at least 1", value)),
            },
        }
    }

    /// Three finite numbers, or `None` when the key is absent.
    pub(crate) fn vector(&self, key: &str) -> Result<Option<[f64; 3]>> {
        let Some(value) = self.get(key) else { return Ok(None) };
        let numbers = value.as_array().filter(|a| a.len() == 3).and_then(|a| {
            let v = [a[0].as_f64()?, a[1].as_f64()?, a[2].as_f64()?];
            v.iter().all(|x| x.is_finite()).then_some(v)
        });
        numbers.map(Some).ok_or_else(|| self.wrong_kind(key, "a list of three numbers [x, y, z]", value))
    }

    /// Three numbers above zero, required.
    pub(crate) fn size(&self, key: &str, hint: &str) -> Result<[f64; 3]> {
        self.require(key, hint)?;
        let size = self.vector(key)?.unwrap_or_default();
        if size.iter().all(|&s| s > 0.0) {
            Ok(size)
        } else {
            Err(self.problem(
                key,
                format!("is {size:?}; every side must be greater than 0"),
                Some("sides are in metres"),
            ))
        }
    }

    /// A number above zero, required.
    pub(crate) fn required_positive(&self, key: &str, hint: &str) -> Result<f64> {
        self.require(key, hint)?;
        Ok(self.positive(key)?.unwrap_or_default())
    }

    fn wrong_kind(&self, key: &str, wanted: &str, found: &Value) -> TwinError {
        self.problem(key, format!("must be {wanted}, found {}", kind(found)), None)
    }
}

/// The valid key spelled most like `key`, unless it is nothing like any of them.
pub(crate) fn nearest(key: &str, valid: &[&str]) -> Option<String> {
    let similarity = |candidate: &str| strsim::jaro_winkler(key, candidate);
    valid
        .iter()
        .max_by(|a, b| similarity(a).total_cmp(&similarity(b)))
        .filter(|best| similarity(best) > 0.7)
        .map(|best| (*best).to_owned())
}

fn kind(value: &Value) -> String {
    match value {
        Value::Null => "null".into(),
        Value::Bool(b) => b.to_string(),
        Value::Number(n) => n.to_string(),
        Value::String(s) => format!("the string \"{s}\""),
        Value::Array(a) => format!("a list of {}", a.len()),
        Value::Object(_) => "an object".into(),
    }
}
