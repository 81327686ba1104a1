//! `gic render`.

use gic::render::{Request, render};

use super::Context;
use super::args::RenderArgs;

pub(crate) fn run(args: &RenderArgs, context: &Context) -> anyhow::Result<()> {
    let request = Request {
        frames: args.frames.clone(),
        out: args.out.clone(),
        viewpoint: args.camera,
        scene: args.scene.clone(),
        background: args.background,
        coloring: args.color,
        beside_video: args.beside_video,
        size: args.size,
        film: args.film.clone(),
        slow_motion: args.slow_motion,
    };
    let outcome = render(&request, &context.events, &context.interrupt)?;
    context.print(format!("{} pictures in {}; {}", outcome.frames, args.out.display(), outcome.legend));
    if let Some(film) = outcome.film {
        context.print(format!("film: {film}"));
    }
    Ok(())
}
