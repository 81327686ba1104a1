//! Every setting of a reconstruction, with its default.

use gic_scene::{Scene, Split};
use serde::{Deserialize, Serialize};

use crate::Architecture;

/// A moment has a visual hull of its own from this many views on. Derived: two rays meet in a point.
pub(crate) const MIN_SYNCHRONOUS: usize = 2;

/// How to train; lengths are relative to the object, so that one set of defaults serves every scene that several
/// cameras filmed. Fields with `arg(skip)` have no flag and are changed in a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::Args), group(skip), command(next_help_heading = "Reconstruction"))]
#[serde(default, deny_unknown_fields)]
pub struct TrainSettings {
    /// Cameras, by number from 0, that are kept for measuring and never trained on.
    #[cfg_attr(feature = "cli", arg(long, value_name = "CAMERA", value_delimiter = ','))]
    pub held_out: Vec<usize>,
    /// Steps in all, warm-up included; the default depends on how the scene was filmed.
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "N", default_value_t = TrainSettings::default().steps, hide_default_value = true)
    )]
    pub steps: usize,
    /// Steps on the first frame alone, before the network starts (all steps are such for a static scene).
    #[cfg_attr(feature = "cli", arg(skip))]
    pub warm_up_steps: usize,
    /// Steps over which the training window grows from the first frame to the whole video after the warm-up.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub growth_steps: usize,
    /// Steps that first fit each frame's affine map of the base motion to the pictures, each frame from the last; 0
    /// leaves all motion to the network.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub affine_steps: usize,
    /// Steps that then bend each frame that its map does not explain.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub bend_steps: usize,
    /// Steps on the frames that those maps explain (an object in free flight), before the network starts: more views of
    /// the same shape.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub mapped_steps: usize,
    /// Steps on all frames with the base motion alone, which cost less than those with the network.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub bent_steps: usize,
    /// Share of the steps in which pictures are shown at half their size: a quarter of the pixels while nothing fine is
    /// settled.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub half_size: f64,
    /// Views rendered per step, all of the same time; the network is evaluated once for all of them.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub views_per_step: usize,
    /// How the first points are chosen.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub initial: InitialPoints,
    /// Distance between the first points, as seen in the pictures [pixels].
    #[cfg_attr(feature = "cli", arg(skip))]
    pub initial_spacing_px: f64,
    /// How far inside the hull's surface the first points lie, in their spacings. Gaussians reach beyond their centres,
    /// and where no silhouette shows it, nothing but the start makes room for that.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub initial_inset: f64,
    /// Whether Gaussians are round or ellipsoids. What follows a motion stays round (paper section 4.1).
    #[cfg_attr(feature = "cli", arg(skip))]
    pub shape: GaussianShape,
    /// Standard deviation of the first Gaussians in units of their spacing.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub first_scale: f64,
    /// Opacity of the first Gaussians.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub first_opacity: f64,
    /// Over how many spacings neighbours share the pull on their positions: in the first step, and from the network's
    /// first step on.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub smoothing: (f64, f64),
    /// At most this many Gaussians per pixel of the object's mean mask area.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub gaussians_per_pixel: f64,
    /// Never more Gaussians than this, whatever the pictures ask for.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N"))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_gaussians: Option<usize>,
    /// Degree of the spherical harmonics, 0 to 3; `None` takes what the number of viewpoints can tell: 3 from 50
    /// cameras on, 1 from 20, else 0.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub sh_degree: Option<usize>,
    /// Steps between raising the degree of the spherical harmonics by one.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub sh_interval: usize,
    /// Sizes of the motion network.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub network: Architecture,
    /// Weights of the losses.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub loss: LossWeights,
    /// Learning rates.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub rates: LearningRates,
    /// Adaptive density control.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub density: DensitySettings,
    /// Share of all steps, the last ones, whose mean is the result; 0 takes the last step's. Meanwhile no Gaussian may
    /// be made or go.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub averaged: f64,
    /// Steps between evaluations on the held-out views.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub evaluate_every: usize,
    /// Evaluations without a better score (or checks without a lower mean training loss) before training stops; 0 never
    /// stops early.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub patience: usize,
    /// Seconds between checkpoints.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub checkpoint_seconds: f64,
}

/// How the first points are chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum InitialPoints {
    /// The scene's sparse points if it has any, else the surface of the visual hull.
    #[default]
    Auto,
    /// On the surface of the masks' visual hull.
    Hull,
    /// Uniformly in the object's box, the paper's way.
    Random,
}

/// The covariances that are trained.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GaussianShape {
    /// One standard deviation per Gaussian.
    #[default]
    Isotropic,
    /// Three standard deviations and a rotation.
    Anisotropic,
}

/// Weights of the loss terms (paper eq. 5, with the release's mask term).
///
/// Picture terms are sums over pixels divided by the object's area in the mask [pixels], so their size does not depend
/// on how much of the picture the object fills.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LossWeights {
    /// Weight of the absolute colour difference.
    pub color: f64,
    /// Weight of 1 - SSIM.
    pub ssim: f64,
    /// Weight of the absolute difference of alpha and mask.
    pub mask: f64,
    /// Weight of the mean scale s(t), measured in initial point spacings.
    pub scale: f64,
    /// Weight of the mean squared distance of neighbours, in spacings: shrinks what no picture holds, such as the
    /// ridges of a visual hull. Only where positions are smoothed.
    pub tension: f64,
}

impl Default for LossWeights {
    fn default() -> Self {
        LossWeights { color: 0.8, ssim: 0.6, mask: 1.0, scale: 0.03, tension: 0.1 }
    }
}

/// Adam's learning rates. Each decays exponentially from `.0` in the first step to `.1` in the last.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LearningRates {
    /// Positions, as a fraction of the object's size.
    pub position: (f64, f64),
    /// Spherical harmonics of degree 0; the higher degrees learn at a twentieth of it.
    pub feature: (f64, f64),
    /// Opacity logit.
    pub opacity: (f64, f64),
    /// Logarithm of the scale.
    pub scale: (f64, f64),
    /// Quaternions of anisotropic Gaussians.
    pub rotation: (f64, f64),
    /// The base motion's poses: matrices, and shifts and bends as a fraction of the object's size.
    pub base: (f64, f64),
    /// The base motion's shades, which multiply the colours.
    pub shade: (f64, f64),
    /// The network's weights; rises from zero in the network's first steps.
    pub network: (f64, f64),
}

impl Default for LearningRates {
    fn default() -> Self {
        LearningRates {
            position: (2.0e-3, 5.0e-5),
            feature: (2.0e-2, 2.5e-3),
            opacity: (5.0e-2, 1.0e-2),
            scale: (1.0e-2, 1.0e-3),
            rotation: (2.0e-3, 2.0e-4),
            base: (5.0e-4, 2.0e-5),
            shade: (8.0e-3, 5.0e-4),
            network: (8.0e-4, 5.0e-5),
        }
    }
}

/// Adaptive density control: where more Gaussians are made, and which go.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DensitySettings {
    /// First step at which Gaussians are added or removed.
    pub from: usize,
    /// Share of all steps after which no more are.
    pub until: f64,
    /// Steps between.
    pub every: usize,
    /// Mean gradient of the projected centre above which a Gaussian is cloned or split, in the units of 3DGS (loss
    /// averaged over the picture, centre in half picture widths).
    pub gradient_threshold: f64,
    /// Gaussians wider than this fraction of the object are split, smaller ones cloned.
    pub split_above: f64,
    /// Gaussians less opaque than this are removed.
    pub min_opacity: f64,
    /// Steps between resets of the opacity; 0 never resets.
    pub opacity_reset_every: usize,
}

impl Default for DensitySettings {
    fn default() -> Self {
        DensitySettings {
            from: 400,
            until: 0.7,
            every: 100,
            gradient_threshold: 2.0e-4,
            split_above: 0.02,
            min_opacity: 0.02,
            opacity_reset_every: 0,
        }
    }
}

impl Default for TrainSettings {
    fn default() -> Self {
        TrainSettings {
            held_out: Vec::new(),
            steps: 850,
            warm_up_steps: 150,
            growth_steps: 0,
            affine_steps: 60,
            bend_steps: 200,
            mapped_steps: 200,
            bent_steps: 400,
            half_size: 0.0,
            views_per_step: 6,
            initial: InitialPoints::default(),
            initial_spacing_px: 3.0,
            initial_inset: 0.5,
            shape: GaussianShape::default(),
            first_scale: 0.5,
            first_opacity: 0.9,
            smoothing: (4.0, 1.0),
            gaussians_per_pixel: 0.5,
            max_gaussians: None,
            sh_degree: None,
            sh_interval: 1000,
            network: Architecture::default(),
            loss: LossWeights::default(),
            rates: LearningRates::default(),
            density: DensitySettings::default(),
            averaged: 0.0,
            evaluate_every: 250,
            patience: 0,
            checkpoint_seconds: 30.0,
        }
    }
}

/// How a scene was filmed, which decides the defaults.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Capture {
    /// Several cameras at each moment.
    Synchronous,
    /// What moves was seen by one camera at a time.
    OneCamera,
    /// Nothing moves.
    Still,
}

impl Capture {
    /// How the pictures to train on were taken.
    pub fn of(scene: &Scene) -> Capture {
        let views = || scene.views.iter().filter(|view| view.split == Split::Train);
        let Some(first) = views().map(|view| view.frame).min() else { return Capture::Still };
        let at_first = views().filter(|view| view.frame == first).count();
        if views().all(|view| view.frame == first) {
            Capture::Still
        } else if at_first < MIN_SYNCHRONOUS {
            Capture::OneCamera
        } else {
            Capture::Synchronous
        }
    }
}

impl TrainSettings {
    /// The defaults for a scene: [`TrainSettings::default`], [`TrainSettings::one_camera`] or [`TrainSettings::still`].
    pub fn for_scene(scene: &Scene) -> Self {
        match Capture::of(scene) {
            Capture::Synchronous => TrainSettings::default(),
            Capture::OneCamera => TrainSettings::one_camera(),
            Capture::Still => TrainSettings::still(),
        }
    }

    /// For what stands still, as 3DGS has it: ellipsoids, one picture per step, as many Gaussians as the pictures ask
    /// for.
    pub fn still() -> Self {
        TrainSettings {
            steps: 7_000,
            views_per_step: 1,
            half_size: 0.2,
            initial_inset: 0.0,
            shape: GaussianShape::Anisotropic,
            smoothing: (0.0, 0.0),
            gaussians_per_pixel: 1.2,
            sh_interval: 500,
            loss: LossWeights { ssim: 0.2, scale: 0.0, tension: 0.0, ..LossWeights::default() },
            rates: LearningRates {
                position: (5.0e-4, 5.0e-6),
                feature: (1.0e-2, 1.5e-3),
                scale: (1.0e-2, 2.0e-3),
                rotation: (2.0e-3, 5.0e-4),
                ..LearningRates::default()
            },
            density: DensitySettings { from: 300, until: 0.6, ..DensitySettings::default() },
            averaged: 0.1,
            ..TrainSettings::default()
        }
    }

    /// For photographs of an object at rest that a video shows elsewhere: round Gaussians, as those of a video's first
    /// frame, for the sake of the filling, and colours that may be turned with the object.
    pub fn scan() -> Self {
        TrainSettings { steps: 800, half_size: 0.25, sh_degree: Some(0), ..TrainSettings::default() }
    }

    /// For what moves before one camera: no moment has a shape of its own to start from, so there is no base motion.
    /// The network starts from Gaussians trained on all pictures, as if nothing moved, is half as wide as the paper's,
    /// and is asked at nodes a 48th of the object apart: as good step by step, and otherwise most of the time would be
    /// spent in it.
    pub fn one_camera() -> Self {
        let still = TrainSettings::still();
        TrainSettings {
            steps: 18_000,
            warm_up_steps: 600,
            affine_steps: 0,
            bend_steps: 0,
            mapped_steps: 0,
            bent_steps: 0,
            half_size: 0.75,
            initial_spacing_px: 6.0,
            network: Architecture { width: 128, node_spacing: 1.0 / 48.0, ..Architecture::default() },
            // As 3DGS has it, what is no place hardly slows down: slower ends were worse by up to half a decibel.
            rates: LearningRates {
                feature: (1.0e-2, 6.0e-3),
                scale: (1.0e-2, 1.0e-2),
                rotation: (2.0e-3, 2.0e-3),
                opacity: (5.0e-2, 2.5e-2),
                network: (3.2e-3, 5.0e-5),
                ..still.rates
            },
            density: DensitySettings { from: 900, every: 200, ..still.density },
            ..still
        }
    }

    /// The schedule that the paper prints: 40,000 steps of one picture, 3,000 of warm-up, points drawn in the object's
    /// box.
    pub fn paper() -> Self {
        TrainSettings {
            steps: 40_000,
            warm_up_steps: 3_000,
            growth_steps: 0,
            affine_steps: 0,
            bend_steps: 0,
            mapped_steps: 0,
            bent_steps: 0,
            views_per_step: 1,
            initial: InitialPoints::Random,
            smoothing: (0.0, 0.0),
            gaussians_per_pixel: 10.0,
            sh_degree: Some(3),
            rates: LearningRates {
                position: (1.6e-4, 1.6e-6),
                feature: (2.5e-3, 2.5e-3),
                opacity: (0.05, 0.05),
                scale: (1.0e-3, 1.0e-3),
                network: (8.0e-4, 1.6e-6),
                ..LearningRates::default()
            },
            density: DensitySettings {
                from: 500,
                until: 0.375,
                every: 500,
                gradient_threshold: 1.5e-4,
                split_above: 0.01,
                min_opacity: 0.005,
                opacity_reset_every: 3_000,
            },
            loss: LossWeights { color: 1.0, ssim: 1.0, mask: 1.0, scale: 0.01, tension: 0.0 },
            evaluate_every: 2_000,
            ..TrainSettings::default()
        }
    }
}
