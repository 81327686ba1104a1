//! Frames: which pictures count as taken together, although each has its own time.

use std::collections::BTreeMap;

use crate::scene::Scene;
use crate::view::View;

/// Two times closer than this [s, or the unit of the format] are the same.
const SAME_TIME: f64 = 1e-6;
/// Cameras whose clocks differ by a whole number of periods to this share of one run together. Derived: times in files
/// are rounded to a thousandth of a period.
const SAME_PHASE: f64 = 1e-3;

/// Pictures of one camera each: `(camera, time)`.
type Shots<'a> = &'a [(usize, f64)];

/// The times of the frames, increasing, and the frame of each picture; `standing` cameras take many pictures each.
///
/// Where cameras share their times, each time is a frame. Where they do not, all run at one rate and frame n is what
/// each takes between the n-th and the next tick of that rate; it has the time of its earliest picture.
pub(crate) fn number_frames(shots: Shots, standing: bool) -> (Vec<f64>, Vec<usize>) {
    let shared = shared_times(shots);
    let mut own: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
    shots.iter().for_each(|(camera, time)| own.entry(*camera).or_default().push(*time));
    let most = own.values().map(Vec::len).max().unwrap_or_default();
    if !standing || shared.0.len() <= most {
        return shared;
    }
    own.values_mut().for_each(|times| times.sort_by(f64::total_cmp));
    let Some(period) = period(&own) else { return shared };
    let ticks = ticks(&own, period);
    let numbers: Vec<i64> = shots.iter().map(|(camera, time)| ticks[camera].number(*time, period)).collect();
    let mut distinct = numbers.clone();
    distinct.sort_unstable();
    distinct.dedup();
    let frames: Vec<usize> = numbers.iter().map(|number| distinct.partition_point(|other| other < number)).collect();
    let mut times = vec![f64::INFINITY; distinct.len()];
    shots.iter().zip(&frames).for_each(|((_, time), frame)| times[*frame] = times[*frame].min(*time));
    (times, frames)
}

/// Each distinct time is a frame.
fn shared_times(shots: Shots) -> (Vec<f64>, Vec<usize>) {
    let mut times: Vec<f64> = shots.iter().map(|(_, time)| *time).collect();
    times.sort_by(f64::total_cmp);
    times.dedup_by(|later, earlier| *later - *earlier <= SAME_TIME);
    let frames = shots.iter().map(|(_, time)| times.partition_point(|t| t <= time).saturating_sub(1)).collect();
    (times, frames)
}

/// The median time between two pictures of a camera; `None` where every camera took one.
fn period(own: &BTreeMap<usize, Vec<f64>>) -> Option<f64> {
    let mut steps: Vec<f64> = own.values().flat_map(|times| times.windows(2).map(|pair| pair[1] - pair[0])).collect();
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).copied().filter(|step| *step > SAME_TIME)
}

/// When a camera's shutter opens.
struct Ticks {
    /// Of the picture that the others are counted from.
    first: f64,
    /// Number of that picture's frame.
    frame: i64,
}

impl Ticks {
    fn number(&self, time: f64, period: f64) -> i64 {
        self.frame + ((time - self.first) / period).round() as i64
    }
}

/// The ticks of each camera: the phase of one whose pictures' times scatter is their mean.
fn ticks(own: &BTreeMap<usize, Vec<f64>>, period: f64) -> BTreeMap<usize, Ticks> {
    let phase = |times: &[f64]| {
        let scatter = times.iter().map(|time| time - times[0] - period * ((time - times[0]) / period).round());
        times[0] + scatter.sum::<f64>() / times.len() as f64
    };
    let phases: BTreeMap<usize, f64> = own.iter().map(|(camera, times)| (*camera, phase(times))).collect();
    let start = phases.values().copied().fold(f64::INFINITY, f64::min);
    let tick = |(camera, first): (usize, f64)| {
        (camera, Ticks { first, frame: ((first - start) / period + SAME_PHASE).floor() as i64 })
    };
    phases.into_iter().map(tick).collect()
}

impl Scene {
    /// Whether any picture was taken at another time than its frame's.
    pub fn has_lags(&self) -> bool {
        self.views.iter().any(|view| self.lags(view))
    }

    /// Whether a picture was taken at another time than its frame's.
    pub fn lags(&self, view: &View) -> bool {
        view.time_s - self.times[view.frame] > SAME_TIME
    }

    /// The same pictures with a frame for each time at which any was taken; the scene itself where none lags.
    #[must_use]
    pub fn moments(&self) -> Scene {
        let shots: Vec<(usize, f64)> = self.views.iter().map(|view| (view.camera, view.time_s)).collect();
        self.framed(shared_times(&shots), self.views.clone())
    }

    /// The number among [`Scene::moments`] of the time at which a picture was taken.
    pub fn moment_of(&self, moments: &Scene, view: &View) -> usize {
        moments.times.partition_point(|time| *time <= view.time_s + 0.5 * SAME_TIME).saturating_sub(1)
    }

    /// The same pictures as if each camera's clock had been `delays` [s] slow, by its index; the first one is at time
    /// 0 again.
    pub(crate) fn delayed(&self, delays: &[f64]) -> Scene {
        let mut views = self.views.clone();
        views.iter_mut().for_each(|view| view.time_s += delays[view.camera]);
        let start = views.iter().map(|view| view.time_s).fold(f64::INFINITY, f64::min);
        views.iter_mut().for_each(|view| view.time_s -= start);
        let shots: Vec<(usize, f64)> = views.iter().map(|view| (view.camera, view.time_s)).collect();
        self.framed(number_frames(&shots, self.has_fixed_cameras()), views)
    }

    fn framed(&self, (times, frames): (Vec<f64>, Vec<usize>), mut views: Vec<View>) -> Scene {
        views.iter_mut().zip(frames).for_each(|(view, frame)| view.frame = frame);
        views.sort_by_key(|view| (view.frame, view.camera));
        Scene { times, views, ..self.clone() }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn film(phases: &[f64], pictures: i32) -> Vec<(usize, f64)> {
        let camera =
            |(camera, phase): (usize, &f64)| (0..pictures).map(move |n| (camera, f64::from(n) + phase)).collect();
        phases.iter().enumerate().flat_map(|one| -> Vec<(usize, f64)> { camera(one) }).collect()
    }

    #[test]
    fn cameras_that_share_their_times_make_a_frame_of_each() {
        let (times, frames) = number_frames(&film(&[0.0, 0.0], 3), true);
        assert_eq!((times, frames), (vec![0.0, 1.0, 2.0], vec![0, 1, 2, 0, 1, 2]));
        // One camera lacks a frame.
        let (times, frames) = number_frames(&[(0, 0.0), (0, 2.0), (1, 0.0), (1, 1.0), (1, 2.0)], true);
        assert_eq!((times, frames), (vec![0.0, 1.0, 2.0], vec![0, 2, 0, 1, 2]));
    }

    #[test]
    fn a_camera_that_lags_by_more_than_a_frame_takes_part_in_later_ones() {
        let (times, frames) = number_frames(&film(&[0.0, 1.4], 3), true);
        assert_eq!((times, frames), (vec![0.0, 1.0, 2.0, 3.4], vec![0, 1, 2, 1, 2, 3]));
    }

    proptest! {
        /// Whatever the phases, and however the times scatter, the n-th pictures of all cameras are frame n.
        #[test]
        fn cameras_with_phases_of_their_own_share_frames(
            phases in prop::collection::vec(0.0..0.97f64, 2..5),
            scatter in prop::collection::vec(-0.005..0.005f64, 40),
        ) {
            let mut shots = film(&phases, 8);
            shots.iter_mut().zip(scatter.iter().cycle()).for_each(|((_, time), off)| *time += off);
            let (times, frames) = number_frames(&shots, true);
            prop_assert_eq!(times.len(), 8);
            prop_assert!(frames.iter().enumerate().all(|(shot, frame)| *frame == shot % 8), "{:?}", frames);
            for ((_, time), frame) in shots.iter().zip(&frames) {
                prop_assert!(*time >= times[*frame] && *time < times[*frame] + 1.0);
            }
        }
    }
}
