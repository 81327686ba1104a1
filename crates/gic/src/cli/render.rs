//! `gic render`.

use gic_scene::Scene;
use gic_view::render::{RenderRequest, SimulatedMotion, Viewpoint, render};

use super::Context;
use super::args::RenderArgs;
use super::view::check_motion;
use crate::outputs::Inputs;
use crate::pipeline::{config_of_run, scene_of_run};

pub(crate) fn run(args: &RenderArgs, context: &Context) -> anyhow::Result<()> {
    check_motion(&args.frames)?;
    let motion = SimulatedMotion::open(&args.frames)?;
    let scene = match (args.camera, &args.scene, &motion.run) {
        (Viewpoint::Orbit, ..) | (_, None, None) => None,
        (_, elsewhere, Some(run)) => Some(scene_of_run(run, elsewhere.as_deref())?),
        (_, Some(path), None) => Some(Scene::open(path).map_err(crate::Error::stage("reading the scene"))?),
    };
    let inputs = scene.iter().fold(Inputs::default(), |inputs, scene| inputs.scene(&scene.root));
    inputs.allow_folder(&args.out, &["frame_"])?;
    args.film.iter().try_for_each(|film| inputs.allow_file(film))?;
    let fitted_frames = match &motion.run {
        // A run without its settings can be drawn, too.
        Some(run) if run.join("config.toml").exists() => {
            let whole = motion.trajectory.twin.get("frames").and_then(|frames| frames.as_u64());
            config_of_run(run)?.scene.fit_frames.or(whole.map(|frames| frames as usize))
        }
        _ => None,
    };
    let request = RenderRequest {
        fitted_frames,
        out: args.out.clone(),
        viewpoint: args.camera,
        background: args.background,
        coloring: args.color,
        beside_video: args.beside_video,
        size: args.size,
        film: args.film.clone(),
        slow_motion: args.slow_motion,
        labels: !args.no_labels,
    };
    let outcome = render(&request, &motion, scene.as_ref(), &context.events, &context.interrupt)?;
    context.print(format!("{} pictures in {}; {}", outcome.frames, args.out.display(), outcome.legend))?;
    if let Some(film) = outcome.film {
        context.print(format!("film: {film}"))?;
    }
    Ok(())
}
