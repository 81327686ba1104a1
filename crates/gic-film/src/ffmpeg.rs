//! The programs ffmpeg and ffprobe, as they are found in the path.

use std::fs::File;
use std::io::{self, Read, Seek};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Output, Stdio};

use gic_files::FileError;
use gic_twin::TwinError;
use serde::Deserialize;

use crate::error::{FilmError, Result};

const BROKEN_FILM_HINT: &str = "play the file with another program; if that works, convert it to MP4 (H.264)";

/// What ffprobe says of a film.
#[derive(Deserialize)]
struct Probed {
    #[serde(default)]
    streams: Vec<Stream>,
    #[serde(default)]
    frames: Vec<ProbedFrame>,
}

#[derive(Deserialize)]
struct Stream {
    codec_type: Option<String>,
    width: Option<usize>,
    height: Option<usize>,
    time_base: Option<String>,
    #[serde(default)]
    side_data_list: Vec<SideData>,
}

#[derive(Deserialize)]
struct SideData {
    rotation: Option<f64>,
}

#[derive(Deserialize)]
struct ProbedFrame {
    best_effort_timestamp_time: Option<String>,
}

/// A film's pictures by their size and times, and whether it has sound.
pub(crate) struct Content {
    /// Width and height [pixels], turned as the film is meant to be seen.
    pub(crate) size: (usize, usize),
    /// Presentation times [s], as they stand in the file.
    pub(crate) times_s: Vec<f64>,
    /// To what the file rounds them [s].
    pub(crate) tick_s: f64,
    /// Whether there is a sound track.
    pub(crate) has_sound: bool,
}

/// Size, times and sound of a film. Decodes it, because only the decoder knows which pictures are shown.
pub(crate) fn probe(path: &Path) -> Result<Content> {
    let streams = parse(path, &ffprobe(path, &["-show_streams"])?)?.streams;
    let damaged = |problem: &str| FilmError::content(path, problem, BROKEN_FILM_HINT);
    let is = |kind: &'static str| move |stream: &&Stream| stream.codec_type.as_deref() == Some(kind);
    let video = streams.iter().find(is("video")).ok_or_else(|| damaged("holds no moving pictures"))?;
    let (width, height) = video.width.zip(video.height).ok_or_else(|| damaged("does not say how large it is"))?;
    let turned = video.side_data_list.iter().filter_map(|data| data.rotation).any(|angle| angle % 180.0 != 0.0);
    let entries = ["-select_streams", "v:0", "-show_frames", "-show_entries", "frame=best_effort_timestamp_time"];
    let frames = parse(path, &ffprobe(path, &entries)?)?.frames;
    let time = |frame: &ProbedFrame| frame.best_effort_timestamp_time.as_ref()?.parse().ok();
    let times_s: Option<Vec<f64>> = frames.iter().map(time).collect();
    let times_s = times_s.ok_or_else(|| damaged("has frames without a time"))?;
    if !times_s.windows(2).all(|pair| pair[0] < pair[1]) {
        return Err(damaged("has frames whose times do not increase"));
    }
    if times_s.is_empty() {
        return Err(damaged("holds no frame that can be decoded"));
    }
    let size = if turned { (height, width) } else { (width, height) };
    let tick_s = video.time_base.as_deref().and_then(ratio).unwrap_or(0.0);
    Ok(Content { size, times_s, tick_s, has_sound: streams.iter().any(|stream| is("audio")(&stream)) })
}

/// The value of a fraction such as 1/1000.
fn ratio(text: &str) -> Option<f64> {
    let (numerator, denominator) = text.split_once('/')?;
    Some(numerator.parse::<f64>().ok()? / denominator.parse::<f64>().ok()?).filter(|value| value.is_finite())
}

fn ffprobe(path: &Path, what: &[&str]) -> Result<Output> {
    let output = Command::new("ffprobe")
        .args(["-v", "error", "-of", "json"])
        .args(what)
        .args(input_options(path))
        .arg(file_argument(path))
        .stdin(Stdio::null())
        .output()
        .map_err(not_started("ffprobe", path))?;
    if output.status.success() { Ok(output) } else { Err(refused(path, &output.stderr)) }
}

fn parse(path: &Path, output: &Output) -> Result<Probed> {
    serde_json::from_slice(&output.stdout).map_err(|error| {
        FilmError::content(path, format!("ffprobe says what gic does not understand: {error}"), BROKEN_FILM_HINT)
    })
}

/// A running ffmpeg, which ends with its owner.
#[derive(Debug)]
pub(crate) struct Decoder {
    path: PathBuf,
    process: Child,
    output: ChildStdout,
    /// What it says; a file, because it would wait where nobody empties a pipe.
    said: File,
}

impl Decoder {
    /// Starts ffmpeg on a film; what it makes comes through its standard output. Times are those of the file.
    pub(crate) fn start(path: &Path, arguments: &[&str]) -> Result<Decoder> {
        let said = tempfile::tempfile().map_err(TwinError::write(&std::env::temp_dir()))?;
        let words = said.try_clone().map_err(TwinError::write(&std::env::temp_dir()))?;
        let mut process = Command::new("ffmpeg")
            .args(["-v", "error", "-nostdin", "-copyts"])
            .args(input_options(path))
            .arg("-i")
            .arg(file_argument(path))
            .args(arguments)
            .arg("-")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(words)
            .spawn()
            .map_err(not_started("ffmpeg", path))?;
        let Some(output) = process.stdout.take() else { unreachable!("the output is a pipe") };
        Ok(Decoder { path: path.to_owned(), process, output, said })
    }

    /// Fills `bytes`.
    ///
    /// # Errors
    /// What ffmpeg says where it ends before.
    pub(crate) fn fill(&mut self, bytes: &mut [u8]) -> Result<()> {
        self.output.read_exact(bytes).map_err(|_| self.broken_off())
    }

    /// All bytes that are left.
    ///
    /// # Errors
    /// What ffmpeg says where it fails.
    pub(crate) fn rest(mut self) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        let read = self.output.read_to_end(&mut bytes);
        let ended = self.process.wait();
        if read.is_ok() && ended.is_ok_and(|status| status.success()) { Ok(bytes) } else { Err(self.broken_off()) }
    }

    fn broken_off(&mut self) -> FilmError {
        let mut text = Vec::new();
        // What it said is a help, not a need.
        let _ = self.said.rewind().and_then(|()| self.said.read_to_end(&mut text));
        refused(&self.path, &text)
    }
}

impl Drop for Decoder {
    fn drop(&mut self) {
        // Both fail where it has ended by itself.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// GIF: browsers show frames of a hundredth of a second for a tenth, and so would ffmpeg.
fn input_options(path: &Path) -> &'static [&'static str] {
    let is_gif = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("gif"));
    if is_gif { &["-min_delay", "1"] } else { &[] }
}

/// Says that the name is a file's: ffmpeg takes what stands before a colon for a protocol.
fn file_argument(path: &Path) -> std::ffi::OsString {
    let mut name = std::ffi::OsString::from("file:");
    name.push(path);
    name
}

fn not_started(program: &'static str, path: &Path) -> impl FnOnce(io::Error) -> FilmError {
    move |source| match source.kind() {
        io::ErrorKind::NotFound => FilmError::NoProgram { program },
        _ => FileError::read(path)(source).into(),
    }
}

/// What a program says about a film that it cannot decode.
fn refused(path: &Path, stderr: &[u8]) -> FilmError {
    let text = String::from_utf8_lossy(stderr);
    let reason = text.lines().next().unwrap_or("it ends before its last frame").trim();
    FilmError::content(path, format!("ffmpeg cannot decode it: {reason}"), BROKEN_FILM_HINT)
}
