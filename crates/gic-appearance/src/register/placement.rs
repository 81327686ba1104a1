//! Where a scan lies in another world: its Gaussians there, and the chain rule from them to turn, shift and size.
//!
//! Small changes act about the scan's own centre c, which lies at p: x' = s R (x - c) + p is followed by a turn by the
//! vector w, a shift t and a growth of the logarithm of the size by g. At zero, dx'/dw = w x (x' - p), dx'/dt = t,
//! dx'/dg = x' - p; the orientation q' of an ellipsoid follows the turn, dq'/dw = (0, w) q' / 2, and its axes grow as
//! everything does. About the centre, the seven numbers hardly influence one another.

use gic_scene::Similarity;
use gic_splat::{GaussianGradients, Gaussians, Shape};
use glam::{DMat3, DQuat, DVec3};

/// Turn about the world's axes [rad], shift [m], logarithm of the size.
pub(crate) const UNKNOWNS: usize = 7;

/// x' = scale * rotation * (x - pivot) + place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Placement {
    /// The scan's centre, in its own frame.
    pub(crate) pivot: DVec3,
    /// Metres per unit of the scan.
    pub(crate) scale: f64,
    pub(crate) rotation: DQuat,
    /// Where the centre lies [m].
    pub(crate) place: DVec3,
}

/// A Gaussian's geometry, or a gradient with respect to it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ellipsoid {
    pub(crate) position: DVec3,
    pub(crate) scales: DVec3,
    /// Quaternion (w, x, y, z).
    pub(crate) rotation: [f64; 4],
}

impl Placement {
    /// After a small change.
    pub(crate) fn stepped(&self, step: &[f64; UNKNOWNS]) -> Placement {
        let turn = DQuat::from_scaled_axis(DVec3::new(step[0], step[1], step[2]));
        Placement {
            pivot: self.pivot,
            scale: self.scale * step[6].exp(),
            rotation: (turn * self.rotation).normalize(),
            place: self.place + DVec3::new(step[3], step[4], step[5]),
        }
    }

    pub(crate) fn similarity(&self) -> Similarity {
        let rotation = DMat3::from_quat(self.rotation);
        Similarity { scale: self.scale, rotation, translation: self.place - self.scale * (rotation * self.pivot) }
    }

    /// A Gaussian of the scan in the world.
    pub(crate) fn moved(&self, g: &Ellipsoid) -> Ellipsoid {
        let [w, x, y, z] = g.rotation;
        let turned = self.rotation * DQuat::from_xyzw(x, y, z, w);
        Ellipsoid {
            position: self.scale * (self.rotation * (g.position - self.pivot)) + self.place,
            scales: self.scale * g.scales,
            rotation: [turned.w, turned.x, turned.y, turned.z],
        }
    }

    /// The gradient with respect to the seven numbers, at zero, from that with respect to a moved Gaussian.
    pub(crate) fn pull_back(&self, moved: &Ellipsoid, slope: &Ellipsoid) -> [f64; UNKNOWNS] {
        let arm = moved.position - self.place;
        let [w, x, y, z] = moved.rotation;
        let [dw, dx, dy, dz] = slope.rotation;
        let (v, dv) = (DVec3::new(x, y, z), DVec3::new(dx, dy, dz));
        // (0, e) (w, v) = (-e.v, w e + e x v)
        let spin = 0.5 * (w * dv - dw * v + v.cross(dv));
        let turn = arm.cross(slope.position) + spin;
        let growth = arm.dot(slope.position) + moved.scales.dot(slope.scales);
        let shift = slope.position;
        [turn.x, turn.y, turn.z, shift.x, shift.y, shift.z, growth]
    }

    /// The scan's Gaussians in the world. Their colours must not depend on the direction, for that is not turned.
    pub(crate) fn gaussians(&self, scan: &Gaussians) -> Gaussians {
        let mut all = scan.clone();
        for i in 0..scan.len() {
            let moved = self.moved(&ellipsoid(&scan.positions, &scan.shape, i));
            all.positions[i] = moved.position.as_vec3().to_array();
            match &mut all.shape {
                Shape::Isotropic { scales } => scales[i] = moved.scales.x as f32,
                Shape::Anisotropic { scales, rotations } => {
                    scales[i] = moved.scales.as_vec3().to_array();
                    rotations[i] = moved.rotation.map(|v| v as f32);
                }
            }
        }
        all
    }

    /// [`Placement::pull_back`] of all, summed.
    pub(crate) fn pull_back_all(&self, moved: &Gaussians, slope: &GaussianGradients) -> [f64; UNKNOWNS] {
        let mut sum = [0.0; UNKNOWNS];
        for i in 0..moved.len() {
            let mut d = ellipsoid(&slope.positions, &slope.shape, i);
            if matches!(slope.shape, Shape::Isotropic { .. }) {
                // One number for three equal axes, and no orientation.
                (d.scales, d.rotation) = (DVec3::new(d.scales.x, 0.0, 0.0), [0.0; 4]);
            }
            let one = self.pull_back(&ellipsoid(&moved.positions, &moved.shape, i), &d);
            sum.iter_mut().zip(one).for_each(|(s, d)| *s += d);
        }
        sum
    }
}

fn ellipsoid(positions: &[[f32; 3]], shape: &Shape, i: usize) -> Ellipsoid {
    let wide = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
    let (scales, rotation) = match shape {
        Shape::Isotropic { scales } => (DVec3::splat(scales[i].into()), [1.0, 0.0, 0.0, 0.0]),
        Shape::Anisotropic { scales, rotations } => (wide(scales[i]), rotations[i].map(f64::from)),
    };
    Ellipsoid { position: wide(positions[i]), scales, rotation }
}

#[cfg(test)]
mod tests {
    use gic_scene::Camera;
    use gic_splat::RenderSettings;
    use gic_splat::twin::{self, Cutoffs, GaussiansF64, PicturesF64};
    use glam::DVec2;

    use super::*;

    const SMOOTH: Cutoffs = Cutoffs::Smooth { width: 0.3 };

    fn scan() -> GaussiansF64 {
        let wave = |i: usize, k: f64| (i as f64 * k + k * k).sin();
        let n = 6;
        GaussiansF64 {
            positions: (0..n).map(|i| DVec3::new(wave(i, 1.1), wave(i, 2.3), wave(i, 3.7))).collect(),
            opacities: (0..n).map(|i| 0.5 + 0.3 * wave(i, 5.0)).collect(),
            scales: (0..n).map(|i| DVec3::new(0.3 + 0.1 * wave(i, 2.0), 0.2, 0.4 + 0.1 * wave(i, 4.0))).collect(),
            rotations: (0..n).map(|i| [0.8, wave(i, 1.7), wave(i, 2.9), wave(i, 4.3)]).collect(),
            sh_degree: 0,
            sh: (0..n).map(|i| DVec3::new(wave(i, 0.7), wave(i, 1.3), wave(i, 1.9))).collect(),
            screen: Vec::new(),
        }
    }

    fn placement() -> Placement {
        Placement {
            pivot: DVec3::new(0.2, -0.1, 0.3),
            scale: 0.4,
            rotation: DQuat::from_euler(glam::EulerRot::XYZ, 0.5, -0.8, 1.9),
            place: DVec3::new(0.1, 0.05, 2.0),
        }
    }

    fn camera() -> Camera {
        Camera {
            width: 24,
            height: 20,
            focal: DVec2::new(40.0, 42.0),
            principal: DVec2::new(12.0, 10.0),
            world_from_camera: DMat3::from_rotation_y(0.1),
            centre: DVec3::new(0.0, 0.1, 0.0),
        }
    }

    fn row(set: &GaussiansF64, i: usize) -> Ellipsoid {
        Ellipsoid { position: set.positions[i], scales: set.scales[i], rotation: set.rotations[i] }
    }

    fn placed(placement: &Placement) -> GaussiansF64 {
        let mut set = scan();
        for i in 0..set.positions.len() {
            let moved = placement.moved(&row(&set, i));
            (set.positions[i], set.scales[i], set.rotations[i]) = (moved.position, moved.scales, moved.rotation);
        }
        set
    }

    /// Weights of a linear loss on the pictures.
    fn weights() -> PicturesF64 {
        let count = camera().width * camera().height;
        let wave = |i: usize, k: f64| (i as f64 * k).sin();
        PicturesF64 {
            color: (0..count).map(|i| DVec3::new(wave(i, 0.13), wave(i, 0.29), wave(i, 0.41))).collect(),
            alpha: (0..count).map(|i| wave(i, 0.19)).collect(),
            depth: Vec::new(),
        }
    }

    fn loss(placement: &Placement) -> f64 {
        let (drawn, w) = (twin::render(&placed(placement), &camera(), &RenderSettings::default(), SMOOTH), weights());
        let color: f64 = drawn.color.iter().zip(&w.color).map(|(c, w)| c.dot(*w)).sum();
        color + drawn.alpha.iter().zip(&w.alpha).map(|(a, w)| a * w).sum::<f64>()
    }

    #[test]
    fn the_chain_through_the_pictures_agrees_with_finite_differences() {
        let at = placement();
        let set = placed(&at);
        let slope = twin::backward(&set, &camera(), &RenderSettings::default(), SMOOTH, &weights());
        let mut found = [0.0; UNKNOWNS];
        for i in 0..set.positions.len() {
            let one = at.pull_back(&row(&set, i), &row(&slope, i));
            found.iter_mut().zip(one).for_each(|(s, d)| *s += d);
        }
        let h = 1e-5;
        for (k, found) in found.iter().enumerate() {
            let stepped = |h: f64| {
                let mut step = [0.0; UNKNOWNS];
                step[k] = h;
                loss(&at.stepped(&step))
            };
            let expected = (stepped(h) - stepped(-h)) / (2.0 * h);
            assert!((found - expected).abs() < 1e-6 * (1.0 + expected.abs()), "{k}: {found} against {expected}");
            assert!(expected.abs() > 1e-2, "{k}: {expected} tests nothing");
        }
    }

    #[test]
    fn single_precision_sets_have_the_same_gradient() {
        let at = placement();
        let set = placed(&at);
        let slope = twin::backward(&set, &camera(), &RenderSettings::default(), SMOOTH, &weights());
        let narrow = |v: &DVec3| v.as_vec3().to_array();
        let source = scan();
        for ellipsoids in [true, false] {
            let shape = match ellipsoids {
                true => Shape::Anisotropic {
                    scales: source.scales.iter().map(narrow).collect(),
                    rotations: source.rotations.iter().map(|q| q.map(|v| v as f32)).collect(),
                },
                false => Shape::Isotropic { scales: source.scales.iter().map(|s| s.x as f32).collect() },
            };
            let gaussians = Gaussians {
                positions: source.positions.iter().map(narrow).collect(),
                opacities: source.opacities.iter().map(|o| *o as f32).collect(),
                shape,
                sh_degree: 0,
                sh: source.sh.iter().map(narrow).collect(),
            };
            let moved = at.gaussians(&gaussians);
            let found = at.pull_back_all(&moved, &slope.to_f32(&gaussians));
            let mut expected = [0.0; UNKNOWNS];
            for i in 0..set.positions.len() {
                let mut d = row(&slope, i);
                let mut g = row(&set, i);
                if !ellipsoids {
                    g.scales = DVec3::splat(g.scales.x);
                    d.rotation = [0.0; 4];
                }
                expected.iter_mut().zip(at.pull_back(&g, &d)).for_each(|(s, d)| *s += d);
            }
            for (found, expected) in found.iter().zip(expected) {
                assert!((found - expected).abs() < 1e-4 * (1.0 + expected.abs()), "{found} against {expected}");
            }
        }
    }

    #[test]
    fn the_similarity_places_points_alike() {
        let (at, x) = (placement(), DVec3::new(0.7, 0.2, -0.4));
        let g = Ellipsoid { position: x, scales: DVec3::ONE, rotation: [1.0, 0.0, 0.0, 0.0] };
        assert!((at.similarity().point(x) - at.moved(&g).position).length() < 1e-12);
    }
}
