//! `gic render`.

use gic::pipeline::scene_of_run;
use gic_scene::Scene;
use gic_view::render::{RenderRequest, SimulatedMotion, Viewpoint, render};

use super::Context;
use super::args::RenderArgs;

pub(crate) fn run(args: &RenderArgs, context: &Context) -> anyhow::Result<()> {
    let motion = SimulatedMotion::open(&args.frames)?;
    let scene = match (args.camera, &args.scene, &motion.run) {
        (Viewpoint::Orbit, ..) | (_, None, None) => None,
        (_, Some(path), _) => Some(Scene::open(path).map_err(gic::Error::stage("reading the scene"))?),
        (_, None, Some(run)) => Some(scene_of_run(run)?),
    };
    let request = RenderRequest {
        out: args.out.clone(),
        viewpoint: args.camera,
        background: args.background,
        coloring: args.color,
        beside_video: args.beside_video,
        size: args.size,
        film: args.film.clone(),
        slow_motion: args.slow_motion,
    };
    let outcome = render(&request, &motion, scene.as_ref(), &context.events, &context.interrupt)?;
    context.print(format!("{} pictures in {}; {}", outcome.frames, args.out.display(), outcome.legend));
    if let Some(film) = outcome.film {
        context.print(format!("film: {film}"));
    }
    Ok(())
}
