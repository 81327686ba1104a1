//! Films: a file, or a folder of numbered pictures, for each camera.

use std::fs;
use std::path::{Path, PathBuf};

use gic_files::FileError;
use rayon::prelude::*;

use crate::error::{FilmError, Result};
use crate::ffmpeg;

/// Endings of film files that are looked for in a folder.
const FILM_ENDINGS: [&str; 9] = ["mp4", "mov", "m4v", "mkv", "webm", "avi", "mts", "m2ts", "gif"];
/// Endings of pictures that make up a film.
const PICTURE_ENDINGS: [&str; 3] = ["png", "jpg", "jpeg"];

/// What one camera recorded.
#[derive(Clone, Debug)]
pub struct Film {
    /// The camera's name: the file's or folder's, without its ending.
    pub name: String,
    /// The file or folder.
    pub path: PathBuf,
    /// Width [pixels].
    pub width: usize,
    /// Height [pixels].
    pub height: usize,
    /// When each frame is shown [s], on the film's own clock, which begins with 0 at its first frame; uneven where the
    /// frame rate varies.
    pub times_s: Vec<f64>,
    /// Whether there is a sound track.
    pub has_sound: bool,
    /// When the first frame is shown on the clock of the file [s], which its sound keeps, too.
    pub(crate) file_start_s: f64,
    /// The pictures, where the film is a folder of them.
    pub(crate) pictures: Vec<PathBuf>,
}

/// Opens films: files and folders of numbered pictures as they are given, or all of a single folder, one a camera, by
/// name. `frame_rate_hz` is the rate of numbered pictures, which have none of their own; films keep theirs.
///
/// # Errors
/// [`FilmError::NoProgram`] without ffmpeg; a [`gic_files::FileError`] for a file that is no film,
/// [`FilmError::Usage`] for numbered pictures without a rate and for two films of one name.
pub fn open_films(paths: &[PathBuf], frame_rate_hz: Option<f64>) -> Result<Vec<Film>> {
    let places = match paths {
        [folder] if folder.is_dir() && numbered_pictures(folder)?.is_empty() => films_in(folder)?,
        _ => paths.to_vec(),
    };
    let films: Vec<Film> = places.par_iter().map(|place| Film::open(place, frame_rate_hz)).collect::<Result<_>>()?;
    for (i, film) in films.iter().enumerate() {
        if let Some(other) = films[..i].iter().find(|other| other.name == film.name) {
            return Err(FilmError::usage(
                format!("{} and {} would both be camera {}", other.path.display(), film.path.display(), film.name),
                "give each camera's film a name of its own",
            ));
        }
    }
    Ok(films)
}

impl Film {
    /// Opens a film file, a folder of numbered pictures that were taken at `frame_rate_hz`, or a single picture.
    ///
    /// # Errors
    /// As [`open_films`].
    pub fn open(path: &Path, frame_rate_hz: Option<f64>) -> Result<Film> {
        if path.is_dir() {
            return Film::of_pictures(path, numbered_pictures(path)?, frame_rate_hz);
        }
        if has_ending(path, &PICTURE_ENDINGS) {
            return Film::of_pictures(path, vec![path.to_owned()], frame_rate_hz);
        }
        gic_files::input::open(path).map_err(FileError::read(path))?;
        let content = ffmpeg::probe(path)?;
        let file_start_s = content.times_s[0];
        Ok(Film {
            name: stem(path),
            path: path.to_owned(),
            width: content.size.0,
            height: content.size.1,
            times_s: without_rounding(&content.times_s, content.tick_s),
            has_sound: content.has_sound,
            file_start_s,
            pictures: Vec::new(),
        })
    }

    /// A film of the pictures that are a folder's, or a single picture.
    fn of_pictures(folder: &Path, pictures: Vec<PathBuf>, frame_rate_hz: Option<f64>) -> Result<Film> {
        let Some(first) = pictures.first() else {
            return Err(FilmError::content(
                folder,
                "holds no numbered pictures",
                "give film files, or folders of pictures such as frame_0001.png",
            ));
        };
        let rate = frame_rate_hz.ok_or_else(|| {
            FilmError::usage(
                format!("the pictures in {} do not say when they were taken", folder.display()),
                "give their rate with --frame-rate-hz",
            )
        })?;
        let (width, height) = image::image_dimensions(first)
            .map_err(|error| FilmError::content(first, error.to_string(), "replace or remove the picture"))?;
        Ok(Film {
            name: stem(folder),
            path: folder.to_owned(),
            width: width as usize,
            height: height as usize,
            times_s: (0..pictures.len()).map(|frame| frame as f64 / rate).collect(),
            has_sound: false,
            file_start_s: 0.0,
            pictures,
        })
    }

    /// Mean number of frames a second; `None` for a single frame.
    pub fn frame_rate_hz(&self) -> Option<f64> {
        let steps = self.times_s.len().checked_sub(1).filter(|steps| *steps > 0)?;
        Some(steps as f64 / (self.times_s[steps] - self.times_s[0]))
    }
}

/// Times from the first one [s], evenly spaced where they are so but for the file's rounding to whole ticks.
fn without_rounding(times_s: &[f64], tick_s: f64) -> Vec<f64> {
    let steps = times_s.len() - 1;
    let step = (times_s[steps] - times_s[0]) / steps.max(1) as f64;
    let even = |n: usize| n as f64 * step;
    let own = |n: usize| times_s[n] - times_s[0];
    if (0..=steps).all(|n| (own(n) - even(n)).abs() <= tick_s) {
        (0..=steps).map(even).collect()
    } else {
        (0..=steps).map(own).collect()
    }
}

/// The film files of a folder, or its folders of numbered pictures, by name.
fn films_in(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = entries(folder)?;
    let mut films: Vec<PathBuf> = entries.iter().filter(|path| has_ending(path, &FILM_ENDINGS)).cloned().collect();
    if films.is_empty() {
        for path in entries.into_iter().filter(|path| path.is_dir()) {
            if !numbered_pictures(&path)?.is_empty() {
                films.push(path);
            }
        }
    }
    if films.is_empty() {
        return Err(FilmError::content(
            folder,
            format!("holds no films ({}) and no folders of numbered pictures", FILM_ENDINGS.join(", ")),
            "put one file a camera into it, or name the files",
        ));
    }
    Ok(films)
}

/// The pictures of a folder whose names end with a number, by that number.
fn numbered_pictures(folder: &Path) -> Result<Vec<PathBuf>> {
    let pictures = entries(folder)?.into_iter().filter(|path| has_ending(path, &PICTURE_ENDINGS));
    let mut numbered: Vec<(u64, PathBuf)> = pictures.filter_map(|path| Some((number_of(&path)?, path))).collect();
    numbered.sort();
    Ok(numbered.into_iter().map(|(_, path)| path).collect())
}

/// The number that a file's name ends with.
fn number_of(path: &Path) -> Option<u64> {
    let stem = stem(path);
    let digits = &stem[stem.trim_end_matches(|c: char| c.is_ascii_digit()).len()..];
    digits.parse().ok()
}

/// What a folder holds, by name; hidden files are none of it.
fn entries(folder: &Path) -> Result<Vec<PathBuf>> {
    let read = fs::read_dir(folder).map_err(FileError::read(folder))?;
    let paths: std::io::Result<Vec<PathBuf>> = read.map(|entry| entry.map(|entry| entry.path())).collect();
    let mut paths = paths.map_err(FileError::read(folder))?;
    paths.retain(|path| !path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b".")));
    paths.sort();
    Ok(paths)
}

fn has_ending(path: &Path, endings: &[&str]) -> bool {
    let ending = path.extension().and_then(|ending| ending.to_str()).map(str::to_lowercase);
    path.is_file() && ending.is_some_and(|ending| endings.contains(&ending.as_str()))
}

fn stem(path: &Path) -> String {
    let path = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    path.file_stem().map_or_else(|| "camera".to_owned(), |stem| stem.to_string_lossy().into_owned())
}
