//! Forward-mode derivatives of the alpha picture against finite differences and against the backward pass.

use gic_scene::Camera;
use gic_simd::Level;
use gic_splat::twin::{self, Cutoffs, GaussiansF64};
use gic_splat::{Gaussians, ImageGradients, RenderSettings, Shape, alpha_tangents, backward, render};
use glam::{DMat3, DVec2, DVec3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn camera() -> Camera {
    Camera {
        width: 37,
        height: 29,
        focal: DVec2::new(40.0, 42.0),
        principal: DVec2::new(18.0, 15.5),
        rotation: DMat3::from_euler(glam::EulerRot::XYZ, 0.2, 0.5, -0.3),
        centre: DVec3::new(0.1, 0.2, -0.1),
    }
}

fn scene(isotropic: bool, n: usize) -> (Gaussians, Vec<Vec<[f32; 3]>>) {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let mut u = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
    let positions: Vec<[f32; 3]> = (0..n)
        .map(|_| camera().unproject(DVec2::new(u(0.0, 37.0), u(0.0, 29.0)), u(0.6, 1.5)).as_vec3().to_array())
        .collect();
    let opacities = (0..n).map(|_| u(0.2, 0.9) as f32).collect();
    let scales: Vec<[f32; 3]> = (0..n).map(|_| [0; 3].map(|_| u(0.02, 0.08) as f32)).collect();
    let rotations = (0..n).map(|_| [0; 4].map(|_| u(-1.0, 1.0) as f32)).collect();
    let tangents = (0..3).map(|_| (0..n).map(|_| [0; 3].map(|_| u(-1.0, 1.0) as f32)).collect()).collect();
    let mut gaussians = Gaussians::colorless(positions, opacities, scales.iter().map(|s| s[0]).collect());
    if !isotropic {
        gaussians.shape = Shape::Anisotropic { scales, rotations };
    }
    (gaussians, tangents)
}

/// The hard cut-offs jump in single pixels: where no Gaussian crosses one between the two pictures, the difference is
/// smooth.
#[test]
fn tangents_match_finite_differences_of_the_twin() {
    for isotropic in [true, false] {
        for settings in [RenderSettings::masks(), RenderSettings::default()] {
            let (gaussians, tangents) = scene(isotropic, 40);
            let settings = RenderSettings { channels: gic_splat::Channels::Alpha, ..settings };
            let at = |tangent: &[[f32; 3]], h: f64| {
                let mut set = GaussiansF64::from(&gaussians);
                for (p, t) in set.positions.iter_mut().zip(tangent) {
                    *p += DVec3::from_array(t.map(f64::from)) * h;
                }
                twin::render(&set, &camera(), &settings, Cutoffs::Hard).alpha
            };
            for level in Level::supported() {
                let settings = RenderSettings { level, ..settings.clone() };
                let out = alpha_tangents(&gaussians, &camera(), &settings, &tangents);
                assert_eq!(out.alpha, render(&gaussians, &camera(), &settings).alpha);
                for (tangent, picture) in tangents.iter().zip(&out.tangents) {
                    let h = 1e-7;
                    let (plus, minus) = (at(tangent, h), at(tangent, -h));
                    let largest = picture.iter().fold(0.0f32, |m, v| m.max(v.abs()));
                    assert!(largest > 1.0, "nothing moves");
                    for i in 0..picture.len() {
                        let numeric = (plus[i] - minus[i]) / (2.0 * h);
                        let error = (f64::from(picture[i]) - numeric).abs();
                        assert!(error < 1e-4 * f64::from(largest), "pixel {i}: {} {numeric}", picture[i]);
                    }
                }
            }
        }
    }
}

/// <loss, dA> along a tangent is <gradient, tangent>, also where pixels end early.
#[test]
fn tangents_and_backward_are_adjoint() {
    let (mut gaussians, tangents) = scene(true, 600);
    gaussians.opacities.iter_mut().for_each(|o| *o = 0.5 + 0.45 * *o);
    let settings = RenderSettings::masks();
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let alpha: Vec<f32> = (0..37 * 29).map(|_| rng.random::<f32>() - 0.5).collect();
    let loss = ImageGradients { alpha, ..ImageGradients::default() };
    let rendered = render(&gaussians, &camera(), &settings);
    assert!(rendered.alpha.iter().any(|&a| a > 0.9999), "no pixel ends early");
    let gradient = backward(&gaussians, &camera(), &settings, &rendered, &loss);
    let out = alpha_tangents(&gaussians, &camera(), &settings, &tangents);
    for (tangent, picture) in tangents.iter().zip(&out.tangents) {
        let forward: f64 = picture.iter().zip(&loss.alpha).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum();
        let pairs = gradient.positions.as_flattened().iter().zip(tangent.as_flattened());
        let reverse: f64 = pairs.map(|(a, b)| f64::from(*a) * f64::from(*b)).sum();
        assert!((forward - reverse).abs() < 1e-4 * (1.0 + forward.abs()), "{forward} {reverse}");
    }
}

#[test]
fn without_tangents_only_the_picture_is_drawn() {
    let (gaussians, _) = scene(true, 10);
    let out = alpha_tangents(&gaussians, &camera(), &RenderSettings::masks(), &[]);
    assert!(out.tangents.is_empty());
    assert_eq!(out.alpha, render(&gaussians, &camera(), &RenderSettings::masks()).alpha);
}
