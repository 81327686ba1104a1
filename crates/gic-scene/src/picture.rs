//! Pictures and masks in memory, and how they are decoded from PNG and JPEG files.

use std::io::{BufRead, BufReader, Cursor, Seek};
use std::path::Path;

use image::codecs::png::PngEncoder;
use image::{DynamicImage, ExtendedColorType, ImageDecoder, ImageEncoder, ImageReader};

use crate::error::{Problem, SceneError};
use crate::jpeg;

/// A colour picture: straight (not premultiplied) RGB as stored on disk, sRGB-encoded, row-major from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Width [pixels].
    pub width: usize,
    /// Height [pixels].
    pub height: usize,
    /// Red, green, blue in [0, 1], shape [height * width, 3], flattened.
    pub rgb: Vec<f32>,
}

/// Coverage of the object per pixel: 0 outside, 1 inside, between on the outline; row-major from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct Mask {
    /// Width [pixels].
    pub width: usize,
    /// Height [pixels].
    pub height: usize,
    /// Coverage in [0, 1], shape [height * width].
    pub coverage: Vec<f32>,
}

/// A rectangle of whole pixels: columns `x0..x1`, rows `y0..y1`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelBox {
    /// First column.
    pub x0: usize,
    /// First row.
    pub y0: usize,
    /// One past the last column.
    pub x1: usize,
    /// One past the last row.
    pub y1: usize,
}

impl PixelBox {
    /// Whether a pixel lies in it.
    pub fn contains(&self, x: usize, y: usize) -> bool {
        (self.x0..self.x1).contains(&x) && (self.y0..self.y1).contains(&y)
    }
}

impl Picture {
    /// Colour of the pixel in column `x`, row `y`.
    pub fn at(&self, x: usize, y: usize) -> [f32; 3] {
        let i = 3 * (y * self.width + x);
        [self.rgb[i], self.rgb[i + 1], self.rgb[i + 2]]
    }

    /// Bilinear colour at image coordinates (pixel centres at +0.5); `None` outside the picture.
    pub fn sample(&self, x: f64, y: f64) -> Option<[f32; 3]> {
        let taps = bilinear_taps(self.width, self.height, x, y)?;
        let mut colour = [0.0; 3];
        for (index, weight) in taps {
            for channel in 0..3 {
                colour[channel] += weight * self.rgb[3 * index + channel];
            }
        }
        // Rounding must not lead out of [0, 1].
        Some(colour.map(|value| value.min(1.0)))
    }

    /// The part in a window, which must lie inside.
    pub(crate) fn cut_out(&self, window: PixelBox) -> Picture {
        let row = |y: usize| &self.rgb[3 * (y * self.width + window.x0)..3 * (y * self.width + window.x1)];
        Picture {
            width: window.x1 - window.x0,
            height: window.y1 - window.y0,
            rgb: (window.y0..window.y1).flat_map(row).copied().collect(),
        }
    }

    /// Reads a PNG or JPEG file.
    ///
    /// # Errors
    /// [`SceneError::Invalid`] naming a file that cannot be decoded.
    pub fn read(path: &Path) -> Result<Picture, SceneError> {
        Ok(decode(path)?.picture)
    }

    /// Writes the picture as an 8-bit PNG, whole or not at all.
    ///
    /// # Errors
    /// A [`gic_files::FileError`] naming the file.
    pub fn save_png(&self, path: &Path) -> Result<(), SceneError> {
        let bytes: Vec<u8> = self.rgb.iter().map(|value| (value.clamp(0.0, 1.0) * 255.0).round() as u8).collect();
        save_png(path, &bytes, (self.width, self.height), ExtendedColorType::Rgb8)
    }
}

/// Writes bytes as a PNG, whole or not at all.
fn save_png(path: &Path, bytes: &[u8], size: (usize, usize), kind: ExtendedColorType) -> Result<(), SceneError> {
    let written = gic_files::write_with(path, |out| {
        let encoder = PngEncoder::new(out);
        encoder.write_image(bytes, size.0 as u32, size.1 as u32, kind).map_err(std::io::Error::other)
    });
    Ok(written?)
}

impl Mask {
    /// Reads a mask file: the alpha channel where there is one that says something, else the brightness.
    ///
    /// # Errors
    /// [`SceneError::Invalid`] naming a file that cannot be decoded.
    pub fn read(path: &Path) -> Result<Mask, SceneError> {
        Ok(decode_mask(path)?)
    }

    /// Writes the coverage as an 8-bit grey PNG, whole or not at all.
    ///
    /// # Errors
    /// A [`gic_files::FileError`] naming the file.
    pub fn save_png(&self, path: &Path) -> Result<(), SceneError> {
        let bytes: Vec<u8> = self.coverage.iter().map(|value| (value.clamp(0.0, 1.0) * 255.0).round() as u8).collect();
        save_png(path, &bytes, (self.width, self.height), ExtendedColorType::L8)
    }

    /// A mask of the size of `picture` that is this one in a window, and empty elsewhere.
    pub(crate) fn put_into(&self, window: PixelBox, picture: &Picture) -> Mask {
        let mut coverage = vec![0.0; picture.width * picture.height];
        for (y, row) in self.coverage.chunks_exact(self.width.max(1)).enumerate() {
            let start = (window.y0 + y) * picture.width + window.x0;
            coverage[start..start + self.width].copy_from_slice(row);
        }
        Mask { width: picture.width, height: picture.height, coverage }
    }

    /// Coverage of the pixel in column `x`, row `y`.
    pub fn at(&self, x: usize, y: usize) -> f32 {
        self.coverage[y * self.width + x]
    }

    /// Bilinear coverage at image coordinates (pixel centres at +0.5); 0 outside the mask.
    pub fn sample(&self, x: f64, y: f64) -> f32 {
        match bilinear_taps(self.width, self.height, x, y) {
            Some(taps) => taps.into_iter().map(|(index, weight)| weight * self.coverage[index]).sum::<f32>().min(1.0),
            None => 0.0,
        }
    }

    /// Sum of the coverage [pixels].
    pub fn area(&self) -> f64 {
        self.coverage.iter().map(|&a| f64::from(a)).sum()
    }

    /// The smallest rectangle that holds every pixel with coverage of at least one half; `None` when there is none.
    pub fn bounding_box(&self) -> Option<PixelBox> {
        let mut found: Option<PixelBox> = None;
        for y in 0..self.height {
            let row = &self.coverage[y * self.width..(y + 1) * self.width];
            let Some(first) = row.iter().position(|&a| a >= 0.5) else { continue };
            let last = row.iter().rposition(|&a| a >= 0.5).unwrap_or(first);
            found = Some(match found {
                None => PixelBox { x0: first, y0: y, x1: last + 1, y1: y + 1 },
                Some(b) => PixelBox { x0: b.x0.min(first), y0: b.y0, x1: b.x1.max(last + 1), y1: y + 1 },
            });
        }
        found
    }

    /// Whether pixels of the object lie on the border of the picture, so that part of it may be out of view.
    pub fn touches_border(&self) -> bool {
        touches_border(&self.coverage, self.width)
    }
}

/// Whether a pixel on the border of a picture is covered at least by half; `coverage` is row-major, `width` pixels a
/// row.
pub fn touches_border(coverage: &[f32], width: usize) -> bool {
    let mut rows = coverage.chunks_exact(width.max(1));
    let covered = |a: &f32| *a >= 0.5;
    let whole = |row: Option<&[f32]>| row.is_some_and(|row| row.iter().any(covered));
    whole(rows.clone().next())
        || whole(rows.clone().next_back())
        || rows.any(|row| covered(&row[0]) || covered(&row[width - 1]))
}

/// The four pixels (index, weight) around image coordinates (x, y), clamped at the border; `None` outside or for NaN.
fn bilinear_taps(width: usize, height: usize, x: f64, y: f64) -> Option<[(usize, f32); 4]> {
    let inside = x >= 0.0 && y >= 0.0 && x <= width as f64 && y <= height as f64;
    if !inside {
        return None;
    }
    let (x, y) = ((x - 0.5).clamp(0.0, (width - 1) as f64), (y - 0.5).clamp(0.0, (height - 1) as f64));
    let (x0, y0) = (x as usize, y as usize);
    let (x1, y1) = ((x0 + 1).min(width - 1), (y0 + 1).min(height - 1));
    let (tx, ty) = ((x - x0 as f64) as f32, (y - y0 as f64) as f32);
    Some([
        (y0 * width + x0, (1.0 - tx) * (1.0 - ty)),
        (y0 * width + x1, tx * (1.0 - ty)),
        (y1 * width + x0, (1.0 - tx) * ty),
        (y1 * width + x1, tx * ty),
    ])
}

/// A decoded file: colour and, where the file has one, the alpha channel.
pub(crate) struct Decoded {
    pub(crate) picture: Picture,
    pub(crate) alpha: Option<Vec<f32>>,
}

/// The reader of a picture file. The content decides on the format, not the name: photographs with the wrong extension
/// are common.
fn reader<R: BufRead + Seek>(source: R, path: &Path) -> Result<ImageReader<R>, Problem> {
    ImageReader::new(source).with_guessed_format().map_err(unreadable(path))
}

fn unreadable<E: std::fmt::Display>(path: &Path) -> impl FnOnce(E) -> Problem {
    move |error| Problem::Unreadable { path: path.to_owned(), reason: error.to_string() }
}

/// Width and height [pixels], and whether there is an alpha channel, from the header of a picture file.
pub(crate) fn header(path: &Path) -> Result<((usize, usize), bool), Problem> {
    let file = gic_files::input::open(path).map_err(unreadable(path))?;
    let decoder = reader(BufReader::new(file), path)?.into_decoder().map_err(unreadable(path))?;
    let (width, height) = decoder.dimensions();
    Ok(((width as usize, height as usize), decoder.color_type().has_alpha()))
}

/// Decodes a PNG or JPEG file: 8 or 16 bits a channel, grey, palette or RGB, with or without alpha.
pub(crate) fn decode(path: &Path) -> Result<Decoded, Problem> {
    let bytes = gic_files::input::read(path).map_err(unreadable(path))?;
    if jpeg::is_jpeg(&bytes) && !jpeg::is_whole(&bytes) {
        return Err(unreadable(path)("the JPEG file is cut off"));
    }
    let decoded = reader(Cursor::new(bytes), path)?.decode().map_err(unreadable(path))?;
    let (width, height) = (decoded.width() as usize, decoded.height() as usize);
    let (rgb, alpha) = match decoded {
        DynamicImage::ImageLuma8(image) => (image.iter().flat_map(|&v| [unit8(v); 3]).collect(), None),
        DynamicImage::ImageRgb8(image) => (image.iter().map(|&v| unit8(v)).collect(), None),
        DynamicImage::ImageRgba8(image) => (
            image.chunks_exact(4).flat_map(|p| [unit8(p[0]), unit8(p[1]), unit8(p[2])]).collect(),
            Some(image.chunks_exact(4).map(|p| unit8(p[3])).collect()),
        ),
        other => {
            // 16 bits and grey with alpha: rare, so one general road.
            let has_alpha = other.color().has_alpha();
            let image = other.to_rgba32f();
            (
                image.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect(),
                has_alpha.then(|| image.chunks_exact(4).map(|p| p[3]).collect()),
            )
        }
    };
    Ok(Decoded { picture: Picture { width, height, rgb }, alpha })
}

fn unit8(value: u8) -> f32 {
    f32::from(value) / 255.0
}

/// A mask file as coverage: the alpha channel where there is one that says something, else the brightness.
///
/// A file with an alpha channel that is opaque everywhere is a black-and-white picture saved as RGBA.
pub(crate) fn decode_mask(path: &Path) -> Result<Mask, Problem> {
    let Decoded { picture, alpha } = decode(path)?;
    let coverage = match alpha {
        Some(alpha) if alpha.iter().any(|&a| a < 1.0) => alpha,
        _ => picture.rgb.chunks_exact(3).map(|p| (p[0] + p[1] + p[2]) / 3.0).collect(),
    };
    Ok(Mask { width: picture.width, height: picture.height, coverage })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mask(width: usize, rows: &[&str]) -> Mask {
        let coverage = rows.iter().flat_map(|row| row.bytes().map(|b| f32::from(b - b'0') / 9.0)).collect();
        Mask { width, height: rows.len(), coverage }
    }

    #[test]
    fn the_bounding_box_holds_what_is_at_least_half_covered() {
        let found = mask(5, &["00000", "03900", "00050", "00000"]);
        assert_eq!(found.bounding_box(), Some(PixelBox { x0: 2, y0: 1, x1: 4, y1: 3 }));
        assert!(!found.touches_border());
        assert!(mask(3, &["000", "009"]).touches_border() && mask(3, &["090", "000", "000"]).touches_border());
        assert_eq!(mask(3, &["040", "000"]).bounding_box(), None);
    }

    #[test]
    fn samples_are_exact_at_pixel_centres_and_linear_between() {
        let mask = mask(3, &["090", "999"]);
        assert_eq!((mask.sample(1.5, 0.5), mask.sample(1.0, 0.5), mask.sample(0.5, 1.0)), (1.0, 0.5, 0.5));
        assert_eq!((mask.sample(0.0, 0.0), mask.sample(3.0, 2.0)), (0.0, 1.0), "clamped at the border");
        assert_eq!((mask.sample(-0.1, 1.0), mask.sample(1.0, 2.1), mask.sample(f64::NAN, 1.0)), (0.0, 0.0, 0.0));
        let picture = Picture { width: 2, height: 1, rgb: vec![0.0, 0.2, 1.0, 1.0, 0.4, 0.0] };
        assert_eq!(picture.sample(1.0, 0.5), Some([0.5, 0.3, 0.5]));
        assert_eq!((picture.sample(2.5, 0.5), picture.at(1, 0)), (None, [1.0, 0.4, 0.0]));
    }
}
