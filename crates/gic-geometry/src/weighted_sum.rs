//! Weighted sums over what is near a point, many points at once: what densities and normals of point sets are made of.
//!
//! The weight falls from 1 at the point itself to 0 at the radius R as w(d) = (1 - (d / R)^2)^2, so that sums change
//! smoothly as points move.

use gic_simd::{Lanes, MAX_LANES};

/// Coordinates in units of the radius of the points that may be near, axis by axis, up to a whole number of lanes.
#[derive(Default)]
pub(crate) struct Nearby {
    axes: [Vec<f32>; 3],
}

/// Sums over the points near one, itself included; in units of the radius.
pub(crate) struct Sums {
    /// Sum of the weights w.
    pub(crate) weight: f64,
    /// Sum of w d, with d the ways from the others to the point; zero where it was not asked for.
    pub(crate) offset: [f64; 3],
}

impl Nearby {
    /// Too far away to weigh anything: squared it is infinite, which is not near.
    const NOWHERE: f32 = f32::MAX;

    /// Takes other points instead, shape [n, 3].
    pub(crate) fn gather(&mut self, points: impl Iterator<Item = [f32; 3]>) {
        self.axes.iter_mut().for_each(Vec::clear);
        for p in points {
            self.axes.iter_mut().zip(p).for_each(|(axis, x)| axis.push(x));
        }
        let whole = self.axes[0].len().next_multiple_of(MAX_LANES);
        self.axes.iter_mut().for_each(|axis| axis.resize(whole, Self::NOWHERE));
    }

    /// The sums around `p`. Points that are no numbers, or too far away to be squared, weigh nothing.
    #[inline(always)]
    pub(crate) fn sums<L: Lanes<Scalar = f32>, const OFFSET: bool>(&self, p: [f32; 3]) -> Sums {
        let [xs, ys, zs] = &self.axes;
        let (px, py, pz) = (L::of(p[0]), L::of(p[1]), L::of(p[2]));
        let (mut total, mut x, mut y, mut z) = (L::zero(), L::zero(), L::zero(), L::zero());
        for at in (0..xs.len()).step_by(L::LANES) {
            let (dx, dy, dz) = (px - L::load(&xs[at..]), py - L::load(&ys[at..]), pz - L::load(&zs[at..]));
            let left = L::one() - dx.mul_add(dx, dy.mul_add(dy, dz * dz));
            // Phrased so that what is no number is not near.
            let near = L::lt(L::zero(), left);
            let weight = L::select(near, left * left, L::zero());
            total += weight;
            if OFFSET {
                x = weight.mul_add(L::select(near, dx, L::zero()), x);
                y = weight.mul_add(L::select(near, dy, L::zero()), y);
                z = weight.mul_add(L::select(near, dz, L::zero()), z);
            }
        }
        Sums { weight: total.sum_lanes(), offset: [x.sum_lanes(), y.sum_lanes(), z.sum_lanes()] }
    }
}
