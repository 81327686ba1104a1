//! A motion as a Rerun recording (.rrd).

use std::path::Path;

use gic_scene::{Camera, Mask, Scene};
use image::{ExtendedColorType, ImageEncoder};
use re_sdk::{RecordingStream, RecordingStreamBuilder};
use re_sdk_types::archetypes::{EncodedImage, Pinhole, Points3D, Scalars, Transform3D, ViewCoordinates};

use super::STAGE;
use crate::atomic;
use crate::config::{Config, Layer};
use crate::error::{Error, Result};
use crate::events::{Event, Events};
use crate::interrupt::Interrupt;
use crate::look::{Look, colors};
use crate::matter::read_particles;
use crate::pipeline::{IdentifyRecord, open_scene, surface_file};
use crate::render::color::{Coloring, Scale};
use crate::render::frames::{Motion, Particles};
use crate::render::paint;
use crate::usage::Meter;

/// Timelines: of the motion, and of the steps of identification.
const TIME: &str = "time";
const STEP: &str = "identification step";

/// Writes the recording. Rerun stamps it with the time of day, so that its bytes differ from run to run.
pub(super) fn record(frames: &Path, file: &Path, events: &Events, interrupt: &Interrupt) -> Result<()> {
    let motion = Motion::open(frames)?;
    events.send(&Event::StageStarted { stage: STAGE.into(), reason: format!("recording to {}", file.display()) });
    let meter = Meter::start();
    let part = file.with_extension("part.rrd");
    let stream = RecordingStreamBuilder::new("gic").save(&part).map_err(failed)?;
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
    twin(&stream, &motion, events, interrupt)?;
    if let Some(run) = &motion.run {
        let scene = open_scene(&Config::resolve(vec![Layer::read(&run.join("config.toml"))?])?)?;
        video(&stream, &scene, run, interrupt)?;
        curves(&stream, &atomic::read_json(&run.join("identify.json"))?)?;
    }
    stream.flush_blocking().map_err(failed)?;
    // Closes the file.
    drop(stream);
    std::fs::rename(&part, file).map_err(Error::write(file))?;
    events.send(&meter.done(STAGE));
    Ok(())
}

fn failed<E: Into<Box<dyn std::error::Error + Send + Sync>>>(error: E) -> Error {
    Error::stage("writing the recording")(error)
}

fn check(interrupt: &Interrupt) -> Result<()> {
    if interrupt.requested() {
        return Err(Error::Interrupted { after: String::new(), resume: "run the same command again".into() });
    }
    Ok(())
}

/// Particles in the colours of their stress, and in their own where the twin has some.
fn twin(stream: &RecordingStream, motion: &Motion, events: &Events, interrupt: &Interrupt) -> Result<()> {
    let stress = Scale::new(Coloring::Stress, &motion.trajectory);
    let looks = paint::looks(motion).ok();
    let count = motion.trajectory.frames.len();
    let mut radius = None;
    for (index, frame) in motion.trajectory.frames.iter().enumerate() {
        check(interrupt)?;
        stream.set_duration_secs(TIME, frame.time_s);
        let particles = motion.particles(index)?;
        let radius = *radius.get_or_insert_with(|| 0.5 * particles.spacing() as f32);
        let points = Points3D::new(particles.positions.iter().map(|p| p.as_vec3().to_array()))
            .with_colors(stress.colors(&particles).into_iter().map(bytes))
            .with_radii([radius]);
        stream.log("world/twin/stress", &points).map_err(failed)?;
        if let Some(looks) = &looks {
            stream.log("world/twin/colours", &colored(looks, &particles)).map_err(failed)?;
        }
        events.step(STAGE, "", index as u64 + 1, Some(count as u64), &[]);
    }
    Ok(())
}

fn colored(looks: &[(usize, Look)], particles: &Particles) -> Points3D {
    let (mut positions, mut rgb, mut radii) = (Vec::new(), Vec::new(), Vec::new());
    let mut start = 0;
    for (count, look) in looks {
        let drawn = look.visible(&particles.positions[start..start + count]);
        rgb.extend(colors(&drawn).map(bytes));
        radii.resize(radii.len() + drawn.len(), 0.5 * look.spacing() as f32);
        positions.extend(drawn.positions);
        start += count;
    }
    Points3D::new(positions).with_colors(rgb).with_radii(radii)
}

fn bytes(color: [f32; 3]) -> [u8; 3] {
    color.map(|c| (c.clamp(0.0, 1.0) * 255.0).round() as u8)
}

/// Cameras, pictures, masks, and the surfaces that were extracted from them.
fn video(stream: &RecordingStream, scene: &Scene, run: &Path, interrupt: &Interrupt) -> Result<()> {
    let place = |camera: usize| format!("world/cameras/{}", scene.camera_names[camera]);
    for (index, camera) in scene.cameras.iter().enumerate() {
        let [x, y, z] = [camera.rotation.x_axis, camera.rotation.y_axis, camera.rotation.z_axis];
        let pose = Transform3D::from_translation_mat3x3(
            camera.centre.as_vec3().to_array(),
            [x, y, z].map(|axis| axis.as_vec3().to_array()),
        );
        stream.log_static(place(index), &[&pose as &dyn re_sdk::AsComponents, &pinhole(camera)]).map_err(failed)?;
    }
    for (frame, &time) in scene.times.iter().enumerate() {
        check(interrupt)?;
        stream.set_duration_secs(TIME, time);
        let views = scene.views_at(frame);
        let masks = scene.load_masks(views).map_err(Error::stage("reading masks"))?;
        for (view, mask) in views.iter().zip(masks) {
            let picture = EncodedImage::from_file(&view.picture).map_err(Error::read(&view.picture))?;
            stream.log(format!("{}/picture", place(view.camera)), &picture).map_err(failed)?;
            let mask = EncodedImage::from_file_contents(png(&mask)?).with_media_type("image/png").with_opacity(0.5);
            stream.log(format!("{}/mask", place(view.camera)), &mask).map_err(failed)?;
        }
        // Frames that were not fitted to have none.
        let surface = run.join(surface_file(frame));
        if surface.exists() {
            let points = read_particles(&surface)?.positions;
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
fn curves(stream: &RecordingStream, found: &IdentifyRecord) -> Result<()> {
    stream.reset_time();
    for (index, step) in found.trace.iter().enumerate() {
        stream.set_time_sequence(STEP, index as i64);
        stream.log(format!("identify/objective/{}", step.stage), &Scalars::single(step.objective)).map_err(failed)?;
        for (estimate, value) in found.estimates.iter().zip(&step.values) {
            stream.log(format!("identify/{}", estimate.name), &Scalars::single(*value)).map_err(failed)?;
        }
    }
    Ok(())
}
