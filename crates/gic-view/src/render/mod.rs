//! `gic render`: pictures of a simulated motion, from a camera of the scene or from an orbit, as PNG files and as a
//! film.

pub(crate) mod color_scale;
mod film;
mod fixed_camera;
mod labels;
mod lettering;
mod obstacle_points;
pub(crate) mod particle_splats;
mod shade;
mod shadow;
pub(crate) mod simulated_motion;
mod viewpoint;

use std::path::PathBuf;

use gic_scene::{Picture, Scene};
use gic_twin::Interrupt;
use gic_twin::ResourceMeter;
use gic_twin::atomic;
use gic_twin::events::{Event, Events};
use rayon::prelude::*;

pub use color_scale::Coloring;
pub use film::FilmEncoder;
pub use fixed_camera::FixedCameraRenderer;
use obstacle_points::Obstacles;
use particle_splats::ParticleSplats;
use shadow::FloorShadow;
pub use simulated_motion::{FrameParticles, SimulatedMotion};
pub use viewpoint::{Viewpoint, ViewpointError};

use crate::error::{Result, ViewError};

const STAGE: &str = "render";
/// What lies behind the matter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Background {
    /// Black.
    Black,
    /// White.
    White,
    /// The ground planes of the simulation as a chequered floor, over light grey.
    Floor,
    /// The camera's own picture of the empty scene.
    Picture,
}

/// What to render, and where to.
#[derive(Clone, Debug)]
pub struct RenderRequest {
    /// Folder for the pictures.
    pub out: PathBuf,
    /// From where.
    pub viewpoint: Viewpoint,
    /// What lies behind.
    pub background: Background,
    /// Meaning of the colours.
    pub coloring: Coloring,
    /// Put the video's picture to the left of each picture; needs a camera of the scene.
    pub beside_video: bool,
    /// Width and height [pixels] of pictures from an orbit.
    pub size: [usize; 2],
    /// A film besides the pictures: .gif, .mp4 or .webp.
    pub film: Option<PathBuf>,
    /// How many times slower than life the film runs.
    pub slow_motion: f64,
    /// How many frames of the film the motion was fitted to; later ones are marked as predicted. `None` of a motion
    /// that was not.
    pub fitted_frames: Option<usize>,
    /// Whether time and colour bar are written into the pictures.
    pub labels: bool,
}

/// What was rendered.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderOutcome {
    /// Number of pictures.
    pub frames: usize,
    /// What the colours mean, in a sentence.
    pub legend: String,
    /// How the film was made, if one was asked for.
    pub film: Option<String>,
}

/// Renders every frame of a motion; `scene` has the cameras, and only an orbit does without.
///
/// # Errors
/// A camera or background that the scene does not have, unwritable files, a film that cannot be
/// encoded here.
pub fn render(
    request: &RenderRequest,
    motion: &SimulatedMotion,
    scene: Option<&Scene>,
    events: &Events,
    interrupt: &Interrupt,
) -> Result<RenderOutcome> {
    let film = request.film.as_deref().map(|path| film::FilmEncoder::of(path, request.slow_motion)).transpose()?;
    let view = viewpoint::CameraPath::new(request, motion, scene)?;
    let environment = view.environment(motion, request.background);
    let first = motion.particles(0)?;
    let splats = ParticleSplats::new(request.coloring, motion, &first)?;
    let spacing = first.spacing();
    let obstacles = Obstacles::of(&motion.trajectory, splats.spacing())?;
    atomic::create_folder(&request.out)?;
    let count = motion.trajectory.frames.len();
    events.send(&Event::StageStarted { stage: STAGE.into(), reason: format!("{count} frames") });
    let meter = ResourceMeter::start();
    let draw = |index: usize| -> Result<Picture> {
        let later = if index > 0 { Some(motion.particles(index)?) } else { None };
        let mut gaussians = splats.gaussians(later.as_ref().unwrap_or(&first));
        splats.add_obstacles(&mut gaussians, &obstacles.at(motion.trajectory.frames[index].time_s));
        let camera = view.camera(index);
        let rendered = gic_splat::render(&gaussians, camera, &splats.settings());
        let positions = &later.as_ref().unwrap_or(&first).positions;
        let shadow = environment.backdrop.first_plane().and_then(|plane| FloorShadow::of(positions, spacing, plane));
        let mut picture = shade::compose(&rendered, camera, &environment, splats.is_lit(), shadow.as_ref());
        if request.labels {
            let predicted = request.fitted_frames.is_some_and(|fitted| index >= fitted);
            let moment = labels::Moment { time_s: motion.trajectory.frames[index].time_s, predicted };
            labels::label(&mut picture, splats.scale(), Some(moment));
        }
        if request.beside_video {
            picture = beside(&view.video(motion.trajectory.frames[index].time_s)?, &picture);
        }
        picture.save_png(&request.out.join(format!("frame_{index:04}.png"))).map_err(ViewError::stage(STAGE))?;
        Ok(picture)
    };
    let mut pictures = Vec::new();
    // A frame's work is partly serial, so several are made at once.
    for batch in (0..count).collect::<Vec<_>>().chunks(rayon::current_num_threads()) {
        interrupt.check(format_args!("{} of {count} pictures", batch[0]))?;
        let drawn = batch.par_iter().map(|&index| draw(index)).collect::<Result<Vec<_>>>()?;
        if film.is_some() {
            pictures.extend(drawn);
        }
        events.step(STAGE, "", (batch[0] + batch.len()) as u64, Some(count as u64), &[]);
    }
    let film = film.map(|film| film.write(&pictures, motion.frame_rate_hz())).transpose()?;
    events.send(&meter.done(STAGE));
    Ok(RenderOutcome { frames: count, legend: splats.legend(), film })
}

/// Two pictures of the same height, side by side.
fn beside(left: &Picture, right: &Picture) -> Picture {
    let rows = left.rgb.chunks_exact(3 * left.width).zip(right.rgb.chunks_exact(3 * right.width));
    Picture {
        width: left.width + right.width,
        height: left.height.min(right.height),
        rgb: rows.flat_map(|(l, r)| l.iter().chain(r)).copied().collect(),
    }
}
