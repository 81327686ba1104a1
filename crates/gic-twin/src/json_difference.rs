//! The first difference between two JSON values, for messages about what changed.

use serde_json::Value;

/// The first place where two values differ, and what stands there; `null` where a key is absent.
pub fn first_difference(place: &str, a: &Value, b: &Value) -> Option<(String, Value, Value)> {
    let join = |key: &str| if place.is_empty() { key.to_owned() } else { format!("{place}.{key}") };
    match (a, b) {
        _ if a == b => None,
        (Value::Object(x), Value::Object(y)) => {
            let mut keys = x.keys().chain(y.keys().filter(|k| !x.contains_key(*k)));
            let null = Value::Null;
            keys.find_map(|k| first_difference(&join(k), x.get(k).unwrap_or(&null), y.get(k).unwrap_or(&null)))
        }
        (Value::Array(x), Value::Array(y)) if x.len() == y.len() => {
            x.iter().zip(y).enumerate().find_map(|(i, (x, y))| first_difference(&join(&i.to_string()), x, y))
        }
        _ => Some((place.to_owned(), a.clone(), b.clone())),
    }
}
