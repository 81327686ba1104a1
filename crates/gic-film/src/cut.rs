//! Which frames of each film become pictures of the scene.

use std::path::PathBuf;

use crate::error::{FilmError, Result};
use crate::film::Film;
use crate::frames::Selection;
use crate::request::ImportRequest;
use crate::tuning::SIMULTANEOUS_SHARE;

/// A frame of a film in the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Shot {
    /// Its number in the film.
    pub(crate) index: usize,
    /// When it was taken [s], from the first picture of the scene.
    pub(crate) time_s: f64,
}

/// The frames that are cut out of each film.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Cut {
    /// Per film, the shot of each frame.
    pub(crate) shots: Vec<Vec<Shot>>,
}

impl Cut {
    /// The slowest film gives the times; of each other film the nearest frames are taken, each with its own time.
    ///
    /// # Errors
    /// [`FilmError::Usage`] for a cut that lies outside the films.
    pub(crate) fn of(films: &[Film], offsets_s: &[f64], request: &ImportRequest) -> Result<Cut> {
        let clock = |film: usize| films[film].times_s.iter().map(move |time| time + offsets_s[film]);
        let begin = |film: usize| clock(film).next().unwrap_or_default();
        let end = |film: usize| clock(film).next_back().unwrap_or_default();
        let rate = |film: usize| films[film].frame_rate_hz().unwrap_or(f64::INFINITY);
        let all = 0..films.len();
        let slowest = all.clone().min_by(|&a, &b| rate(a).total_cmp(&rate(b))).unwrap_or_default();
        let period = 1.0 / rate(slowest).max(f64::MIN_POSITIVE);
        let first_s = all.clone().map(begin).fold(f64::NEG_INFINITY, f64::max);
        let last_s = all.clone().map(end).fold(f64::INFINITY, f64::min);
        let start_s = request.start_s.unwrap_or(first_s);
        // Half a period: the nearest frame of a film may begin a little later than asked for.
        let (from, to) = (start_s - SIMULTANEOUS_SHARE * period, last_s + 0.5 * period);
        let ticks: Vec<f64> =
            clock(slowest).filter(|time| *time >= from && *time <= to).step_by(request.every).collect();
        let wanted = request.frames.unwrap_or(ticks.len());
        let has_begun = start_s >= first_s - 0.5 * period;
        if !has_begun || ticks.is_empty() || wanted > ticks.len() {
            return Err(FilmError::usage(
                format!(
                    "the films run together from {first_s:.3} to {last_s:.3} s; from {start_s:.3} s on they have {} of \
                     {} frames",
                    ticks.len(),
                    request.frames.map_or("the".into(), |frames| frames.to_string())
                ),
                "change --start, --frames or --every; --thumbnails shows the films with their times",
            ));
        }
        let shots = all.map(|film| {
            let times: Vec<f64> = clock(film).collect();
            let shot = |tick: &f64| {
                let after = times.partition_point(|time| time < tick).min(times.len() - 1);
                let before = after.saturating_sub(1);
                let index = if tick - times[before] < times[after] - tick { before } else { after };
                let is_same = (times[index] - tick).abs() <= SIMULTANEOUS_SHARE * period;
                Shot { index, time_s: if is_same { *tick } else { times[index] } }
            };
            ticks[..wanted].iter().map(shot).collect()
        });
        let mut cut = Cut { shots: shots.collect() };
        let earliest = cut.shots.iter().flatten().map(|shot| shot.time_s).fold(f64::INFINITY, f64::min);
        cut.shots.iter_mut().flatten().for_each(|shot| shot.time_s -= earliest);
        Ok(cut)
    }

    /// Number of frames.
    pub(crate) fn frames(&self) -> usize {
        self.shots.first().map_or(0, Vec::len)
    }

    /// What to decode of a film to meet all of its shots.
    pub(crate) fn selection(&self, film: usize) -> Selection {
        let shots = &self.shots[film];
        let (first, last) = (shots[0].index, shots[shots.len() - 1].index);
        let step = shots.get(1).map_or(1, |second| second.index - first).max(1);
        let is_even = shots.iter().enumerate().all(|(n, shot)| shot.index == first + n * step);
        Selection { range: first..last + 1, every: if is_even { step } else { 1 } }
    }

    /// The file of a picture, from the scene's folder.
    pub(crate) fn file_of(film: &Film, frame: usize) -> PathBuf {
        PathBuf::from("images").join(format!("{}_{frame:04}.png", film.name))
    }
}
