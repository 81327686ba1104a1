//! The commands around a run, from outside, as far as they need no minutes of training.

mod common;

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use common::gic;
use serde_json::Value;

fn demo() -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("demo").to_str().unwrap().to_owned()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

#[test]
fn inspect_tells_what_was_read() {
    let folder = tempfile::tempdir().unwrap();
    let sheet = folder.path().join("sheet.png");
    let output = gic(&["inspect", &demo(), "--sheet", sheet.to_str().unwrap()]);
    assert!(output.status.success(), "{output:?}");
    let report = text(&output.stdout);
    assert!(report.contains("PAC-NeRF") && report.contains("8 cameras"), "{report}");
    assert!(sheet.exists());
    let json = gic(&["inspect", &demo(), "--json"]);
    let json: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
    assert_eq!((json["camera_count"].as_u64(), json["frame_count"].as_u64()), (Some(8), Some(11)));
}

#[test]
fn a_run_without_material_says_so_before_it_trains() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let output = gic(&["run", &demo(), "-o", run.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("--material"), "{output:?}");
    assert!(!run.join("gaussians").exists());
}

#[test]
fn more_frames_to_fit_than_the_video_has_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let output = gic(&["run", &demo(), "-o", run.to_str().unwrap(), "--material", "elastic", "--fit-frames", "12"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("from 2 to 11"), "{output:?}");
}

#[test]
fn numbers_out_of_range_are_refused_with_the_range() {
    for (flag, value, parts) in [
        ("--threads", "100000", ["--threads", "from 1 to 1024"]),
        ("--fit-frames", "0", ["fit_frames is 0", "from 2 to 11"]),
        ("--frame-rate-hz", "1e-320", ["frame_rate_hz = 1e-320", "from 0.001 to 1000000"]),
    ] {
        let output = gic(&["inspect", &demo(), flag, value]);
        let message = text(&output.stderr);
        assert!(!output.status.success() && parts.iter().all(|part| message.contains(part)), "{flag}: {message}");
    }
}

#[test]
fn a_camera_that_is_not_there_is_refused_with_those_that_are() {
    let output = gic(&["inspect", &demo(), "--cameras", "0,8"]);
    assert_eq!(output.status.code(), Some(2));
    let message = text(&output.stderr);
    assert!(message.contains("= 8: is no camera"), "{message}");
    assert!(message.contains("7 ("), "{message}");
    let few = gic(&["inspect", &demo(), "--cameras", "0,4,6", "--json"]);
    let few: serde_json::Value = serde_json::from_slice(&few.stdout).unwrap();
    assert_eq!((few["camera_count"].as_u64(), few["frame_count"].as_u64()), (Some(3), Some(11)));
}

#[test]
fn the_stages_up_to_filling_run_by_themselves() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let run = run.to_str().unwrap();
    let few = ["--cameras", "0,4,6", "--fit-frames", "3", "--steps", "150"];
    let trained = gic(&[&["reconstruct", &demo(), "-o", run], &few[..]].concat());
    assert!(trained.status.success(), "{trained:?}");
    let filled = gic(&["fill", run]);
    assert!(filled.status.success(), "{filled:?}");
    assert!(text(&filled.stdout).contains("particles"), "{filled:?}");
}

#[test]
fn a_scene_without_a_scan_has_nothing_to_register() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let run = run.to_str().unwrap();
    gic(&["run", &demo(), "-o", run]);
    let output = gic(&["register", run]);
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("nothing to register"), "{output:?}");
}

#[test]
fn a_real_capture_that_cannot_be_registered_is_refused_before_it_trains() {
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("../gic-scene/tests/data/real_capture");
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let refused = |flags: &[&str], part: &str| {
        let place = ["run", scene.to_str().unwrap(), "-o", run.to_str().unwrap(), "--material", "elastic"];
        let output = gic(&[&place, flags].concat());
        assert_eq!(output.status.code(), Some(1));
        assert!(text(&output.stderr).contains(part), "`{part}` is not in: {}", text(&output.stderr));
        assert!(!run.join("gaussians").exists());
        fs::remove_dir_all(&run).unwrap();
    };
    refused(&["--cameras", "1"], "one view cannot tell its size from its distance");
    refused(&["--target", "surfaces"], "masks are used");
    refused(&["--target", "both"], "masks are used");
    refused(&["--held-out", "0"], "leave --held-out out");
}

#[test]
fn every_setting_is_written_and_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let args =
        ["--steps", "7", "--held-out", "3,5", "--set", "reconstruct.loss.scale=0.25", "--fix", "poisson_ratio=0.3"];
    // Without a material the run stops after its settings are known.
    gic(&[&["run", &demo(), "-o", run.to_str().unwrap()], &args[..]].concat());
    let settings = fs::read_to_string(run.join("config.toml")).unwrap();
    for line in ["steps = 7", "held_out = [3, 5]", "scale = 0.25", "poisson_ratio = 0.3", "density_kg_m3 = 1000.0"] {
        assert!(settings.contains(line), "`{line}` is missing in:\n{settings}");
    }
    let other = folder.path().join("other");
    gic(&["run", &demo(), "-o", other.to_str().unwrap(), "--config", run.join("config.toml").to_str().unwrap()]);
    assert_eq!(settings, fs::read_to_string(other.join("config.toml")).unwrap());
}

#[test]
fn a_misspelled_setting_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let output = gic(&["run", &demo(), "-o", run.to_str().unwrap(), "--set", "reconstruct.stepz=1"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("stepz"), "{output:?}");
}

#[test]
fn settings_that_cannot_be_used_are_refused_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let place = ["run", &demo(), "-o", run.to_str().unwrap(), "--material", "elastic"];
    for (flags, code, parts) in [
        (&["--fix", "poisson=0.3"][..], 2, ["'poisson'", "poisson_ratio"]),
        (&["--fix", "poisson_ratio=0.7"], 2, ["poisson_ratio", "0.7"]),
        (&["--material", "auto", "--fix", "poisson=0.3"], 2, ["'poisson'", "friction_angle_deg"]),
        (&["--material", "auto", "--set", "identify.starts=[{parameters=[1.0]}]"], 2, ["start", "law"]),
        (&["--set", "identify.poisson_ratio=0.7"], 2, ["--set", "poisson_ratio"]),
        (&["--density=-5"], 2, ["density_kg_m3", "-5"]),
        (&["--levels", "99"], 2, ["levels", "from 1 to 10"]),
        (&["--grid-spacing-m", "0"], 2, ["grid_spacing_m", "above 0"]),
        (&["--particle-spacing-m=-1"], 2, ["particle_spacing_m", "above 0"]),
        (&["--substeps-per-frame", "0"], 2, ["substeps_per_frame", "above 0"]),
        (&["--held-out", "99"], 2, ["held_out", "0 to 7"]),
        (&["--set", "identify.frames=1"], 2, ["frames", "two frames"]),
        (&["--set", "identify.frames=99"], 2, ["99", "has 11"]),
        (&["--set", "appearance.train.steps=0"], 2, ["steps", "at least 1"]),
        (&["--set", "register.starts=0"], 2, ["starts", "at least 1"]),
        (&["--colliders", "nowhere.json"], 1, ["nowhere.json", "check the path"]),
    ] {
        let place = if flags[0] == "--material" { &place[..4] } else { &place[..] };
        let output = gic(&[place, flags].concat());
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{flags:?}: {message}");
        assert!(parts.iter().all(|part| message.contains(part)), "{flags:?}: {message}");
        assert!(!run.exists(), "{flags:?}");
    }
}

#[test]
fn a_run_folder_without_scene_says_how_to_start() {
    let folder = tempfile::tempdir().unwrap();
    let output = gic(&["identify", folder.path().to_str().unwrap(), "--material", "sand"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("gic run SCENE"), "{output:?}");
}

#[test]
fn a_scene_that_is_none_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let empty = folder.path().to_str().unwrap();
    let output = gic(&["inspect", empty]);
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains(empty), "{output:?}");
}

#[test]
fn a_run_that_is_not_finished_cannot_be_evaluated() {
    let folder = tempfile::tempdir().unwrap();
    let truth = Path::new(&demo()).join("gt");
    let output = gic(&["eval", folder.path().to_str().unwrap(), "--truth", truth.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("finish the run first"), "{output:?}");
}

#[test]
fn a_suite_without_scenes_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().to_str().unwrap();
    let output = gic(&["bench", path, "-o", path]);
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("gt/params.json"), "{output:?}");
}

/// The whole road, on the scene that comes with gic, with few training steps: minutes, so run it with
/// `cargo test -p gic --test pipeline -- --ignored`.
#[test]
#[ignore = "takes minutes"]
fn a_run_goes_from_video_to_report_and_reruns_only_what_changed() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let start = ["run", &demo(), "-o", run.to_str().unwrap(), "--material", "elastic", "--steps", "400"];
    let output = gic(&start);
    assert!(output.status.success(), "{output:?}");
    for file in ["config.toml", "log.jsonl", "continuum.ply", "twin.json", "prediction/trajectory.json", "report.html"]
    {
        assert!(run.join(file).is_file(), "{file} is missing");
    }
    let page = fs::read_to_string(run.join("report.html")).unwrap();
    assert!(!page.contains("http://") && !page.contains("https://"), "the report must open offline");
    for part in
        ["Young&#x27;s modulus", "kPa", "Times and memory", "<td>reconstruct</td>", "viewer-data", "<th>truth</th>"]
    {
        assert!(page.contains(part), "{part}");
    }
    let twin = fs::read(run.join("twin.json")).unwrap();
    let again = text(&gic(&start).stderr);
    for stage in ["reconstruct", "fill", "identify", "predict", "appearance"] {
        assert!(again.contains(&format!("{stage}: up to date")), "{again}");
    }
    assert_eq!(twin, fs::read(run.join("twin.json")).unwrap());
    let changed = text(&gic(&[&start[..], &["--density", "1200"]].concat()).stderr);
    assert!(changed.contains("fill: up to date"), "{changed}");
    assert!(changed.contains("identify: runs again: identify.density_kg_m3 was 1000.0 and is now 1200.0"), "{changed}");
    let truth = Path::new(&demo()).join("gt");
    let table = gic(&["eval", run.to_str().unwrap(), "--truth", truth.to_str().unwrap()]);
    assert!(text(&table.stdout).contains("youngs_modulus_pa"), "{table:?}");
    // The filled body of another frame is no frame of the prediction.
    fs::copy(run.join("filling/0003.ply"), run.join("prediction/particles_0003.ply")).unwrap();
    let stale = gic(&["eval", run.to_str().unwrap(), "--truth", truth.to_str().unwrap()]);
    assert!(text(&stale.stderr).contains("particles_0003.ply: is not the file that `predict` wrote"), "{stale:?}");
}

/// In the first four frames the object flies. What is known of it is its velocity, and that is a whole twin. Takes
/// minutes, so run it with `cargo test -p gic --test pipeline -- --ignored`.
#[test]
#[ignore = "takes minutes"]
fn an_object_that_touches_nothing_gives_a_twin_that_every_command_reads() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run");
    let run = path.to_str().unwrap();
    let start = ["run", &demo(), "-o", run, "--material", "elastic", "--steps", "400", "--frames", "4"];
    let output = gic(&start);
    assert!(output.status.success(), "{output:?}");
    let printed = text(&output.stdout);
    assert!(printed.matches("NOT DETERMINED").count() == 2, "{printed}");
    for file in ["twin.json", "identify.json", "prediction/trajectory.json", "fill.json"] {
        let content = fs::read_to_string(path.join(file)).unwrap();
        assert!(file == "identify.json" || !content.contains("null"), "{file}: {content}");
    }
    let twin: Value = serde_json::from_slice(&fs::read(path.join("twin.json")).unwrap()).unwrap();
    assert_eq!(twin["identifiable"]["youngs_modulus_pa"], false);
    assert_eq!(twin["intervals_95"]["youngs_modulus_pa"], serde_json::json!([1e3, 3e7]));
    assert!(twin["intervals_95"]["initial_velocity_y_m_s"][0].is_f64(), "{twin}");
    let again = text(&gic(&["identify", run]).stderr);
    assert!(again.contains("identify: up to date"), "{again}");
    let out = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let truth = Path::new(&demo()).join("gt");
    for command in [
        &["simulate", run, "-o", &out("future"), "--frames", "3"][..],
        &["report", run],
        &["eval", run, "--truth", truth.to_str().unwrap()],
        &["export", run, "--format", "particles", "-o", &out("set.npz")],
    ] {
        let output = gic(command);
        assert!(output.status.success(), "{command:?}: {output:?}");
    }
}

/// Killed, without a chance to tidy up, at several moments of its work, and started again each time. Takes minutes, so
/// run it with `cargo test -p gic --test pipeline -- --ignored`.
#[test]
#[ignore = "takes minutes"]
fn an_identification_killed_at_any_moment_ends_at_the_same_twin() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let path = run.to_str().unwrap();
    let output = gic(&["reconstruct", &demo(), "-o", path, "--steps", "400"]);
    assert!(output.status.success(), "{output:?}");
    assert!(gic(&["fill", path]).status.success());
    let identify = ["identify", path, "--material", "elastic"];
    let early = [3, 8, 20, 40].map(|seconds| killed(&identify, Duration::from_secs(seconds)));
    assert!(early[0] && early[1], "it was never killed at work: {early:?}");
    let output = gic(&identify);
    assert!(output.status.success(), "{output:?}");
    let of = |file: &str| -> Value { serde_json::from_slice(&fs::read(run.join(file)).unwrap()).unwrap() };
    let result = || {
        let (mut twin, record) = (of("twin.json"), of("identify.json"));
        twin.as_object_mut().unwrap().remove("seconds");
        (twin, record["estimates"].clone(), fs::read(run.join("twin.ply")).unwrap())
    };
    let pieces = result();
    for file in ["stamps/identify.json", "stamps/identify.begun.json", "identify.json", "twin.json"] {
        fs::remove_file(run.join(file)).unwrap();
    }
    assert!(gic(&identify).status.success());
    assert!(pieces == result(), "{:?}\n{:?}", pieces.0, result().0);
}

/// Starts a command and kills it after a while; whether it was still at work.
fn killed(args: &[&str], after: Duration) -> bool {
    let mut child =
        Command::new(env!("CARGO_BIN_EXE_gic")).args(args).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    std::thread::sleep(after);
    let early = child.try_wait().unwrap().is_none();
    child.kill().unwrap();
    child.wait().unwrap();
    early
}

/// What a run holds, without what differs between two runs: clock times, the log, and what is only kept on the way.
fn results(run: &Path) -> Vec<(String, Vec<u8>)> {
    let mut found = Vec::new();
    let mut folders = vec![run.to_owned()];
    while let Some(folder) = folders.pop() {
        for path in fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()) {
            let name = path.strip_prefix(run).unwrap().to_str().unwrap().to_owned();
            let passing = ["stamps", "log.jsonl", "report.html"].contains(&name.as_str()) || name.contains("/.");
            match path.is_dir() {
                _ if passing || name.starts_with('.') => (),
                true => folders.push(path),
                false => found.push((name, without_seconds(fs::read(&path).unwrap()))),
            }
        }
    }
    found.sort();
    found
}

fn without_seconds(bytes: Vec<u8>) -> Vec<u8> {
    match serde_json::from_slice::<Value>(&bytes) {
        Ok(Value::Object(mut map)) => {
            map.remove("seconds");
            Value::Object(map).to_string().into_bytes()
        }
        _ => bytes,
    }
}

/// The whole road, killed at random moments through all stages until it is through. Takes minutes, so run it with
/// `cargo test --release -p gic --test pipeline -- --ignored`.
#[test]
#[ignore = "takes minutes"]
fn a_run_killed_at_random_moments_of_all_stages_ends_at_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, pieces] = ["whole", "pieces"].map(|name| folder.path().join(name).to_str().unwrap().to_owned());
    let demo = demo();
    let few = ["--material", "elastic", "--steps", "400", "--cameras", "0,1,2,3,4,6"];
    let start = |out: &str| [&["run", &demo, "-o"], &[out][..], &few].concat().iter().map(|s| s.to_string()).collect();
    let clock = std::time::Instant::now();
    let args: Vec<String> = start(&whole);
    let output = gic(&args.iter().map(String::as_str).collect::<Vec<_>>());
    assert!(output.status.success(), "{output:?}");
    let seconds = clock.elapsed().as_secs_f64();
    let args: Vec<String> = start(&pieces);
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    // A fixed sequence of moments (the golden ratio's multiples), each a part of a sixth of the whole.
    let moment = |kill: u32| Duration::from_secs_f64((f64::from(kill) * 0.618_033_988_75).fract() * seconds / 6.0);
    let kills = (1..=24).filter(|&kill| killed(&args, moment(kill))).count();
    assert!(kills >= 6, "it was killed only {kills} times");
    let output = gic(&args);
    assert!(output.status.success(), "{output:?}");
    let [whole, pieces] = [whole, pieces].map(|run| results(Path::new(&run)));
    let names = |run: &[(String, Vec<u8>)]| run.iter().map(|(name, _)| name.clone()).collect::<Vec<_>>();
    assert_eq!(names(&whole), names(&pieces));
    for ((name, whole), (_, pieces)) in whole.iter().zip(&pieces) {
        assert!(whole == pieces, "{name} differs");
    }
}
