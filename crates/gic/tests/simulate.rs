//! `gic simulate` from outside: what a user types, what appears, what a mistake says.

#[path = "common/case.rs"]
mod case;
mod common;

use std::fs;
use std::hash::{Hash, Hasher};
use std::path::Path;
use std::process::{Command, Output};

use serde_json::{Value, json};

use case::Case;
use common::gic;

/// A twin of a small elastic box above a sticky floor, 4 frames.
fn box_twin() -> Value {
    json!({
        "schema": "gic.twin/1",
        "material": {"model": "elastic", "youngs_modulus_pa": 1e5, "poisson_ratio": 0.3},
        "initial_velocity_m_s": [0.2, -2.0, 0.0],
        "colliders": [{"shape": "half_space", "normal": [0, 1, 0], "contact": "sticky"}],
        "grid_spacing_m": 0.04,
        "frames": 4,
        "continuum": {"shape": "box", "size_m": [0.12, 0.12, 0.12], "centre_m": [0, 0.1, 0]}
    })
}

impl Case {
    fn simulate(&self, twin: &Value, out: &str, more: &[&str]) -> Output {
        let (twin, out) = (self.write(twin), self.path(out));
        gic(&[&["simulate", twin.to_str().unwrap(), "-o", out.to_str().unwrap()], more].concat())
    }

    /// Runs a twin that must fail; its message.
    fn refusal(&self, twin: &Value) -> String {
        let output = self.simulate(twin, "out", &[]);
        assert_eq!(output.status.code(), Some(1), "{output:?}");
        String::from_utf8(output.stderr).unwrap()
    }
}

fn assert_says(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "`{part}` is missing in:\n{message}");
    }
}

/// Rows of a binary PLY of floats: names and values.
fn rows(path: &Path) -> (Vec<String>, Vec<Vec<f32>>) {
    let bytes = fs::read(path).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    assert!(header.contains("format binary_little_endian 1.0"), "{header}");
    let names: Vec<String> =
        header.lines().filter_map(|l| l.strip_prefix("property float ")).map(str::to_owned).collect();
    let values: Vec<f32> = bytes[end..].chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
    let rows = values.chunks_exact(names.len()).map(<[f32]>::to_vec).collect();
    (names, rows)
}

/// Names and hashes of the files that a user sees.
fn files(folder: &Path) -> Vec<(String, u64)> {
    let hash = |path: &Path| {
        let mut hasher = std::hash::DefaultHasher::new();
        fs::read(path).unwrap().hash(&mut hasher);
        hasher.finish()
    };
    let mut files: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some())
        .map(|path| (path.file_name().unwrap().to_str().unwrap().to_owned(), hash(&path)))
        .collect();
    files.sort();
    files
}

#[test]
fn a_simulation_over_its_budget_is_refused_before_it_starts() {
    let case = Case::new();
    let refused = |set: &[&str], parts: &[&str]| {
        let output = case.simulate(&box_twin(), "out", set);
        assert_eq!(output.status.code(), Some(1), "{output:?}");
        assert_says(&String::from_utf8(output.stderr).unwrap(), parts);
        assert!(!case.path("out").exists());
    };
    for substeps in ["18446744073709551615", "1000000000"] {
        refused(&["--set", &format!("substeps_per_frame={substeps}")], &["substeps_per_frame", substeps, "200000"]);
    }
    refused(&["--frames", "2000000000"], &["2000000000 frames", "hours", "--budget-hours"]);
    refused(&["--budget-gb", "0.00001"], &["GB", "--budget-gb"]);
    refused(&["--set", "particle_spacing_m=1e-6"], &["particle_spacing_m"]);
}

#[test]
fn a_world_that_the_grid_does_not_see_is_refused_or_doubted() {
    let case = Case::new();
    let with = |key: &str, value: Value| {
        let mut twin = box_twin();
        twin[key] = value;
        twin
    };
    assert_says(&case.refusal(&with("grid_spacing_m", json!(0.5))), &["bodies[0]", "cells", "grid_spacing_m"]);
    let thin = json!([{"shape": "box", "centre_m": [0, -0.1, 0], "size_m": [1, 0.02, 1], "contact": "sticky"}]);
    let output = case.simulate(&with("colliders", thin), "thin", &[]);
    assert!(output.status.success(), "{output:?}");
    assert_says(&String::from_utf8(output.stderr).unwrap(), &["warning", "colliders[0]", "cells thick"]);
    let jump = json!([{"shape": "half_space", "normal": [1, 0, 0], "point_m": [-1, 0, 0], "contact": "sticky",
        "keyframes": [{"time_s": 0, "position_m": [-1, 0, 0]}, {"time_s": 1e-9, "position_m": [1, 0, 0]}]}]);
    assert_says(&case.refusal(&with("colliders", jump)), &["colliders[0]", "m/s", "keyframes"]);
}

#[test]
fn writes_every_frame_from_the_initial_state() {
    let case = Case::new();
    let output = case.simulate(&box_twin(), "out", &[]);
    assert!(output.status.success(), "{output:?}");
    let (names, first) = rows(&case.path("out/particles_0000.ply"));
    assert_eq!(names, ["x", "y", "z", "vx", "vy", "vz", "von_mises_pa", "J"]);
    assert_eq!(first.len(), 6 * 6 * 6);
    for row in &first {
        assert_eq!(row[3..], [0.2, -2.0, 0.0, 0.0, 1.0], "the initial state moves rigidly and is undeformed");
    }
    let (_, last) = rows(&case.path("out/particles_0003.ply"));
    assert!(last.iter().flatten().all(|v| v.is_finite()));
    assert!(last.iter().any(|row| row[6] > 100.0), "the impact leaves stress");
    assert!(!case.path("out/particles_0004.ply").exists());
    let trajectory: Value = serde_json::from_slice(&fs::read(case.path("out/trajectory.json")).unwrap()).unwrap();
    assert_eq!(trajectory["frames"].as_array().unwrap().len(), 4);
    assert_eq!(trajectory["frames"][3]["file"], "particles_0003.ply");
    let forces: Vec<f64> =
        (0..4).map(|i| trajectory["frames"][i]["contact_forces_n"][0][1].as_f64().unwrap()).collect();
    assert!(forces[0] == 0.0 && forces.iter().any(|force| *force != 0.0), "the floor was hit: {forces:?}");
}

#[test]
fn free_flight_follows_gravity() {
    let case = Case::new();
    let mut twin = box_twin();
    twin["colliders"] = json!([]);
    assert!(case.simulate(&twin, "out", &[]).status.success());
    let trajectory: Value = serde_json::from_slice(&fs::read(case.path("out/trajectory.json")).unwrap()).unwrap();
    let t = 3.0 / 24.0;
    let height = trajectory["frames"][3]["centre_of_mass_m"][1].as_f64().unwrap();
    let substeps = trajectory["frames"][3]["substeps"].as_f64().unwrap();
    // Symplectic Euler falls half a substep's worth of speed too far.
    let expected = 0.1 - 2.0 * t - 4.9 * t * (t + 1.0 / 24.0 / substeps);
    assert!((height - expected).abs() < 1e-4, "{height} against {expected}");
}

#[test]
fn particles_from_a_ply_keep_number_and_order() {
    let case = Case::new();
    let positions: Vec<[f32; 3]> = (0..50).map(|i| [0.01 * (i * 7 % 50) as f32, 0.5, 0.02 * (i % 3) as f32]).collect();
    let mut ply = format!("ply\nformat ascii 1.0\nelement vertex {}\n", positions.len());
    ply += "property float x\nproperty float y\nproperty float z\nend_header\n";
    for [x, y, z] in &positions {
        ply += &format!("{x} {y} {z}\n");
    }
    fs::write(case.path("matter.ply"), ply).unwrap();
    let mut twin = box_twin();
    twin["continuum"] = json!("matter.ply");
    assert!(case.simulate(&twin, "out", &["--frames", "1"]).status.success());
    let (_, written) = rows(&case.path("out/particles_0000.ply"));
    assert_eq!(written.iter().map(|r| [r[0], r[1], r[2]]).collect::<Vec<_>>(), positions);
}

#[test]
fn a_mesh_is_filled() {
    let case = Case::new();
    let corner = |i: usize| [i & 1, i >> 1 & 1, i >> 2 & 1].map(|bit| 0.1 * bit as f64 + 0.2);
    let mut obj: String = (0..8).map(corner).map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
    for face in [[1, 3, 4, 2], [5, 6, 8, 7], [1, 2, 6, 5], [3, 7, 8, 4], [1, 5, 7, 3], [2, 4, 8, 6]] {
        obj += &format!("f {} {} {} {}\n", face[0], face[1], face[2], face[3]);
    }
    fs::write(case.path("cube.obj"), obj).unwrap();
    let mut twin = box_twin();
    twin["continuum"] = json!("cube.obj");
    assert!(case.simulate(&twin, "out", &["--frames", "1", "--set", "particle_spacing_m=0.01"]).status.success());
    assert_eq!(rows(&case.path("out/particles_0000.ply")).1.len(), 1000);
}

#[test]
fn going_on_gives_the_bytes_of_an_uninterrupted_run() {
    let case = Case::new();
    assert!(case.simulate(&box_twin(), "whole", &["--frames", "6"]).status.success());
    assert!(case.simulate(&box_twin(), "parts", &["--frames", "3"]).status.success());
    let kept = fs::metadata(case.path("parts/particles_0001.ply")).unwrap().modified().unwrap();
    assert!(case.simulate(&box_twin(), "parts", &["--frames", "6"]).status.success());
    assert_eq!(files(&case.path("whole")), files(&case.path("parts")));
    let after = fs::metadata(case.path("parts/particles_0001.ply")).unwrap().modified().unwrap();
    assert_eq!(kept, after, "frames that were there are not computed again");
}

#[test]
fn the_thread_count_does_not_change_a_byte() {
    let case = Case::new();
    assert!(case.simulate(&box_twin(), "one", &["--threads", "1"]).status.success());
    assert!(case.simulate(&box_twin(), "three", &["--threads", "3"]).status.success());
    assert_eq!(files(&case.path("one")), files(&case.path("three")));
}

#[test]
fn a_folder_of_another_twin_is_not_overwritten() {
    let case = Case::new();
    assert!(case.simulate(&box_twin(), "out", &["--frames", "2"]).status.success());
    let before = files(&case.path("out"));
    let output = case.simulate(&box_twin(), "out", &["--set", "youngs_modulus_pa=2e5"]);
    assert_eq!(output.status.code(), Some(1));
    let message = String::from_utf8(output.stderr).unwrap();
    assert_says(&message, &["`material.youngs_modulus_pa` was 100000.0 and is now 200000.0", "--restart"]);
    assert_eq!(before, files(&case.path("out")));
    let output = case.simulate(&box_twin(), "out", &["--set", "youngs_modulus_pa=2e5", "--restart"]);
    assert!(output.status.success(), "{output:?}");
    assert_ne!(before, files(&case.path("out")));
}

#[cfg(unix)]
#[test]
fn ctrl_c_finishes_the_frame_and_says_how_to_go_on() {
    use std::io::Read;
    use std::process::Stdio;
    let case = Case::new();
    let (twin, out) = (case.write(&box_twin()), case.path("out"));
    let args = ["simulate", twin.to_str().unwrap(), "-o", out.to_str().unwrap(), "--frames", "100000"];
    let mut child = Command::new(env!("CARGO_BIN_EXE_gic")).args(args).stderr(Stdio::piped()).spawn().unwrap();
    while !out.join("particles_0002.ply").exists() {
        assert!(child.try_wait().unwrap().is_none(), "the simulation ended by itself");
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let code = child.wait().unwrap().code();
    let mut message = String::new();
    child.stderr.take().unwrap().read_to_string(&mut message).unwrap();
    assert_eq!(code, Some(130), "{message}");
    assert_says(&message, &["interrupted after", "run the same command again to go on with frame"]);
    let trajectory: Value = serde_json::from_slice(&fs::read(out.join("trajectory.json")).unwrap()).unwrap();
    let done = trajectory["frames"].as_array().unwrap().len();
    // What it left is a whole number of frames, the same as without the interruption.
    assert!(case.simulate(&box_twin(), "whole", &["--frames", &done.to_string()]).status.success());
    assert_eq!(files(&out), files(&case.path("whole")));
}

#[test]
fn a_truncated_ply_is_refused() {
    let case = Case::new();
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 3\n\
                  property float x\nproperty float y\nproperty float z\nend_header\n";
    fs::write(case.path("cut.ply"), [header.as_bytes(), &[0; 30]].concat()).unwrap();
    let mut twin = box_twin();
    twin["continuum"] = json!("cut.ply");
    assert_says(&case.refusal(&twin), &["cut.ply", "truncated", "promises 3 vertices", "hint:"]);
}

#[test]
fn positions_that_are_not_numbers_are_refused() {
    let case = Case::new();
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 2\n\
                  property float x\nproperty float y\nproperty float z\nend_header\n";
    let numbers = [0.0f32, 1.0, 0.0, 0.0, f32::NAN, 0.0].map(f32::to_le_bytes).concat();
    fs::write(case.path("nan.ply"), [header.as_bytes(), &numbers].concat()).unwrap();
    let mut twin = box_twin();
    twin["continuum"] = json!("nan.ply");
    assert_says(&case.refusal(&twin), &["nan.ply", "vertex 1", "not finite"]);
}

#[test]
fn a_file_without_particles_is_refused() {
    let case = Case::new();
    let header =
        "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    fs::write(case.path("none.ply"), header).unwrap();
    let mut twin = box_twin();
    twin["continuum"] = json!("none.ply");
    assert_says(&case.refusal(&twin), &["none.ply", "holds no particles"]);
}

#[test]
fn an_open_mesh_is_refused() {
    let case = Case::new();
    fs::write(case.path("open.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\n").unwrap();
    let mut twin = box_twin();
    twin["continuum"] = json!("open.obj");
    assert_says(&case.refusal(&twin), &["open.obj", "not watertight: 3 edges", "hint:"]);
}

#[test]
fn wrong_values_are_named_with_file_and_field() {
    let case = Case::new();
    let wrong: [(&str, Value, &[&str]); 10] = [
        ("/density_kg_m3", json!(-5), &["`density_kg_m3` is -5", "greater than 0"]),
        ("/material/poisson_ratio", json!(0.5), &["`material.poisson_ratio` is 0.5", "0.49"]),
        ("/material/youngs_modulus_pa", json!("hard"), &["`material.youngs_modulus_pa` must be a number", "\"hard\""]),
        ("/material/model", json!("elasitc"), &["`material.model`", "did you mean \"elastic\""]),
        ("/schema", json!("gic.twin/9"), &["`schema` is \"gic.twin/9\""]),
        ("/frames", json!(0), &["`frames` must be a whole number of at least 1"]),
        ("/gravity_m_s2", json!([0, -9.8]), &["`gravity_m_s2` must be a list of three numbers"]),
        ("/colliders/0/normal", json!([0, 0, 0]), &["`colliders[0].normal` has no direction"]),
        ("/colliders/0/contact", json!("glue"), &["`colliders[0].contact`", "sticky, slip, separating"]),
        ("/continuum", json!("gone.ply"), &["cannot read", "gone.ply", "relative to the twin's own folder"]),
    ];
    for (pointer, value, parts) in wrong {
        let mut twin = box_twin();
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        twin.pointer_mut(parent).unwrap()[key] = value;
        assert_says(&case.refusal(&twin), parts);
    }
}

#[test]
fn unknown_keys_are_named_with_the_nearest_valid_one() {
    let case = Case::new();
    let mut twin = box_twin();
    twin["gravity"] = json!([0, -9.8, 0]);
    assert_says(&case.refusal(&twin), &["twin.json", "unknown key `gravity`", "did you mean `gravity_m_s2`?"]);
    let mut twin = box_twin();
    twin["material"]["youngs_modulus"] = json!(1e5);
    assert_says(&case.refusal(&twin), &["unknown key `material.youngs_modulus`", "did you mean `youngs_modulus_pa`?"]);
    let mut twin = box_twin();
    twin["colliders"][0]["fricton"] = json!(0.5);
    assert_says(&case.refusal(&twin), &["unknown key `colliders[0].fricton`", "did you mean `friction`?"]);
}

#[test]
fn a_misspelled_setting_is_named() {
    let case = Case::new();
    let output = case.simulate(&box_twin(), "out", &["--set", "young_modulus_pa=1e5"]);
    assert_eq!(output.status.code(), Some(1));
    let message = String::from_utf8(output.stderr).unwrap();
    assert_says(&message, &["`material.young_modulus_pa`", "did you mean `youngs_modulus_pa`?"]);
}

#[test]
fn particles_inside_a_collider_are_refused() {
    let case = Case::new();
    let mut twin = box_twin();
    twin["continuum"]["centre_m"] = json!([0, -0.2, 0]);
    assert_says(&case.refusal(&twin), &["particle 0", "inside colliders[0]", "hint:"]);
}

#[test]
fn a_spacing_that_nothing_fits_is_refused() {
    let case = Case::new();
    let mut twin = box_twin();
    twin["continuum"] =
        json!({"shape": "torus", "major_radius_m": 0.1, "minor_radius_m": 0.001, "centre_m": [0, 0.3, 0]});
    twin["particle_spacing_m"] = json!(0.1);
    assert_says(&case.refusal(&twin), &["no particle fits", "particle_spacing_m"]);
    twin["particle_spacing_m"] = json!(1e-9);
    assert_says(&case.refusal(&twin), &["asks for about", "raise `particle_spacing_m`"]);
}

#[test]
fn an_unwritable_output_is_refused() {
    let case = Case::new();
    fs::write(case.path("out"), "a file, not a folder").unwrap();
    assert_says(&case.refusal(&box_twin()), &["cannot write", "out", "hint:"]);
}

#[test]
fn damaged_json_is_refused_with_its_line() {
    let case = Case::new();
    fs::write(case.path("twin.json"), "{\n  \"schema\": \"gic.twin/1\",\n  oops\n}").unwrap();
    let output = gic(&["simulate", case.path("twin.json").to_str().unwrap(), "-o", case.path("out").to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(1));
    assert_says(&String::from_utf8(output.stderr).unwrap(), &["twin.json is not valid JSON", "line 3"]);
}

#[test]
fn usage_errors_and_help_have_their_exit_codes() {
    assert_eq!(gic(&["simulate"]).status.code(), Some(2));
    assert_eq!(gic(&["simulate", "t.json", "-o", "d", "--frames", "0"]).status.code(), Some(2));
    assert_eq!(gic(&["fly"]).status.code(), Some(2));
    let help = gic(&["--help"]);
    assert_eq!(help.status.code(), Some(0));
    assert_says(&String::from_utf8(help.stdout).unwrap(), &["simulate", "Exit codes", "130"]);
}

#[test]
fn every_shell_gets_a_completion_script() {
    for shell in ["bash", "zsh", "fish"] {
        let output = gic(&["completions", shell]);
        assert!(output.status.success());
        assert_says(&String::from_utf8(output.stdout).unwrap(), &["simulate"]);
    }
}

#[test]
fn the_examples_start() {
    let examples = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples");
    let mut found = 0;
    for entry in fs::read_dir(examples).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "json") {
            let out = tempfile::tempdir().unwrap();
            let output =
                gic(&["-q", "simulate", path.to_str().unwrap(), "-o", out.path().to_str().unwrap(), "--frames", "3"]);
            assert!(output.status.success(), "{}: {output:?}", path.display());
            found += 1;
        }
    }
    assert!(found >= 5, "one example per material");
}

#[test]
fn gradients_agree_with_finite_differences() {
    let output = gic(&["gradcheck"]);
    let table = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{table}");
    assert_says(
        &table,
        &["youngs_modulus_pa", "friction_angle_deg", "viscosity_pa_s", "plastic_viscosity_pa_s", "derivatives agree"],
    );
}

/// Two boxes of different materials in free fall, one faster than the other: they meet in the air.
#[test]
fn twins_in_one_world_exchange_momentum_and_keep_its_sum() {
    let case = Case::new();
    let mut twin = box_twin();
    twin["continuum"]["centre_m"] = json!([0, 0.5, 0]);
    twin["initial_velocity_m_s"] = json!([0.0, 0.0, 0.0]);
    let other = json!({
        "schema": "gic.twin/1",
        "material": {"model": "plasticine", "youngs_modulus_pa": 2e5, "poisson_ratio": 0.3, "yield_stress_pa": 2e3},
        "density_kg_m3": 2000.0,
        "initial_velocity_m_s": [0.0, -2.0, 0.0],
        "grid_spacing_m": 0.04,
        "continuum": {"shape": "box", "size_m": [0.12, 0.12, 0.12]}
    });
    let file = case.path("other.json");
    fs::write(&file, other.to_string()).unwrap();
    let with = format!("{}@0.03,0.68,0", file.display());
    let output = case.simulate(&twin, "out", &["--with", &with, "--frames", "4"]);
    assert!(output.status.success(), "{output:?}");
    let trajectory: Value = serde_json::from_slice(&fs::read(case.path("out/trajectory.json")).unwrap()).unwrap();
    let frames = trajectory["frames"].as_array().unwrap();
    let momentum = |frame: &Value| frame["momentum_kg_m_s"][1].as_f64().unwrap();
    // 0.12^3 m^3 of 1000 and of 2000 kg/m^3.
    let mass = 3.0 * 1.728;
    for frame in frames {
        let expected = momentum(&frames[0]) - 9.8 * mass * frame["time_s"].as_f64().unwrap();
        assert!((momentum(frame) / expected - 1.0).abs() < 1e-4, "{} against {expected}", momentum(frame));
    }
    // They have met: the lower one is faster than free fall.
    let counts: Vec<usize> = serde_json::from_value(trajectory["bodies"].clone()).unwrap();
    let (names, particles) = rows(&case.path("out/particles_0003.ply"));
    let vy = names.iter().position(|n| n == "vy").unwrap();
    let mean = particles[..counts[0]].iter().map(|row| row[vy]).sum::<f32>() / counts[0] as f32;
    assert!(mean < -9.8 * 3.0 / 24.0 - 0.3, "{mean}");
}

#[test]
fn another_law_gravity_and_obstacles_come_by_flags() {
    let case = Case::new();
    let obstacles = case.path("press.toml");
    let text = "[[colliders]]\nshape = \"sphere\"\ncentre_m = [0.0, -1.0, 0.0]\nradius_m = 0.1\ncontact = \"slip\"\n";
    fs::write(&obstacles, text).unwrap();
    let flags = ["--material", "newtonian", "--gravity", "0,-1.6,0", "--velocity", "0,0,0", "--frames", "2"];
    let missing = case.simulate(&box_twin(), "out", &flags);
    assert_says(&String::from_utf8_lossy(&missing.stderr), &["material.viscosity_pa_s", "is missing"]);
    let all = [&flags[..], &["--set", "viscosity_pa_s=50", "--set", "bulk_modulus_pa=1e5"]].concat();
    let all = [&all[..], &["--colliders", obstacles.to_str().unwrap()]].concat();
    let output = case.simulate(&box_twin(), "out", &all);
    assert!(output.status.success(), "{output:?}");
    let trajectory: Value = serde_json::from_slice(&fs::read(case.path("out/trajectory.json")).unwrap()).unwrap();
    assert_eq!(trajectory["twin"]["material"]["model"], "newtonian");
    assert_eq!(trajectory["twin"]["gravity_m_s2"], json!([0.0, -1.6, 0.0]));
    assert_eq!(trajectory["colliders"][1], "colliders[1] (sphere)");
}
