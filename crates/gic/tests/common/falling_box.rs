//! A simulated motion to draw.

use std::fs;

use serde_json::json;
use tempfile::TempDir;

use super::common::gic;

/// A folder with `twin.json` and `frames`: three frames of a box that falls from a height [m] onto a floor.
pub(crate) fn falling_box(height_m: f64) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let twin = json!({
        "schema": "gic.twin/1",
        "material": {"model": "elastic", "youngs_modulus_pa": 1e5, "poisson_ratio": 0.3},
        "initial_velocity_m_s": [0.0, -2.0, 0.0],
        "colliders": [{"shape": "half_space", "normal": [0, 1, 0], "contact": "sticky"}],
        "grid_spacing_m": 0.04,
        "frames": 3,
        "continuum": {"shape": "box", "size_m": [0.12, 0.12, 0.12], "centre_m": [0.0, height_m, 0.0]}
    });
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    fs::write(path("twin.json"), twin.to_string()).unwrap();
    let output = gic(&["simulate", &path("twin.json"), "-o", &path("frames")]);
    assert!(output.status.success(), "{output:?}");
    folder
}
