//! Frames of a film, decoded one after the other.

use std::ops::Range;

use gic_scene::Picture;

use crate::error::{FilmError, Result};
use crate::ffmpeg::Decoder;
use crate::film::Film;

/// Which frames of a film to decode: every `every`th of `range`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Selection {
    /// Numbers of frames, from 0.
    pub range: Range<usize>,
    /// 1 for all of them.
    pub every: usize,
}

impl Selection {
    /// The numbers of the frames.
    pub fn indices(&self) -> impl Iterator<Item = usize> + use<> {
        self.range.clone().step_by(self.every.max(1))
    }
}

/// A decoded frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Its number in the film, from 0.
    pub index: usize,
    /// Width [pixels].
    pub width: usize,
    /// Height [pixels].
    pub height: usize,
    /// Red, green and blue, 8 bits each, sRGB as filmed; shape [height * width, 3], flattened.
    pub rgb: Vec<u8>,
}

impl Frame {
    /// As a picture of a scene.
    pub fn picture(&self) -> Picture {
        let rgb = self.rgb.iter().map(|&value| f32::from(value) / 255.0).collect();
        Picture { width: self.width, height: self.height, rgb }
    }
}

/// Decodes frames in their order; ends after an error.
#[derive(Debug)]
pub struct Frames<'a> {
    film: &'a Film,
    left: std::vec::IntoIter<usize>,
    decoder: Option<Decoder>,
}

impl Film {
    /// All frames.
    pub fn all(&self) -> Selection {
        Selection { range: 0..self.times_s.len(), every: 1 }
    }

    /// Starts to decode frames.
    ///
    /// # Errors
    /// [`FilmError::NoProgram`] without ffmpeg. The frames themselves are errors where they cannot be decoded.
    pub fn frames(&self, selection: &Selection) -> Result<Frames<'_>> {
        let end = selection.range.end.min(self.times_s.len());
        let selection = Selection { range: selection.range.start.min(end)..end, every: selection.every.max(1) };
        let indices: Vec<usize> = selection.indices().collect();
        let decoder =
            if self.pictures.is_empty() && !indices.is_empty() { Some(self.decoder(&selection)?) } else { None };
        Ok(Frames { film: self, left: indices.into_iter(), decoder })
    }

    fn decoder(&self, Selection { range, every }: &Selection) -> Result<Decoder> {
        let (first, last) = (range.start, range.end - 1);
        let chosen = format!("select=between(n\\,{first}\\,{last})*not(mod(n-{first}\\,{every}))");
        let count = range.len().div_ceil(*every).to_string();
        // Passed through: no frame is doubled or left out to make the rate even.
        let arguments = ["-map", "0:v:0", "-vf", &chosen, "-fps_mode", "passthrough", "-frames:v", &count];
        let form = ["-f", "rawvideo", "-pix_fmt", "rgb24"];
        Decoder::start(&self.path, &[&arguments[..], &form].concat())
    }
}

impl Iterator for Frames<'_> {
    type Item = Result<Frame>;

    fn next(&mut self) -> Option<Result<Frame>> {
        let index = self.left.next()?;
        let frame = self.read(index);
        if frame.is_err() {
            self.left = Vec::new().into_iter();
        }
        Some(frame)
    }
}

impl Frames<'_> {
    fn read(&mut self, index: usize) -> Result<Frame> {
        let (width, height) = (self.film.width, self.film.height);
        let rgb = match &mut self.decoder {
            Some(decoder) => {
                let mut rgb = vec![0; 3 * width * height];
                decoder.fill(&mut rgb)?;
                rgb
            }
            None => self.read_picture(index)?,
        };
        Ok(Frame { index, width, height, rgb })
    }

    fn read_picture(&self, index: usize) -> Result<Vec<u8>> {
        let path = &self.film.pictures[index];
        let unusable = |reason: String| FilmError::content(path, reason, "replace or remove the picture");
        let picture = image::open(path).map_err(|error| unusable(error.to_string()))?.into_rgb8();
        let (found, expected) = ((picture.width(), picture.height()), (self.film.width, self.film.height));
        if (found.0 as usize, found.1 as usize) != expected {
            return Err(unusable(format!("is {found:?} pixels, unlike the first picture with {expected:?}")));
        }
        Ok(picture.into_raw())
    }
}
