//! `gic bench`: tasks, their records and tables; what runs for long or needs a cluster is in scripts/check_engines.py.
#![cfg(unix)]

mod common;

use std::fs;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use common::gic;
use serde_json::Value;
use tempfile::TempDir;

/// The bundled scene.
const DEMO: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/demo");
/// Arguments with which a run ends within seconds, because it has not learned enough.
const SHORT: [&str; 5] = ["--steps", "1", "--cameras", "0,4,6", "--no-appearance"];

/// A folder with a suite of two scenes, which are the same.
fn suite() -> (TempDir, String, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let scenes = folder.path().join("suite");
    fs::create_dir(&scenes).unwrap();
    ["cat_0", "cat_1"].iter().for_each(|name| symlink(DEMO, scenes.join(name)).unwrap());
    let out = folder.path().join("out");
    (folder, scenes.to_str().unwrap().into(), out)
}

fn bench(suite: &str, out: &Path, flags: &[&str], arguments: &[&str]) -> Output {
    let words = [&["bench", suite, "-o", out.to_str().unwrap()], flags, &["--threads", "1", "--"], arguments].concat();
    gic(&words)
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn json(path: PathBuf) -> Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

#[test]
fn failures_are_named_and_tables_are_made_of_what_is_there() {
    let (_folder, suite, out) = suite();
    let ended = bench(&suite, &out, &["--jobs", "2"], &SHORT);
    assert!(ended.status.success(), "{ended:?}");
    assert!(text(&ended.stdout).contains("0 of 2 tasks have a result"), "{ended:?}");
    let results = json(out.join("results.json"));
    assert!(results["scenes"][0]["Err"].as_str().unwrap().contains("filling failed"), "{results}");
    for file in ["results.md", "results.csv", "costs.json", "suite.html", "cat_1/messages.txt", "cat_1/result.json"] {
        assert!(out.join(file).is_file(), "{file} is missing");
    }
    let page = fs::read_to_string(out.join("suite.html")).unwrap();
    assert!(page.contains("2 without a result") && page.contains("data:image/jpeg;base64,"), "{page}");
    assert!(!page.contains("http://") && !page.contains("{{"), "the page needs no network and is filled in");
    fs::remove_file(out.join("cat_0/result.json")).unwrap();
    let collected = gic(&["bench", "--collect", out.to_str().unwrap()]);
    assert!(collected.status.success(), "{collected:?}");
    assert!(text(&collected.stderr).contains("cat_0: has not ended, or was killed"), "{collected:?}");
}

#[test]
fn a_forecast_starts_nothing_and_sweeps_have_a_folder_for_each_case() {
    let (_folder, suite, out) = suite();
    let flags = ["--forecast", "--matrix", "identify.target=masks,surfaces", "--cameras", "0,4,6;all", "--repeat", "2"];
    let told = bench(&suite, &out, &flags, &[]);
    assert!(text(&told.stdout).contains("16 tasks to run, 0 finished"), "{told:?}");
    assert!(text(&told.stdout).contains("By rule"), "{told:?}");
    let tasks = json(out.join("suite.json"))["tasks"].as_array().unwrap().clone();
    assert_eq!(tasks.len(), 16);
    assert_eq!(tasks[0]["folder"], "cat_0/identify.target=masks+cameras=0,4,6+seed=0");
    assert!(!out.join("cat_0").exists());
}

#[test]
fn settings_and_flags_are_checked_before_any_work() {
    let (_folder, suite, out) = suite();
    for (flags, arguments, problem) in [
        (vec!["--partition", "long"], vec![], "--partition is for --on slurm"),
        (vec!["--matrix", "fill.levelz=3,4"], vec![], "levelz"),
        (vec![], vec!["--steps", "many"], "--steps"),
        (vec![], vec!["--cameras", "0,99"], "99"),
    ] {
        let refused = bench(&suite, &out, &flags, &arguments);
        assert!(!refused.status.success() && text(&refused.stderr).contains(problem), "{refused:?}");
        assert!(!out.exists(), "{problem}");
    }
    let refused = bench(&suite, &out, &["--wait"], &[]);
    assert!(refused.status.code() == Some(2) && text(&refused.stderr).contains("hint: leave it out"), "{refused:?}");
}

/// Slurm's and Python's places are taken by scripts that do what is looked at here.
#[test]
fn engines_get_scripts_and_orders_with_the_tasks_that_are_not_finished() {
    let (folder, suite, out) = suite();
    let bin = folder.path().join("bin");
    fs::create_dir(&bin).unwrap();
    let script = |name: &str, body: &str| {
        fs::write(bin.join(name), format!("#!/bin/sh\n{body}\n")).unwrap();
        fs::set_permissions(bin.join(name), fs::Permissions::from_mode(0o755)).unwrap();
    };
    script("sbatch", "echo 17");
    script("python3", &format!("cat > {}/order.json", bin.display()));
    let path = format!("{}:{}", bin.display(), std::env::var("PATH").unwrap());
    let start = |flags: &[&str]| {
        let out = out.to_str().unwrap();
        let words = [&["bench", &suite, "-o", out, "--threads", "3"], flags].concat();
        Command::new(env!("CARGO_BIN_EXE_gic")).args(words).env("PATH", &path).output().unwrap()
    };
    let submitted = start(&["--on", "slurm", "--partition", "long", "--filter", "cat_1"]);
    assert!(text(&submitted.stdout).contains("--collect"), "{submitted:?}");
    let batch = fs::read_to_string(out.join("bench.sbatch")).unwrap();
    assert!(batch.contains("#SBATCH --array=0-0") && batch.contains("'cat_1'"), "{batch}");
    assert!(batch.contains("--partition=long") && batch.contains("--cpus-per-task=3"), "{batch}");
    let ended = start(&["--on", "ray", "--memory-gb", "2"]);
    assert!(ended.status.success(), "{ended:?}");
    let order = json(bin.join("order.json"));
    assert_eq!(order["tasks"], serde_json::json!(["cat_0", "cat_1"]));
    assert_eq!((&order["engine"], &order["threads"], &order["memory_gb"]), (&"ray".into(), &3.into(), &2.0.into()));
}

/// The bundled scene in `folder`, its last picture standing still until there are `frames` frames.
fn lengthened(folder: &Path, frames: usize) {
    fs::create_dir_all(folder.join("data")).unwrap();
    symlink(Path::new(DEMO).join("gt"), folder.join("gt")).unwrap();
    for entry in fs::read_dir(Path::new(DEMO).join("data")).unwrap().map(Result::unwrap) {
        symlink(entry.path(), folder.join("data").join(entry.file_name())).unwrap();
    }
    let mut entries = json(Path::new(DEMO).join("all_data.json"));
    let is_last = |entry: &&Value| entry["file_path"].as_str().unwrap().ends_with("_10.png");
    let last: Vec<Value> = entries.as_array().unwrap().iter().filter(is_last).cloned().collect();
    for (frame, last) in (11..frames).flat_map(|frame| last.iter().map(move |last| (frame, last))) {
        let file = last["file_path"].as_str().unwrap();
        let (same, new) = (file.to_owned(), file.replace("_10.", &format!("_{frame}.")));
        for kind in ["r_", "a_"] {
            let [same, new] = [&same, &new].map(|file| file.replace("r_", kind));
            symlink(Path::new(DEMO).join(same), folder.join(new)).unwrap();
        }
        let mut entry = last.clone();
        (entry["file_path"], entry["time"]) = (new.into(), (frame as f64 / 24.0).into());
        entries.as_array_mut().unwrap().push(entry);
    }
    fs::write(folder.join("all_data.json"), entries.to_string()).unwrap();
}

#[test]
fn suites_are_written_for_the_code_of_other_methods() {
    let folder = tempfile::tempdir().unwrap();
    let (suite, out) = (folder.path().join("suite"), folder.path().join("export"));
    fs::create_dir(&suite).unwrap();
    symlink(DEMO, suite.join("short_0")).unwrap();
    lengthened(&suite.join("cat_0"), 14);
    let export = |scene: &str| {
        let words = ["bench", suite.to_str().unwrap(), "-o", out.to_str().unwrap(), "--export-suite", "projo4d"];
        gic(&[&words[..], &["--cameras", "4", "--filter", scene]].concat())
    };
    let refused = export("short_0");
    assert!(text(&refused.stderr).contains("has 11 frames, and ProJo4D asks for 14"), "{refused:?}");
    let written = export("cat_0");
    assert!(written.status.success(), "{written:?}");
    let scene = out.join("data/pacnerf/elastic/cat_0");
    let entries = json(scene.join("all_data.json"));
    assert_eq!(entries.as_array().unwrap().len(), 14);
    assert_eq!(entries[1]["file_path"], "./data/r_0_1.png");
    let picture = image::open(scene.join("data/m_0_1.png")).unwrap();
    assert_eq!(picture.color(), image::ColorType::Rgb8);
    let pixels = picture.into_rgb8();
    let white = pixels.pixels().filter(|pixel| pixel.0 == [255; 3]).count();
    assert_eq!(pixels.get_pixel(0, 0).0, [255; 3]);
    assert!(white > pixels.len() / 6 && white < pixels.len() / 3 - 500, "{white}");
    assert!(json(out.join("data/pacnerf/elastic.json"))["cat_0"]["E"].as_f64().unwrap() > 0.0);
    assert!(out.join("simulation_data/elastic/cat_0/000.ply").is_file());
    let script = fs::read_to_string(out.join("run.sh")).unwrap();
    assert!(script.contains("run 'cat_0' 'data/pacnerf/elastic/cat_0' python train_projo4d.py"), "{script}");
    assert!(Command::new("sh").args(["-n", out.join("run.sh").to_str().unwrap()]).status().unwrap().success());
}
