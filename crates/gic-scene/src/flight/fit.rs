//! The velocities of a flight that all outlines agree with.

use gic_optimize::least_squares;
use glam::DVec3;
use nalgebra::DVector;
use rayon::prelude::*;

use super::FreeFlight;
use super::outline::Outline;
use super::tangency::tangency;
use crate::{Camera, Hull, HullSettings, HullView, Mask};

/// Outlines of another frame may be so many times further from common tangents than those of one frame are, whose
/// misses no motion explains. Fitted on: five bodies, three cameras, with 1.2 at most in flight and 1.8 and more in the
/// first frame that touches the ground.
const LARGEST_EXCESS: f64 = 1.5;
/// What masks without noise leave of misses between frames [pixels], beside the misses in a frame. Fitted on: the same
/// bodies.
const PIXEL_NOISE_PX: f64 = 0.08;
/// Steps of finite differences of velocity [m/s], acceleration [m/s^2] and angular velocity [rad/s]. Derived: they move
/// outlines by less than a tenth of a pixel.
const MOTION_DIFFERENCES: [f64; 9] = [1e-3, 1e-3, 1e-3, 1e-2, 1e-2, 1e-2, 1e-2, 1e-2, 1e-2];
/// The same of a camera's delay [frames].
const DELAY_DIFFERENCE_FRAMES: f64 = 1e-3;

/// Frames whose hulls the first fits start from: as many as a parabola needs. Derived.
const PARABOLA_FRAMES: usize = 3;

/// What a camera shows of the body in a frame.
#[derive(Clone, Debug)]
pub struct FlightView {
    /// Index of the camera.
    pub index: usize,
    /// The camera.
    pub camera: Camera,
    /// The body's mask.
    pub mask: Mask,
}

/// An outline in a frame, by its camera's index.
struct Moment {
    frame: usize,
    camera: usize,
    outline: Outline,
}

impl Moment {
    fn new(frame: usize, view: &FlightView) -> Option<Moment> {
        Some(Moment { frame, camera: view.index, outline: Outline::new(&view.camera, &view.mask)? })
    }
}

/// What has been seen of the body so far.
#[derive(Default)]
struct Sightings {
    /// Outlines, frame by frame.
    moments: Vec<Moment>,
    /// Middles of the first frames' hulls [m], from which the first fits start.
    middles: Vec<DVec3>,
}

impl Sightings {
    /// Takes the views of a frame; `None` where they do not show the body as a whole.
    fn add(&mut self, frame: usize, views: &[FlightView]) -> Option<()> {
        if self.middles.len() < PARABOLA_FRAMES {
            self.middles.push(middle_of_hull(views)?);
        }
        let before = self.moments.len();
        self.moments.extend(views.iter().filter_map(|view| Moment::new(frame, view)));
        (self.moments.len() > before).then_some(())
    }

    /// The moments of the first frames.
    fn until(&self, frames: usize) -> &[Moment] {
        &self.moments[..self.moments.partition_point(|moment| moment.frame < frames)]
    }
}

/// The pairs of moments that are `wanted`.
fn pairs(moments: &[Moment], wanted: impl Fn(&Moment, &Moment) -> bool) -> Vec<[usize; 2]> {
    let all = (0..moments.len()).flat_map(|i| (0..i).map(move |k| [k, i]));
    all.filter(|[k, i]| wanted(&moments[*k], &moments[*i])).collect()
}

impl FreeFlight {
    /// The flight of the body that `views` of each frame show, asked for frame by frame; `times` [s] are the frames'.
    /// `None` where the outlines of two frames at least do not agree with a common flight, or where fewer than two
    /// cameras show the body as a whole.
    ///
    /// # Errors
    /// Those of `views`.
    pub fn find<E>(
        times: &[f64],
        mut views: impl FnMut(usize) -> Result<Vec<FlightView>, E>,
    ) -> Result<Option<FreeFlight>, E> {
        let mut seen = Sightings::default();
        let mut flight = FreeFlight::default();
        for (frame, time) in times.iter().enumerate() {
            let Some(()) = seen.add(frame, &views(frame)?) else { break };
            let longer = flight.clone().longer(time - times[0], &seen, true);
            // Delays are not known before there are two frames.
            let noise = if frame == 1 { &longer } else { &flight }.noise_px(&seen);
            if frame > 0 && !noise.is_some_and(|noise| longer.miss_of_newest(&seen) <= LARGEST_EXCESS * noise) {
                break;
            }
            flight = longer;
        }
        Ok((flight.frames() > 1).then(|| flight.without_idle_delays(&seen)))
    }

    /// The flight with a frame more, at `time` [s], fitted to its first frames' outlines with or without delays.
    fn longer(mut self, time: f64, seen: &Sightings, with_delays: bool) -> FreeFlight {
        self.times.push(time);
        self.about = seen.middles[0];
        let cameras = seen.moments.iter().map(|moment| moment.camera + 1).max().unwrap_or_default();
        self.delays.resize(cameras, 0.0);
        match parabola(&self.times, &seen.middles) {
            Some((velocity, acceleration)) => FreeFlight { velocity, acceleration, ..self }.fitted(seen, with_delays),
            None if self.frames() == 1 => self,
            None => self.fitted(seen, with_delays),
        }
    }

    /// The flight with velocities and, if asked, delays that the outlines agree with best.
    fn fitted(&self, seen: &Sightings, with_delays: bool) -> FreeFlight {
        let moments = seen.until(self.frames());
        let pairs = pairs(moments, |_, _| true);
        let residuals = |unknowns: &DVector<f64>| self.with(unknowns).misses(moments, &pairs);
        let delay = DELAY_DIFFERENCE_FRAMES * self.frame_seconds();
        let delays = if with_delays { self.delays.len() - 1 } else { 0 };
        let differences = [&MOTION_DIFFERENCES[..], &vec![delay; delays]].concat();
        let start = self.unknowns().rows(0, differences.len()).into_owned();
        let fit = least_squares(residuals, start, &differences);
        FreeFlight { miss_px: rms(&fit.residuals).unwrap_or_default(), ..self.with(&fit.unknowns) }
    }

    /// How far the outlines of the newest frame are from common tangents with all others, root mean square [pixels].
    fn miss_of_newest(&self, seen: &Sightings) -> f64 {
        let moments = seen.until(self.frames());
        let with_newest = pairs(moments, |a, b| a.frame.max(b.frame) + 1 == self.frames());
        rms(&self.misses(moments, &with_newest)).unwrap_or(f64::INFINITY)
    }

    /// How far outlines are from common tangents that no motion could bring nearer, root mean square [pixels].
    fn noise_px(&self, seen: &Sightings) -> Option<f64> {
        let moments = seen.until(self.frames());
        let same_frame = pairs(moments, |a, b| a.frame == b.frame);
        rms(&self.misses(moments, &same_frame)).map(|miss| miss.hypot(PIXEL_NOISE_PX))
    }

    /// The flight with common times of all cameras where these explain the outlines, too.
    fn without_idle_delays(self, seen: &Sightings) -> FreeFlight {
        let common = self.times.iter().fold(FreeFlight::default(), |flight, time| flight.longer(*time, seen, false));
        let noise = self.noise_px(seen).unwrap_or_default();
        if common.miss_px <= LARGEST_EXCESS * noise { common } else { self }
    }

    /// Mean time between frames [s].
    pub fn frame_seconds(&self) -> f64 {
        self.times.last().copied().unwrap_or_default() / (self.times.len() - 1).max(1) as f64
    }

    /// Velocity, acceleration, angular velocity, and the delays of all cameras but the first.
    fn unknowns(&self) -> DVector<f64> {
        let motion = [self.velocity, self.acceleration, self.angular_velocity].map(|v| v.to_array()).concat();
        DVector::from_vec([motion, self.delays[1..].to_vec()].concat())
    }

    /// The flight with other unknowns; delays that are not among them stay.
    fn with(&self, unknowns: &DVector<f64>) -> FreeFlight {
        let vector = |k: usize| DVec3::new(unknowns[k], unknowns[k + 1], unknowns[k + 2]);
        let mut delays = self.delays.clone();
        for (delay, unknown) in delays[1..].iter_mut().zip(unknowns.iter().skip(MOTION_DIFFERENCES.len())) {
            *delay = *unknown;
        }
        FreeFlight { velocity: vector(0), acceleration: vector(3), angular_velocity: vector(6), delays, ..self.clone() }
    }

    /// How far pairs of outlines, moved to the first frame, are from common tangents [pixels]; exactly zero where they
    /// can have none.
    fn misses(&self, moments: &[Moment], pairs: &[[usize; 2]]) -> DVector<f64> {
        let outlines: Vec<Outline> = moments.iter().map(|moment| self.outline_at_start(moment)).collect();
        let miss = |[k, i]: &[usize; 2]| tangency(&outlines[*k], &outlines[*i], self.about).unwrap_or_default();
        let misses: Vec<[f64; 2]> = pairs.par_iter().map(miss).collect();
        DVector::from_iterator(2 * misses.len(), misses.into_iter().flatten())
    }

    /// The outline that the body of the first frame has for a camera that sees it as at that moment.
    fn outline_at_start(&self, moment: &Moment) -> Outline {
        let time = self.times[moment.frame] + self.delays[moment.camera];
        let back = self.pose(time).0.transpose();
        Outline {
            centre: self.back(moment.outline.centre, time),
            rays: moment.outline.rays.iter().map(|ray| back * *ray).collect(),
            ..moment.outline
        }
    }
}

/// Velocity [m/s] and acceleration [m/s^2] at the first of two or three times [s] of a point that is at `places` [m];
/// `None` of more, from which a fit starts better than from middles of hulls.
fn parabola(times: &[f64], places: &[DVec3]) -> Option<(DVec3, DVec3)> {
    let mean = |k: usize| (places[k] - places[0]) / times[k];
    match times.len() {
        2 => Some((mean(1), DVec3::ZERO)),
        PARABOLA_FRAMES => {
            let acceleration = 2.0 * (mean(2) - mean(1)) / (times[2] - times[1]);
            Some((mean(1) - 0.5 * times[1] * acceleration, acceleration))
        }
        _ => None,
    }
}

/// Root mean square of the misses of pairs that have common tangents; `None` where there are none.
fn rms(misses: &DVector<f64>) -> Option<f64> {
    let count = misses.iter().filter(|miss| **miss != 0.0).count();
    (count > 0).then(|| (misses.norm_squared() / count as f64).sqrt())
}

/// The middle of what is inside of all masks [m].
fn middle_of_hull(views: &[FlightView]) -> Option<DVec3> {
    let shown: Vec<HullView> = views
        .iter()
        .filter(|view| view.mask.area() > 0.0)
        .map(|FlightView { camera, mask, .. }| HullView { camera, mask })
        .collect();
    let points = Hull::carve(&shown, &HullSettings::default())?.points();
    Some(points.iter().sum::<DVec3>() / points.len() as f64)
}
