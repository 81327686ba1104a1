//! `gic simulate`.

use gic::simulate::{Request, simulate};

use super::Context;
use super::args::SimulateArgs;

pub(crate) fn run(args: &SimulateArgs, context: &Context) -> anyhow::Result<()> {
    let request = Request {
        twin: args.twin.clone(),
        settings: args.set.clone(),
        out: args.out.clone(),
        frames: args.frames,
        restart: args.restart,
    };
    let outcome = simulate(&request, &context.events, &context.interrupt)?;
    context.print(format!("{} frames of {} particles in {}", outcome.frames, outcome.particles, args.out.display()));
    Ok(())
}
