//! The base motion: an affine map and a coarse displacement field per frame, beside which the network's residuals are
//! small.
//!
//! In frame f a canonical point goes to `b(x) = A_f (x - o) + o + t_f + u_f(x)`, with the field u trilinear on a
//! lattice. Between frames A, t and u are cubic in time.
//!
//! A network that must learn the whole way of an object from single pictures forgets one moment while it learns
//! another. Twelve numbers per frame carry what a body does as a whole (fall, turn, stretch), a lattice how it bends;
//! the network adds the rest.

use gic_scene::FreeFlight;
use glam::{DMat3, DVec3, Vec3};
use serde::{Deserialize, Serialize};

use crate::Lattice;

/// A pose for every frame, in between interpolated smoothly.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BaseMotion {
    /// The point about which the maps turn and stretch [m].
    pub origin: [f64; 3],
    /// Times of the frames, ascending [s].
    pub times: Vec<f64>,
    /// The map of each frame.
    pub maps: Vec<Affine>,
    /// The nodes of the displacement fields, in the canonical frame.
    pub lattice: Lattice,
    /// Displacements of the nodes in each frame, added to the mapped positions [m], shape [frames][nodes, 3].
    #[serde(skip)]
    pub bends: Vec<Vec<[f32; 3]>>,
    /// By how much more than one each frame multiplies the colours at the nodes, shape [frames][nodes, 3].
    #[serde(skip)]
    pub shades: Vec<Vec<[f32; 3]>>,
}

/// What the base motion does at one time.
#[derive(Clone, Debug, PartialEq)]
pub struct Pose {
    /// The affine part.
    pub map: Affine,
    /// Displacements of the lattice's nodes [m].
    pub bend: Vec<[f32; 3]>,
    /// By how much more than one colours are multiplied at the nodes.
    pub shade: Vec<[f32; 3]>,
}

/// Derivative of a loss with respect to a [`Pose`].
pub(crate) type PoseGradient = Pose;

/// The map `x -> matrix (x - origin) + origin + shift`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Affine {
    /// Column by column.
    pub matrix: [f64; 9],
    /// Displacement of the origin [m].
    pub shift: [f64; 3],
}

impl Affine {
    /// The map that moves nothing.
    pub const IDENTITY: Affine = Affine { matrix: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], shift: [0.0; 3] };

    /// Twice this map minus the one before, but shifted by what is known from elsewhere [m].
    pub(crate) fn extrapolated(&self, before: &Affine, shift: DVec3) -> Affine {
        Affine { matrix: core::array::from_fn(|i| 2.0 * self.matrix[i] - before.matrix[i]), shift: shift.to_array() }
    }

    fn linear(&self) -> DMat3 {
        DMat3::from_cols_array(&self.matrix)
    }
}

impl BaseMotion {
    /// A motion with one frame, in which nothing moves.
    pub(crate) fn still(origin: DVec3, times: Vec<f64>, lattice: Lattice) -> BaseMotion {
        let bends = vec![vec![[0.0; 3]; lattice.nodes()]];
        let shades = bends.clone();
        BaseMotion { origin: origin.to_array(), times, maps: vec![Affine::IDENTITY], lattice, bends, shades }
    }

    /// The same with the frames of a flight after the first: there the body of the first frame is moved rigidly.
    pub(crate) fn with_flight(&self, flight: &FreeFlight) -> BaseMotion {
        let (mut motion, first, origin) = (self.clone(), self.pose(0), DVec3::from_array(self.origin));
        for (frame, &time) in flight.times.iter().enumerate().skip(1) {
            let turn = flight.turn(time);
            let moved = flight.forth(origin + DVec3::from_array(first.map.shift), time);
            let map =
                Affine { matrix: (turn * first.map.linear()).to_cols_array(), shift: (moved - origin).to_array() };
            let turned = |bend: &[f32; 3]| (turn.as_mat3() * Vec3::from_array(*bend)).to_array();
            motion.times.insert(frame, self.times[0] + time);
            motion.maps.insert(frame, map);
            motion.bends.insert(frame, first.bend.iter().map(turned).collect());
            motion.shades.insert(frame, first.shade.clone());
        }
        motion
    }

    /// The pose of a frame.
    pub(crate) fn pose(&self, frame: usize) -> Pose {
        Pose { map: self.maps[frame], bend: self.bends[frame].clone(), shade: self.shades[frame].clone() }
    }

    /// The pose at a time [s]: a cubic through the frames' poses whose slope at each is that of the parabola through it
    /// and its neighbours, so that free fall is met exactly; outside the frames' times, the nearest frame's pose.
    pub fn at(&self, time: f64) -> Pose {
        let mut map = Affine { matrix: [0.0; 9], shift: [0.0; 3] };
        let mut bend = vec![[0.0f32; 3]; self.lattice.nodes()];
        let mut shade = bend.clone();
        for (weight, frame) in self.weights(time) {
            let add = |sum: &mut [f64], part: &[f64]| sum.iter_mut().zip(part).for_each(|(s, p)| *s += weight * p);
            add(&mut map.matrix, &self.maps[frame].matrix);
            add(&mut map.shift, &self.maps[frame].shift);
            let add = |sum: &mut [[f32; 3]], part: &[[f32; 3]]| {
                let numbers = sum.as_flattened_mut().iter_mut().zip(part.as_flattened());
                numbers.for_each(|(sum, part)| *sum += weight as f32 * part);
            };
            add(&mut bend, &self.bends[frame]);
            add(&mut shade, &self.shades[frame]);
        }
        Pose { map, bend, shade }
    }

    /// How much each frame's pose counts at `time`.
    fn weights(&self, time: f64) -> Vec<(f64, usize)> {
        let last = self.times.len() - 1;
        let after = self.times.partition_point(|&t| t <= time);
        if after == 0 || after > last {
            return vec![(1.0, if after == 0 { 0 } else { last })];
        }
        let before = after - 1;
        let h = self.times[after] - self.times[before];
        let s = (time - self.times[before]) / h;
        // Hermite's basis.
        let mut weights = vec![((1.0 + 2.0 * s) * (1.0 - s) * (1.0 - s), before), ((3.0 - 2.0 * s) * s * s, after)];
        let slopes = [(s * (1.0 - s) * (1.0 - s) * h, before), (s * s * (s - 1.0) * h, after)];
        for (weight, frame) in slopes {
            weights.extend(self.slope(frame).into_iter().map(|(w, f)| (weight * w, f)));
        }
        weights
    }

    /// The slope [1/s] at a frame as a combination of maps.
    fn slope(&self, frame: usize) -> Vec<(f64, usize)> {
        let last = self.times.len() - 1;
        let between = |a: usize, b: usize, weight: f64| {
            let rate = weight / (self.times[b] - self.times[a]);
            [(-rate, a), (rate, b)]
        };
        if frame == 0 {
            return between(0, 1, 1.0).to_vec();
        }
        if frame == last {
            return between(last - 1, last, 1.0).to_vec();
        }
        let (t0, t1, t2) = (self.times[frame - 1], self.times[frame], self.times[frame + 1]);
        let share = (t1 - t0) / (t2 - t0);
        [between(frame - 1, frame, 1.0 - share), between(frame, frame + 1, share)].concat()
    }

    /// Where `pose` takes a point [m].
    pub fn moved(&self, pose: &Pose, x: [f32; 3]) -> [f32; 3] {
        let origin = DVec3::from_array(self.origin);
        let offset = DVec3::from_array(x.map(f64::from)) - origin;
        let bend = DVec3::from_array(self.lattice.value(&pose.bend, x).map(f64::from));
        (pose.map.linear() * offset + origin + DVec3::from_array(pose.map.shift) + bend).as_vec3().to_array()
    }

    /// From the loss's derivative with respect to the moved points to that with respect to the pose but its shade, and
    /// to the points themselves, to which it is added.
    pub(crate) fn pull_back(
        &self,
        pose: &Pose,
        points: &[[f32; 3]],
        slope: &[[f32; 4]],
        d_points: &mut [[f32; 3]],
    ) -> PoseGradient {
        let origin = DVec3::from_array(self.origin);
        let back = pose.map.linear().transpose();
        let (mut d_matrix, mut d_shift) = (DMat3::ZERO, DVec3::ZERO);
        let mut d_bend = vec![[0.0; 3]; pose.bend.len()];
        for ((&x, &[gx, gy, gz, _]), d) in points.iter().zip(slope).zip(d_points) {
            self.lattice.pull_back(&pose.bend, x, [gx, gy, gz], &mut d_bend, d);
            let g = DVec3::new(gx.into(), gy.into(), gz.into());
            let offset = DVec3::from_array(x.map(f64::from)) - origin;
            d_matrix += DMat3::from_cols(g * offset.x, g * offset.y, g * offset.z);
            d_shift += g;
            let own = (back * g).as_vec3();
            for axis in 0..3 {
                d[axis] += own[axis];
            }
        }
        Pose {
            map: Affine { matrix: d_matrix.to_cols_array(), shift: d_shift.to_array() },
            bend: d_bend,
            shade: Vec::new(),
        }
    }

    /// Why this cannot be a base motion, if so; for files.
    pub(crate) fn complaint(&self) -> Option<&'static str> {
        let ascending = self.times.windows(2).all(|pair| pair[0] < pair[1]);
        let finite = |numbers: &[f64]| numbers.iter().all(|x| x.is_finite());
        let nodes = if self.lattice.is_valid() { self.lattice.nodes() } else { 0 };
        if self.times.len() < 2
            || self.times.len() != self.maps.len()
            || self.times.len() != self.bends.len()
            || self.times.len() != self.shades.len()
        {
            Some("needs two frames at least, and a map, a bend and a shade for each")
        } else if nodes == 0 || self.bends.iter().chain(&self.shades).any(|field| field.len() != nodes) {
            Some("the lattice and the fields on it do not belong together")
        } else if !ascending || !finite(&self.times) {
            Some("times must ascend")
        } else if !finite(&self.origin)
            || !self.maps.iter().all(|m| finite(&m.matrix) && finite(&m.shift))
            || !self.bends.iter().chain(&self.shades).flatten().flatten().all(|x| x.is_finite())
        {
            Some("holds numbers that are not finite")
        } else {
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(t: f64) -> Affine {
        Affine {
            matrix: core::array::from_fn(|i| Affine::IDENTITY.matrix[i] + 0.3 * t * (i as f64 - 4.0) - 0.2 * t * t),
            shift: [0.1 * t, -4.9 * t * t, 0.3 - t],
        }
    }

    fn bend(t: f64) -> Vec<[f32; 3]> {
        let number = |i: usize, k: usize| ((i * 3 + k) as f64).cos() * (t - 2.0 * t * t);
        (0..125).map(|i| core::array::from_fn(|k| number(i, k) as f32)).collect()
    }

    fn motion() -> BaseMotion {
        let times = vec![0.0, 0.1, 0.25, 0.3, 0.5];
        BaseMotion {
            origin: [0.1, -0.2, 0.3],
            maps: times.iter().map(|&t| map(t)).collect(),
            lattice: Lattice { low: [-0.7; 3], cell: 0.37, size: [5; 3] },
            bends: times.iter().map(|&t| bend(t)).collect(),
            shades: times.iter().map(|&t| bend(2.0 * t)).collect(),
            times,
        }
    }

    fn numbers(pose: &Pose) -> Vec<f64> {
        let bend = pose.bend.iter().chain(&pose.shade).flatten().map(|&x| f64::from(x));
        pose.map.matrix.into_iter().chain(pose.map.shift).chain(bend).collect()
    }

    /// The number `i` of [`numbers`], changed.
    fn nudged(pose: &Pose, i: usize, step: f64) -> Pose {
        let mut pose = pose.clone();
        match i {
            0..9 => pose.map.matrix[i] += step,
            9..12 => pose.map.shift[i - 9] += step,
            _ => pose.bend.as_flattened_mut()[i - 12] += step as f32,
        }
        pose
    }

    #[test]
    fn meets_the_frames_and_follows_free_fall_between_them() {
        let motion = motion();
        let close = |a: &Pose, b: &Pose| numbers(a).iter().zip(numbers(b)).all(|(a, b)| (a - b).abs() < 1e-6);
        for frame in 0..5 {
            assert!(close(&motion.at(motion.times[frame]), &motion.pose(frame)), "{frame}");
        }
        for time in [0.12, 0.2, 0.27] {
            assert!(
                close(&motion.at(time), &Pose { map: map(time), bend: bend(time), shade: bend(2.0 * time) }),
                "a parabola at {time}"
            );
        }
        assert!(close(&motion.at(-1.0), &motion.pose(0)) && close(&motion.at(9.0), &motion.pose(4)));
    }

    #[test]
    fn pulling_back_agrees_with_finite_differences() {
        let motion = motion();
        let pose = Pose { map: map(0.4), bend: bend(0.4), shade: Vec::new() };
        let points: Vec<[f32; 3]> =
            (0..5).map(|i| core::array::from_fn(|k| ((i * 3 + k) as f32 * 0.7).sin() * 0.5)).collect();
        let slope: Vec<[f32; 4]> = (0..5).map(|i| core::array::from_fn(|k| ((i * 4 + k) as f32 * 1.3).cos())).collect();
        let loss = |pose: &Pose, points: &[[f32; 3]]| -> f64 {
            let moved = points.iter().map(|&x| motion.moved(pose, x));
            moved.zip(&slope).map(|(x, g)| (0..3).map(|k| f64::from(x[k]) * f64::from(g[k])).sum::<f64>()).sum()
        };
        let mut d_points = vec![[0.5f32; 3]; 5];
        let got = numbers(&motion.pull_back(&pose, &points, &slope, &mut d_points));
        let h = 1e-2;
        for (i, got) in got.into_iter().enumerate() {
            let expected = (loss(&nudged(&pose, i, h), &points) - loss(&nudged(&pose, i, -h), &points)) / (2.0 * h);
            assert!((got - expected).abs() < 1e-4, "number {i}: {got} against {expected}");
        }
        // The field is linear along each axis within a cell, and no point is this near to a face.
        let h = 2e-3;
        for i in 0..5 {
            for axis in 0..3 {
                let at = |step: f64| {
                    let mut points = points.clone();
                    points[i][axis] += step as f32;
                    loss(&pose, &points)
                };
                let expected = (at(h) - at(-h)) / (2.0 * h);
                let got = f64::from(d_points[i][axis]) - 0.5;
                assert!((got - expected).abs() < 5e-4, "point {i} axis {axis}: {got} against {expected}");
            }
        }
    }

    #[test]
    fn in_flight_the_body_of_the_first_frame_moves_rigidly() {
        let motion = motion();
        let flight = FreeFlight {
            about: DVec3::new(0.05, 0.3, -0.1),
            velocity: DVec3::new(0.4, -1.0, 0.2),
            angular_velocity: DVec3::new(3.0, -1.0, 2.0),
            acceleration: DVec3::NEG_Y * 9.8,
            times: vec![0.0, 0.03, 0.07],
            ..FreeFlight::default()
        };
        let flown = motion.with_flight(&flight);
        assert_eq!(flown.times, [0.0, 0.03, 0.07, 0.1, 0.25, 0.3, 0.5]);
        let point = |motion: &BaseMotion, time: f64, i: usize| {
            let x = core::array::from_fn(|k| ((i * 3 + k) as f32).sin() * 0.4);
            DVec3::from_array(motion.moved(&motion.at(time), x).map(f64::from))
        };
        for i in 0..20 {
            let first = point(&motion, 0.0, i);
            for &time in &flight.times {
                let (is, should) = (point(&flown, time, i), flight.forth(first, time));
                assert!(is.distance(should) < 1e-6, "{time}: {is} instead of {should}");
            }
            assert_eq!(point(&flown, 0.25, i), point(&motion, 0.25, i), "later frames stay");
        }
    }

    #[test]
    fn extrapolation_goes_on_alike() {
        let mut a = Affine::IDENTITY;
        a.matrix[4] = 0.9;
        let b = a.extrapolated(&Affine::IDENTITY, DVec3::X);
        assert!((b.matrix[4] - 0.8).abs() < 1e-12 && b.shift == [1.0, 0.0, 0.0]);
    }

    #[test]
    fn damage_is_told() {
        assert_eq!(motion().complaint(), None);
        let complains = |damage: &dyn Fn(&mut BaseMotion)| {
            let mut motion = motion();
            damage(&mut motion);
            motion.complaint().is_some()
        };
        assert!(complains(&|m| m.times[1] = f64::NAN));
        assert!(complains(&|m| m.maps.truncate(4)));
        assert!(complains(&|m| m.bends[1].truncate(100)));
        assert!(complains(&|m| m.shades[1].truncate(100)));
        assert!(complains(&|m| m.lattice.size[0] = 1));
        assert!(complains(&|m| m.maps[2].shift[0] = f64::INFINITY));
        assert!(complains(&|m| m.bends[2][7][0] = f32::NAN));
    }
}
