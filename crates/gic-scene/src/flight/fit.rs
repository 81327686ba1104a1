//! The velocities of a flight that all outlines agree with.

use gic_optimize::{Minimum, least_squares};
use glam::DVec3;
use nalgebra::{DMatrix, DVector, Matrix6};
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
/// Steps of finite differences of velocity [m/s] and angular velocity [rad/s]. Derived: they move outlines by less than
/// a tenth of a pixel.
const VELOCITY_DIFFERENCES: [f64; 6] = [1e-3, 1e-3, 1e-3, 1e-2, 1e-2, 1e-2];
/// The same of the acceleration [m/s^2].
const ACCELERATION_DIFFERENCES: [f64; 3] = [1e-2; 3];
/// The same of a camera's delay [frames].
const DELAY_DIFFERENCE_FRAMES: f64 = 1e-3;

/// Frames whose hulls the first fits start from: as many as a parabola needs. Derived.
const PARABOLA_FRAMES: usize = 3;

/// What a fit seeks besides velocity and angular velocity.
#[derive(Clone, Copy)]
struct Sought {
    acceleration: bool,
    delays: bool,
}

/// What a camera shows of the body in a frame.
#[derive(Clone, Debug)]
pub struct FlightView {
    /// Index of the camera.
    pub index: usize,
    /// The camera.
    pub camera: Camera,
    /// By how much its picture is known to be later than the frame's time [s].
    pub lag_s: f64,
    /// The body's mask.
    pub mask: Mask,
}

/// An outline in a frame, by its camera's index.
struct Moment {
    frame: usize,
    camera: usize,
    lag_s: f64,
    outline: Outline,
}

impl Moment {
    fn new(frame: usize, view: &FlightView) -> Option<Moment> {
        let outline = Outline::new(&view.camera, &view.mask)?;
        Some(Moment { frame, camera: view.index, lag_s: view.lag_s, outline })
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
    /// The acceleration is the given one [m/s^2], or sought, and so are the cameras' delays where `delays` says so.
    /// `None` where the outlines of two frames at least do not
    /// agree with a common flight, or where fewer than two cameras show the body as a whole.
    ///
    /// # Errors
    /// Those of `views`.
    pub fn find<E>(
        times: &[f64],
        acceleration: Option<DVec3>,
        delays: bool,
        mut views: impl FnMut(usize) -> Result<Vec<FlightView>, E>,
    ) -> Result<Option<FreeFlight>, E> {
        let mut seen = Sightings::default();
        let sought = Sought { acceleration: acceleration.is_none(), delays };
        let start = FreeFlight { acceleration: acceleration.unwrap_or_default(), ..FreeFlight::default() };
        let mut flight = start.clone();
        for (frame, time) in times.iter().enumerate() {
            let Some(()) = seen.add(frame, &views(frame)?) else { break };
            let longer = flight.clone().longer(time - times[0], &seen, sought);
            // Delays are not known before there are two frames.
            let noise = if frame == 1 { &longer } else { &flight }.noise_px(&seen);
            if frame > 0 && !noise.is_some_and(|noise| longer.miss_of_newest(&seen) <= LARGEST_EXCESS * noise) {
                break;
            }
            flight = longer;
        }
        Ok(match flight.frames() {
            0 | 1 => None,
            _ if delays => Some(flight.without_idle_delays(start, &seen, sought)),
            _ => Some(flight),
        })
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
        self.fitted(seen, sought)
    }

    /// The flight with the unknowns that the outlines agree with best.
    fn fitted(&self, seen: &Sightings, sought: Sought) -> FreeFlight {
        let moments = seen.until(self.frames());
        let pairs = pairs(moments, |_, _| true);
        let residuals = |unknowns: &DVector<f64>| self.with(unknowns, sought).misses(moments, &pairs);
        let differences = self.differences(sought);
        let fit = least_squares(residuals, self.unknowns(sought), &differences);
        let miss_px = rms(&fit.residuals).unwrap_or_default();
        let covariance = covariance(residuals, &fit, &differences, moments.len());
        FreeFlight { miss_px, covariance, ..self.with(&fit.unknowns, sought) }
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

    /// The flight with common times of all cameras, fitted from the `start` on, where these explain the outlines, too.
    fn without_idle_delays(self, start: FreeFlight, seen: &Sightings, sought: Sought) -> FreeFlight {
        let sought = Sought { delays: false, ..sought };
        let common = self.times.iter().fold(start, |flight, time| flight.longer(*time, seen, sought));
        let noise = self.noise_px(seen).unwrap_or_default();
        if common.miss_px <= LARGEST_EXCESS * noise { common } else { self }
    }

    /// Mean time between frames [s].
    pub fn frame_seconds(&self) -> f64 {
        self.times.last().copied().unwrap_or_default() / (self.times.len() - 1).max(1) as f64
    }

    /// Velocity and angular velocity, and where they are sought the acceleration and the delays of all cameras but the
    /// first.
    fn unknowns(&self, sought: Sought) -> DVector<f64> {
        let mut unknowns = [self.velocity, self.angular_velocity].map(|v| v.to_array()).concat();
        if sought.acceleration {
            unknowns.extend(self.acceleration.to_array());
        }
        if sought.delays {
            unknowns.extend(&self.delays[1..]);
        }
        DVector::from_vec(unknowns)
    }

    /// Steps of the unknowns' finite differences.
    fn differences(&self, sought: Sought) -> Vec<f64> {
        let mut differences = VELOCITY_DIFFERENCES.to_vec();
        if sought.acceleration {
            differences.extend(ACCELERATION_DIFFERENCES);
        }
        if sought.delays {
            let delay = DELAY_DIFFERENCE_FRAMES * self.frame_seconds();
            differences.extend(self.delays[1..].iter().map(|_| delay));
        }
        differences
    }

    /// The flight with other unknowns.
    fn with(&self, unknowns: &DVector<f64>, sought: Sought) -> FreeFlight {
        let vector = |k: usize| DVec3::new(unknowns[k], unknowns[k + 1], unknowns[k + 2]);
        let mut flight = FreeFlight { velocity: vector(0), angular_velocity: vector(3), ..self.clone() };
        let mut next = VELOCITY_DIFFERENCES.len();
        if sought.acceleration {
            flight.acceleration = vector(next);
            next += ACCELERATION_DIFFERENCES.len();
        }
        if sought.delays {
            flight.delays[1..].copy_from_slice(&unknowns.as_slice()[next..]);
        }
        flight
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
        let time = self.times[moment.frame] + moment.lag_s + self.delays[moment.camera];
        let back = self.pose(time).0.transpose();
        Outline {
            centre: self.back(moment.outline.centre, time),
            rays: moment.outline.rays.iter().map(|ray| back * *ray).collect(),
            ..moment.outline
        }
    }
}

/// Covariance of velocity [m/s] and angular velocity [rad/s] at a minimum. Each of the outlines takes part in as many
/// pairs as there are others, and these share its error: together they say no more than one of them.
fn covariance(
    residuals: impl Fn(&DVector<f64>) -> DVector<f64>,
    fit: &Minimum,
    differences: &[f64],
    outlines: usize,
) -> Matrix6<f64> {
    let misses = rms(&fit.residuals).unwrap_or_default();
    let shared = outlines.saturating_sub(1) as f64;
    let curvature = fit.curvature(residuals, differences);
    // Unknown to any extent where the outlines do not tell all.
    let inverse = curvature
        .try_inverse()
        .unwrap_or_else(|| DMatrix::from_diagonal_element(differences.len(), differences.len(), f64::INFINITY));
    inverse.fixed_view::<6, 6>(0, 0) * (misses * misses * shared)
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
