//! Attacks on gic for as long as there is time: scenes, twins and run folders with changed files, worlds with hostile
//! settings, one seed after the other. It begins with a run of the bundled scene, which takes minutes.
//!
//! ```sh
//! cargo build --release -p gic && cargo run --release -p gic --example fuzz -- --minutes 30
//! ```
//!
//! `--seed N` starts at another seed. What fails is made smaller, kept in `target/fuzz/SEED` with the message, and
//! printed; the exit status is then 1.

#[path = "../tests/common/attack.rs"]
mod attack;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::{Context, ensure};
use attack::Case;

fn main() -> anyhow::Result<ExitCode> {
    let (minutes, first) = (option("--minutes")?.unwrap_or(1.0), option("--seed")?.unwrap_or(0.0) as u64);
    let program = std::env::current_exe()?;
    let gic = program.parent().and_then(Path::parent).context("a target folder")?.join("gic");
    ensure!(gic.is_file(), "{} is missing; build it with `cargo build --release -p gic`", gic.display());
    let made = [tempfile::tempdir()?, tempfile::tempdir()?, tempfile::tempdir()?];
    let [run, twin, whole_run] = made.each_ref().map(|folder| folder.path());
    let mut targets = attack::scenes();
    targets.extend([attack::run(&gic, run), attack::twin(&gic, twin), attack::whole_run(&gic, whole_run)]);
    let end = Instant::now() + Duration::from_secs_f64(60.0 * minutes);
    let (mut seed, mut failures) = (first, 0);
    while Instant::now() < end {
        let folder = tempfile::tempdir()?;
        let case = Case::new(seed, &targets);
        if let Err(problem) = case.play(&gic, folder.path()) {
            failures += 1;
            println!("seed {seed}: {problem}");
            keep(case, seed, &gic)?;
        }
        seed += 1;
    }
    println!("seeds {first} to {}: {failures} of {} cases failed", seed.saturating_sub(1), seed - first);
    Ok(if failures == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// The number behind a flag.
fn option(flag: &str) -> anyhow::Result<Option<f64>> {
    let value = std::env::args().skip_while(|arg| arg != flag).nth(1);
    value.map(|text| text.parse().with_context(|| format!("{flag} {text}"))).transpose()
}

/// Makes a failing case smaller and leaves its folder and message behind.
fn keep(case: Case, seed: u64, gic: &Path) -> anyhow::Result<()> {
    let place = PathBuf::from(format!("target/fuzz/{seed}"));
    let fresh = || {
        let _ = std::fs::remove_dir_all(&place);
        std::fs::create_dir_all(&place).map(|()| place.clone()).expect("an empty folder")
    };
    let smaller = minimised(case, gic, &fresh);
    let problem = smaller.play(gic, &fresh()).err().unwrap_or_else(|| "does not fail each time".into());
    std::fs::write(place.join("case.txt"), format!("seed {seed}\n{smaller:#?}\n{problem}\n"))?;
    println!("  kept in {}", place.display());
    Ok(())
}

/// The case with as few changes as still fail.
fn minimised(mut case: Case, gic: &Path, fresh: &dyn Fn() -> PathBuf) -> Case {
    let mut index = 0;
    while index < case.changes.len() && case.changes.len() > 1 {
        let mut fewer = case.clone();
        fewer.changes.remove(index);
        match fewer.play(gic, &fresh()) {
            Err(_) => case = fewer,
            Ok(()) => index += 1,
        }
    }
    case
}
