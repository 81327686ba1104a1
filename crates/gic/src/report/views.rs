//! The twin against the video: every camera and frame, those that were only predicted included.

use std::fmt::Write;

use gic_twin::events::Events;
use gic_twin::json;
use gic_twin::matter::read_particles;
use gic_view::html::escape;
use gic_view::report::{Overlay, Series, TwinDrawing, chart, overlays};
use gic_view::skinned_gaussians::SkinnedGaussians;

use super::STAGE;
use crate::error::{Error, Result};
use crate::pipeline::{IdentifyRecord, Run, TWIN_MATTER};

pub(super) fn views(run: &Run, found: &IdentifyRecord, events: &Events) -> Result<String> {
    let scene = run.video();
    let (fitted, frames) = (run.fitted_frames(), scene.times.len());
    let (drawing, appearance) = run.drawing(&run.continuum()?)?;
    let skin = SkinnedGaussians::load(run.folder(), &read_particles(&run.folder().join(TWIN_MATTER))?.positions)?;
    let drawn = TwinDrawing { drawing, appearance, factor: found.splat_factor, skin };
    let mut by_camera: Vec<Vec<Option<Overlay>>> = scene.cameras.iter().map(|_| Vec::new()).collect();
    for frame in 0..frames {
        let views = overlays(scene, &drawn, &run.predicted(frame)?, frame)?;
        by_camera.iter_mut().zip(views).for_each(|(camera, overlay)| camera.push(overlay));
        events.step(STAGE, "", frame as u64 + 1, Some(frames as u64), &[]);
    }
    let embed = Error::stage("writing the report");
    let embedded = (|| Ok((json::text(&scene.times)?, json::text(&by_camera)?)))();
    let (times, pictures) = embedded.map_err(|e: json::Unwritable| embed(e))?;
    let mut text = format!(
        "<h2>The twin over the video</h2><p>{} <span class=\"observed\">Green</span>: outline of the observed mask; \
         <span class=\"twin\">red</span>: outline of the simulated twin.{}</p>\
         <p><button id=\"play\">play / stop</button> \
         <input id=\"frame\" type=\"range\" min=\"0\" max=\"{}\" value=\"0\"> \
         <span id=\"time\"></span></p>\
         <div class=\"views\">",
        what_was_fitted(fitted, frames),
        if drawn.skin.is_some() { " Below each: the twin in its own colours." } else { "" },
        frames.saturating_sub(1)
    );
    for name in &scene.camera_names {
        let _ = write!(
            text,
            "<figure><img class=\"outlines\" alt=\"\"><img class=\"look\" alt=\"\">\
             <figcaption>camera {}: <span></span></figcaption></figure>",
            escape(name)
        );
    }
    let _ = write!(
        text,
        "</div><div class=\"charts\">{}</div>\
         <script>const TIMES = {times}; const FITTED = {fitted}; const VIEWS = {pictures};\n{}</script>",
        overlaps(&by_camera, fitted),
        include_str!("script.js")
    );
    Ok(text)
}

fn what_was_fitted(fitted: usize, frames: usize) -> String {
    if fitted == frames {
        "All frames were fitted.".into()
    } else {
        format!("The first {fitted} frames were fitted; the last {} are <b>predictions</b>.", frames - fitted)
    }
}

/// How well the twin covers the masks over time, apart for what was fitted and what was predicted.
fn overlaps(by_camera: &[Vec<Option<Overlay>>], fitted: usize) -> String {
    let frames = by_camera.iter().map(Vec::len).max().unwrap_or(0);
    let mean = |frame: usize| {
        let seen: Vec<f64> = by_camera.iter().filter_map(|camera| Some(camera.get(frame)?.as_ref()?.iou)).collect();
        (!seen.is_empty()).then(|| (frame as f64, seen.iter().sum::<f64>() / seen.len() as f64))
    };
    let series = |name: &str, range: std::ops::Range<usize>| Series {
        name: name.into(),
        points: range.filter_map(mean).collect(),
    };
    let fitted = fitted.min(frames);
    let mut lines = vec![series("fitted", 0..fitted)];
    if fitted < frames {
        lines.push(series("predicted", fitted..frames));
    }
    chart("overlap (IoU) of the twin with the masks over frames, mean of the cameras", &lines, false)
}
