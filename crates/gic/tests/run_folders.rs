//! Run folders under attack: moved, damaged, foreign, written by two at once.

mod common;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use common::gic;
use tempfile::TempDir;

fn demo() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("demo")
}

fn path(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A folder with the bundled scene in `scene`, and in `run` its reconstruction, far from converged.
fn reconstructed() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    copy(&demo(), &folder.path().join("scene"));
    let output = reconstruct(&folder.path().join("scene"), &folder.path().join("run"));
    assert!(output.status.success(), "{output:?}");
    folder
}

fn reconstruct(scene: &Path, run: &Path) -> Output {
    let few = ["--cameras", "0,4,6", "--fit-frames", "2", "--steps", "2"];
    gic(&[&["reconstruct", path(scene), "-o", path(run)], &few[..]].concat())
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let (source, target) = (entry.as_ref().unwrap().path(), to.join(entry.unwrap().file_name()));
        if source.is_dir() { copy(&source, &target) } else { fs::copy(source, target).map(drop).unwrap() }
    }
}

/// What a command that must fail says.
fn refusal(output: &Output) -> String {
    let message = String::from_utf8(output.stderr.clone()).unwrap();
    assert_eq!(output.status.code(), Some(1), "{message}");
    message
}

#[track_caller]
fn assert_says(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "`{part}` is missing in:\n{message}");
    }
}

fn message(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

#[test]
fn a_run_and_its_scene_can_be_moved() {
    let folder = reconstructed();
    let [run, scene] = ["moved/run", "moved/scene"].map(|name| folder.path().join(name));
    fs::create_dir(folder.path().join("moved")).unwrap();
    fs::rename(folder.path().join("run"), &run).unwrap();
    fs::rename(folder.path().join("scene"), &scene).unwrap();
    assert_says(&refusal(&gic(&["register", path(&run)])), &["scene", "--scene"]);
    // Found again, the scene is remembered.
    assert_says(&refusal(&gic(&["register", path(&run), "--scene", path(&scene)])), &["nothing to register"]);
    assert_says(&refusal(&gic(&["register", path(&run)])), &["nothing to register"]);
    assert_says(&message(&reconstruct(&scene, &run)), &["reconstruct: up to date"]);
    // Another scene at that place is not taken for the run's own.
    fs::copy(scene.join("data/r_0_0.png"), scene.join("data/r_0_1.png")).unwrap();
    assert_says(&refusal(&gic(&["register", path(&run)])), &["is not the one that", "--scene"]);
}

#[test]
fn obstacles_are_taken_into_the_run() {
    let folder = reconstructed();
    let (run, file) = (folder.path().join("run"), folder.path().join("table.toml"));
    fs::write(&file, "[[colliders]]\nshape = \"half_space\"\nnormal = [0, 1, 0]\ncontact = \"slip\"\n").unwrap();
    // Without a material the command stops after its settings are kept.
    gic(&["identify", path(&run), "--colliders", path(&file)]);
    assert_says(&fs::read_to_string(run.join("config.toml")).unwrap(), &["colliders = \"colliders.toml\""]);
    assert_eq!(fs::read(run.join("colliders.toml")).unwrap(), fs::read(file).unwrap());
}

#[test]
fn a_result_that_no_stage_wrote_is_named_and_kept() {
    let folder = reconstructed();
    let (run, scene) = (folder.path().join("run"), folder.path().join("scene"));
    let result = run.join("gaussians/canonical.ply");
    let mut bytes = fs::read(&result).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    fs::write(&result, &bytes).unwrap();
    assert_says(&refusal(&reconstruct(&scene, &run)), &["canonical.ply", "`reconstruct`", "move it away"]);
    assert_eq!(fs::read(&result).unwrap(), bytes);
    assert_says(&refusal(&gic(&["report", path(&run)])), &["canonical.ply"]);
    fs::remove_file(&result).unwrap();
    assert_says(&message(&reconstruct(&scene, &run)), &["runs again: gaussians/canonical.ply is missing"]);
    assert_says(&message(&reconstruct(&scene, &run)), &["up to date"]);
}

#[test]
fn a_damaged_stamp_does_not_start_the_work_anew() {
    let folder = reconstructed();
    let (run, scene) = (folder.path().join("run"), folder.path().join("scene"));
    let stamp = run.join("stamps/reconstruct.json");
    let whole = fs::read(&stamp).unwrap();
    fs::write(&stamp, &whole[..whole.len() / 2]).unwrap();
    assert_says(&refusal(&reconstruct(&scene, &run)), &["stamps/reconstruct.json", "is damaged", "remove it"]);
    assert!(run.join("gaussians/canonical.ply").exists());
    fs::write(&stamp, whole).unwrap();
    assert_says(&message(&reconstruct(&scene, &run)), &["up to date"]);
}

#[test]
fn the_second_writer_is_told_who_writes_and_readers_do_not_wait() {
    let folder = reconstructed();
    let (run, scene) = (folder.path().join("run"), folder.path().join("scene"));
    let config = fs::read(run.join("config.toml")).unwrap();
    let held = gic_files::FolderLock::take(&run).unwrap();
    let holder = format!("process {} on ", std::process::id());
    assert_says(&refusal(&reconstruct(&scene, &run)), &[&holder, "being written"]);
    let reader = refusal(&gic(&["report", path(&run)]));
    assert_says(&reader, &["identify.json", "finish the run first"]);
    assert!(!reader.contains("being written"), "{reader}");
    assert_eq!(config, fs::read(run.join("config.toml")).unwrap());
    drop(held);
    assert_says(&message(&reconstruct(&scene, &run)), &["up to date"]);
}

#[test]
fn a_run_is_not_made_in_its_scene() {
    let folder = tempfile::tempdir().unwrap();
    copy(&demo(), folder.path());
    assert_says(&refusal(&reconstruct(folder.path(), folder.path())), &["the scene's own folder"]);
    assert!(!folder.path().join("config.toml").exists());
}
