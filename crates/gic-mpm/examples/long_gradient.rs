//! Time and peak memory of a long gradient: 59,319 particles, 13 frames of 200 substeps, under the default memory
//! budget.
//!
//! `cargo run --release -p gic-mpm --example long_gradient [elastic|plasticine]`

#[path = "../benches/common/mod.rs"]
mod common;

use std::time::Instant;

use common::{falling_cube, materials};
use gic_mpm::{Options, gradient};

/// Particles along each side of the cube.
const SIDE: usize = 39;
/// Frame 0 included.
const FRAMES: usize = 14;
const SUBSTEPS_PER_FRAME: usize = 200;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let [elastic, plasticine] = materials();
    let material = match std::env::args().nth(1).as_deref() {
        None | Some("elastic") => elastic,
        Some("plasticine") => plasticine,
        Some(other) => return Err(format!("{other}: choose elastic or plasticine").into()),
    };
    let start = Instant::now();
    let last = FRAMES - 1;
    let found = gradient(&falling_cube(material, SIDE, SUBSTEPS_PER_FRAME), &Options::default(), FRAMES, |frame| {
        (frame.index == last).then(|| frame.positions.clone())
    })?;
    let seconds = start.elapsed().as_secs_f64();
    let names = material.parameter_names();
    println!("{}: {names:?} {:?}, {seconds:.1} s of wall time", material.model(), found.bodies[0].material);
    // Linux tells the peak of the resident memory.
    if let Ok(status) = std::fs::read_to_string("/proc/self/status") {
        status.lines().filter(|line| line.starts_with("VmHWM")).for_each(|line| println!("{line}"));
    }
    Ok(())
}
