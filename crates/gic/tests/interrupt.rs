//! Ctrl-C ends every command soon, and what it left can be gone on with.
#![cfg(unix)]

use std::fs;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// The bundled scene.
const DEMO: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/demo");
/// Two seconds are promised; the rest is for a busy machine.
const LIMIT: Duration = Duration::from_secs(6);

#[test]
fn ctrl_c_ends_a_run_at_any_moment_and_leaves_it_whole() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    for seconds in [0.05, 0.5, 2.0, 5.0, 9.0] {
        let mut child = Command::new(env!("CARGO_BIN_EXE_gic"))
            .args(["run", DEMO, "--material", "elastic", "-o", run.to_str().unwrap()])
            .stderr(Stdio::null())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_secs_f64(seconds));
        let asked = Instant::now();
        assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
        let status = child.wait().unwrap();
        // Before the program listens, the signal ends it.
        assert!(status.code().is_none_or(|code| code == 130), "{seconds} s: {status}");
        assert!(asked.elapsed() < LIMIT, "{seconds} s: {:?}", asked.elapsed());
    }
    assert!(fs::read_to_string(run.join("config.toml")).unwrap().contains("[reconstruct]"));
    let stamps: Vec<_> = fs::read_dir(run.join("stamps")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert!(!stamps.contains(&"identify.json".into()), "{stamps:?}");
}
