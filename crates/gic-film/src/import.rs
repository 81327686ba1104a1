//! From films to a scene folder in nerfstudio's layout.
//!
//! `images/` has the pictures that were cut out, `backgrounds/` the empty scenes, `transforms.json` lists pictures,
//! times and, once they are known, cameras. `import.json` says what the folder was made from: the same import goes on
//! where it stopped, and another one does not mix with it. What lies in `backgrounds/` already is kept.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use gic_files::{FileError, FolderLock};
use gic_scene::Picture;
use gic_twin::events::Events;
use gic_twin::{Interrupt, TwinError, atomic};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::align::{Align, Alignment, align};
use crate::background::EmptyScene;
use crate::cameras::KnownCameras;
use crate::cut::Cut;
use crate::error::{FilmError, Result};
use crate::film::{Film, open_films};
use crate::imported::{Imported, ImportedCamera};
use crate::request::ImportRequest;
use crate::scene_file::SceneFile;
use crate::sheet::labelled;
use crate::tuning::SHEET_COLUMNS;

/// What a folder was made from.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Recipe {
    schema: String,
    films: Vec<Source>,
    start_s: Option<f64>,
    frames: Option<usize>,
    every: usize,
    frame_rate_hz: Option<f64>,
    align: Align,
}

#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Source {
    path: PathBuf,
    bytes: u64,
}

const STAGE: &str = "import";
const SCHEMA: &str = "gic.import/1";
/// The file that says what a folder was made from.
const STAMP: &str = "import.json";

/// Imports films.
///
/// # Errors
/// Films that cannot be decoded, a folder that holds something else, cameras of other names, an interruption.
pub fn import(request: &ImportRequest, events: &Events, interrupt: &Interrupt) -> Result<Imported> {
    // Cameras first: their mistakes must not wait for the decoding.
    let cameras = request.calibration.as_deref().map(KnownCameras::read).transpose()?;
    if request.films.is_empty() {
        return complete(&request.scene, cameras.as_ref());
    }
    let films = open_films(&request.films, request.frame_rate_hz)?;
    if let Some(cameras) = &cameras {
        films.iter().try_for_each(|film| cameras.keys_of(&film.name, (film.width, film.height)).map(drop))?;
    }
    let recipe = Recipe::of(request, &films)?;
    recipe.check_place(&request.scene)?;
    if SceneFile::path_in(&request.scene).is_file() {
        events.note(STAGE, "the pictures are there already");
        return complete(&request.scene, cameras.as_ref());
    }
    let alignment = align(&films, request.align, interrupt)?;
    let cut = Cut::of(&films, &alignment.offsets_s, request)?;
    let _lock = begin(&request.scene, &recipe)?;
    let decoded = write_films(&request.scene, &films, &cut, events, interrupt)?;
    let imported = describe(&films, &alignment, &cut, decoded.iter().map(|film| film.empty.as_ref()));
    let sheet: Vec<Vec<Option<Picture>>> = decoded.into_iter().map(|film| film.tiles).collect();
    gic_scene::sheet::assemble(&sheet).save_png(&request.scene.join("contact.png"))?;
    let mut file = SceneFile::new(&films, &cut, &imported);
    finish(&mut file, &request.scene, cameras.as_ref())
}

/// Gives cameras to a scene that was imported before.
fn complete(scene: &Path, cameras: Option<&KnownCameras>) -> Result<Imported> {
    finish(&mut SceneFile::read(scene)?, scene, cameras)
}

fn finish(file: &mut SceneFile, scene: &Path, cameras: Option<&KnownCameras>) -> Result<Imported> {
    if let Some(cameras) = cameras {
        file.set_cameras(cameras)?;
    }
    file.write(scene)?;
    file.imported()
}

impl Recipe {
    fn of(request: &ImportRequest, films: &[Film]) -> Result<Recipe> {
        let source = |film: &Film| {
            let path = gic_files::resolved(&film.path);
            let bytes = fs::metadata(&path).map_err(FileError::read(&path))?.len();
            Ok(Source { path, bytes })
        };
        Ok(Recipe {
            schema: SCHEMA.into(),
            films: films.iter().map(source).collect::<Result<_>>()?,
            start_s: request.start_s,
            frames: request.frames,
            every: request.every,
            frame_rate_hz: request.frame_rate_hz,
            align: request.align,
        })
    }

    /// Refuses a folder that holds anything but this import.
    fn check_place(&self, folder: &Path) -> Result<()> {
        let other = |problem: String| {
            Err(FilmError::content(folder, problem, "choose another folder with -o, or remove this one first"))
        };
        let stamp = folder.join(STAMP);
        if stamp.is_file() {
            let there: Value = atomic::read_json(&stamp)?;
            return match serde_json::from_value::<Recipe>(there) {
                Ok(there) if there == *self => Ok(()),
                _ => other("holds another import: other films, or another cut".into()),
            };
        }
        let is_full = fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some());
        if is_full { other("is not empty, and no import of films".into()) } else { Ok(()) }
    }
}

/// Makes the folder this import's own, and locks it.
fn begin(folder: &Path, recipe: &Recipe) -> Result<FolderLock> {
    for part in ["images", "backgrounds"] {
        atomic::create_folder(&folder.join(part))?;
    }
    let lock = FolderLock::take(folder).map_err(TwinError::from)?;
    atomic::write_json(&folder.join(STAMP), recipe)?;
    Ok(lock)
}

/// What is kept of a film while it is written.
struct Decoded {
    empty: Option<EmptyScene>,
    tiles: Vec<Option<Picture>>,
}

/// Writes the pictures of the cut and the empty scenes.
fn write_films(
    folder: &Path,
    films: &[Film],
    cut: &Cut,
    events: &Events,
    interrupt: &Interrupt,
) -> Result<Vec<Decoded>> {
    let (done, all) = (AtomicU64::new(0), (films.len() * cut.frames()) as u64);
    let progress = || {
        let step = done.fetch_add(1, Ordering::Relaxed) + 1;
        events.step(STAGE, "pictures", step, Some(all), &[]);
    };
    let tile_every = cut.frames().div_ceil(SHEET_COLUMNS);
    let write_film = |(number, film): (usize, &Film)| -> Result<Decoded> {
        let shots = &cut.shots[number];
        let mut tiles = Vec::new();
        let mut decoder = film.frames(&cut.selection(number))?;
        for (frame, shot) in shots.iter().enumerate() {
            interrupt.check("some pictures")?;
            let Some(decoded) =
                decoder.by_ref().find(|next| next.as_ref().map_or(true, |next| next.index == shot.index))
            else {
                break;
            };
            let picture = decoded?.picture();
            picture.save_png(&folder.join(Cut::file_of(film, frame)))?;
            if frame.is_multiple_of(tile_every) {
                tiles.push(Some(labelled(&picture, None, &format!("{:.3}", shot.time_s))));
            }
            progress();
        }
        drop(decoder);
        Ok(Decoded { empty: write_background(folder, film, interrupt)?, tiles })
    };
    films.par_iter().enumerate().map(write_film).collect()
}

/// Writes the empty scene of a film, where there is none yet.
fn write_background(folder: &Path, film: &Film, interrupt: &Interrupt) -> Result<Option<EmptyScene>> {
    let path = folder.join(SceneFile::background_of(&film.name));
    if path.is_file() {
        return Ok(None);
    }
    let empty = EmptyScene::of(film, interrupt)?;
    empty.picture.save_png(&path)?;
    Ok(Some(empty))
}

fn describe<'a>(
    films: &[Film],
    alignment: &Alignment,
    cut: &Cut,
    empty: impl Iterator<Item = Option<&'a EmptyScene>>,
) -> Imported {
    let camera = |((film, offset_s), empty): ((&Film, &f64), Option<&EmptyScene>)| ImportedCamera {
        name: film.name.clone(),
        size_px: [film.width, film.height],
        frame_rate_hz: film.frame_rate_hz(),
        offset_s: *offset_s,
        never_free_px: empty.map(|empty| empty.never_free),
        taken_out_px: empty.map(|empty| empty.taken_out),
    };
    Imported {
        cameras: films.iter().zip(&alignment.offsets_s).zip(empty).map(camera).collect(),
        aligned_by: alignment.by,
        frames: cut.frames(),
        is_calibrated: false,
    }
}
