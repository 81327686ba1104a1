//! `gic view`.

use std::path::Path;
use std::process::{Command, Stdio};

use gic_view::page::{PageRequest, default_page, view};

use super::Context;
use super::args::ViewArgs;
use crate::outputs::Inputs;
use crate::pipeline::{Stage, check_results};
use crate::recording::record;

pub(crate) fn run(args: &ViewArgs, context: &Context) -> anyhow::Result<()> {
    check_motion(&args.frames)?;
    if let Some(file) = &args.rerun {
        Inputs::default().allow_file(file)?;
        return recording(args, file, context);
    }
    let page = args.out.clone().unwrap_or_else(|| default_page(&args.frames));
    Inputs::default().allow_file(&page)?;
    let request = PageRequest { frames: args.frames.clone(), page: page.clone() };
    let outcome = view(&request, &context.events, &context.interrupt)?;
    let megabytes = outcome.bytes as f64 / 1e6;
    context.print(format!(
        "{} points, {} frames, {megabytes:.1} MB: open {} in a browser",
        outcome.points,
        outcome.frames,
        page.display()
    ))?;
    Ok(())
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
