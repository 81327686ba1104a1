//! Films: GIF here, MP4 and animated WebP by a found ffmpeg.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use gic_files::NewFile;
use gic_scene::Picture;
use gic_twin::{TwinError, atomic};
use image::codecs::gif::{GifEncoder, Repeat};
use image::{Delay, Frame, Rgba, RgbaImage};

use super::STAGE;
use crate::error::{Result, ViewError};

/// Quality of the palette: 1 best, 30 fastest.
const GIF_SPEED: i32 = 10;

/// How a film will be made.
pub struct FilmEncoder {
    path: PathBuf,
    kind: FilmFormat,
    slow_motion: f64,
}

enum FilmFormat {
    Gif,
    Mp4,
    Webp,
}

impl FilmEncoder {
    /// Chosen by the file's ending, so many times slower than life.
    ///
    /// # Errors
    /// An ending that is no film's, or a film that cannot be made here.
    pub fn of(path: &Path, slow_motion: f64) -> Result<Self> {
        let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
        let kind = match ending.as_str() {
            "gif" => FilmFormat::Gif,
            "mp4" => FilmFormat::Mp4,
            "webp" => FilmFormat::Webp,
            other => {
                return Err(ViewError::Usage {
                    problem: format!("`{other}` is no kind of film that gic can make"),
                    hint: Some("name the film .gif, .mp4 or .webp".into()),
                });
            }
        };
        if !matches!(kind, FilmFormat::Gif) {
            let found = Command::new("ffmpeg").arg("-version").stdout(Stdio::null()).stderr(Stdio::null()).status();
            if !found.is_ok_and(|status| status.success()) {
                return Err(ViewError::Usage {
                    problem: format!(".{ending} needs the program ffmpeg, which is not to be found here"),
                    hint: Some("install ffmpeg, or make a .gif".into()),
                });
            }
        }
        Ok(Self { path: path.to_owned(), kind, slow_motion })
    }

    /// Writes the film of the pictures; says how.
    ///
    /// # Errors
    /// An unwritable file, a failure of ffmpeg.
    pub fn write(&self, pictures: &[Picture], frame_rate_hz: f64) -> Result<String> {
        let rate = frame_rate_hz / self.slow_motion;
        let by = match self.kind {
            FilmFormat::Gif => {
                self.gif(pictures, rate)?;
                "GIF, by gic"
            }
            FilmFormat::Mp4 => {
                // H.264 needs even sizes.
                let even = ["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2"];
                let quality = ["-f", "mp4", "-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "18"];
                self.ffmpeg(pictures, rate, &[&even[..], &quality].concat())?;
                "H.264, by ffmpeg"
            }
            FilmFormat::Webp => {
                let codec = ["-f", "webp", "-c:v", "libwebp_anim", "-loop", "0", "-quality", "80"];
                self.ffmpeg(pictures, rate, &codec)?;
                "animated WebP, by ffmpeg"
            }
        };
        Ok(format!("{} ({by}, {rate:.1} frames per second)", self.path.display()))
    }

    fn gif(&self, pictures: &[Picture], rate: f64) -> Result<()> {
        let mut bytes = Vec::new();
        let mut encoder = GifEncoder::new_with_speed(&mut bytes, GIF_SPEED);
        encoder.set_repeat(Repeat::Infinite).map_err(ViewError::stage(STAGE))?;
        // GIF counts hundredths of a second.
        let delay = Delay::from_numer_denom_ms((1000.0 / rate).round().max(20.0) as u32, 1);
        for picture in pictures {
            let frame = Frame::from_parts(to_image(picture), 0, 0, delay);
            encoder.encode_frame(frame).map_err(ViewError::stage(STAGE))?;
        }
        drop(encoder);
        Ok(atomic::write(&self.path, &bytes)?)
    }

    /// Hands the pictures to ffmpeg, one after the other.
    fn ffmpeg(&self, pictures: &[Picture], rate: f64, codec: &[&str]) -> Result<()> {
        let film = NewFile::at(&self.path).map_err(TwinError::from)?;
        let [width, height] = pictures.first().map_or([0, 0], |picture| [picture.width, picture.height]);
        let mut ffmpeg = Command::new("ffmpeg")
            .args(["-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"])
            .args(["-video_size", &format!("{width}x{height}"), "-framerate", &format!("{rate}"), "-i", "-"])
            .args(codec)
            .arg(film.part())
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(TwinError::write(&self.path))?;
        if let Some(mut input) = ffmpeg.stdin.take() {
            for picture in pictures {
                // Where ffmpeg gives up early, it says why below.
                if input.write_all(&bytes_of(picture)).is_err() {
                    break;
                }
            }
        }
        let output = ffmpeg.wait_with_output().map_err(TwinError::write(&self.path))?;
        if !output.status.success() {
            let reason = String::from_utf8_lossy(&output.stderr).trim().to_owned();
            return Err(ViewError::Stage {
                stage: STAGE,
                hint: Some("the pictures themselves are complete; try a .gif".into()),
                source: format!("ffmpeg could not make {}: {reason}", self.path.display()).into(),
            });
        }
        Ok(film.finish().map_err(TwinError::from)?)
    }
}

/// Red, green and blue of all pixels.
fn bytes_of(picture: &Picture) -> Vec<u8> {
    picture.rgb.iter().map(|c| (c * 255.0).round() as u8).collect()
}

fn to_image(picture: &Picture) -> RgbaImage {
    RgbaImage::from_fn(picture.width as u32, picture.height as u32, |x, y| {
        let [r, g, b] = picture.at(x as usize, y as usize).map(|c| (c * 255.0).round() as u8);
        Rgba([r, g, b, 255])
    })
}
