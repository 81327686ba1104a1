//! Outputs: they never take the place of inputs, and one that cannot be written is an error.

mod common;
#[path = "common/falling_box.rs"]
mod falling_box;

use std::fs;
use std::path::Path;

use common::gic;
use falling_box::falling_box;

#[test]
fn what_a_command_reads_it_does_not_write_over() {
    let folder = falling_box(0.2);
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let kept = |file: &str, args: &[&str]| {
        let before = fs::read(path(file)).unwrap();
        let output = gic(args);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{args:?}: {message}");
        assert!(message.contains("nothing is written over it") && message.contains(file), "{args:?}: {message}");
        assert_eq!(before, fs::read(path(file)).unwrap(), "{args:?}");
    };
    kept("frames/trajectory.json", &["view", &path("frames"), "-o", &path("frames/trajectory.json")]);
    let film = path("frames/particles_0001.ply");
    kept("frames/particles_0001.ply", &["render", &path("frames"), "-o", &path("pictures"), "--film", &film]);
    // The matter of a twin must not become a frame of its own future.
    fs::copy(path("frames/particles_0002.ply"), path("particles_0000.ply")).unwrap();
    let twin = fs::read_to_string(path("twin.json")).unwrap();
    let mut twin: serde_json::Value = serde_json::from_str(&twin).unwrap();
    twin["continuum"] = "particles_0000.ply".into();
    fs::write(path("other.json"), twin.to_string()).unwrap();
    kept("particles_0000.ply", &["simulate", &path("other.json"), "-o", &path("")]);
}

#[test]
fn a_sheet_does_not_replace_a_picture_of_the_scene() {
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("demo");
    let picture = scene.join("data/r_0_0.png");
    let before = fs::read(&picture).unwrap();
    let output = gic(&["inspect", scene.to_str().unwrap(), "--sheet", picture.to_str().unwrap()]);
    assert!(String::from_utf8_lossy(&output.stderr).contains("a file of the scene"), "{output:?}");
    assert_eq!(before, fs::read(&picture).unwrap());
}

#[test]
fn a_motion_moves_with_its_matter() {
    let folder = falling_box(0.2);
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    fs::create_dir(path("a")).unwrap();
    fs::rename(path("frames/particles_0000.ply"), path("a/matter.ply")).unwrap();
    let twin = fs::read_to_string(path("twin.json")).unwrap();
    let mut twin: serde_json::Value = serde_json::from_str(&twin).unwrap();
    twin["continuum"] = "matter.ply".into();
    fs::write(path("a/twin.json"), twin.to_string()).unwrap();
    assert!(gic(&["simulate", &path("a/twin.json"), "-o", &path("a/frames")]).status.success());
    let trajectory = fs::read_to_string(path("a/frames/trajectory.json")).unwrap();
    let trajectory: serde_json::Value = serde_json::from_str(&trajectory).unwrap();
    assert_eq!(trajectory["twin"]["continuum"], "../matter.ply");
    fs::rename(path("a"), path("b")).unwrap();
    let again = gic(&["simulate", &path("b/twin.json"), "-o", &path("b/frames")]);
    assert!(String::from_utf8_lossy(&again.stderr).contains("3 frames of this simulation already"), "{again:?}");
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_under_the_results_is_an_error() {
    use std::process::{Command, Stdio};
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("demo");
    let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_gic"))
        .args(["inspect", scene.to_str().unwrap(), "--json"])
        .stdout(Stdio::from(full))
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    assert!(String::from_utf8_lossy(&output.stderr).contains("standard output"), "{output:?}");
}

/// `gic` with limits of the shell that starts it.
#[cfg(unix)]
fn limited(limits: &str, args: &[&str]) -> std::process::Output {
    // Beyond the limit on files, writing is to fail and not to kill.
    let script = format!("trap '' XFSZ; {limits}; exec \"$@\"");
    let mut command = std::process::Command::new("bash");
    command.args(["-c", &script, "limited", env!("CARGO_BIN_EXE_gic")]).args(args).output().unwrap()
}

#[cfg(unix)]
#[test]
fn a_disk_that_fills_up_leaves_what_was_whole_and_the_same_command_goes_on() {
    let folder = falling_box(0.2);
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let simulate = ["simulate", &path("twin.json"), "-o", &path("again")];
    // 1 KiB: too little for the first frame.
    let full = limited("ulimit -f 1", &simulate);
    let message = String::from_utf8_lossy(&full.stderr).into_owned();
    assert_eq!(full.status.code(), Some(1), "{message}");
    assert!(message.contains("cannot write") && message.contains("particles_0000.ply"), "{message}");
    assert!(!folder.path().join("again/particles_0000.ply").exists());
    assert!(gic(&simulate).status.success());
    for file in ["particles_0002.ply", "trajectory.json"] {
        let read = |run: &str| fs::read(path(&format!("{run}/{file}"))).unwrap();
        assert!(read("frames") == read("again"), "{file} differs");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn too_few_file_handles_are_an_error_that_names_the_file() {
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("demo");
    let few = limited("ulimit -n 8", &["inspect", scene.to_str().unwrap(), "--threads", "8"]);
    let message = String::from_utf8_lossy(&few.stderr).into_owned();
    assert!(matches!(few.status.code(), Some(0 | 1)) && !message.contains("panicked"), "{message}");
    // One handle is left, and the lock of the folder takes it.
    let folder = falling_box(0.2);
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let none = limited("ulimit -n 4", &["simulate", &path("twin.json"), "-o", &path("again")]);
    let message = String::from_utf8_lossy(&none.stderr).into_owned();
    assert_eq!(none.status.code(), Some(1), "{message}");
    assert!(message.contains("error: "), "{message}");
}

#[test]
fn of_two_writers_at_a_time_one_is_told_of_the_other() {
    let folder = falling_box(0.2);
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let start = || {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_gic"));
        command.args(["simulate", &path("twin.json"), "-o", &path("both")]);
        command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped()).spawn().unwrap()
    };
    let outputs = [start(), start(), start()].map(|child| child.wait_with_output().unwrap());
    assert!(outputs.iter().any(|output| output.status.success()), "{outputs:?}");
    for refused in outputs.iter().filter(|output| !output.status.success()) {
        assert!(String::from_utf8_lossy(&refused.stderr).contains("being written by process"), "{refused:?}");
    }
    for frame in 0..3 {
        let read = |run: &str| fs::read(path(&format!("{run}/particles_000{frame}.ply"))).unwrap();
        assert!(read("frames") == read("both"), "frame {frame} differs");
    }
}
