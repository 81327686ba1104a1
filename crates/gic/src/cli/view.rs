//! `gic view`.

use std::path::Path;
use std::process::{Command, Stdio};

use gic_scene::Scene;
use gic_twin::twin::Twin;
use gic_view::page::{PageRequest, default_page, view, view_live};
use gic_view::render::SimulatedMotion;

use super::Context;
use super::args::ViewArgs;
use super::simulate::inputs_of;
use crate::outputs::Inputs;
use crate::pipeline::{Stage, check_results, scene_of_run, twin_file};
use crate::recording::record;

pub(crate) fn run(args: &ViewArgs, context: &Context) -> anyhow::Result<()> {
    if args.live {
        return live(args, context);
    }
    check_motion(&args.frames)?;
    if let Some(file) = &args.rerun {
        Inputs::default().allow_file(file)?;
        return recording(args, file, context);
    }
    let page = args.out.clone().unwrap_or_else(|| default_page(&args.frames));
    Inputs::default().allow_file(&page)?;
    let motion = SimulatedMotion::open(&args.frames)?;
    let scene = film_of(args, &motion, context)?;
    let request = PageRequest { page: page.clone() };
    let outcome = view(&request, &motion, scene.as_ref(), &context.events, &context.interrupt)?;
    let megabytes = outcome.bytes as f64 / 1e6;
    context.print(format!(
        "{} splats, {} frames, {megabytes:.1} MB: open {} in a browser",
        outcome.splats,
        outcome.frames,
        page.display()
    ))?;
    Ok(())
}

/// Writes the page that simulates.
fn live(args: &ViewArgs, context: &Context) -> anyhow::Result<()> {
    let file = twin_file(&args.frames)?;
    let page = args.out.clone().unwrap_or_else(|| file.with_file_name("live.html"));
    inputs_of(std::iter::once(&file)).allow_file(&page)?;
    let outcome = view_live(&PageRequest { page: page.clone() }, &Twin::read(&file, &[])?)?;
    let megabytes = outcome.bytes as f64 / 1e6;
    let (particles, page) = (outcome.splats, page.display());
    context.print(format!("{particles} particles, {megabytes:.1} MB: open {page} in a browser"))?;
    Ok(())
}

/// The scene whose film stands behind the twin: the one asked for, or a run's own, if it is still where it was.
fn film_of(args: &ViewArgs, motion: &SimulatedMotion, context: &Context) -> anyhow::Result<Option<Scene>> {
    match (&args.scene, &motion.run) {
        (Some(path), Some(run)) => Ok(Some(scene_of_run(run, Some(path))?)),
        (Some(path), None) => Ok(Some(Scene::open(path).map_err(crate::Error::stage("reading the scene"))?)),
        (None, Some(run)) => Ok(scene_of_run(run, None)
            .inspect_err(|error| {
                let text = format!("without the film: {error}; say with --scene SCENE where it is");
                context.events.warn("view", text);
            })
            .ok()),
        (None, None) => Ok(None),
    }
}

/// Refuses the motion of a run whose results are not what its stages wrote.
pub(super) fn check_motion(frames: &Path) -> anyhow::Result<()> {
    Ok(check_results(frames, &[Stage::Identify, Stage::Predict, Stage::Appearance])?)
}

/// Writes the recording, and opens it where the viewer is installed.
fn recording(args: &ViewArgs, file: &Path, context: &Context) -> anyhow::Result<()> {
    record(&args.frames, file, &context.events, &context.interrupt)?;
    let opened =
        Command::new("rerun").arg(file).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
    context.print(match opened {
        Ok(_) => format!("recording in {}, opened in Rerun", file.display()),
        Err(_) => format!(
            "recording in {}: install Rerun (pip install rerun-sdk) and open it with `rerun {0}`",
            file.display()
        ),
    })?;
    Ok(())
}
