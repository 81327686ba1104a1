//! A motion as a recording for the Rerun viewer (.rrd).

use std::path::{Path, PathBuf};

use gic_files::NewFile;
use gic_scene::{Camera, Mask, Scene};
use gic_twin::Interrupt;
use gic_twin::ResourceMeter;
use gic_twin::TwinError;
use gic_twin::events::{Event, Events};
use gic_twin::matter::read_particles;
use image::{ExtendedColorType, ImageEncoder};
use re_sdk::{RecordingStream, RecordingStreamBuilder};
use re_sdk_types::archetypes::{EncodedImage, Pinhole, Points3D, Scalars, Transform3D, ViewCoordinates};

use crate::error::{Result, ViewError};
use crate::render::color_scale::{ColorScale, Coloring, byte_color};
use crate::render::particle_splats;
use crate::render::simulated_motion::{FrameParticles, SimulatedMotion};
use crate::skinned_gaussians::{SkinnedGaussians, colors};

const STAGE: &str = "view";
/// Timelines: of the motion, and of the steps of identification.
const TIME: &str = "time";
const STEP: &str = "identification step";

/// What a recording shows besides the motion, where it is that of a run.
pub struct RunEvidence {
    /// The scene.
    pub scene: Scene,
    /// The file of the surface that was found in each of the scene's frames; missing files are left out.
    pub surfaces: Vec<PathBuf>,
    /// Curves over the steps of identification.
    pub curves: Vec<Curve>,
}

/// A number over the steps of identification.
pub struct Curve {
    /// Its place among the recording's entities.
    pub entity: String,
    /// (step, value).
    pub points: Vec<(i64, f64)>,
}

/// Writes the recording: particles and colours of the motion; of a run also cameras, pictures, masks, surfaces and
/// curves. Rerun stamps it with the time of day, so that its bytes differ from run to run.
///
/// # Errors
/// Damaged files, an unwritable file, an interrupt.
pub fn record(
    motion: &SimulatedMotion,
    run: Option<&RunEvidence>,
    file: &Path,
    events: &Events,
    interrupt: &Interrupt,
) -> Result<()> {
    events.send(&Event::StageStarted { stage: STAGE.into(), reason: format!("recording to {}", file.display()) });
    let meter = ResourceMeter::start();
    let new = NewFile::at(file).map_err(TwinError::from)?;
    let stream = RecordingStreamBuilder::new("gic").save(new.part()).map_err(failed)?;
    let up = motion.up();
    let coordinates = match up.abs().max_position() {
        0 if up.x > 0.0 => ViewCoordinates::RIGHT_HAND_X_UP(),
        0 => ViewCoordinates::RIGHT_HAND_X_DOWN(),
        1 if up.y > 0.0 => ViewCoordinates::RIGHT_HAND_Y_UP(),
        1 => ViewCoordinates::RIGHT_HAND_Y_DOWN(),
        _ if up.z > 0.0 => ViewCoordinates::RIGHT_HAND_Z_UP(),
        _ => ViewCoordinates::RIGHT_HAND_Z_DOWN(),
    };
    stream.log_static("world", &coordinates).map_err(failed)?;
    twin(&stream, motion, events, interrupt)?;
    if let Some(run) = run {
        video(&stream, run, interrupt)?;
        curves(&stream, &run.curves)?;
    }
    stream.flush_blocking().map_err(failed)?;
    // Closes the file.
    drop(stream);
    new.finish().map_err(TwinError::from)?;
    events.send(&meter.done(STAGE));
    Ok(())
}

fn failed<E: Into<Box<dyn std::error::Error + Send + Sync>>>(error: E) -> ViewError {
    ViewError::stage("writing the recording")(error)
}

/// Particles in the colours of their stress, and in their own where the twin has some.
fn twin(stream: &RecordingStream, motion: &SimulatedMotion, events: &Events, interrupt: &Interrupt) -> Result<()> {
    let stress = ColorScale::new(Coloring::Stress, &motion.trajectory);
    let skins = particle_splats::skins_or_warning(motion, STAGE, events);
    let count = motion.trajectory.frames.len();
    let mut radius = None;
    for (index, frame) in motion.trajectory.frames.iter().enumerate() {
        interrupt.check("")?;
        stream.set_duration_secs(TIME, frame.time_s);
        let particles = motion.particles(index)?;
        let radius = *radius.get_or_insert_with(|| 0.5 * particles.spacing() as f32);
        let points = Points3D::new(particles.positions.iter().map(|p| p.as_vec3().to_array()))
            .with_colors(stress.colors(&particles).into_iter().map(byte_color))
            .with_radii([radius]);
        stream.log("world/twin/stress", &points).map_err(failed)?;
        if let Some(skins) = &skins {
            stream.log("world/twin/colours", &colored(skins, &particles)).map_err(failed)?;
        }
        events.step(STAGE, "", index as u64 + 1, Some(count as u64), &[]);
    }
    Ok(())
}

fn colored(skins: &[(usize, SkinnedGaussians)], particles: &FrameParticles) -> Points3D {
    let (mut positions, mut rgb, mut radii) = (Vec::new(), Vec::new(), Vec::new());
    let mut start = 0;
    for (count, skin) in skins {
        let drawn = skin.visible(&particles.positions[start..start + count]);
        rgb.extend(colors(&drawn).map(byte_color));
        radii.resize(radii.len() + drawn.len(), 0.5 * skin.spacing() as f32);
        positions.extend(drawn.positions);
        start += count;
    }
    Points3D::new(positions).with_colors(rgb).with_radii(radii)
}

/// Cameras, pictures, masks, and the surfaces that were extracted from them.
fn video(stream: &RecordingStream, run: &RunEvidence, interrupt: &Interrupt) -> Result<()> {
    let scene = &run.scene;
    let place = |camera: usize| format!("world/cameras/{}", scene.camera_names[camera]);
    for (index, camera) in scene.cameras.iter().enumerate() {
        let [x, y, z] =
            [camera.world_from_camera.x_axis, camera.world_from_camera.y_axis, camera.world_from_camera.z_axis];
        let pose = Transform3D::from_translation_mat3x3(
            camera.centre.as_vec3().to_array(),
            [x, y, z].map(|axis| axis.as_vec3().to_array()),
        );
        stream.log_static(place(index), &[&pose as &dyn re_sdk::AsComponents, &pinhole(camera)]).map_err(failed)?;
    }
    for (frame, &time) in scene.times.iter().enumerate() {
        interrupt.check("")?;
        stream.set_duration_secs(TIME, time);
        let views = scene.views_at(frame);
        let masks = scene.load_masks(views).map_err(ViewError::stage("reading masks"))?;
        for (view, mask) in views.iter().zip(masks) {
            let picture = EncodedImage::from_file(&view.picture).map_err(TwinError::read(&view.picture))?;
            stream.log(format!("{}/picture", place(view.camera)), &picture).map_err(failed)?;
            let mask = EncodedImage::from_file_contents(png(&mask)?).with_media_type("image/png").with_opacity(0.5);
            stream.log(format!("{}/mask", place(view.camera)), &mask).map_err(failed)?;
        }
        // Frames that were not fitted to have none.
        if let Some(surface) = run.surfaces.get(frame).filter(|file| file.exists()) {
            let points = read_particles(surface)?.positions;
            let points = Points3D::new(points.iter().map(|p| p.as_vec3().to_array())).with_colors([[46, 204, 64]]);
            stream.log("world/surface", &points).map_err(failed)?;
        }
    }
    Ok(())
}

fn pinhole(camera: &Camera) -> Pinhole {
    Pinhole::from_focal_length_and_resolution(
        camera.focal.as_vec2().to_array(),
        [camera.width as f32, camera.height as f32],
    )
    .with_principal_point(camera.principal.as_vec2().to_array())
}

fn png(mask: &Mask) -> Result<Vec<u8>> {
    let grey: Vec<u8> = mask.coverage.iter().map(|c| (c * 255.0).round() as u8).collect();
    let mut png = Vec::new();
    image::codecs::png::PngEncoder::new(&mut png)
        .write_image(&grey, mask.width as u32, mask.height as u32, ExtendedColorType::L8)
        .map_err(failed)?;
    Ok(png)
}

/// What identification found on its way.
fn curves(stream: &RecordingStream, curves: &[Curve]) -> Result<()> {
    stream.reset_time();
    for curve in curves {
        for &(step, value) in &curve.points {
            stream.set_time_sequence(STEP, step);
            stream.log(curve.entity.as_str(), &Scalars::single(value)).map_err(failed)?;
        }
    }
    Ok(())
}
