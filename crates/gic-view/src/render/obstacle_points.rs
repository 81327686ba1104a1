//! Obstacles in pictures: points on their surfaces, drawn as grey matter.

use std::f64::consts::{FRAC_PI_2, TAU};
use std::path::Path;

use gic_mpm::{Collider, Primitive};
use gic_twin::simulate::Trajectory;
use gic_twin::twin::Twin;
use glam::DVec3;

use crate::error::Result;

/// Points of one obstacle, at most; larger ones get coarser points.
const MAX_POINTS: f64 = 40_000.0;

/// The obstacles of a motion but its planes, with points on their surfaces.
pub(super) struct Obstacles {
    solids: Vec<(Collider, Vec<DVec3>)>,
}

impl Obstacles {
    /// Those of a trajectory, with points `spacing` metres apart.
    ///
    /// # Errors
    /// Obstacles that are not valid.
    pub(super) fn of(trajectory: &Trajectory, spacing: f64) -> Result<Self> {
        let Some(list) = trajectory.twin.get("colliders") else { return Ok(Self { solids: Vec::new() }) };
        let obstacles = Twin::obstacles_of(Path::new("trajectory.json"), list)?;
        let solid = |collider: Collider| {
            let points = surface(&collider.primitive, spacing);
            (!points.is_empty()).then_some((collider, points))
        };
        Ok(Self { solids: obstacles.iter().filter_map(|obstacle| solid(obstacle.to_collider())).collect() })
    }

    /// Their points at a time [s] in the world [m].
    pub(super) fn at(&self, time_s: f64) -> Vec<DVec3> {
        let posed = |(collider, points): &(Collider, Vec<DVec3>)| {
            let (position, rotation) = collider.path.placement(time_s);
            points.iter().map(move |p| position + rotation * *p).collect::<Vec<_>>()
        };
        self.solids.iter().flat_map(posed).collect()
    }
}

/// Points on a shape's surface in its own frame, about `spacing` metres apart; none for a half space.
fn surface(primitive: &Primitive, spacing: f64) -> Vec<DVec3> {
    let area = match *primitive {
        Primitive::HalfSpace { .. } => return Vec::new(),
        Primitive::Sphere { radius_m } => 2.0 * TAU * radius_m * radius_m,
        Primitive::Box { half_size_m: h } | Primitive::Pad { half_size_m: h } => {
            8.0 * (h.x * h.y + h.y * h.z + h.z * h.x)
        }
        Primitive::Cylinder { radius_m, half_height_m } | Primitive::Capsule { radius_m, half_height_m } => {
            2.0 * TAU * radius_m * (half_height_m + radius_m)
        }
    };
    let spacing = spacing.max((area / MAX_POINTS).sqrt());
    match *primitive {
        Primitive::HalfSpace { .. } => Vec::new(),
        Primitive::Box { half_size_m } | Primitive::Pad { half_size_m } => faces(half_size_m, spacing),
        Primitive::Sphere { radius_m } => arc(-FRAC_PI_2, FRAC_PI_2, radius_m, 0.0, spacing),
        Primitive::Capsule { radius_m, half_height_m } => {
            let mut points = arc(-FRAC_PI_2, 0.0, radius_m, -half_height_m, spacing);
            points.extend(steps(-half_height_m, half_height_m, spacing).flat_map(|y| ring(radius_m, y, spacing)));
            points.extend(arc(0.0, FRAC_PI_2, radius_m, half_height_m, spacing));
            points
        }
        Primitive::Cylinder { radius_m, half_height_m } => {
            let side = steps(-half_height_m, half_height_m, spacing).flat_map(|y| ring(radius_m, y, spacing));
            let ends = [-half_height_m, half_height_m].into_iter();
            let discs = ends.flat_map(|y| steps(0.0, radius_m, spacing).flat_map(move |r| ring(r, y, spacing)));
            side.chain(discs).collect()
        }
    }
}

/// Evenly spaced numbers from `low` to `high`, both included.
fn steps(low: f64, high: f64, spacing: f64) -> impl Iterator<Item = f64> {
    let count = ((high - low) / spacing).ceil().max(1.0);
    (0..=count as usize).map(move |i| low + (high - low) * i as f64 / count)
}

/// A circle about the y axis.
fn ring(radius: f64, y: f64, spacing: f64) -> Vec<DVec3> {
    let count = (TAU * radius / spacing).ceil().max(1.0);
    let point = |i: usize| {
        let (sin, cos) = (TAU * i as f64 / count).sin_cos();
        DVec3::new(radius * cos, y, radius * sin)
    };
    (0..count as usize).map(point).collect()
}

/// Circles of a ball's part between two latitudes [rad], whose centre lies at `height`.
fn arc(low: f64, high: f64, radius: f64, height: f64, spacing: f64) -> Vec<DVec3> {
    let latitudes = steps(low, high, spacing / radius);
    latitudes.flat_map(|angle| ring(radius * angle.cos(), height + radius * angle.sin(), spacing)).collect()
}

/// The six faces of a box.
fn faces(half: DVec3, spacing: f64) -> Vec<DVec3> {
    let mut points = Vec::new();
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for (side, a) in
            [-1.0, 1.0].into_iter().flat_map(|side| steps(-half[u], half[u], spacing).map(move |a| (side, a)))
        {
            for b in steps(-half[v], half[v], spacing) {
                let mut p = DVec3::ZERO;
                (p[axis], p[u], p[v]) = (side * half[axis], a, b);
                points.push(p);
            }
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_lie_on_the_surface_and_close_together() {
        let shapes = [
            Primitive::Sphere { radius_m: 0.1 },
            Primitive::Box { half_size_m: DVec3::new(0.1, 0.05, 0.2) },
            Primitive::Cylinder { radius_m: 0.1, half_height_m: 0.2 },
            Primitive::Capsule { radius_m: 0.1, half_height_m: 0.2 },
        ];
        for primitive in shapes {
            let points = surface(&primitive, 0.01);
            let collider = Collider { primitive, ..Collider::plane(DVec3::ZERO, DVec3::Y, gic_mpm::Contact::Sticky) };
            let farthest = points.iter().map(|p| collider.signed_distance(*p, 0.0).abs()).fold(0.0, f64::max);
            assert!(farthest < 1e-9, "{primitive:?}: {farthest}");
            for p in points.iter().step_by(points.len() / 20) {
                let nearest = points.iter().filter(|q| *q != p).map(|q| q.distance(*p)).fold(f64::INFINITY, f64::min);
                assert!(nearest < 0.0101, "{primitive:?}: {nearest}");
            }
        }
        assert!(surface(&Primitive::HalfSpace { normal: DVec3::Y }, 0.01).is_empty());
        assert!(surface(&Primitive::Sphere { radius_m: 100.0 }, 0.001).len() < 60_000);
    }
}
