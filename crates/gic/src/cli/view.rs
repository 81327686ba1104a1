//! `gic view`.

use gic::view::{Request, default_page, view};

use super::Context;
use super::args::ViewArgs;

pub(crate) fn run(args: &ViewArgs, context: &Context) -> anyhow::Result<()> {
    let page = args.out.clone().unwrap_or_else(|| default_page(&args.frames));
    let request = Request { frames: args.frames.clone(), page: page.clone() };
    let outcome = view(&request, &context.events, &context.interrupt)?;
    let megabytes = outcome.bytes as f64 / 1e6;
    context.print(format!(
        "{} points, {} frames, {megabytes:.1} MB: open {} in a browser",
        outcome.points,
        outcome.frames,
        page.display()
    ));
    Ok(())
}
