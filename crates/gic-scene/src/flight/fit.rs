//! The velocities of a flight that all outlines agree with.

use gic_optimize::least_squares;
use glam::DVec3;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::FreeFlight;
use super::moment::{FlightView, Moment};
use super::outline::Cone;
use super::tangency::tangency;
use super::unknowns::{Sought, Unknowns, VELOCITIES};
use crate::{Hull, HullSettings, HullView};

/// Outlines of another frame may be so many times further from common tangents than those of one frame are, whose
/// misses no motion explains. Fitted on: five bodies, three cameras, with 1.2 at most in flight and 1.8 and more in the
/// first frame that touches the ground.
const LARGEST_EXCESS: f64 = 1.5;
/// What masks without noise leave of misses between frames [pixels], beside the misses in a frame. Fitted on: the same
/// bodies.
const PIXEL_NOISE_PX: f64 = 0.08;
/// Frames whose hulls the first fits start from: as many as a parabola needs. Derived.
const PARABOLA_FRAMES: usize = 3;

/// Rounds of fitting with a prior, whose weight follows from the misses. Budget: these settle to a tenth.
const PRIOR_ROUNDS: usize = 2;

/// Steps over which it is measured how well the outlines tell the unknowns, in those of the fit. Derived: they move
/// outlines by up to a pixel, as far as corners of their hulls lie apart, from one of which to the next tangents go.
const CORNERS: f64 = 10.0;

/// What a flight may show of the cameras.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Seek {
    /// By how much they lag.
    pub delays: bool,
    /// Errors of their calibration.
    pub errors: bool,
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
    /// Whether a frame's views have been taken.
    fn have(&self, frame: usize) -> bool {
        self.moments.last().is_some_and(|newest| frame <= newest.frame)
    }

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
    /// The acceleration is the given one [m/s^2], or sought, and so is what `seek` says of the cameras. `None` where
    /// the outlines of two frames at least do not agree with a common flight, or where fewer than two cameras show the
    /// body as a whole.
    ///
    /// # Errors
    /// Those of `views`.
    pub fn find<E>(
        times: &[f64],
        acceleration: Option<DVec3>,
        seek: Seek,
        mut views: impl FnMut(usize) -> Result<Vec<FlightView>, E>,
    ) -> Result<Option<FreeFlight>, E> {
        let mut seen = Sightings::default();
        let start = FreeFlight { acceleration: acceleration.unwrap_or_default(), ..FreeFlight::default() };
        let plain = Sought { acceleration: acceleration.is_none(), delays: false, errors: false };
        let simple = start.followed(times, &mut seen, plain, &mut views)?;
        if seek == Seek::default() || (simple.frames() >= 2 && simple.spread_px <= LARGEST_EXCESS * PIXEL_NOISE_PX) {
            return Ok(Some(simple).filter(|flight| flight.frames() >= 2));
        }
        let full = Sought { delays: seek.delays, errors: seek.errors, ..plain };
        let flight = start.followed(times, &mut seen, full, &mut views)?;
        Ok((flight.frames() >= 2).then(|| flight.simplest(&start, &seen, full)))
    }

    /// The flight through as many frames as outlines agree with.
    fn followed<E>(
        &self,
        times: &[f64],
        seen: &mut Sightings,
        sought: Sought,
        views: &mut impl FnMut(usize) -> Result<Vec<FlightView>, E>,
    ) -> Result<FreeFlight, E> {
        let mut flight = self.clone();
        for (frame, time) in times.iter().enumerate() {
            if !seen.have(frame) && seen.add(frame, &views(frame)?).is_none() {
                break;
            }
            let longer = flight.clone().longer(time - times[0], seen, sought);
            if frame > 0 {
                let noise = if flight.is_told() { &flight } else { &longer }.noise_px(seen, sought);
                if !noise.is_some_and(|noise| longer.miss_of_newest(seen) <= LARGEST_EXCESS * noise) {
                    break;
                }
            }
            flight = longer;
        }
        Ok(flight)
    }

    /// The flight with a frame more, at `time` [s], fitted to its first frames' outlines.
    fn longer(mut self, time: f64, seen: &Sightings, sought: Sought) -> FreeFlight {
        self.times.push(time);
        self.about = seen.middles[0];
        let cameras = seen.moments.iter().map(|moment| moment.camera + 1).max().unwrap_or_default();
        self.delays.resize(cameras, 0.0);
        if self.frames() == 1 {
            return self;
        }
        let known = (!sought.acceleration).then_some(self.acceleration);
        if let Some((velocity, acceleration)) = parabola(&self.times, &seen.middles, known) {
            (self.velocity, self.acceleration) = (velocity, acceleration);
        }
        let carried = self.fitted(seen, sought);
        if self.angular_velocity == DVec3::ZERO {
            return carried;
        }
        // Few outlines leave several minima along the spin, and one more frame does not lead out of a wrong one.
        self.angular_velocity = DVec3::ZERO;
        let from_no_spin = self.fitted(seen, sought);
        if carried.miss_px.total_cmp(&from_no_spin.miss_px).is_lt() { carried } else { from_no_spin }
    }

    /// The flight with the unknowns that the outlines agree with best.
    fn fitted(&self, seen: &Sightings, sought: Sought) -> FreeFlight {
        let mut flight = self.clone();
        for _ in 0..if sought.errors { PRIOR_ROUNDS } else { 1 } {
            flight = flight.fitted_once(seen, sought);
        }
        flight
    }

    /// The same, the weight of the prior following from the outlines' errors that the last fit left.
    fn fitted_once(&self, seen: &Sightings, sought: Sought) -> FreeFlight {
        let moments = seen.until(self.frames());
        let pairs = pairs(moments, |_, _| true);
        let unknowns = Unknowns::new(sought, self, moments);
        let shared = moments.len().saturating_sub(1) as f64;
        let noise = if self.is_told() { self.spread_px } else { self.miss_px }.hypot(PIXEL_NOISE_PX);
        let residuals = |values: &DVector<f64>| {
            let misses = unknowns.put(self, values).misses(moments, &pairs);
            unknowns.with_prior(misses, values, noise * shared.sqrt())
        };
        let differences = unknowns.differences();
        let fit = least_squares(residuals, unknowns.of(self), &differences);
        let flight = unknowns.put(self, &fit.unknowns);
        let miss_px = rms(&fit.residuals.rows(0, 2 * pairs.len()).into_owned()).unwrap_or_default();
        let over_corners: Vec<f64> = differences.iter().map(|difference| CORNERS * difference).collect();
        let inverse = inverse(fit.curvature(residuals, &over_corners));
        let told = 2.0 * moments.len() as f64 - unknowns.told(&inverse, noise * shared.sqrt());
        let spread_px = miss_px * (2.0 * moments.len() as f64 / told.max(0.0)).sqrt();
        // Each of the outlines takes part in as many pairs as there are others, and these share its error: together
        // they say no more than one of them.
        let error_px = if spread_px.is_finite() { spread_px } else { noise };
        let covariance = inverse * (error_px * error_px * shared);
        FreeFlight {
            miss_px,
            spread_px,
            error_deviations: unknowns.error_deviations(&covariance),
            covariance: covariance.fixed_view::<VELOCITIES, VELOCITIES>(0, 0).into_owned(),
            ..flight
        }
    }

    /// How far the outlines of the newest frame are from common tangents with all others, root mean square [pixels].
    fn miss_of_newest(&self, seen: &Sightings) -> f64 {
        let moments = seen.until(self.frames());
        let with_newest = pairs(moments, |a, b| a.frame.max(b.frame) + 1 == self.frames());
        rms(&self.misses(moments, &with_newest)).unwrap_or(f64::INFINITY)
    }

    /// Whether the outlines are more than what is sought.
    fn is_told(&self) -> bool {
        self.frames() > 1 && self.spread_px.is_finite()
    }

    /// How far outlines are from common tangents that no motion could bring nearer, root mean square [pixels]: those of
    /// a frame, and per degree of freedom where what is sought of the cameras brings them nearer.
    fn noise_px(&self, seen: &Sightings, sought: Sought) -> Option<f64> {
        let moments = seen.until(self.frames());
        let same_frame = pairs(moments, |a, b| a.frame == b.frame);
        let by_cameras = (sought.delays || sought.errors) && self.is_told() && self.miss_px > 0.0;
        let of_freedom = if by_cameras { self.spread_px / self.miss_px } else { 1.0 };
        rms(&self.misses(moments, &same_frame)).map(|miss| of_freedom * miss.hypot(PIXEL_NOISE_PX))
    }

    /// The flight that takes least of what is sought of the cameras and explains the outlines as well as this one does,
    /// fitted from the `start` on: common times, else delays, else errors of cameras, too.
    fn simplest(self, start: &FreeFlight, seen: &Sightings, sought: Sought) -> FreeFlight {
        let enough = LARGEST_EXCESS * self.spread_px.hypot(PIXEL_NOISE_PX);
        let less = [Sought { delays: false, errors: false, ..sought }, Sought { errors: false, ..sought }];
        let without =
            |less: Sought| self.times.iter().fold(start.clone(), |flight, time| flight.longer(*time, seen, less));
        less.into_iter().map(without).find(|flight| flight.spread_px <= enough).unwrap_or(self)
    }

    /// How far pairs of outlines, moved to the first frame, are from common tangents [pixels]; exactly zero where they
    /// can have none.
    fn misses(&self, moments: &[Moment], pairs: &[[usize; 2]]) -> DVector<f64> {
        let cones: Vec<Cone> = moments.par_iter().map(|moment| self.cone_at_start(moment)).collect();
        let miss = |[k, i]: &[usize; 2]| tangency(&cones[*k], &cones[*i], self.about).unwrap_or_default();
        let misses: Vec<[f64; 2]> = pairs.par_iter().map(miss).collect();
        DVector::from_iterator(2 * misses.len(), misses.into_iter().flatten())
    }

    /// The cone of the body of the first frame for a camera that sees it as at that moment.
    fn cone_at_start(&self, moment: &Moment) -> Cone {
        let time = self.times[moment.frame] + moment.lag_s + self.delays[moment.camera];
        let back = self.pose(time).0.transpose();
        let cone = moment.outline.cone(&self.errors.get(moment.camera).copied().unwrap_or_default());
        Cone { centre: self.back(cone.centre, time), rays: cone.rays.iter().map(|ray| back * *ray).collect(), ..cone }
    }
}

/// The inverse of a curvature, infinite where the outlines do not tell all.
fn inverse(curvature: DMatrix<f64>) -> DMatrix<f64> {
    let size = curvature.nrows();
    curvature.try_inverse().unwrap_or_else(|| DMatrix::from_diagonal_element(size, size, f64::INFINITY))
}

/// Velocity [m/s] and acceleration [m/s^2] at the first of two or three times [s] of a point that is at `places` [m],
/// its acceleration known or not; `None` of more, from which a fit starts better than from middles of hulls.
fn parabola(times: &[f64], places: &[DVec3], acceleration: Option<DVec3>) -> Option<(DVec3, DVec3)> {
    let mean = |k: usize| (places[k] - places[0]) / times[k];
    let last = times.len() - 1;
    match (times.len(), acceleration) {
        (2..=PARABOLA_FRAMES, Some(known)) => Some((mean(last) - 0.5 * times[last] * known, known)),
        (2, None) => Some((mean(1), DVec3::ZERO)),
        (PARABOLA_FRAMES, None) => {
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
