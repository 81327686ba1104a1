//! `gic simulate`.

use gic::simulate::{Request, simulate};

use super::Context;
use super::args::SimulateArgs;

pub(crate) fn run(args: &SimulateArgs, context: &Context) -> anyhow::Result<()> {
    // A run folder stands for the twin in it.
    let twin = if args.twin.is_dir() { args.twin.join("twin.json") } else { args.twin.clone() };
    let request =
        Request { twin, settings: args.set.clone(), out: args.out.clone(), frames: args.frames, restart: args.restart };
    let outcome = simulate(&request, &context.events, &context.interrupt)?;
    context.print(format!("{} frames of {} particles in {}", outcome.frames, outcome.particles, args.out.display()));
    Ok(())
}
