//! The video's pictures and masks, small enough for a page, with the cameras that took them.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use gic_scene::{Camera, Mask, Picture, Scene, View};
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use rayon::prelude::*;
use serde::Serialize;

use crate::error::{Result, ViewError};

/// Widest picture in a page [pixels]. Budget: as wide as a page shows it.
const MAX_WIDTH_PX: usize = 640;
/// Pixels of one kind of picture in a page, over all cameras and frames. Budget: about 6 MB of JPEG.
const MAX_PIXELS: usize = 40_000_000;
const JPEG_QUALITY: u8 = 78;

/// All of the video that a page shows.
#[derive(Serialize)]
pub struct Video {
    /// Time of each frame [s].
    pub times_s: Vec<f64>,
    /// The cameras.
    pub cameras: Vec<VideoCamera>,
}

/// A camera, its pictures and its masks.
#[derive(Serialize)]
pub struct VideoCamera {
    /// What the scene calls it.
    pub name: String,
    /// Width and height of what it filmed [pixels]; pictures in the page are smaller by a whole number.
    size_px: [usize; 2],
    focal_px: [f64; 2],
    principal_px: [f64; 2],
    /// The camera's axes (right, down, forward) in the world, one after the other.
    axes: [[f64; 3]; 3],
    centre_m: [f64; 3],
    /// Per frame; null where it has no picture.
    pub shots: Vec<Option<Shot>>,
}

/// A picture of the video.
#[derive(Serialize)]
pub struct Shot {
    /// JPEG, base64.
    picture: String,
    /// Coverage of the object as grey, PNG, base64.
    mask: String,
}

impl Video {
    /// The cameras of a scene, without a frame yet.
    pub fn of(scene: &Scene) -> Self {
        let names = scene.camera_names.iter().zip(&scene.cameras);
        let cameras = names.map(|(name, camera)| VideoCamera::new(name, camera)).collect();
        Self { times_s: scene.times.clone(), cameras }
    }

    /// Reads the next frame of the scene; returns the masks of its views.
    ///
    /// # Errors
    /// Pictures that cannot be read.
    pub fn add_frame(&mut self, scene: &Scene, frame: usize) -> Result<Vec<Mask>> {
        let views = scene.views_at(frame);
        let read: Vec<(Shot, Mask)> = views
            .par_iter()
            .map(|view| {
                let (picture, mask) = scene.load(view).map_err(ViewError::stage("reading pictures"))?;
                Ok((Shot::new(&Thumbnail::of(scene, view.camera), &picture, &mask)?, mask))
            })
            .collect::<Result<_>>()?;
        self.cameras.iter_mut().for_each(|camera| camera.shots.push(None));
        let place = |(view, (shot, mask)): (&View, (Shot, Mask))| {
            self.cameras[view.camera].shots[frame] = Some(shot);
            mask
        };
        Ok(views.iter().zip(read).map(place).collect())
    }
}

impl VideoCamera {
    fn new(name: &str, camera: &Camera) -> Self {
        Self {
            name: name.to_owned(),
            size_px: [camera.width, camera.height],
            focal_px: camera.focal.to_array(),
            principal_px: camera.principal.to_array(),
            axes: [camera.world_from_camera.x_axis, camera.world_from_camera.y_axis, camera.world_from_camera.z_axis]
                .map(|axis| axis.to_array()),
            centre_m: camera.centre.to_array(),
            shots: Vec::new(),
        }
    }
}

impl Shot {
    fn new(thumbnail: &Thumbnail, picture: &Picture, mask: &Mask) -> Result<Self> {
        let grey: Vec<u8> = (0..thumbnail.len()).map(|i| byte(thumbnail.mean(i, &|p| mask.coverage[p]))).collect();
        Ok(Self { picture: thumbnail.jpeg_of(picture)?, mask: thumbnail.png(&grey, ExtendedColorType::L8)? })
    }
}

/// A value in [0, 1] as a byte.
pub(crate) fn byte(value: f32) -> u8 {
    (255.0 * value.clamp(0.0, 1.0)).round() as u8
}

/// How a page shows a picture: every `factor` x `factor` pixels as one.
pub(crate) struct Thumbnail {
    factor: usize,
    /// Width [pixels].
    pub(crate) width: usize,
    /// Height [pixels].
    pub(crate) height: usize,
    /// Width of the picture itself [pixels].
    full_width: usize,
}

impl Thumbnail {
    /// For the pictures of a camera: the largest with which all pictures of the scene fit into a page.
    pub(crate) fn of(scene: &Scene, camera: usize) -> Self {
        let Camera { width, height, .. } = scene.cameras[camera];
        let pixels = scene.views.len() * width * height;
        let shrink = (pixels as f64 / MAX_PIXELS as f64).sqrt().ceil() as usize;
        let factor = width.div_ceil(MAX_WIDTH_PX).max(shrink).max(1).min(width.min(height));
        Self { factor, width: width / factor, height: height / factor, full_width: width }
    }

    /// Number of its pixels.
    pub(crate) fn len(&self) -> usize {
        self.width * self.height
    }

    /// Mean of what the pixels have that become pixel `i`.
    pub(crate) fn mean(&self, i: usize, value: &dyn Fn(usize) -> f32) -> f32 {
        let (x, y) = (i % self.width * self.factor, i / self.width * self.factor);
        let mut sum = 0.0;
        for row in y..y + self.factor {
            for column in x..x + self.factor {
                sum += value(row * self.full_width + column);
            }
        }
        sum / (self.factor * self.factor) as f32
    }

    /// JPEG, base64, of a picture of the full size.
    pub(crate) fn jpeg_of(&self, picture: &Picture) -> Result<String> {
        let color = |i: usize| [0, 1, 2].map(|c| byte(self.mean(i, &|p| picture.rgb[3 * p + c])));
        let bytes: Vec<u8> = (0..self.len()).flat_map(color).collect();
        let mut jpeg = Vec::new();
        JpegEncoder::new_with_quality(&mut jpeg, JPEG_QUALITY)
            .encode(&bytes, self.width as u32, self.height as u32, ExtendedColorType::Rgb8)
            .map_err(ViewError::stage("encoding a picture of a page"))?;
        Ok(STANDARD.encode(jpeg))
    }

    /// PNG, base64, of bytes for each of its pixels.
    pub(crate) fn png(&self, bytes: &[u8], kind: ExtendedColorType) -> Result<String> {
        let mut png = Vec::new();
        PngEncoder::new(&mut png)
            .write_image(bytes, self.width as u32, self.height as u32, kind)
            .map_err(ViewError::stage("encoding a picture of a page"))?;
        Ok(STANDARD.encode(png))
    }
}
