//! Pictures of the video with the outlines of the observed and the re-rendered mask.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use gic_continuum::{Appearance, Drawing, agreement, informed_gaussians};
use gic_scene::{Mask, Picture};
use gic_splat::{RenderSettings, render};
use glam::DVec3;
use image::codecs::jpeg::JpegEncoder;
use serde::Serialize;

use crate::error::{Error, Result};
use crate::pipeline::Run;

/// Pictures are reduced to at most this width [pixels].
const WIDTH: usize = 280;
const QUALITY: u8 = 70;
const OBSERVED: [u8; 3] = [46, 204, 64];
const TWIN: [u8; 3] = [255, 59, 48];

/// One picture of the report.
#[derive(Serialize)]
pub(super) struct Overlay {
    /// The picture, JPEG, base64.
    jpeg: String,
    /// Overlap of both masks.
    iou: f64,
}

/// Every camera's view of a frame, in the order of the cameras; `None` where a camera has no picture.
pub(super) fn overlays(
    run: &Run,
    (drawing, drawn): &(Drawing, Appearance),
    factor: f64,
    positions: &[DVec3],
    frame: usize,
) -> Result<Vec<Option<Overlay>>> {
    let scene = run.video();
    let views = scene.views_at(frame);
    let loaded = scene.load_all(views).map_err(Error::stage("reading pictures"))?;
    let appearance = Appearance { scale: factor * drawn.scale, ..*drawn };
    let gaussians = informed_gaussians(&drawing.positions(positions), &drawing.particles, &appearance);
    let mut found: Vec<Option<Overlay>> = scene.cameras.iter().map(|_| None).collect();
    for (view, (picture, mask)) in views.iter().zip(loaded) {
        let alpha = render(&gaussians, scene.camera_of(view), &RenderSettings::masks()).alpha;
        let iou = agreement(&alpha, &mask.coverage).iou;
        let twin = Mask { width: mask.width, height: mask.height, coverage: alpha };
        found[view.camera] = Some(Overlay { jpeg: draw(&picture, &mask, &twin)?, iou });
    }
    Ok(found)
}

fn draw(picture: &Picture, mask: &Mask, twin: &Mask) -> Result<String> {
    let factor = picture.width.div_ceil(WIDTH).max(1);
    let (width, height) = (picture.width / factor, picture.height / factor);
    let pixels = (factor * factor) as f32;
    let mean = |x: usize, y: usize, value: &dyn Fn(usize) -> f32| {
        let mut sum = 0.0;
        for dy in 0..factor {
            for dx in 0..factor {
                sum += value((y * factor + dy) * picture.width + x * factor + dx);
            }
        }
        sum / pixels
    };
    let reduce = |mask: &Mask| -> Vec<bool> {
        let inside = |i: usize| mean(i % width, i / width, &|p| mask.coverage[p]) >= 0.5;
        (0..width * height).map(inside).collect()
    };
    let (observed, twin) = (reduce(mask), reduce(twin));
    let mut bytes = Vec::with_capacity(3 * width * height);
    for y in 0..height {
        for x in 0..width {
            let colour = match (outline(&twin, width, height, x, y), outline(&observed, width, height, x, y)) {
                (true, _) => TWIN,
                (false, true) => OBSERVED,
                (false, false) => [0, 1, 2].map(|c| (255.0 * mean(x, y, &|p| picture.rgb[3 * p + c])).round() as u8),
            };
            bytes.extend(colour);
        }
    }
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, QUALITY)
        .encode(&bytes, width as u32, height as u32, image::ExtendedColorType::Rgb8)
        .map_err(Error::stage("encoding a picture of the report"))?;
    Ok(STANDARD.encode(jpeg))
}

/// Whether a pixel is inside with a neighbour outside.
fn outline(inside: &[bool], width: usize, height: usize, x: usize, y: usize) -> bool {
    let at = |x: usize, y: usize| inside[y * width + x];
    at(x, y)
        && (x == 0
            || y == 0
            || x + 1 == width
            || y + 1 == height
            || !(at(x - 1, y) && at(x + 1, y) && at(x, y - 1) && at(x, y + 1)))
}
