//! `--set KEY=VALUE`: changes to a twin before it is read.

use std::path::Path;
use std::str::FromStr;

use gic_files::FileError;
use serde_json::{Map, Value};

use super::read::{TOP_KEYS, parameter_names};
use crate::error::{Result, TwinError};

/// One change to a twin: a key, or a path of keys and list positions joined by dots, and its new value.
///
/// A key that is not one of the twin's own, such as `youngs_modulus_pa`, means a parameter of the material.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    /// The path, one entry per level.
    pub path: Vec<String>,
    /// The value: JSON where it parses as such, numbers separated by commas as a list, else a string.
    pub value: Value,
}

/// A text that is no [`Setting`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SettingError {
    /// Nothing is assigned.
    #[error("`{0}` has no `=`; write KEY=VALUE")]
    NoAssignment(String),
    /// The part before `=` is empty, or a level of it is.
    #[error("`{0}` is not a key; write KEY=VALUE, for example youngs_modulus_pa=2e5")]
    NoKey(String),
}

impl FromStr for Setting {
    type Err = SettingError;

    fn from_str(text: &str) -> std::result::Result<Self, SettingError> {
        let (key, value) = text.split_once('=').ok_or_else(|| SettingError::NoAssignment(text.into()))?;
        let mut path: Vec<String> = key.trim().split('.').map(str::to_owned).collect();
        if path.iter().any(String::is_empty) {
            return Err(SettingError::NoKey(key.into()));
        }
        if path.len() == 1 && !TOP_KEYS.contains(&path[0].as_str()) {
            path.insert(0, "material".into());
        }
        Ok(Self { path, value: parse_value(value.trim()) })
    }
}

fn parse_value(text: &str) -> Value {
    let as_json = |t: &str| serde_json::from_str::<Value>(t).ok();
    as_json(text)
        .or_else(|| as_json(&format!("[{text}]")).filter(|list| text.contains(',') && list.is_array()))
        .unwrap_or_else(|| Value::String(text.to_owned()))
}

impl Setting {
    /// Applies the change to the JSON of a twin. Misspelled keys are found later, by the strict reader.
    pub(super) fn apply(&self, file: &Path, root: &mut Value) -> Result<()> {
        let mut here = &mut *root;
        for (depth, key) in self.path.iter().enumerate() {
            let place = self.path[..=depth].join(".");
            let refuse = |problem: &str| {
                TwinError::File(FileError::Field {
                    path: file.to_owned(),
                    field: place.clone(),
                    problem: problem.into(),
                    hint: Some("check the --set options against the twin".into()),
                })
            };
            here = match here {
                Value::Object(map) => map.entry(key.clone()).or_insert_with(|| Value::Object(Map::new())),
                Value::Array(items) => {
                    let len = items.len();
                    key.parse::<usize>()
                        .ok()
                        .and_then(|i| items.get_mut(i))
                        .ok_or_else(|| refuse(&format!("is not in the list, which has {len} entries counted from 0")))?
                }
                _ => return Err(refuse("is inside a value that has no parts")),
            };
        }
        *here = self.value.clone();
        if self.path == ["material", "model"] {
            self.forget_other_laws(root);
        }
        Ok(())
    }

    /// After a change of the law: parameters that it does not have go. Those that it lacks are asked for by the strict
    /// reader.
    fn forget_other_laws(&self, root: &mut Value) {
        let names = self.value.as_str().and_then(parameter_names);
        if let (Some(material), Some(names)) = (root["material"].as_object_mut(), names) {
            material.retain(|key, _| key == "model" || names.contains(&key.as_str()));
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn bare_parameters_belong_to_the_material() {
        let s: Setting = "youngs_modulus_pa=2e5".parse().unwrap();
        assert_eq!(s.path, ["material", "youngs_modulus_pa"]);
        assert_eq!(s.value, json!(2e5));
    }

    #[test]
    fn values_are_json_lists_or_words() {
        let value = |t: &str| t.parse::<Setting>().unwrap().value;
        assert_eq!(value("gravity_m_s2=0,-1.62,0"), json!([0, -1.62, 0]));
        assert_eq!(value("gravity_m_s2=[0,-1.62,0]"), json!([0, -1.62, 0]));
        assert_eq!(value("colliders.0.contact=slip"), json!("slip"));
    }

    #[test]
    fn another_law_keeps_the_parameters_that_it_has() {
        let plasticine =
            json!({"model": "plasticine", "youngs_modulus_pa": 1e5, "poisson_ratio": 0.3, "yield_stress_pa": 1e3});
        let mut twin = json!({ "material": plasticine });
        let set: Setting = "material.model=elastic".parse().unwrap();
        set.apply(Path::new("t.json"), &mut twin).unwrap();
        assert_eq!(twin["material"], json!({"model": "elastic", "youngs_modulus_pa": 1e5, "poisson_ratio": 0.3}));
    }

    #[test]
    fn nested_paths_reach_into_lists() {
        let mut twin = json!({"colliders": [{"contact": "sticky"}]});
        let set: Setting = "colliders.0.contact=slip".parse().unwrap();
        set.apply(Path::new("t.json"), &mut twin).unwrap();
        assert_eq!(twin["colliders"][0]["contact"], "slip");
        let outside: Setting = "colliders.1.contact=slip".parse().unwrap();
        let message = outside.apply(Path::new("t.json"), &mut twin).unwrap_err().to_string();
        assert!(message.contains("colliders.1") && message.contains("1 entries"), "{message}");
    }
}
