//! `gic view`: a motion as one HTML page that needs nothing installed: WebGL points, a time slider, orbit, stress and
//! speed.

mod points;

use std::path::{Path, PathBuf};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use gic_twin::Interrupt;
use gic_twin::ResourceMeter;
use gic_twin::atomic;
use gic_twin::events::{Event, Events};
use glam::DVec3;
use serde::Serialize;

use crate::error::{Result, ViewError};
use crate::render::color_scale::{ColorScale, Coloring};
use crate::render::particle_splats;
use crate::render::simulated_motion::SimulatedMotion;
use points::PagePoints;

const STAGE: &str = "view";
/// Lines of the floor on each side of its middle.
const FLOOR_LINES: i32 = 10;

/// What to show, and where to.
#[derive(Clone, Debug)]
pub struct PageRequest {
    /// A folder written by `gic simulate`, or a run folder.
    pub frames: PathBuf,
    /// The page.
    pub page: PathBuf,
}

/// What the page shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PageOutcome {
    /// Points in every frame.
    pub points: usize,
    /// Frames.
    pub frames: usize,
    /// Size of the page.
    pub bytes: usize,
}

/// What the script needs to know besides the points.
#[derive(Serialize)]
struct PageHeader {
    points: usize,
    frames: usize,
    times_s: Vec<f64>,
    frame_rate_hz: f64,
    /// Box of all points in all frames [m]; positions are fractions of it.
    low: [f64; 3],
    high: [f64; 3],
    point_radius_m: f64,
    up: [f64; 3],
    /// Ends of the floor's lines [m].
    floor: Vec<f64>,
    modes: Vec<ColorMode>,
}

/// A meaning of the colours; `kind` 0 is the points' own colour, 1 stress, 2 speed.
#[derive(Serialize)]
struct ColorMode {
    name: &'static str,
    kind: u8,
    legend: String,
}

/// Writes the page.
///
/// # Errors
/// A folder without frames, damaged files, an unwritable page.
pub fn view(request: &PageRequest, events: &Events, interrupt: &Interrupt) -> Result<PageOutcome> {
    let motion = SimulatedMotion::open(&request.frames)?;
    let count = motion.trajectory.frames.len();
    events.send(&Event::StageStarted { stage: STAGE.into(), reason: format!("{count} frames") });
    let meter = ResourceMeter::start();
    let skins = particle_splats::skins_or_warning(&motion, STAGE, events);
    let points = PagePoints::read(&motion, skins, &mut |index| {
        events.step(STAGE, "", index as u64 + 1, Some(count as u64), &[]);
        interrupt.requested()
    })?;
    let scales = [Coloring::Stress, Coloring::Speed].map(|coloring| ColorScale::new(coloring, &motion.trajectory));
    let bytes = points.encode(&scales);
    let head = head(&motion, &points, &scales);
    let title = motion.trajectory.twin.pointer("/material/model").and_then(|m| m.as_str()).unwrap_or("twin");
    let json = gic_twin::json::text(&head).map_err(ViewError::stage("writing the page"))?;
    // The script last: it holds none of the other marks.
    let page = include_str!("page.html")
        .replace("TITLE", &crate::html::escape(&format!("{title} twin")))
        .replace("HEAD", &json)
        .replace("DATA", &STANDARD.encode(&bytes))
        .replace("SCRIPT", include_str!("page.js"));
    atomic::write(&request.page, page.as_bytes())?;
    events.send(&meter.done(STAGE));
    Ok(PageOutcome { points: points.len(), frames: count, bytes: page.len() })
}

fn head(motion: &SimulatedMotion, points: &PagePoints, scales: &[ColorScale; 2]) -> PageHeader {
    let (low, high) = points.bounds();
    let mut modes = vec![
        ColorMode { name: "stress", kind: 1, legend: scales[0].legend() },
        ColorMode { name: "speed", kind: 2, legend: scales[1].legend() },
    ];
    if points.has_colors() {
        modes.insert(0, ColorMode { name: "appearance", kind: 0, legend: "colour: as in the video".into() });
    }
    PageHeader {
        points: points.len(),
        frames: motion.trajectory.frames.len(),
        times_s: motion.trajectory.frames.iter().map(|frame| frame.time_s).collect(),
        frame_rate_hz: motion.frame_rate_hz(),
        low: low.into(),
        high: high.into(),
        point_radius_m: points.spacing(),
        up: motion.up().into(),
        floor: motion.planes().first().map(|plane| floor(*plane, low, high)).unwrap_or_default(),
        modes,
    }
}

/// Lines on a plane below the middle of a box.
fn floor((point, normal): (DVec3, DVec3), low: DVec3, high: DVec3) -> Vec<f64> {
    let normal = normal.normalize_or(DVec3::Y);
    let (u, v) = normal.any_orthonormal_pair();
    let centre = 0.5 * (low + high);
    let middle = centre - normal * (centre - point).dot(normal);
    let half = 0.75 * (high - low).length();
    let mut ends = Vec::new();
    for i in -FLOOR_LINES..=FLOOR_LINES {
        let offset = half * f64::from(i) / f64::from(FLOOR_LINES);
        for (along, across) in [(u, v), (v, u)] {
            for side in [-half, half] {
                ends.extend((middle + along * side + across * offset).to_array());
            }
        }
    }
    ends
}

/// Where the page of a motion goes if nothing else is said.
pub fn default_page(frames: &Path) -> PathBuf {
    frames.join("view.html")
}
