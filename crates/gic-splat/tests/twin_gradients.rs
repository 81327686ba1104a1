//! The twin's gradients against central finite differences in f64, attribute lane by attribute lane.
//!
//! Smooth cut-offs stand in for the hard ones, so that Gaussians at the near plane, beyond the frustum's margin, at the
//! alpha limits, at the end of the transmittance and with clamped colours are all part of the check.

use gic_scene::Camera;
use gic_splat::twin::{self, Cutoffs, GaussiansF64, PicturesF64};
use gic_splat::{Channels, RenderSettings};
use glam::{DMat3, DVec2, DVec3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const SMOOTH: Cutoffs = Cutoffs::Smooth { width: 0.1 };

fn camera() -> Camera {
    Camera {
        width: 9,
        height: 7,
        focal: DVec2::new(8.0, 9.0),
        principal: DVec2::new(4.2, 3.7),
        world_from_camera: DMat3::from_euler(glam::EulerRot::XYZ, 0.3, -0.4, 0.2),
        centre: DVec3::new(0.3, -0.2, 0.1),
    }
}

/// Gaussians all over the view and some beyond its edges and at the near plane.
fn scene(n: usize, seed: u64) -> GaussiansF64 {
    let camera = camera();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut set = GaussiansF64 { sh_degree: 3, ..GaussiansF64::default() };
    for i in 0..n {
        let mut u = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
        let depth = if i % 5 == 0 { u(0.18, 0.3) } else { u(0.5, 2.0) };
        set.positions.push(camera.unproject(DVec2::new(u(-4.0, 13.0), u(-3.0, 10.0)), depth));
        set.opacities.push(u(0.3, 1.05));
        set.scales.push(DVec3::new(u(0.02, 0.3), u(0.02, 0.3), u(0.02, 0.3)) * depth);
        set.rotations.push(std::array::from_fn(|_| u(-1.0, 1.0)));
        set.sh.extend((0..16).map(|_| DVec3::new(u(-0.8, 0.8), u(-0.8, 0.8), u(-0.8, 0.8))));
    }
    set
}

fn settings(compensate: bool) -> RenderSettings {
    RenderSettings { background: [0.2, 0.5, 0.9], near: 0.2, compensate, ..RenderSettings::default() }
}

fn weights(seed: u64) -> PicturesF64 {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut u = || rng.random::<f64>() * 2.0 - 1.0;
    let n = camera().width * camera().height;
    PicturesF64 {
        color: (0..n).map(|_| DVec3::new(u(), u(), u())).collect(),
        alpha: (0..n).map(|_| u()).collect(),
        depth: (0..n).map(|_| u()).collect(),
    }
}

/// A fixed linear functional of the three pictures.
fn loss(pictures: &PicturesF64, weights: &PicturesF64) -> f64 {
    let color: f64 = pictures.color.iter().zip(&weights.color).map(|(a, b)| a.dot(*b)).sum();
    let dot = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
    color + dot(&pictures.alpha, &weights.alpha) + dot(&pictures.depth, &weights.depth)
}

/// Compares one lane of the gradient with a central difference; `lane` reaches the number to move.
fn check(
    name: &str,
    analytic: f64,
    set: &GaussiansF64,
    settings: &RenderSettings,
    lane: impl Fn(&mut GaussiansF64) -> &mut f64,
) {
    let weights = weights(7);
    let at = |h: f64| {
        let mut moved = set.clone();
        *lane(&mut moved) += h;
        loss(&twin::render(&moved, &camera(), settings, SMOOTH), &weights)
    };
    let h = 1e-5;
    // Fourth order: the smooth cut-offs curve strongly.
    let numeric = (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h);
    let error = (analytic - numeric).abs();
    assert!(error <= 1e-6 * (1.0 + numeric.abs()), "{name}: analytic {analytic}, numeric {numeric}");
}

#[test]
fn every_lane_matches_finite_differences() {
    for (compensate, seed) in [(false, 1), (true, 2)] {
        let (set, settings) = (scene(12, seed), settings(compensate));
        let gradient = twin::backward(&set, &camera(), &settings, SMOOTH, &weights(7));
        for i in 0..set.positions.len() {
            for a in 0..3 {
                check(&format!("position {i}.{a}"), gradient.positions[i][a], &set, &settings, |s| {
                    &mut s.positions[i][a]
                });
                check(&format!("scale {i}.{a}"), gradient.scales[i][a], &set, &settings, |s| &mut s.scales[i][a]);
            }
            for q in 0..4 {
                check(&format!("rotation {i}.{q}"), gradient.rotations[i][q], &set, &settings, |s| {
                    &mut s.rotations[i][q]
                });
            }
            check(&format!("opacity {i}"), gradient.opacities[i], &set, &settings, |s| &mut s.opacities[i]);
        }
        for k in 0..set.sh.len() {
            for channel in 0..3 {
                check(&format!("sh {k}.{channel}"), gradient.sh[k][channel], &set, &settings, |s| {
                    &mut s.sh[k][channel]
                });
            }
        }
    }
}

/// Moving the principal point moves every projected centre: the screen-space gradients add up to that derivative.
/// (The frustum's margin moves with it, so the Gaussians are kept well inside.)
#[test]
fn screen_gradient_matches_a_shift_of_the_picture() {
    let mut set = scene(8, 5);
    for (i, p) in set.positions.iter_mut().enumerate() {
        *p = camera().unproject(DVec2::new(3.0 + 0.3 * i as f64, 4.0 - 0.2 * i as f64), 1.0 + 0.1 * i as f64);
    }
    let settings = settings(false);
    let sharp = Cutoffs::Smooth { width: 0.01 };
    let gradient = twin::backward(&set, &camera(), &settings, sharp, &weights(7));
    let total: DVec2 = gradient.screen.iter().sum();
    for axis in 0..2 {
        let at = |h: f64| {
            let mut moved = camera();
            moved.principal[axis] += h;
            loss(&twin::render(&set, &moved, &settings, sharp), &weights(7))
        };
        let numeric = (8.0 * (at(1e-6) - at(-1e-6)) - (at(2e-6) - at(-2e-6))) / 12e-6;
        assert!((total[axis] - numeric).abs() < 1e-5 * (1.0 + numeric.abs()), "{total} {numeric}");
    }
}

/// As the smooth cut-offs sharpen, their pictures become the definition's.
#[test]
fn smooth_cutoffs_tend_to_the_hard_ones() {
    let (set, settings) = (scene(10, 11), settings(false));
    let hard = twin::render(&set, &camera(), &settings, Cutoffs::Hard);
    let distance = |width: f64| {
        let soft = twin::render(&set, &camera(), &settings, Cutoffs::Smooth { width });
        soft.alpha.iter().zip(&hard.alpha).map(|(a, b)| (a - b).abs()).sum::<f64>() / hard.alpha.len() as f64
    };
    assert!(distance(1e-4) < 1e-4, "{}", distance(1e-4));
    assert!(distance(1e-4) < distance(1e-1));
}

/// Leaving pictures out changes nothing in the others, and the background shows through in what alpha leaves.
#[test]
fn channels_agree_and_background_shows_through() {
    let (set, camera) = (scene(10, 3), camera());
    let full = settings(false);
    let all = twin::render(&set, &camera, &full, Cutoffs::Hard);
    for channels in [Channels::ColorAlpha, Channels::AlphaDepth, Channels::Alpha] {
        let some = twin::render(&set, &camera, &RenderSettings { channels, ..full.clone() }, Cutoffs::Hard);
        assert_eq!(some.alpha, all.alpha);
        assert_eq!(some.color.is_empty(), channels != Channels::ColorAlpha);
        assert_eq!(some.depth.is_empty(), channels != Channels::AlphaDepth);
    }
    let over_black = RenderSettings { background: [0.0; 3], ..full.clone() };
    let black = twin::render(&set, &camera, &over_black, Cutoffs::Hard);
    let background = DVec3::from_array(full.background.map(f64::from));
    for i in 0..all.alpha.len() {
        let expected = black.color[i] + background * (1.0 - all.alpha[i]);
        assert!((all.color[i] - expected).length() < 1e-12);
        assert!((0.0..=1.0).contains(&all.alpha[i]));
    }
}

/// One isotropic Gaussian on the optical axis: its picture in closed form.
#[test]
fn one_gaussian_in_closed_form() {
    let camera = Camera {
        width: 11,
        height: 11,
        focal: DVec2::splat(20.0),
        principal: DVec2::splat(5.5),
        world_from_camera: DMat3::IDENTITY,
        centre: DVec3::ZERO,
    };
    let (depth, scale, opacity) = (2.0, 0.15, 0.8);
    let set = GaussiansF64 {
        positions: vec![DVec3::new(0.0, 0.0, depth)],
        opacities: vec![opacity],
        scales: vec![DVec3::splat(scale)],
        rotations: vec![[1.0, 0.0, 0.0, 0.0]],
        sh_degree: 0,
        sh: vec![DVec3::new(0.4, 0.0, -0.3) / gic_splat::sh::C0],
        screen: Vec::new(),
    };
    let pictures = twin::render(&set, &camera, &RenderSettings::default(), Cutoffs::Hard);
    let variance = (20.0 * scale / depth).powi(2) + f64::from(0.3f32);
    for i in 0..121 {
        let r2 = ((i % 11) as f64 - 5.0).powi(2) + ((i / 11) as f64 - 5.0).powi(2);
        let raw = opacity * (-0.5 * r2 / variance).exp();
        let alpha = if raw >= 1.0 / 255.0 { raw } else { 0.0 };
        assert!((pictures.alpha[i] - alpha).abs() < 1e-12);
        assert!((pictures.depth[i] - alpha * depth).abs() < 1e-12);
        assert!((pictures.color[i] - DVec3::new(0.9, 0.5, 0.2) * alpha).length() < 1e-12);
    }
}
