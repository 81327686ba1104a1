//! The first guess of the motion: one affine map per frame, fitted to the pictures.
//!
//! A network that starts from no motion renders the Gaussians where the object no longer is, and learns slowly. Twelve numbers
//! per frame, followed from frame to frame, put the canonical Gaussians where the pictures show the object; the network learns
//! that motion by regression, which needs no rendering, and then everything else from the pictures.

use glam::{DMat3, DVec3};

use crate::adam::{Moments, decayed};

/// Learning rate of the matrix; the shift's is the same in units of the object's size.
const RATE: (f64, f64) = (1.5e-2, 1.5e-3);

/// The map `x -> matrix (x - origin) + origin + shift`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Affine {
    pub(crate) origin: DVec3,
    pub(crate) matrix: DMat3,
    /// Displacement of the origin [m].
    pub(crate) shift: DVec3,
}

impl Affine {
    /// The map that moves nothing.
    pub(crate) fn identity(origin: DVec3) -> Affine {
        Affine { origin, matrix: DMat3::IDENTITY, shift: DVec3::ZERO }
    }

    /// What comes after `self` when the change from `before` to `self` goes on; the shift is known from elsewhere.
    pub(crate) fn extrapolated(&self, before: &Affine, shift: DVec3) -> Affine {
        Affine { matrix: self.matrix * 2.0 - before.matrix, shift, ..*self }
    }

    /// Displacement [m] of a point.
    pub(crate) fn displacement(&self, x: [f32; 3]) -> DVec3 {
        let offset = DVec3::from_array(x.map(f64::from)) - self.origin;
        self.matrix * offset + self.shift - offset
    }
}

/// Adam on the twelve numbers of one map.
pub(crate) struct AffineFit {
    pub(crate) map: Affine,
    size: f64,
    moments: Moments,
    steps: usize,
    step: usize,
}

impl AffineFit {
    /// Starts from `map`; the object is `size` metres wide.
    pub(crate) fn new(map: Affine, size: f64, steps: usize) -> AffineFit {
        AffineFit { map, size, moments: Moments::zeros(12), steps, step: 0 }
    }

    /// One step, from the loss's derivative with respect to the moved points; `points` are their places before.
    pub(crate) fn update(&mut self, points: &[[f32; 3]], slope: &[[f32; 3]]) {
        let (mut d_matrix, mut d_shift) = (DMat3::ZERO, DVec3::ZERO);
        for (x, g) in points.iter().zip(slope) {
            let offset = (DVec3::from_array(x.map(f64::from)) - self.map.origin) / self.size;
            let g = DVec3::from_array(g.map(f64::from));
            d_matrix += DMat3::from_cols(g * offset.x, g * offset.y, g * offset.z);
            d_shift += g;
        }
        let unit_shift = self.map.shift / self.size;
        let pack = |m: DMat3, v: DVec3| -> Vec<f32> {
            m.to_cols_array().into_iter().chain(v.to_array()).map(|x| x as f32).collect()
        };
        let mut numbers = pack(self.map.matrix, unit_shift);
        let rate = decayed(RATE, self.step as f64 / self.steps as f64);
        self.step += 1;
        self.moments.update(&mut numbers, &pack(d_matrix, d_shift), rate, self.step);
        let numbers: Vec<f64> = numbers.into_iter().map(f64::from).collect();
        self.map.matrix = DMat3::from_cols_slice(&numbers[..9]);
        self.map.shift = DVec3::from_slice(&numbers[9..]) * self.size;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_map_between_two_clouds() {
        let points: Vec<[f32; 3]> =
            (0..60).map(|i| core::array::from_fn(|k| ((i * (3 + k)) as f32 * 0.7 + k as f32).sin() * 0.2)).collect();
        let truth = Affine {
            origin: DVec3::new(0.02, 0.0, 0.01),
            matrix: DMat3::from_rotation_y(0.2) * DMat3::from_diagonal(DVec3::new(1.1, 0.9, 1.0)),
            shift: DVec3::new(0.03, -0.05, 0.01),
        };
        let mut fit = AffineFit::new(Affine::identity(truth.origin), 0.4, 400);
        for _ in 0..400 {
            let slope: Vec<[f32; 3]> = points
                .iter()
                .map(|&x| (fit.map.displacement(x) - truth.displacement(x)).as_vec3().to_array())
                .collect();
            fit.update(&points, &slope);
        }
        for &x in &points {
            let error = (fit.map.displacement(x) - truth.displacement(x)).length();
            assert!(error < 1e-3, "{error} m");
        }
    }

    #[test]
    fn extrapolation_goes_on_alike() {
        let origin = DVec3::ZERO;
        let a = Affine { origin, matrix: DMat3::from_diagonal(DVec3::new(1.0, 0.9, 1.0)), shift: DVec3::Y };
        let b = a.extrapolated(&Affine::identity(origin), DVec3::X);
        assert!((b.matrix.y_axis.y - 0.8).abs() < 1e-12 && b.shift == DVec3::X);
    }
}
