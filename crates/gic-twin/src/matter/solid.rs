//! Simple shapes filled with particles on a regular lattice.

use glam::DVec3;
use serde::Serialize;

use crate::rotation;

/// A shape at a place.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Solid {
    /// What it is, with its lengths.
    #[serde(flatten)]
    pub kind: SolidKind,
    /// Its centre [m]; default the origin.
    pub centre_m: [f64; 3],
    /// Rotation about the world's x, then y, then z axis [degrees]; default 0.
    pub rotation_deg: [f64; 3],
}

/// The shapes, each around the origin before rotation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "shape", rename_all = "snake_case")]
pub enum SolidKind {
    /// Three square bars along x, y and z that cross in the middle.
    Cross {
        /// Lengths of the bars along x, y, z [m].
        size_m: [f64; 3],
        /// Side of every bar's square section [m].
        thickness_m: f64,
    },
    /// A box.
    Box {
        /// Whole sides [m].
        size_m: [f64; 3],
    },
    /// A ball.
    Sphere {
        /// Radius [m].
        radius_m: f64,
    },
    /// A ring around y.
    Torus {
        /// From the centre of the ring to the centre of its tube [m].
        major_radius_m: f64,
        /// Radius of the tube [m].
        minor_radius_m: f64,
    },
    /// A cylinder along y.
    Cylinder {
        /// Radius [m].
        radius_m: f64,
        /// Whole height [m].
        height_m: f64,
    },
}

impl SolidKind {
    /// Half of the sides of its bounding box [m].
    pub fn half_extent(&self) -> DVec3 {
        match *self {
            Self::Cross { size_m, thickness_m } => DVec3::from(size_m).max(DVec3::splat(thickness_m)) / 2.0,
            Self::Box { size_m } => DVec3::from(size_m) / 2.0,
            Self::Sphere { radius_m } => DVec3::splat(radius_m),
            Self::Torus { major_radius_m, minor_radius_m } => {
                let r = major_radius_m + minor_radius_m;
                DVec3::new(r, minor_radius_m, r)
            }
            Self::Cylinder { radius_m, height_m } => DVec3::new(radius_m, height_m / 2.0, radius_m),
        }
    }

    /// Whether a point of its own frame [m] lies inside.
    pub fn contains(&self, p: DVec3) -> bool {
        let inside_box = |half: DVec3| p.abs().cmple(half).all();
        match *self {
            Self::Cross { size_m, thickness_m } => (0..3).any(|axis| {
                let mut half = DVec3::splat(thickness_m / 2.0);
                half[axis] = size_m[axis] / 2.0;
                inside_box(half)
            }),
            Self::Box { size_m } => inside_box(DVec3::from(size_m) / 2.0),
            Self::Sphere { radius_m } => p.length_squared() <= radius_m * radius_m,
            Self::Torus { major_radius_m, minor_radius_m } => {
                let from_tube = p.x.hypot(p.z) - major_radius_m;
                from_tube * from_tube + p.y * p.y <= minor_radius_m * minor_radius_m
            }
            Self::Cylinder { radius_m, height_m } => {
                p.x * p.x + p.z * p.z <= radius_m * radius_m && p.y.abs() <= height_m / 2.0
            }
        }
    }

    /// Its volume [m^3].
    pub fn volume(&self) -> f64 {
        use std::f64::consts::PI;
        match *self {
            Self::Cross { size_m, thickness_m: t } => {
                // Every bar passes through the same middle cube, which counts once.
                size_m.iter().map(|length| (length - t).max(0.0) * t * t).sum::<f64>() + t * t * t
            }
            Self::Box { size_m } => size_m.iter().product(),
            Self::Sphere { radius_m } => 4.0 / 3.0 * PI * radius_m.powi(3),
            Self::Torus { major_radius_m, minor_radius_m } => 2.0 * PI * PI * major_radius_m * minor_radius_m.powi(2),
            Self::Cylinder { radius_m, height_m } => PI * radius_m * radius_m * height_m,
        }
    }
}

impl Solid {
    /// Particles [m] on a lattice of `spacing` [m] that turns with the shape and is centred in its bounding box, z
    /// fastest.
    ///
    /// A side that is a multiple of the spacing holds exactly as many particles.
    pub fn sample(&self, spacing: f64) -> Vec<DVec3> {
        let turn = rotation(self.rotation_deg);
        let half = self.kind.half_extent();
        // A side of 0.3 holds 30 spacings of 0.01 although 0.3 / 0.01 rounds to 29.999...
        let counts = half.to_array().map(|h| ((2.0 * h / spacing + 1e-6).floor() as usize).max(1));
        let at = |i: usize, axis: usize| (i as f64 - (counts[axis] as f64 - 1.0) / 2.0) * spacing;
        let mut particles = Vec::new();
        for i in 0..counts[0] {
            for j in 0..counts[1] {
                for k in 0..counts[2] {
                    let local = DVec3::new(at(i, 0), at(j, 1), at(k, 2));
                    if self.kind.contains(local) {
                        particles.push(DVec3::from(self.centre_m) + turn * local);
                    }
                }
            }
        }
        particles
    }

    /// Largest side of its bounding box before rotation [m].
    pub fn largest_side(&self) -> f64 {
        2.0 * self.kind.half_extent().max_element()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KINDS: [SolidKind; 5] = [
        SolidKind::Cross { size_m: [0.32, 0.28, 0.30], thickness_m: 0.1 },
        SolidKind::Box { size_m: [0.2, 0.1, 0.3] },
        SolidKind::Sphere { radius_m: 0.1 },
        SolidKind::Torus { major_radius_m: 0.13, minor_radius_m: 0.045 },
        SolidKind::Cylinder { radius_m: 0.08, height_m: 0.2 },
    ];

    #[test]
    fn sampled_volume_is_the_shapes_volume() {
        for kind in KINDS {
            let shape = Solid { kind, centre_m: [0.0; 3], rotation_deg: [0.0; 3] };
            let sampled = shape.sample(0.005).len() as f64 * 0.005f64.powi(3);
            assert!((sampled / kind.volume() - 1.0).abs() < 0.02, "{kind:?}: {sampled} against {}", kind.volume());
        }
    }

    #[test]
    fn a_cross_of_whole_cells_has_exactly_their_particles() {
        let shape = Solid { kind: KINDS[0], centre_m: [1.0, 2.0, 3.0], rotation_deg: [30.0, 0.0, 0.0] };
        assert_eq!(shape.sample(0.01).len(), (22 + 18 + 20) * 100 + 1000);
    }

    #[test]
    fn rotation_and_centre_move_the_particles_rigidly() {
        let still = Solid { kind: KINDS[1], centre_m: [0.0; 3], rotation_deg: [0.0; 3] };
        let moved = Solid { kind: KINDS[1], centre_m: [0.5, -1.0, 2.0], rotation_deg: [90.0, 0.0, 0.0] };
        for (a, b) in still.sample(0.02).iter().zip(moved.sample(0.02)) {
            // A quarter turn about x takes y to z.
            let expected = DVec3::new(a.x, -a.z, a.y) + DVec3::new(0.5, -1.0, 2.0);
            assert!((expected - b).length() < 1e-12);
        }
    }
}
