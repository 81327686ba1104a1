//! `gic view --rerun`: a motion as a recording, and with it the video and the identification where it is a run's.

use std::path::Path;

use gic_twin::Interrupt;
use gic_twin::events::Events;

use crate::error::Result;

/// Writes a Rerun recording of a motion, and of the video and the identification where it is a run's: cameras,
/// pictures, masks, surfaces, particles, colours, curves.
///
/// # Errors
/// A gic without the feature `rerun`, damaged files, an unwritable file.
#[cfg(feature = "rerun")]
pub fn record(frames: &Path, file: &Path, events: &Events, interrupt: &Interrupt) -> Result<()> {
    use gic_view::recording::RunEvidence;
    let motion = gic_view::render::SimulatedMotion::open(frames)?;
    let background = motion.run.as_deref().map(|run| -> Result<RunEvidence> {
        let scene = crate::pipeline::scene_of_run(run, None)?;
        let surfaces = (0..scene.times.len()).map(|frame| run.join(crate::pipeline::surface_file(frame))).collect();
        let curves = curves(&gic_twin::atomic::read_json(&run.join("identify.json"))?);
        Ok(RunEvidence { scene, surfaces, curves })
    });
    let background = background.transpose()?;
    Ok(gic_view::recording::record(&motion, background.as_ref(), file, events, interrupt)?)
}

/// Objectives by stage, and parameters.
#[cfg(feature = "rerun")]
fn curves(found: &crate::pipeline::IdentifyRecord) -> Vec<gic_view::recording::Curve> {
    use gic_view::recording::Curve;
    let mut curves: Vec<Curve> = Vec::new();
    let mut add = |entity: String, step: usize, value: f64| {
        let place = curves.iter().position(|curve| curve.entity == entity).unwrap_or(curves.len());
        if place == curves.len() {
            curves.push(Curve { entity, points: Vec::new() });
        }
        curves[place].points.push((step as i64, value));
    };
    for (index, step) in found.trace.iter().enumerate() {
        add(format!("identify/objective/{}", step.stage), index, step.objective);
        for (estimate, value) in found.estimates.iter().zip(&step.values) {
            add(format!("identify/{}", estimate.name), index, *value);
        }
    }
    curves
}

/// Writes a Rerun recording; this gic cannot.
///
/// # Errors
/// Always.
#[cfg(not(feature = "rerun"))]
pub fn record(_: &Path, file: &Path, _: &Events, _: &Interrupt) -> Result<()> {
    Err(crate::error::Error::Usage {
        problem: format!("cannot write {}: this gic was built without Rerun", file.display()),
        hint: Some(
            "build it with `cargo build --release --features rerun`, or make the HTML page without --rerun".into(),
        ),
    })
}
