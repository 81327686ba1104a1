//! Pictures of the video with the outlines of the observed and the re-rendered mask, and of the twin in its colours.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use gic_continuum::{Appearance, Drawing, agreement, informed_gaussians};
use gic_scene::{Camera, Mask, Picture, Scene};
use gic_splat::{Gaussians, RenderSettings, render};
use glam::DVec3;
use image::codecs::jpeg::JpegEncoder;
use serde::Serialize;

use crate::error::{Result, ViewError};
use crate::skinned_gaussians::SkinnedGaussians;

/// Pictures are reduced to at most this width [pixels].
const THUMBNAIL_WIDTH_PX: usize = 280;
const JPEG_QUALITY: u8 = 70;
const OBSERVED_RGB: [u8; 3] = [46, 204, 64];
const TWIN_RGB: [u8; 3] = [255, 59, 48];

/// One camera's view of a frame.
#[derive(Serialize)]
pub struct Overlay {
    /// The video's picture with both outlines, JPEG, base64.
    jpeg: String,
    /// Overlap of both masks.
    pub iou: f64,
    /// The twin in its own colours over black, JPEG, base64.
    #[serde(rename = "look")]
    colored: Option<String>,
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
}

/// Every camera's view of a frame, in the order of the cameras; `None` where a camera has no picture. `positions` [m]
/// are those of the twin's particles.
pub fn overlays(scene: &Scene, drawn: &TwinDrawing, positions: &[DVec3], frame: usize) -> Result<Vec<Option<Overlay>>> {
    let views = scene.views_at(frame);
    let loaded = scene.load_all(views).map_err(ViewError::stage("reading pictures"))?;
    let appearance = Appearance { scale: drawn.factor * drawn.appearance.scale, ..drawn.appearance };
    let shape = informed_gaussians(&drawn.drawing.positions(positions), &drawn.drawing.particles, &appearance);
    let skin = drawn.skin.as_ref().map(|skin| skin.visible(positions));
    let mut found: Vec<Option<Overlay>> = scene.cameras.iter().map(|_| None).collect();
    for (view, (picture, mask)) in views.iter().zip(loaded) {
        let camera = scene.camera_of(view);
        let alpha = render(&shape, camera, &RenderSettings::masks()).alpha;
        let iou = agreement(&alpha, &mask.coverage).iou;
        let twin = Mask { width: mask.width, height: mask.height, coverage: alpha };
        let colored = skin.as_ref().map(|skin| colored(skin, camera)).transpose()?;
        found[view.camera] = Some(Overlay { jpeg: outlined(&picture, &mask, &twin)?, iou, colored });
    }
    Ok(found)
}

/// The video's picture with the outlines of both masks.
fn outlined(picture: &Picture, mask: &Mask, twin: &Mask) -> Result<String> {
    let thumbnail = Thumbnail::of(picture.width, picture.height);
    let inside = |mask: &Mask| -> Vec<bool> {
        (0..thumbnail.width * thumbnail.height).map(|i| thumbnail.mean(i, &|p| mask.coverage[p]) >= 0.5).collect()
    };
    let (observed, twin) = (inside(mask), inside(twin));
    thumbnail.encode(|i| match (thumbnail.is_outline(&twin, i), thumbnail.is_outline(&observed, i)) {
        (true, _) => TWIN_RGB,
        (false, true) => OBSERVED_RGB,
        (false, false) => [0, 1, 2].map(|c| byte(thumbnail.mean(i, &|p| picture.rgb[3 * p + c]))),
    })
}

/// The twin in its own colours, over black.
fn colored(skin: &Gaussians, camera: &Camera) -> Result<String> {
    let thumbnail = Thumbnail::of(camera.width, camera.height);
    let color = render(skin, camera, &RenderSettings::pictures()).color;
    thumbnail.encode(|i| [0, 1, 2].map(|c| byte(thumbnail.mean(i, &|p| color[p][c].clamp(0.0, 1.0)))))
}

fn byte(value: f32) -> u8 {
    (255.0 * value).round() as u8
}

/// How the report shows a picture: every `factor` x `factor` pixels as one.
struct Thumbnail {
    factor: usize,
    width: usize,
    height: usize,
    /// Width of the picture itself [pixels].
    full_width: usize,
}

impl Thumbnail {
    fn of(width: usize, height: usize) -> Thumbnail {
        let factor = width.div_ceil(THUMBNAIL_WIDTH_PX).max(1);
        Thumbnail { factor, width: width / factor, height: height / factor, full_width: width }
    }

    /// Mean of what the pixels have that become pixel `i`.
    fn mean(&self, i: usize, value: &dyn Fn(usize) -> f32) -> f32 {
        let (x, y) = (i % self.width * self.factor, i / self.width * self.factor);
        let mut sum = 0.0;
        for row in y..y + self.factor {
            for column in x..x + self.factor {
                sum += value(row * self.full_width + column);
            }
        }
        sum / (self.factor * self.factor) as f32
    }

    /// Whether pixel `i` is inside with a neighbour outside.
    fn is_outline(&self, inside: &[bool], i: usize) -> bool {
        let (x, y) = (i % self.width, i / self.width);
        let at_border = x == 0 || y == 0 || x + 1 == self.width || y + 1 == self.height;
        inside[i]
            && (at_border || !(inside[i - 1] && inside[i + 1] && inside[i - self.width] && inside[i + self.width]))
    }

    /// JPEG, base64, of a colour per pixel.
    fn encode(&self, color: impl Fn(usize) -> [u8; 3]) -> Result<String> {
        let bytes: Vec<u8> = (0..self.width * self.height).flat_map(color).collect();
        let mut jpeg = Vec::new();
        JpegEncoder::new_with_quality(&mut jpeg, JPEG_QUALITY)
            .encode(&bytes, self.width as u32, self.height as u32, image::ExtendedColorType::Rgb8)
            .map_err(ViewError::stage("encoding a picture of the report"))?;
        Ok(STANDARD.encode(jpeg))
    }
}
