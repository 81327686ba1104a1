//! A fixed number of attacks; `cargo run --release -p gic --example fuzz` plays as many as there is time for.

#[path = "common/attack.rs"]
mod attack;

use std::path::Path;

use attack::{Case, Target};

fn gic() -> &'static Path {
    Path::new(env!("CARGO_BIN_EXE_gic"))
}

fn hold(cases: u64, targets: &[Target]) {
    for seed in 0..cases {
        let folder = tempfile::tempdir().unwrap();
        let case = Case::new(seed, targets);
        case.play(gic(), folder.path()).unwrap_or_else(|problem| panic!("seed {seed}, {case:?}: {problem}"));
    }
}

#[test]
fn changed_scenes_are_read_or_refused() {
    hold(400, &attack::scenes());
}

#[test]
fn changed_twins_and_hostile_settings_are_simulated_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let twin = attack::twin(gic(), folder.path());
    hold(120, &[twin]);
}

#[test]
fn changed_runs_are_whole_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let run = attack::run(gic(), folder.path());
    hold(60, &[run]);
}

/// Takes minutes, so run it with `cargo test --release -p gic --test fuzz -- --ignored`.
#[test]
#[ignore = "takes minutes"]
fn changed_results_of_all_stages_are_whole_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let run = attack::whole_run(gic(), folder.path());
    hold(200, &[run]);
}
