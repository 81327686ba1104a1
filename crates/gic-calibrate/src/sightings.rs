//! From films to views: pictures, the tags in them, and their aligned corners.

use gic_film::{Film, Selection, open_films};
use gic_twin::Interrupt;
use rayon::prelude::*;

use crate::align::{align, shifted};
use crate::board::Board;
use crate::detect::{Sighting, find_tags, other_family};
use crate::error::{CalibrateError, Result};
use crate::grey::Grey;
use crate::request::{CalibrateRequest, Motion};
use crate::rig::{Rig, View};
use crate::tuning::{MOVING_MOMENTS, STILL_FRAMES, STILL_SHIFT_PX};

/// What all cameras saw.
pub(crate) struct Sightings {
    /// Names of the cameras.
    pub(crate) names: Vec<String>,
    /// Width and height of their pictures [pixels].
    pub(crate) sizes: Vec<[usize; 2]>,
    /// The views that show tags.
    pub(crate) views: Vec<View>,
    /// The picture of each view.
    pub(crate) pictures: Vec<Grey>,
    /// Number of moments.
    pub(crate) moments: usize,
}

impl Sightings {
    /// Reads films and finds the board's tags in them.
    pub(crate) fn read(request: &CalibrateRequest, interrupt: &Interrupt) -> Result<Sightings> {
        // When pictures were taken matters to moving boards only, and there all cameras count alike.
        let films = open_films(&request.films, Some(request.frame_rate_hz.unwrap_or(1.0)))?;
        let seen: Vec<Vec<(usize, Grey, Vec<Sighting>)>> = match request.motion {
            Motion::Still => {
                let one = |film: &Film| {
                    still_view(film, request.board.border(), interrupt).map(|(picture, tags)| vec![(0, picture, tags)])
                };
                films.par_iter().map(one).collect::<Result<_>>()?
            }
            Motion::Moving => {
                let moments = moments(&films);
                films
                    .par_iter()
                    .map(|film| moving_views(film, &moments, request.board.border(), interrupt))
                    .collect::<Result<_>>()?
            }
        };
        let mut all = Sightings {
            names: films.iter().map(|film| film.name.clone()).collect(),
            sizes: films.iter().map(|film| [film.width, film.height]).collect(),
            views: Vec::new(),
            pictures: Vec::new(),
            moments: 0,
        };
        for (camera, pictures) in seen.into_iter().enumerate() {
            check_tags(&films[camera].name, &pictures, request.board)?;
            for (moment, picture, tags) in pictures {
                let is_own = |tag: &Sighting| request.board.sheet_of(tag.id).is_some();
                let aligned: Vec<Sighting> =
                    tags.iter().filter(|t| is_own(t)).filter_map(|t| align(&picture, t)).collect();
                if !aligned.is_empty() {
                    all.views.push(View { camera, moment, tags: aligned });
                    all.pictures.push(picture);
                }
            }
            if all.views.iter().all(|view| view.camera != camera) {
                return Err(no_tag(&films[camera].name, "its tags are cut off, blurred or too small"));
            }
        }
        all.number_moments();
        Ok(all)
    }

    /// Moments that no view has are left out.
    fn number_moments(&mut self) {
        let mut seen: Vec<usize> = self.views.iter().map(|view| view.moment).collect();
        seen.sort_unstable();
        seen.dedup();
        for view in &mut self.views {
            view.moment = seen.binary_search(&view.moment).unwrap_or_default();
        }
        self.moments = seen.len();
    }

    /// The sightings of one camera alone.
    pub(crate) fn of_camera(&self, camera: usize) -> Sightings {
        let own = || self.views.iter().zip(&self.pictures).filter(move |(view, _)| view.camera == camera);
        let mut alone = Sightings {
            names: vec![self.names[camera].clone()],
            sizes: vec![self.sizes[camera]],
            views: own().map(|(view, _)| View { camera: 0, ..view.clone() }).collect(),
            pictures: own().map(|(_, picture)| picture.clone()).collect(),
            moments: 0,
        };
        alone.number_moments();
        alone
    }

    /// Looks for the tags that views should show by the rig and do not have yet; returns how many were found.
    pub(crate) fn search(&mut self, rig: &Rig, border: usize) -> usize {
        let find = |(view, picture): (&View, &Grey)| -> Vec<Sighting> {
            let is_new = |tag: &usize| view.tags.iter().all(|seen| seen.id != rig.tags[*tag].1.id);
            let guess = |tag: usize| {
                let corners = rig.predict(view.camera, view.moment, tag)?;
                align(picture, &shifted(picture, &Sighting { id: rig.tags[tag].1.id, corners, border })?)
            };
            (0..rig.tags.len()).filter(is_new).filter_map(guess).collect()
        };
        let found: Vec<Vec<Sighting>> = self.views.par_iter().zip(&self.pictures).map(find).collect();
        let count = found.iter().map(Vec::len).sum();
        self.views.iter_mut().zip(found).for_each(|(view, tags)| view.tags.extend(tags));
        count
    }
}

/// Decodes some frames, by their numbers in ascending order.
fn frames(film: &Film, numbers: &[usize], interrupt: &Interrupt) -> Result<Vec<Grey>> {
    let (Some(first), Some(last)) = (numbers.first(), numbers.last()) else { return Ok(Vec::new()) };
    let mut found = Vec::new();
    for frame in film.frames(&Selection { range: *first..last + 1, every: 1 })? {
        interrupt.check("some pictures")?;
        let frame = frame?;
        if numbers.binary_search(&frame.index).is_ok() {
            found.push(Grey::of(&frame));
        }
    }
    Ok(found)
}

/// What a still camera sees of a still board.
fn still_view(film: &Film, border: usize, interrupt: &Interrupt) -> Result<(Grey, Vec<Sighting>)> {
    let numbers = gic_scene::sheet::evenly_spaced(film.times_s.len(), STILL_FRAMES);
    let frames = frames(film, &numbers, interrupt)?;
    if let (Some(first), Some(last)) = (frames.first(), frames.last()) {
        check_still(&film.name, &find_tags(first, border), &find_tags(last, border))?;
    }
    let picture = Grey::still(&frames).ok_or_else(|| no_tag(&film.name, "its film has no frame"))?;
    let tags = find_tags(&picture, border);
    Ok((picture, tags))
}

/// Refuses a board that moves from the first to the last frame.
fn check_still(name: &str, first: &[Sighting], last: &[Sighting]) -> Result<()> {
    let mut shifts: Vec<f64> = Vec::new();
    for tag in first {
        if let Some(other) = last.iter().find(|other| other.id == tag.id) {
            shifts.extend(tag.corners.iter().zip(&other.corners).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])));
        }
    }
    shifts.sort_unstable_by(f64::total_cmp);
    match shifts.get(shifts.len() / 2) {
        Some(shift) if *shift > STILL_SHIFT_PX => Err(CalibrateError::usage(
            format!("camera {name}: its tags move by {shift:.1} pixels from the first to the last frame"),
            "give --moving where the board is shown in several places, else film it again with board and camera at rest",
        )),
        _ => Ok(()),
    }
}

/// Moments [s] at which moving boards are looked at, from the beginning of all films.
fn moments(films: &[Film]) -> Vec<f64> {
    let shortest = films.iter().min_by(|a, b| f64::total_cmp(&length_s(a), &length_s(b)));
    let times = shortest.map_or(&[][..], |film| &film.times_s);
    gic_scene::sheet::evenly_spaced(times.len(), MOVING_MOMENTS).into_iter().map(|n| times[n]).collect()
}

fn length_s(film: &Film) -> f64 {
    film.times_s.last().copied().unwrap_or_default()
}

fn moving_views(
    film: &Film,
    moments: &[f64],
    border: usize,
    interrupt: &Interrupt,
) -> Result<Vec<(usize, Grey, Vec<Sighting>)>> {
    let nearest = |moment: &f64| {
        let distance = |n: &usize| (film.times_s[*n] - moment).abs();
        (0..film.times_s.len()).min_by(|a, b| f64::total_cmp(&distance(a), &distance(b))).unwrap_or_default()
    };
    let mut numbers: Vec<usize> = moments.iter().map(nearest).collect();
    let wanted = numbers.clone();
    numbers.dedup();
    let pictures = frames(film, &numbers, interrupt)?;
    let mut views = Vec::new();
    for (number, picture) in numbers.into_iter().zip(pictures) {
        interrupt.check("some pictures")?;
        let moment = wanted.iter().position(|n| *n == number).unwrap_or_default();
        let tags = find_tags(&picture, border);
        views.push((moment, picture, tags));
    }
    Ok(views)
}

/// Refuses a camera without tags of the board.
fn check_tags(name: &str, pictures: &[(usize, Grey, Vec<Sighting>)], board: Board) -> Result<()> {
    let found: Vec<u32> = pictures.iter().flat_map(|(_, _, tags)| tags.iter().map(|tag| tag.id)).collect();
    if found.iter().any(|id| board.sheet_of(*id).is_some()) {
        return Ok(());
    }
    if let Some(id) = found.first() {
        return Err(CalibrateError::pictures(
            format!("camera {name} sees tag {id}, which the board {board} does not have"),
            "name the board that was printed with --board; tags alone are `--board tags`",
        ));
    }
    match pictures.iter().find_map(|(_, picture, _)| other_family(picture, board.border())) {
        Some(family) => Err(CalibrateError::pictures(
            format!("camera {name} sees tags of {family}, none of the board {board}"),
            "name the board that was printed with --board, or print one with `gic calibrate --print board.pdf`",
        )),
        None => Err(no_tag(name, "no tag of the family 36h11 is found in its pictures")),
    }
}

fn no_tag(name: &str, why: &str) -> CalibrateError {
    CalibrateError::pictures(
        format!("camera {name}: {why}"),
        "show the board from nearer, sharp and evenly lit, with the white around the tags; print larger tags; or leave \
         the camera out",
    )
}
