//! `gic grasp`: two rigid pads, as of a parallel gripper, close on a twin, hold it and lift it.
//!
//! The matter floats weightless while the pads close slowly; at each width it comes to rest and the forces are
//! averaged. Then weight sets in, the gripper is raised from a table, and what slides or stays behind is measured.

mod antipodal;
mod contact;
mod course;
mod error;
mod film;
mod grasp;
mod gripper;
mod gripper_frame;
mod lift;
mod pad_grid;
mod pad_simulation;
mod percentile;
mod report;
mod request;
mod squeeze;

use gic_mpm::Material;
use gic_twin::Interrupt;
use gic_twin::ResourceMeter;
use gic_twin::atomic;
use gic_twin::events::{Event, Events};
use gic_twin::simulate::forecast_in_words;
use gic_twin::twin::Twin;

pub use error::{GraspError, Result};
pub use gripper::Gripper;
pub use gripper_frame::{AxisChoice, AxisError};
pub use pad_grid::MAX_REFINEMENT;
pub use report::{GraspReport, Lift, Squeeze};
pub use request::GraspRequest;

use grasp::Grasp;
use request::STAGE;

/// Grasps a twin at every width and writes what was found into the folder.
///
/// # Errors
/// Bad input, matter that no gripper holds, an unstable simulation, an unwritable folder.
pub fn grasp(request: &GraspRequest, events: &Events, interrupt: &Interrupt) -> Result<GraspReport> {
    let widths = descending(&request.widths_m)?;
    let twin = Twin { colliders: Vec::new(), ..Twin::read(&request.twin, &request.settings)? };
    check_grippable(&twin.material)?;
    // A film that cannot be made is an error before the simulation.
    let film = request.pictures.then(|| film::FilmTarget::of(&request.film)).transpose()?;
    let (twin, world) = twin.to_world()?;
    atomic::create_folder(&request.out)?;
    let meter = ResourceMeter::start();
    let mut grasp = Grasp::new(request, &twin, &world, widths[0], events, interrupt)?;
    let forecast = grasp.forecast(&widths)?;
    let reason = format!("{} widths; {} or more", widths.len(), forecast_in_words(&forecast));
    events.send(&Event::StageStarted { stage: STAGE.into(), reason });
    let report = grasp.run(&widths)?;
    atomic::write_json(&request.out.join("grasp.json"), &report)?;
    if let Some(film) = film {
        let (gripper_frame, simulation) = (&grasp.gripper_frame, &grasp.simulation);
        let text = grasp.film.draw(
            gripper_frame,
            &simulation.pads,
            simulation.up,
            &report,
            (&request.out, request.size),
            &film,
        )?;
        events.note(STAGE, text);
    }
    events.send(&meter.done(STAGE));
    Ok(report)
}

/// The widths from the largest to the smallest, each once.
fn descending(widths: &[f64]) -> Result<Vec<f64>> {
    if let Some(bad) = widths.iter().find(|w| !(**w > 0.0 && w.is_finite())) {
        return Err(GraspError::Usage {
            problem: format!("a gripper cannot close to {bad} m"),
            hint: Some("give widths in metres above 0: --width-m 0.055,0.045,0.035".into()),
        });
    }
    let mut widths = widths.to_vec();
    widths.sort_by(|a, b| b.total_cmp(a));
    widths.dedup();
    if widths.is_empty() {
        return Err(GraspError::Usage {
            problem: "there is no width to close to".into(),
            hint: Some("give widths in metres: --width-m 0.055,0.045,0.035".into()),
        });
    }
    Ok(widths)
}

fn check_grippable(material: &Material) -> Result<()> {
    let why = match material {
        Material::Newtonian { .. } => "a fluid, which flows out between the pads",
        Material::Sand { .. } => "loose grains without cohesion, which fall from between the pads",
        _ => return Ok(()),
    };
    Err(GraspError::Usage {
        problem: format!("the twin's material is {}: {why}", material.model()),
        hint: Some("elastic, viscoelastic, plasticine and non-newtonian twins can be gripped".into()),
    })
}
