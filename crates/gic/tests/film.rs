//! The bundled film: what a user has before anything was done to it.

mod common;

use std::path::Path;

/// The ball's delays as its makers measured them, in frames after the first camera.
const DELAYS: [f64; 4] = [0.0, 0.094, -0.151, -0.394];

#[test]
fn inspect_tells_that_the_cameras_of_the_bundled_film_lag() {
    let film = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/film_ball");
    let out = common::gic(&["inspect", film.to_str().expect("a path"), "--json"]);
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let report: serde_json::Value = serde_json::from_slice(&out.stdout).expect("JSON");
    let flight = &report["flight"];
    let delays: Vec<f64> = serde_json::from_value(flight["delays_frames"].clone()).expect("delays");
    assert_eq!(delays.len(), DELAYS.len());
    assert!(delays.iter().zip(DELAYS).all(|(found, measured)| (found - measured).abs() < 0.1), "{delays:?}");
    assert_eq!(flight["calibration_errors"], serde_json::json!([]), "the cameras were calibrated");
    let unit = report["fall"]["unit_m"].as_f64().expect("a fall");
    assert!((unit - 1.0).abs() < 0.02, "lengths are metres: {unit}");
}
