//! The silhouette of the Gaussian-informed continuum: alpha of isotropic Gaussians (paper eq. 2), made opaque, forward
//! and backward.
//!
//! The body is opaque, but where it is thin, few Gaussians lie behind each other and alpha stays below one, in gaps
//! between them most. A mask shows none of that, and a pile of sand would have to spread further to look as large as
//! it is. So the odds of alpha are squared: `C = A^2 / (A^2 + (1 - A)^2)`. Where alpha is one half, the outline stays;
//! of what is missing inside and too much outside, most is gone.
//!
//! Alpha alone does not depend on the order of the Gaussians, A(u) = 1 - prod_i (1 - o_i exp(-|u - mu_i|^2 / 2
//! sigma_i^2)), and an isotropic Gaussian separates into a row and a column. So neither sorting nor tiles are needed,
//! and a view of 8,000 particles costs a fraction of a millisecond, which matters when every Jacobian re-renders every
//! view once per unknown.

use gic_scene::Camera;
use gic_simd::{Kernel, Lanes, Level, MAX_LANES, dispatch};

use crate::forward::footprint::{Footprint, IsotropicGaussians, Projection};
use crate::forward::occlusion::Occlusion;
use crate::tuning::STEP_VARIANCE;

/// Coverage of the pixels of `camera` by the particles, row-major, shape [height * width].
pub(crate) fn coverage(gaussians: IsotropicGaussians, camera: &Camera) -> Vec<f32> {
    dispatch(Level::active(), Draw { gaussians, camera, occlusion: None })
}

/// The same where the particles are less than a pixel away from where they were when the picture with `occlusion` was
/// drawn.
pub(crate) fn coverage_nearby(gaussians: IsotropicGaussians, camera: &Camera, occlusion: &Occlusion) -> Vec<f32> {
    dispatch(Level::active(), Draw { gaussians, camera, occlusion: Some(occlusion) })
}

/// Coverage of a pixel with a transmittance: the odds of its alpha are squared.
fn opaque(transmittance: f32) -> f32 {
    let alpha = 1.0 - transmittance;
    let square = alpha * alpha;
    square / (square + transmittance * transmittance)
}

/// What one minus alpha is multiplied by for the derivative of the coverage c by alpha: with the odds r = A / (1 - A),
/// r^2 = c / (1 - c) and dc/dA (1 - A) = 2 r (1 + r) / (1 + r^2)^2.
fn slope_times_transmittance(coverage: f32) -> f32 {
    let odds = (coverage / (1.0 - coverage).max(f32::MIN_POSITIVE)).sqrt();
    let square = 1.0 + odds * odds;
    2.0 * odds * (1.0 + odds) / (square * square)
}

struct Draw<'a> {
    gaussians: IsotropicGaussians<'a>,
    camera: &'a Camera,
    /// What stays opaque; `None` where that is not known.
    occlusion: Option<&'a Occlusion>,
}

impl Draw<'_> {
    #[inline]
    fn is_hidden(&self, footprint: &Footprint) -> bool {
        self.occlusion.is_some_and(|occlusion| occlusion.hides(footprint.columns, footprint.rows))
    }
}

impl Kernel for Draw<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn run<L: Lanes<Scalar = f32>>(self) -> Vec<f32> {
        let (width, height) = (self.camera.width, self.camera.height);
        let projection = Projection::new(self.camera);
        // Whole lanes are drawn: what lies beyond a Gaussian's last column is multiplied by one, in the next row or
        // behind the picture.
        let mut transmittance: Vec<f32> = match self.occlusion {
            Some(occlusion) => occlusion.transmittance().chain([1.0; MAX_LANES]).collect(),
            None => vec![1.0; width * height + MAX_LANES],
        };
        let (mut row, mut column) = (vec![0.0f32; width + MAX_LANES], vec![0.0f32; height + MAX_LANES]);
        for first in (0..self.gaussians.positions.len()).step_by(L::LANES) {
            for (_, footprint) in projection.footprints::<L>(&self.gaussians, first).seen() {
                if self.is_hidden(&footprint) {
                    continue;
                }
                let whole = footprint.column_falloff::<L>(&mut row);
                footprint.row_falloff::<L>(&mut column);
                let first = footprint.rows.0 * width + footprint.columns.0;
                for at in (0..whole).step_by(L::LANES) {
                    let falloff = L::load(&row[at..]);
                    for (j, weight) in (0..footprint.rows.1 - footprint.rows.0).zip(&column) {
                        let to = &mut transmittance[first + j * width + at..];
                        let t = L::load(to);
                        (t * L::of(-weight)).mul_add(falloff, t).store(to);
                    }
                }
            }
        }
        transmittance.truncate(width * height);
        for t in &mut transmittance {
            *t = opaque(*t);
        }
        transmittance
    }
}

/// Adds d loss / d position [per m] to `gradient`, given the rendered coverage and d loss / d coverage.
///
/// dA/d alpha_i = (1 - A) / (1 - alpha_i). The change of a Gaussian's width with its depth is small against the motion
/// of its centre across the outline, but it is included, so that finite differences agree.
pub(crate) fn coverage_backward(
    gaussians: IsotropicGaussians,
    camera: &Camera,
    rendered: &[f32],
    bar: &[f32],
    gradient: &mut [glam::DVec3],
) {
    dispatch(Level::active(), DrawBackward { gaussians, camera, rendered, bar, gradient });
}

struct DrawBackward<'a> {
    gaussians: IsotropicGaussians<'a>,
    camera: &'a Camera,
    rendered: &'a [f32],
    bar: &'a [f32],
    gradient: &'a mut [glam::DVec3],
}

impl Kernel for DrawBackward<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes<Scalar = f32>>(self) {
        let (width, height) = (self.camera.width, self.camera.height);
        let projection = Projection::new(self.camera);
        // d loss / d alpha_i, but for the share of the Gaussian itself.
        let mut pull: Vec<f32> =
            (self.bar.iter().zip(self.rendered)).map(|(bar, c)| bar * slope_times_transmittance(*c)).collect();
        pull.resize(width * height + MAX_LANES, 0.0);
        let (mut row, mut column) = (vec![0.0f32; width + MAX_LANES], vec![0.0f32; height + MAX_LANES]);
        for first in (0..self.gaussians.positions.len()).step_by(L::LANES) {
            for (lane, footprint) in projection.footprints::<L>(&self.gaussians, first).seen() {
                let whole = footprint.column_falloff::<L>(&mut row);
                footprint.row_falloff::<L>(&mut column);
                let start_u = footprint.columns.0 as f32 + 0.5 - footprint.centre.0;
                // Sums of the pull, along columns and rows, and times the squared distance.
                let (mut sum, mut along_x, mut along_y, mut squared) = (L::zero(), L::zero(), L::zero(), L::zero());
                for (j, weight) in (footprint.rows.0..footprint.rows.1).zip(&column) {
                    let (start, weight) = (j * width + footprint.columns.0, L::of(*weight));
                    let v = L::of(j as f32 + 0.5 - footprint.centre.1);
                    for at in (0..whole).step_by(L::LANES) {
                        let u = L::lane_index() + L::of(start_u + at as f32);
                        let own = weight * L::load(&row[at..]);
                        let p = L::load(&pull[start + at..]) * own / (L::one() - own).max(L::of(1e-6));
                        sum += p;
                        along_x = p.mul_add(u, along_x);
                        along_y = p.mul_add(v, along_y);
                        squared = p.mul_add(u.mul_add(u, v * v), squared);
                    }
                }
                let variance = f64::from(footprint.variance);
                let (dx, dy) = (along_x.sum_lanes() / variance, along_y.sum_lanes() / variance);
                // own = o s2/(s2 + b) exp(-d2 / 2(s2 + b)); by log sigma: 2 b/(s2 + b) + d2 s2/(s2 + b)^2.
                let blur = f64::from(STEP_VARIANCE);
                let spread = sum.sum_lanes() * 2.0 * blur / variance
                    + squared.sum_lanes() * (variance - blur) / variance.powi(2);
                let (c, focal) = (footprint.camera.as_dvec3(), projection.focal.as_dvec2());
                let across = glam::DVec3::new(
                    dx * focal.x / c.z,
                    dy * focal.y / c.z,
                    -(dx * focal.x * c.x + dy * focal.y * c.y) / (c.z * c.z) - spread / c.z,
                );
                self.gradient[first + lane] += projection.turn.as_dmat3().transpose() * across;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec2, DVec3};
    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng};

    fn camera() -> Camera {
        Camera {
            width: 48,
            height: 40,
            focal: DVec2::splat(60.0),
            principal: DVec2::new(24.0, 20.0),
            world_from_camera: DMat3::from_rotation_y(0.3) * DMat3::from_rotation_x(0.2),
            centre: DVec3::new(-0.3, 0.2, -1.0),
        }
    }

    fn gaussians<'a>(positions: &'a [[f32; 3]], opacities: &'a [f32], scales: &'a [f32]) -> IsotropicGaussians<'a> {
        IsotropicGaussians { positions, opacities, scales, factor: 1.1 }
    }

    fn points(n: usize) -> Vec<[f32; 3]> {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        (0..n).map(|_| [0; 3].map(|_: i32| 0.3 * random.random::<f32>() - 0.15)).collect()
    }

    #[test]
    fn agrees_with_the_rasteriser() {
        let positions = points(60);
        let (opacities, scales) = (vec![0.6; 60], vec![0.03; 60]);
        let own = coverage(gaussians(&positions, &opacities, &scales), &camera());
        let gaussians = gic_splat::Gaussians {
            positions,
            opacities,
            shape: gic_splat::Shape::Isotropic { scales: vec![0.033; 60] },
            sh_degree: 0,
            sh: vec![[0.0; 3]; 60],
        };
        let reference = gic_splat::render(&gaussians, &camera(), &gic_splat::RenderSettings::default());
        // The rasteriser keeps the perspective's shear of each Gaussian and a wider low pass.
        let (mut difference, mut covered) = (0.0, 0.0);
        for (a, b) in own.iter().zip(reference.alpha.iter().map(|alpha| opaque(1.0 - alpha))) {
            difference += (a - b).abs();
            covered += b;
        }
        assert!(covered > 100.0 && difference < 0.05 * covered, "{difference} of {covered}");
    }

    /// A sheet of Gaussians 2.3 standard deviations apart, with gaps of alpha in between.
    #[test]
    fn what_is_thin_is_opaque() {
        let apart = |i: usize| 0.025 * (i as f32 - 4.5);
        let positions: Vec<[f32; 3]> = (0..100).map(|i| [apart(i % 10), apart(i / 10), 0.0]).collect();
        let (opacities, scales) = (vec![0.9; 100], vec![0.01; 100]);
        let camera = Camera {
            world_from_camera: DMat3::IDENTITY,
            centre: DVec3::new(0.0, 0.0, -1.0),
            focal: DVec2::splat(100.0),
            ..camera()
        };
        let drawn = coverage(gaussians(&positions, &opacities, &scales), &camera);
        let alpha = plain_alpha(gaussians(&positions, &opacities, &scales), &camera);
        // Within the outermost Gaussians.
        let inside = |i: &usize| (12..36).contains(&(i % 48)) && (8..32).contains(&(i / 48));
        let missing = |values: &dyn Fn(usize) -> f64| (0..48 * 40).filter(inside).map(|i| 1.0 - values(i)).sum::<f64>();
        let (before, after) = (missing(&|i| alpha[i]), missing(&|i| f64::from(drawn[i])));
        println!("{before} missing in alpha, {after} in coverage");
        assert!(after < 0.6 * before, "{before} {after}");
        for (a, c) in alpha.iter().zip(&drawn) {
            assert!((a - 0.5) * (f64::from(*c) - a) >= -1e-3, "{a} became {c}");
        }
    }

    /// The definition in f64, Gaussian by Gaussian and pixel by pixel.
    fn plain(gaussians: IsotropicGaussians, camera: &Camera) -> Vec<f64> {
        plain_alpha(gaussians, camera).iter().map(|a| a * a / (a * a + (1.0 - a) * (1.0 - a))).collect()
    }

    fn plain_alpha(gaussians: IsotropicGaussians, camera: &Camera) -> Vec<f64> {
        let mut transmittance = vec![1.0f64; camera.width * camera.height];
        for (i, position) in gaussians.positions.iter().enumerate() {
            let p =
                camera.world_from_camera.transpose() * (glam::Vec3::from_array(*position).as_dvec3() - camera.centre);
            let centre = camera.focal * p.truncate() / p.z + camera.principal;
            let sigma =
                (camera.focal.x * camera.focal.y).sqrt() * f64::from(gaussians.scales[i] * gaussians.factor) / p.z;
            let variance = sigma * sigma + f64::from(STEP_VARIANCE);
            for (k, t) in transmittance.iter_mut().enumerate() {
                let d = DVec2::new((k % camera.width) as f64 + 0.5, (k / camera.width) as f64 + 0.5) - centre;
                if p.z > 0.0 && d.abs().max_element() <= 4.0 * variance.sqrt() {
                    let peak = f64::from(gaussians.opacities[i]) * sigma * sigma / variance;
                    *t *= 1.0 - peak * (-0.5 * d.length_squared() / variance).exp();
                }
            }
        }
        transmittance.iter().map(|t| 1.0 - t).collect()
    }

    proptest! {
        #[test]
        fn all_levels_agree_with_the_definition(
            n in 0usize..70,
            seed in 0u64..1000,
            scale in 0.002f32..0.1,
            spread in 0.1f32..3.0,
        ) {
            let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
            let mut position = || [0; 3].map(|_: i32| spread * (random.random::<f32>() - 0.5));
            let positions: Vec<[f32; 3]> = (0..n).map(|_| position()).collect();
            let scales: Vec<f32> = (0..n).map(|i| scale * (1.0 + i as f32 / 30.0)).collect();
            let opacities = vec![0.8; n];
            // In front of the camera by as much as a Gaussian reaches.
            let (centre, focal) = (DVec3::new(-0.3, 0.2, -8.0), DVec2::splat(300.0));
            let far = Camera { centre, world_from_camera: DMat3::IDENTITY, focal, ..camera() };
            let gaussians = gaussians(&positions, &opacities, &scales);
            let exact = plain(gaussians, &far);
            for level in Level::supported() {
                let found = dispatch(level, Draw { gaussians, camera: &far, occlusion: None });
                prop_assert_eq!(found.len(), exact.len());
                for (found, exact) in found.iter().zip(&exact) {
                    // A pixel at the very end may fall on the other side of it: exp(-8).
                    prop_assert!((f64::from(*found) - exact).abs() < 7e-4, "{}: {} instead of {}", level, found, exact);
                }
                let errors = found.iter().zip(&exact).map(|(a, b)| (f64::from(*a) - b).abs());
                let mean = errors.sum::<f64>() / exact.len() as f64;
                prop_assert!(mean < 2e-6, "{}: {}", level, mean);
            }
        }
    }

    /// A ball as particles fill it, in whose middle all is opaque.
    #[test]
    fn what_is_opaque_need_not_be_drawn_again() {
        let axis = |i: usize| 0.01 * (i as f32 - 10.0);
        let cube = (0..21usize.pow(3)).map(|i| [axis(i % 21), axis(i / 21 % 21), axis(i / 441)]);
        let positions: Vec<[f32; 3]> = cube.filter(|p| glam::Vec3::from_array(*p).length() < 0.1).collect();
        let (opacities, scales) = (vec![0.9; positions.len()], vec![0.005; positions.len()]);
        let camera = Camera { focal: DVec2::splat(150.0), centre: DVec3::new(-0.3, 0.2, -0.9), ..camera() };
        let occlusion = Occlusion::of(&coverage(gaussians(&positions, &opacities, &scales), &camera), camera.width);
        let opaque = occlusion.transmittance().filter(|transmittance| *transmittance == 0.0).count();
        assert!(opaque > 100, "{opaque} pixels");
        // A quarter of a pixel.
        for axis in 0..3 {
            let mut moved = positions.clone();
            moved.iter_mut().for_each(|p| p[axis] += 0.0015);
            let moved = gaussians(&moved, &opacities, &scales);
            let (all, nearby) = (coverage(moved, &camera), coverage_nearby(moved, &camera, &occlusion));
            for (at, (all, nearby)) in all.iter().zip(&nearby).enumerate() {
                assert!((all - nearby).abs() < 1e-7, "{at}: {nearby} instead of {all}");
            }
        }
    }

    #[test]
    fn what_is_nowhere_is_not_drawn() {
        let nowhere = [[f32::NAN; 3], [f32::INFINITY, 0.0, 0.0], [0.0, 0.0, f32::INFINITY], [0.0, 0.0, -5.0]];
        let (opacities, scales) = (vec![0.6; 4], vec![0.03; 4]);
        let straight = Camera { world_from_camera: DMat3::IDENTITY, ..camera() };
        for camera in [camera(), straight] {
            assert!(coverage(gaussians(&nowhere, &opacities, &scales), &camera).iter().all(|a| *a == 0.0));
        }
    }

    #[test]
    fn gradient_agrees_with_finite_differences() {
        let positions = points(25);
        let (opacities, scales) = (vec![0.7; 25], vec![0.02; 25]);
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(6);
        let bar: Vec<f32> = (0..48 * 40).map(|_| random.random::<f32>() - 0.5).collect();
        let loss = |positions: &[[f32; 3]]| -> f64 {
            coverage(gaussians(positions, &opacities, &scales), &camera())
                .iter()
                .zip(&bar)
                .map(|(a, b)| f64::from(*a) * f64::from(*b))
                .sum()
        };
        let rendered = coverage(gaussians(&positions, &opacities, &scales), &camera());
        let mut gradient = vec![DVec3::ZERO; 25];
        coverage_backward(gaussians(&positions, &opacities, &scales), &camera(), &rendered, &bar, &mut gradient);
        let largest = gradient.iter().map(|g| g.abs().max_element()).fold(0.0, f64::max);
        for i in 0..25 {
            for axis in 0..3 {
                let step = 1e-3f32;
                let moved = |by: f32| {
                    let mut p = positions.clone();
                    p[i][axis] += by;
                    loss(&p)
                };
                let numeric = (moved(step) - moved(-step)) / f64::from(2.0 * step);
                assert!((numeric - gradient[i][axis]).abs() < 0.02 * largest, "{i} {axis}: {numeric} {}", gradient[i]);
            }
        }
    }
}
