//! Shapes of obstacles and their signed distances.

use glam::DVec3;

/// A solid shape in its own frame; solid where the signed distance is negative.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Primitive {
    /// Everything below the plane through the origin whose outward normal is `normal`.
    HalfSpace {
        /// Outward unit normal.
        normal: DVec3,
    },
    /// Ball around the origin.
    Sphere {
        /// Radius [m].
        radius_m: f64,
    },
    /// Axis-aligned box around the origin.
    Box {
        /// Half of each side [m].
        half_size_m: DVec3,
    },
    /// Axis-aligned box around the origin of which only the face towards +x acts: inside, the normal is always +x. A
    /// finger's margin presses with its face; a box pushes what has sunk in near an edge, or deep, out at the side.
    Pad {
        /// Half of each side [m].
        half_size_m: DVec3,
    },
    /// Finite cylinder around the local y axis, centred at the origin.
    Cylinder {
        /// Radius [m].
        radius_m: f64,
        /// Half of its length [m].
        half_height_m: f64,
    },
    /// Cylinder with round ends around the local y axis, centred at the origin.
    Capsule {
        /// Radius [m].
        radius_m: f64,
        /// Half of the length between the centres of the round ends [m].
        half_height_m: f64,
    },
}

/// Nodes this far outside still count as inside [m], so that nodes on the surface do despite rounding (as in the
/// published simulator).
const SURFACE_TOLERANCE_M: f64 = 1e-6;
/// The same in cells, where they are so small that this is less. Derived: no contact shows a thousandth of a cell.
const SURFACE_TOLERANCE_CELLS: f64 = 1e-3;

/// How far outside [m] a node counts as inside on a grid of that spacing [m].
pub(crate) fn surface_tolerance(spacing_m: f64) -> f64 {
    SURFACE_TOLERANCE_M.min(SURFACE_TOLERANCE_CELLS * spacing_m)
}

impl Primitive {
    /// How deep [m] a point of the shape's own frame is inside, from the nearest face; zero or less outside.
    pub(super) fn depth(&self, p: DVec3) -> f64 {
        match *self {
            Self::Pad { half_size_m } => -box_distance(p, half_size_m).0,
            _ => -self.signed_distance(p).0,
        }
    }

    /// Farthest distance [m] of its surface from the origin of its frame.
    pub(crate) fn reach(&self) -> f64 {
        match *self {
            Self::HalfSpace { .. } => f64::INFINITY,
            Self::Sphere { radius_m } => radius_m,
            Self::Box { half_size_m } | Self::Pad { half_size_m } => half_size_m.length(),
            Self::Cylinder { radius_m, half_height_m } => radius_m.hypot(half_height_m),
            Self::Capsule { radius_m, half_height_m } => radius_m + half_height_m,
        }
    }

    /// Its smallest side [m].
    pub(crate) fn thickness(&self) -> f64 {
        match *self {
            Self::HalfSpace { .. } => f64::INFINITY,
            Self::Sphere { radius_m } | Self::Capsule { radius_m, .. } => 2.0 * radius_m,
            Self::Box { half_size_m } | Self::Pad { half_size_m } => 2.0 * half_size_m.min_element(),
            Self::Cylinder { radius_m, half_height_m } => 2.0 * radius_m.min(half_height_m),
        }
    }

    /// Signed distance [m] of a point in the shape's own frame (negative inside) and its gradient, the outward unit
    /// normal.
    pub(super) fn signed_distance(&self, p: DVec3) -> (f64, DVec3) {
        match *self {
            Self::HalfSpace { normal } => (p.dot(normal), normal),
            Self::Sphere { radius_m } => {
                let length = p.length();
                (length - radius_m, unit(p, length))
            }
            Self::Box { half_size_m } => box_distance(p, half_size_m),
            Self::Pad { half_size_m } => match box_distance(p, half_size_m) {
                outside if outside.0 > SURFACE_TOLERANCE_M => outside,
                _ => (p.x - half_size_m.x, DVec3::X),
            },
            Self::Cylinder { radius_m, half_height_m } => {
                let radial = DVec3::new(p.x, 0.0, p.z);
                let length = radial.length();
                profile_distance(
                    length - radius_m,
                    p.y.abs() - half_height_m,
                    unit(radial, length),
                    DVec3::Y * p.y.signum(),
                )
            }
            Self::Capsule { radius_m, half_height_m } => {
                let from_axis = p - DVec3::Y * p.y.clamp(-half_height_m, half_height_m);
                let length = from_axis.length();
                (length - radius_m, unit(from_axis, length))
            }
        }
    }
}

/// `v / length`, or up where the direction is undefined.
fn unit(v: DVec3, length: f64) -> DVec3 {
    if length > 1e-12 { v / length } else { DVec3::Y }
}

fn box_distance(p: DVec3, half_size: DVec3) -> (f64, DVec3) {
    let beyond = p.abs() - half_size;
    let outside = beyond.max(DVec3::ZERO);
    if outside != DVec3::ZERO {
        let length = outside.length();
        return (length, outside * p.signum() / length);
    }
    let axis = if beyond.x >= beyond.y && beyond.x >= beyond.z {
        DVec3::X
    } else if beyond.y >= beyond.z {
        DVec3::Y
    } else {
        DVec3::Z
    };
    (beyond.max_element(), axis * p.signum())
}

/// Distance to a region bounded by two perpendicular faces: `a` beyond the face with normal `a_normal`, `b` likewise.
fn profile_distance(a: f64, b: f64, a_normal: DVec3, b_normal: DVec3) -> (f64, DVec3) {
    if a > 0.0 && b > 0.0 {
        let length = a.hypot(b);
        (length, (a_normal * a + b_normal * b) / length)
    } else if a >= b {
        (a, a_normal)
    } else {
        (b, b_normal)
    }
}

#[cfg(test)]
pub(super) fn one_of_each() -> [Primitive; 6] {
    [
        Primitive::HalfSpace { normal: DVec3::new(0.6, 0.8, 0.0) },
        Primitive::Sphere { radius_m: 0.7 },
        Primitive::Box { half_size_m: DVec3::new(0.3, 0.5, 0.8) },
        Primitive::Cylinder { radius_m: 0.4, half_height_m: 0.6 },
        Primitive::Capsule { radius_m: 0.3, half_height_m: 0.5 },
        Primitive::Pad { half_size_m: DVec3::new(0.3, 0.5, 0.8) },
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn normal_is_the_gradient_of_the_distance(p in proptest::array::uniform3(-1.5f64..1.5), shape in 0usize..6) {
            let (shape, p, h) = (one_of_each()[shape], DVec3::from(p), 1e-6);
            let (distance, normal) = shape.signed_distance(p);
            let gradient = DVec3::from_array(DVec3::AXES.map(|axis| {
                (shape.signed_distance(p + axis * h).0 - shape.signed_distance(p - axis * h).0) / (2.0 * h)
            }));
            // On a medial axis, where the nearest face changes, there is no gradient.
            prop_assume!((gradient.length() - 1.0).abs() < 1e-6);
            prop_assert!((gradient - normal).length() < 1e-5);
            // Walking the distance along the normal reaches the surface from outside.
            if distance > 0.0 {
                let landed = shape.signed_distance(p - normal * distance).0;
                // Inside a margin only the depth below its face counts, also behind its sides.
                let is_pad = matches!(shape, Primitive::Pad { .. });
                prop_assert!(landed.abs() < 1e-9 || (landed < 0.0 && is_pad));
            }
        }
    }
}
