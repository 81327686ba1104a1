//! `gic export` from outside: runs aside, what it takes and what it refuses.

#[path = "common/case.rs"]
mod case;
mod common;

use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use case::Case;
use common::gic;

/// A small box above a floor, 3 frames.
fn box_twin(material: &Value) -> Value {
    json!({
        "schema": "gic.twin/1",
        "material": material,
        "initial_velocity_m_s": [0.2, -2.0, 0.0],
        "colliders": [{"shape": "half_space", "normal": [0, 1, 0], "contact": "sticky"}],
        "grid_spacing_m": 0.04,
        "frames": 3,
        "continuum": {"shape": "box", "size_m": [0.12, 0.12, 0.12], "centre_m": [0, 0.1, 0]}
    })
}

fn elastic() -> Value {
    json!({"model": "elastic", "youngs_modulus_pa": 1e5, "poisson_ratio": 0.3})
}

fn export(from: &Path, format: &str, to: &Path, more: &[&str]) -> Result<String, String> {
    let words = ["export", from.to_str().unwrap(), "--format", format, "-o", to.to_str().unwrap()];
    let output = gic(&[&words, more].concat());
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    if output.status.success() { Ok(text(output.stdout)) } else { Err(text(output.stderr)) }
}

#[test]
fn every_format_of_a_twin_states_one_mass() {
    let case = Case::new();
    let twin = case.write(&box_twin(&elastic()));
    for (format, file) in [
        ("ply", "p.ply"),
        ("surface-ply", "s.ply"),
        ("obj", "s.obj"),
        ("stl", "s.stl"),
        ("glb", "t.glb"),
        ("msh", "t.msh"),
        ("mjcf", "t.xml"),
        ("usd", "t.usda"),
        ("particle-usd", "p.usda"),
        ("particles", "t.npz"),
    ] {
        let said = export(&twin, format, &case.path(file), &[]).unwrap();
        assert!(said.contains("of 1.7280 kg"), "{format}: {said}");
        assert!(fs::metadata(case.path(file)).unwrap().len() > 100, "{format}");
    }
    for beside in ["t.genesis.py", "t.particles.json"] {
        assert!(case.path(beside).is_file(), "{beside}");
    }
}

#[test]
fn a_simulated_folder_moves_and_a_twin_alone_does_not() {
    let case = Case::new();
    let twin = case.write(&box_twin(&elastic()));
    let simulated = case.path("simulated");
    assert!(gic(&["simulate", twin.to_str().unwrap(), "-o", simulated.to_str().unwrap()]).status.success());
    let stage = |from: &Path, more: &[&str]| {
        export(from, "particle-usd", &case.path("a.usda"), more).unwrap();
        fs::read_to_string(case.path("a.usda")).unwrap()
    };
    assert!(!stage(&twin, &[]).contains("timeSamples"));
    let moving = stage(&simulated, &[]);
    assert!(moving.contains("timeSamples") && moving.contains("endTimeCode = 2") && moving.contains("upAxis = \"Y\""));
    let turned = stage(&simulated, &["--up", "z"]);
    assert!(turned.contains("upAxis = \"Z\"") && turned.contains("physics:gravityDirection = (0, 0, -1)"), "{turned}");
    // Nothing has colours here.
    let message = export(&simulated, "gaussian-usd", &case.path("g.usda"), &[]).unwrap_err();
    assert!(message.contains("no colours") && message.contains("gic run"), "{message}");
    // A frame of the simulation is not written over.
    let message = export(&simulated, "ply", &simulated.join("particles_0001.ply"), &[]).unwrap_err();
    assert!(message.contains("particles_0001.ply is a frame of a simulation"), "{message}");
    let message = export(&twin, "ply", &twin, &[]).unwrap_err();
    assert!(message.contains("is an input"), "{message}");
}

#[test]
fn two_bodies_are_refused_and_plasticity_is_not_lost_in_silence() {
    let case = Case::new();
    let clay = json!({"model": "plasticine", "youngs_modulus_pa": 1e5, "poisson_ratio": 0.3, "yield_stress_pa": 1e3});
    let twin = case.write(&box_twin(&clay));
    let path = twin.to_str().unwrap();
    let message = export(&twin, "mjcf", &case.path("t.xml"), &[]).unwrap_err();
    assert!(message.contains("plasticine") && message.contains("--approximate"), "{message}");
    export(&twin, "mjcf", &case.path("t.xml"), &["--approximate"]).unwrap();
    export(&twin, "usd", &case.path("t.usda"), &[]).unwrap();
    let message = export(&twin, "glb", &case.path("t.glb"), &["--up", "z"]).unwrap_err();
    assert!(message.contains("glTF has y up"), "{message}");
    let pair = case.path("pair");
    let with = format!("{path}@0,0.3,0");
    let simulated = gic(&["simulate", path, "-o", pair.to_str().unwrap(), "--with", &with]);
    assert!(simulated.status.success(), "{simulated:?}");
    let message = export(&pair, "usd", &case.path("p.usda"), &[]).unwrap_err();
    assert!(message.contains("holds 2 bodies") && message.contains("simulate each twin"), "{message}");
    let message = export(&case.path("nothing"), "usd", &case.path("n.usda"), &[]).unwrap_err();
    assert!(message.contains("nothing"), "{message}");
}
