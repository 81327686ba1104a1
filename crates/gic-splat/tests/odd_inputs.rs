//! Odd cameras and odd Gaussians: no panic, finite pictures, finite gradients, at every SIMD level.

use gic_scene::Camera;
use gic_simd::Level;
use gic_splat::{Channels, Gaussians, GaussiansError, ImageGradients, RenderSettings, Shape, backward, render};
use glam::{DMat3, DVec2, DVec3};
use proptest::prelude::*;

fn camera(width: usize, height: usize) -> Camera {
    Camera {
        width,
        height,
        focal: DVec2::splat(20.0),
        principal: DVec2::new(width as f64, height as f64) * 0.5,
        world_from_camera: DMat3::from_rotation_y(0.1),
        centre: DVec3::new(0.0, 0.1, -1.0),
    }
}

/// Mostly sensible numbers, and the worst ones.
fn number() -> impl Strategy<Value = f32> {
    prop_oneof![
        8 => -2.0f32..2.0,
        1 => prop::sample::select(vec![0.0, -0.0, 1e-38, 1e-20, 1e20, 3e38, -3e38, -1.0]),
        1 => prop::sample::select(vec![f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MIN_POSITIVE, 1e-45]),
    ]
}

fn odd_gaussians() -> impl Strategy<Value = Gaussians> {
    let row = (
        prop::array::uniform3(number()),
        prop_oneof![3 => 0.0f32..1.2, 1 => number()],
        prop::array::uniform3(prop_oneof![4 => 0.0f32..0.5, 1 => number()]),
        prop::array::uniform4(number()),
        prop::collection::vec(prop::array::uniform3(prop_oneof![20 => -1.0f32..1.0, 1 => number()]), 9),
    );
    (prop::collection::vec(row, 0..12), any::<bool>()).prop_map(|(rows, isotropic)| Gaussians {
        positions: rows.iter().map(|r| r.0).collect(),
        opacities: rows.iter().map(|r| r.1).collect(),
        shape: if isotropic {
            Shape::Isotropic { scales: rows.iter().map(|r| r.2[0]).collect() }
        } else {
            Shape::Anisotropic {
                scales: rows.iter().map(|r| r.2).collect(),
                rotations: rows.iter().map(|r| r.3).collect(),
            }
        },
        sh_degree: 2,
        sh: rows.iter().flat_map(|r| r.4.clone()).collect(),
    })
}

fn all_finite<'a>(values: impl IntoIterator<Item = &'a f32>) -> bool {
    values.into_iter().all(|v| v.is_finite())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn pictures_and_gradients_are_finite(
        gaussians in odd_gaussians(),
        width in prop::sample::select(vec![1usize, 2, 15, 16, 17, 40]),
        height in prop::sample::select(vec![1usize, 3, 16, 33]),
        dilation in prop::sample::select(vec![0.0f32, 0.3]),
        compensate: bool,
        channels in prop::sample::select(vec![
            Channels::ColorAlphaDepth, Channels::ColorAlpha, Channels::AlphaDepth, Channels::Alpha,
        ]),
    ) {
        let camera = camera(width, height);
        let n = width * height;
        let loss = ImageGradients { color: vec![[1.0, -0.5, 0.25]; n], alpha: vec![-0.7; n], depth: vec![0.3; n] };
        for level in Level::supported() {
            let settings = RenderSettings { level, dilation, compensate, channels, ..RenderSettings::default() };
            let rendered = render(&gaussians, &camera, &settings);
            prop_assert_eq!(rendered.alpha.len(), n);
            prop_assert!(rendered.alpha.iter().all(|a| (0.0..=1.0).contains(a)));
            prop_assert!(all_finite(rendered.color.as_flattened()) && all_finite(&rendered.depth));
            let gradient = backward(&gaussians, &camera, &settings, &rendered, &loss);
            prop_assert!(all_finite(gradient.positions.as_flattened()), "position {:?}", gradient);
            prop_assert!(all_finite(&gradient.opacities) && all_finite(&gradient.screen), "{:?}", gradient);
            prop_assert!(all_finite(gradient.sh.as_flattened()), "{:?}", gradient);
            match &gradient.shape {
                Shape::Isotropic { scales } => prop_assert!(all_finite(scales), "{:?}", scales),
                Shape::Anisotropic { scales, rotations } => {
                    prop_assert!(all_finite(scales.as_flattened()), "{:?}", scales);
                    prop_assert!(all_finite(rotations.as_flattened()), "{:?}", rotations);
                }
            }
        }
    }
}

/// A Gaussian that is not a number leaves the others alone, is counted, and gets no gradient.
#[test]
fn bad_gaussians_are_rejected_and_counted() {
    let good = Gaussians::colorless(vec![[0.0, 0.0, 0.5]], vec![0.8], vec![0.1]);
    let mut mixed = good.clone();
    for (position, opacity, scale) in [
        ([f32::NAN, 0.0, 0.0], 0.5, 0.1),
        ([0.0; 3], f32::NAN, 0.1),
        ([0.0; 3], -0.5, 0.1),
        ([0.0; 3], 0.5, f32::INFINITY),
    ] {
        mixed.positions.push(position);
        mixed.opacities.push(opacity);
        let Shape::Isotropic { scales } = &mut mixed.shape else { unreachable!("made so") };
        scales.push(scale);
    }
    let (camera, settings) = (camera(20, 20), RenderSettings::masks());
    let (alone, among) = (render(&good, &camera, &settings), render(&mixed, &camera, &settings));
    assert_eq!(alone.alpha, among.alpha);
    assert!(alone.alpha.iter().any(|&a| a > 0.5));
    assert_eq!((alone.rejected, among.rejected), (0, 4));
    let loss = ImageGradients { alpha: vec![1.0; 400], ..ImageGradients::default() };
    let gradient = backward(&mixed, &camera, &settings, &among, &loss);
    assert!(gradient.opacities[0] > 0.0);
    assert_eq!(gradient.opacities[1..], [0.0; 4]);
    assert_eq!(good.validate(), Ok(()));
    assert_eq!(mixed.validate(), Err(GaussiansError::Value { attribute: "position", index: 1 }));
}

#[test]
fn nothing_and_behind_the_camera_leave_the_background() {
    let camera = camera(19, 7);
    let settings = RenderSettings { background: [0.1, 0.2, 0.3], ..RenderSettings::default() };
    let mut set = Gaussians::colorless(Vec::new(), Vec::new(), Vec::new());
    for _ in 0..2 {
        let rendered = render(&set, &camera, &settings);
        assert!(rendered.color.iter().all(|&c| c == [0.1, 0.2, 0.3]));
        assert!(rendered.alpha.iter().chain(&rendered.depth).all(|&v| v == 0.0));
        set = Gaussians { sh: vec![[0.5; 3]], ..Gaussians::colorless(vec![[0.0, 0.0, -3.0]], vec![0.9], vec![0.5]) };
    }
}

/// A Gaussian as wide as the world covers the picture with its opacity.
#[test]
fn a_huge_gaussian_covers_everything() {
    let set = Gaussians::colorless(vec![[0.0, 0.0, 2.0]], vec![0.6], vec![500.0]);
    let rendered = render(&set, &camera(40, 33), &RenderSettings::masks());
    assert!(rendered.alpha.iter().all(|a| (a - 0.6).abs() < 1e-4), "{:?}", &rendered.alpha[..3]);
}

#[test]
#[should_panic(expected = "`opacities` has 0 entries where 1 belong")]
fn arrays_that_do_not_belong_together_are_a_clear_panic() {
    let set = Gaussians::colorless(vec![[0.0; 3]], Vec::new(), vec![0.1]);
    render(&set, &camera(4, 4), &RenderSettings::masks());
}
