//! The velocities of a flight that all outlines agree with.

use gic_optimize::{Minimum, least_squares};
use glam::DVec3;
use nalgebra::DVector;
use rayon::prelude::*;

use super::FreeFlight;
use super::outline::Outline;
use super::tangency::tangency;
use crate::{Camera, Hull, HullSettings, HullView, Mask};

/// Outlines of different frames may be so many times further from common tangents than those of one frame are, whose
/// misses no motion explains. Fitted on: five bodies, three cameras, which have at most 2.2 in flight and 3.5 and
/// more in the first frame that touches the ground.
const LARGEST_EXCESS: f64 = 3.0;
/// The noise of outlines is at least this [pixels]. Fitted on: the same bodies, where it is .03 to .054; few pairs of
/// one frame tell it badly.
const LEAST_NOISE_PX: f64 = 0.05;
/// Steps of finite differences of velocity [m/s], acceleration [m/s^2] and angular velocity [rad/s]. Derived: they move
/// outlines by less than a tenth of a pixel.
const DIFFERENCES: [f64; 9] = [1e-3, 1e-3, 1e-3, 1e-2, 1e-2, 1e-2, 1e-2, 1e-2, 1e-2];

/// An outline in a frame.
struct Moment {
    frame: usize,
    outline: Outline,
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
        mut views: impl FnMut(usize) -> Result<Vec<(Camera, Mask)>, E>,
    ) -> Result<Option<FreeFlight>, E> {
        let (mut moments, mut middles, mut found) = (Vec::new(), Vec::new(), None);
        let mut start: Option<FreeFlight> = None;
        for frame in 0..times.len() {
            let seen = views(frame)?;
            let Some(middle) = middle_of_hull(&seen) else { break };
            middles.push(middle);
            let outlines = seen.iter().filter_map(|(camera, mask)| Outline::new(camera, mask));
            moments.extend(outlines.map(|outline| Moment { frame, outline }));
            let flight = start.get_or_insert_with(|| FreeFlight {
                about: middle,
                velocity: DVec3::ZERO,
                acceleration: DVec3::ZERO,
                angular_velocity: DVec3::ZERO,
                times: Vec::new(),
                miss_px: 0.0,
            });
            let time = times[frame] - times[0];
            flight.times.push(time);
            if frame == 0 {
                continue;
            }
            if let Some((velocity, acceleration)) = parabola(&flight.times, &middles) {
                (flight.velocity, flight.acceleration) = (velocity, acceleration);
            }
            let Some(longer) = flight.fitted(&moments) else { break };
            *flight = longer;
            found = Some(flight.clone());
        }
        Ok(found)
    }

    /// The flight with velocities that the outlines agree with best; `None` where they do not.
    fn fitted(&self, moments: &[Moment]) -> Option<FreeFlight> {
        let pairs = |same_frame: bool| {
            let all = (0..moments.len()).flat_map(|i| (0..i).map(move |k| (k, i)));
            all.filter(|(k, i)| (moments[*k].frame == moments[*i].frame) == same_frame).collect::<Vec<_>>()
        };
        let noise = rms(&self.misses(moments, &pairs(true)))?;
        let across = pairs(false);
        let start = [self.velocity, self.acceleration, self.angular_velocity].map(|v| v.to_array()).concat();
        let residuals = |unknowns: &DVector<f64>| self.with(unknowns).misses(moments, &across);
        let fit: Minimum = least_squares(residuals, DVector::from_vec(start), &DIFFERENCES);
        let miss_px = rms(&fit.residuals)?;
        (miss_px <= LARGEST_EXCESS * noise.max(LEAST_NOISE_PX))
            .then(|| FreeFlight { miss_px, ..self.with(&fit.unknowns) })
    }

    /// The flight with another velocity, acceleration and angular velocity.
    fn with(&self, unknowns: &DVector<f64>) -> FreeFlight {
        let vector = |k: usize| DVec3::new(unknowns[k], unknowns[k + 1], unknowns[k + 2]);
        FreeFlight { velocity: vector(0), acceleration: vector(3), angular_velocity: vector(6), ..self.clone() }
    }

    /// How far pairs of outlines, moved to the first frame, are from common tangents [pixels]; exactly zero where they
    /// can have none.
    fn misses(&self, moments: &[Moment], pairs: &[(usize, usize)]) -> DVector<f64> {
        let back = |moment: &Moment| {
            let (turn, _) = self.pose(self.times[moment.frame]);
            let back = turn.transpose();
            Outline {
                centre: self.back(moment.outline.centre, moment.frame),
                rays: moment.outline.rays.iter().map(|ray| back * *ray).collect(),
                ..moment.outline
            }
        };
        let outlines: Vec<Outline> = moments.iter().map(back).collect();
        let miss = |(i, k): &(usize, usize)| tangency(&outlines[*i], &outlines[*k], self.about).unwrap_or_default();
        let misses: Vec<[f64; 2]> = pairs.par_iter().map(miss).collect();
        DVector::from_iterator(2 * misses.len(), misses.into_iter().flatten())
    }
}

/// Velocity [m/s] and acceleration [m/s^2] at the first of two or three times [s] of a point that is at `places` [m];
/// `None` of more, from which a fit starts better than from middles of hulls.
fn parabola(times: &[f64], places: &[DVec3]) -> Option<(DVec3, DVec3)> {
    let mean = |k: usize| (places[k] - places[0]) / times[k];
    match times.len() {
        2 => Some((mean(1), DVec3::ZERO)),
        3 => {
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
fn middle_of_hull(views: &[(Camera, Mask)]) -> Option<DVec3> {
    let shown: Vec<HullView> =
        views.iter().filter(|(_, m)| m.area() > 0.0).map(|(camera, mask)| HullView { camera, mask }).collect();
    let points = Hull::carve(&shown, &HullSettings::default())?.points();
    Some(points.iter().sum::<DVec3>() / points.len() as f64)
}
