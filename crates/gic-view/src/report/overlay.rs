//! The twin as each camera of the video would have filmed it, and its outline over that of the observed mask.

use gic_continuum::{Appearance, Drawing, agreement, informed_gaussians};
use gic_scene::{Camera, Mask, Picture, Scene, View};
use gic_splat::{Gaussians, RenderSettings, render};
use glam::DVec3;
use image::ExtendedColorType;
use rayon::prelude::*;
use serde::Serialize;

use crate::error::Result;
use crate::skinned_gaussians::SkinnedGaussians;
use crate::video::Thumbnail;

const OBSERVED_RGBA: [u8; 4] = [46, 204, 64, 255];
const TWIN_RGBA: [u8; 4] = [255, 59, 48, 255];
/// What the twin stands before where the scene has no picture without the object.
const BACKDROP_RGB: [f32; 3] = [0.16, 0.17, 0.20];
/// Colour of a twin without colours of its own.
const PLAIN_RGB: [f32; 3] = crate::render::color_scale::PLAIN_RGB;

/// One camera's view of the twin in a frame.
#[derive(Serialize)]
pub struct Overlay {
    /// Overlap of the observed and the re-rendered mask (intersection over union).
    pub iou: f64,
    /// The twin over the scene without the object, JPEG, base64.
    twin: String,
    /// The outlines of the observed mask and of the twin, otherwise clear; PNG, base64.
    outlines: String,
}

/// How the twin is drawn.
pub struct TwinDrawing {
    /// The points that make its outline, and their size.
    pub drawing: Drawing,
    /// How these points are drawn.
    pub appearance: Appearance,
    /// Factor on their size that fits the first masks.
    pub factor: f64,
    /// Its colours, where it has any.
    pub skin: Option<SkinnedGaussians>,
    /// What each camera sees without the object, where the scene tells.
    pub backgrounds: Vec<Option<Picture>>,
}

/// What each of `views`, all of one time, shows of the twin; `masks` are theirs, `positions` [m] those of the twin's
/// particles at that time.
///
/// # Errors
/// Pictures that cannot be encoded.
pub fn overlays(
    scene: &Scene,
    drawn: &TwinDrawing,
    positions: &[DVec3],
    views: &[(&View, &Mask)],
) -> Result<Vec<Overlay>> {
    let appearance = Appearance { scale: drawn.factor * drawn.appearance.scale, ..drawn.appearance };
    let shape = informed_gaussians(&drawn.drawing.positions(positions), &drawn.drawing.particles, &appearance);
    let skin = drawn.skin.as_ref().map(|skin| skin.visible(positions));
    let overlays = views.par_iter().map(|(view, mask)| {
        let camera = scene.camera_of(view);
        let thumbnail = Thumbnail::of(scene, view.camera);
        let alpha = render(&shape, camera, &RenderSettings::masks()).alpha;
        let iou = agreement(&alpha, &mask.coverage).iou;
        let outlines = outlines(&thumbnail, &mask.coverage, &alpha)?;
        let twin = twin_over(drawn.backgrounds[view.camera].as_ref(), skin.as_ref(), &alpha, camera);
        Ok(Overlay { iou, twin: thumbnail.jpeg_of(&twin)?, outlines })
    });
    overlays.collect()
}

/// The outlines of both masks; the twin's lies above.
fn outlines(thumbnail: &Thumbnail, observed: &[f32], twin: &[f32]) -> Result<String> {
    let inside =
        |mask: &[f32]| -> Vec<bool> { (0..thumbnail.len()).map(|i| thumbnail.mean(i, &|p| mask[p]) >= 0.5).collect() };
    let (observed, twin) = (inside(observed), inside(twin));
    let color = |i: usize| match (is_outline(thumbnail, &twin, i), is_outline(thumbnail, &observed, i)) {
        (true, _) => TWIN_RGBA,
        (false, true) => OBSERVED_RGBA,
        (false, false) => [0; 4],
    };
    thumbnail.png(&(0..thumbnail.len()).flat_map(color).collect::<Vec<u8>>(), ExtendedColorType::Rgba8)
}

/// Whether pixel `i` is inside with a neighbour outside.
fn is_outline(thumbnail: &Thumbnail, inside: &[bool], i: usize) -> bool {
    let (width, height) = (thumbnail.width, thumbnail.height);
    let (x, y) = (i % width, i / width);
    let at_border = x == 0 || y == 0 || x + 1 == width || y + 1 == height;
    inside[i] && (at_border || !(inside[i - 1] && inside[i + 1] && inside[i - width] && inside[i + width]))
}

/// The twin in its own colours over the picture without the object; a twin without colours is its mask.
fn twin_over(background: Option<&Picture>, skin: Option<&Gaussians>, alpha: &[f32], camera: &Camera) -> Picture {
    let rendered = skin.map(|skin| render(skin, camera, &RenderSettings::pictures()));
    let pixels = camera.width * camera.height;
    let mut rgb = Vec::with_capacity(3 * pixels);
    for i in 0..pixels {
        let (color, alpha) = match &rendered {
            Some(rendered) => (rendered.color[i], rendered.alpha[i]),
            None => (PLAIN_RGB.map(|c| c * alpha[i]), alpha[i]),
        };
        let behind = background.map_or(BACKDROP_RGB, |picture| [0, 1, 2].map(|c| picture.rgb[3 * i + c]));
        rgb.extend([0, 1, 2].map(|c| (color[c] + (1.0 - alpha) * behind[c]).clamp(0.0, 1.0)));
    }
    Picture { width: camera.width, height: camera.height, rgb }
}
