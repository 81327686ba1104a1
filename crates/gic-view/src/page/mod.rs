//! `gic view`: a motion as one HTML page that needs nothing installed: splats and points in WebGL2, the film behind
//! them, obstacles, a colour bar, time.
//!
//! [`Viewer`] is the part that the report embeds, too.

mod live;
mod matter;
mod obstacles;

use std::path::{Path, PathBuf};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use gic_scene::Scene;
use gic_twin::Interrupt;
use gic_twin::ResourceMeter;
use gic_twin::atomic;
use gic_twin::events::{Event, Events};
use serde::Serialize;

use crate::error::Result;
use crate::render::color_scale::{ColorScale, Coloring};
use crate::render::particle_splats;
use crate::render::simulated_motion::SimulatedMotion;
use crate::template::{self, Template};
use crate::units::Unit;
use crate::video::Video;
pub use live::view_live;
use live::{Live, LiveHeader};
use matter::{MatterHeader, PageMatter};
use obstacles::{PageObstacle, obstacles};

const STAGE: &str = "view";

/// The parts of the viewer, for pages that include `viewer.html` and `viewer.css`. Their context needs `viewer`, a
/// [`Viewer`], and `video`, a [`Video`] as JSON or `null`.
pub const VIEWER_TEMPLATES: [Template; 11] = [
    ("viewer.html", include_str!("viewer/viewer.html")),
    ("viewer.css", include_str!("viewer/viewer.css")),
    ("math.js", include_str!("viewer/math.js")),
    ("matter.js", include_str!("viewer/matter.js")),
    ("shaders.js", include_str!("viewer/shaders.js")),
    ("solids.js", include_str!("viewer/solids.js")),
    ("renderer.js", include_str!("viewer/renderer.js")),
    ("camera.js", include_str!("viewer/camera.js")),
    ("controls.js", include_str!("viewer/controls.js")),
    ("viewer.js", include_str!("viewer/viewer.js")),
    ("live.js", include_str!("live/live.js")),
];

/// What to show, and where to.
#[derive(Clone, Debug)]
pub struct PageRequest {
    /// The page.
    pub page: PathBuf,
}

/// What the page shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PageOutcome {
    /// Splats in every frame.
    pub splats: usize,
    /// Frames.
    pub frames: usize,
    /// Size of the page.
    pub bytes: usize,
}

/// A motion as the viewer's script reads it; by default none at all.
#[derive(Default, Serialize)]
pub struct Viewer {
    /// What the script needs to know besides the matter: JSON.
    head: String,
    /// The matter: bytes, base64.
    data: String,
    /// Splats in every frame.
    pub splats: usize,
    /// Frames.
    pub frames: usize,
    /// The simulator, where the page simulates.
    live: Option<Live>,
}

/// The content of `head`.
#[derive(Serialize)]
struct ViewerHeader {
    matter: MatterHeader,
    times_s: Vec<f64>,
    frame_rate_hz: f64,
    up: [f64; 3],
    bodies: Vec<PageBody>,
    obstacles: Vec<PageObstacle>,
    meanings: Vec<Meaning>,
    live: Option<LiveHeader>,
}

/// A body: its name, and how many of the splats are its own.
#[derive(Serialize)]
struct PageBody {
    name: String,
    splats: usize,
}

/// A meaning of the colours; `kind` 0 is the splats' own colour, 1 stress, 2 speed, 3 bodies.
#[derive(Serialize)]
struct Meaning {
    name: &'static str,
    kind: u8,
    title: &'static str,
    unit: &'static str,
    /// From SI to the unit.
    factor: f64,
    /// Values drawn blue and red, SI; null where the colours measure nothing.
    range: Option<[f64; 2]>,
}

impl Viewer {
    /// Reads the motion; `stage` is whose steps are told.
    ///
    /// # Errors
    /// Damaged files, obstacles that are not valid, an interrupt.
    pub fn of(motion: &SimulatedMotion, stage: &str, events: &Events, interrupt: &Interrupt) -> Result<Self> {
        let frames = motion.trajectory.frames.len();
        let skins = particle_splats::skins_or_warning(motion, stage, events);
        let matter = PageMatter::read(motion, skins.as_deref(), &mut |index| {
            events.step(stage, "matter", index as u64 + 1, Some(frames as u64), &[]);
            Ok(interrupt.check("")?)
        })?;
        let names = motion.continua().into_iter().map(|body| body.name);
        let head = ViewerHeader {
            matter: matter.header(),
            times_s: motion.trajectory.frames.iter().map(|frame| frame.time_s).collect(),
            frame_rate_hz: motion.frame_rate_hz(),
            up: motion.up().into(),
            bodies: names.zip(matter.bodies()).map(|(name, &splats)| PageBody { name, splats }).collect(),
            obstacles: obstacles(&motion.trajectory)?,
            meanings: meanings(motion, matter.has_colors(), matter.bodies().len()),
            live: None,
        };
        let (splats, data) = (head.matter.splats, STANDARD.encode(matter.encode()));
        Ok(Self { head: template::script_json(&head)?, data, splats, frames, live: None })
    }
}

fn meanings(motion: &SimulatedMotion, has_colors: bool, bodies: usize) -> Vec<Meaning> {
    let plain = |name, kind| Meaning { name, kind, title: "", unit: "", factor: 1.0, range: None };
    let measured = |name, kind, coloring, title, unit: fn(f64) -> Unit| {
        let max = ColorScale::new(coloring, &motion.trajectory).max_value();
        let unit = unit(max);
        Meaning { name, kind, title, unit: unit.name, factor: 1.0 / unit.size, range: Some([0.0, max]) }
    };
    let mut meanings = vec![
        measured("stress", 1, Coloring::Stress, "von Mises stress", Unit::pressure),
        measured("speed", 2, Coloring::Speed, "speed", Unit::speed),
    ];
    if bodies > 1 {
        meanings.insert(0, plain("bodies", 3));
    }
    if has_colors {
        meanings.insert(0, plain("appearance", 0));
    }
    meanings
}

/// Writes the page of a motion, with the film behind it where `scene` is given.
///
/// # Errors
/// Damaged files, pictures that cannot be read, an unwritable page.
pub fn view(
    request: &PageRequest,
    motion: &SimulatedMotion,
    scene: Option<&Scene>,
    events: &Events,
    interrupt: &Interrupt,
) -> Result<PageOutcome> {
    let frames = motion.trajectory.frames.len();
    events.send(&Event::StageStarted { stage: STAGE.into(), reason: format!("{frames} frames") });
    let meter = ResourceMeter::start();
    let viewer = Viewer::of(motion, STAGE, events, interrupt)?;
    let video = scene.map(|scene| film(scene, events, interrupt)).transpose()?;
    let video = template::script_json(&video)?;
    let model = motion.trajectory.twin.pointer("/material/model").and_then(|m| m.as_str()).unwrap_or("digital");
    let outcome = write_page(request, format!("{model} twin"), viewer, video)?;
    events.send(&meter.done(STAGE));
    Ok(outcome)
}

/// Fills in the page and writes it; `video` is a [`Video`] as JSON.
fn write_page(request: &PageRequest, title: String, viewer: Viewer, video: String) -> Result<PageOutcome> {
    let (splats, frames) = (viewer.splats, viewer.frames);
    let templates = [&[("page.html", include_str!("viewer/page.html"))], &VIEWER_TEMPLATES[..]].concat();
    let page = template::fill(&templates, &Page { title, viewer, video })?;
    atomic::write(&request.page, page.as_bytes())?;
    Ok(PageOutcome { splats, frames, bytes: page.len() })
}

/// All of a scene's film.
fn film(scene: &Scene, events: &Events, interrupt: &Interrupt) -> Result<Video> {
    let mut video = Video::of(scene);
    for frame in 0..scene.times.len() {
        video.add_frame(scene, frame)?;
        events.step(STAGE, "film", frame as u64 + 1, Some(scene.times.len() as u64), &[]);
        interrupt.check("")?;
    }
    Ok(video)
}

/// The context of the page.
#[derive(Serialize)]
struct Page {
    title: String,
    viewer: Viewer,
    video: String,
}

/// Where the page of a motion goes if nothing else is said.
pub fn default_page(frames: &Path) -> PathBuf {
    frames.join("view.html")
}
