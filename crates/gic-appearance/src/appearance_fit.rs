//! Colours for matter whose motion is known: what the identified twin looks like (paper section 5.2, "appearance").
//!
//! A Gaussian with albedo a and outward normal n has the colour `c = a E(n)`, with E the irradiance of one light for
//! all ([`Light`]). The positions of all times are given; albedo, opacity and a bounded scale of each Gaussian and the
//! light are trained on the pictures. The light lets colours follow an object that turns: an albedo alone keeps the
//! shading of where it was seen.

use std::ops::ControlFlow;

use gic_motion::pictures::{self, Bounds, Target, picture_loss, psnr, windowed};
use gic_optimize::{Moments, decayed};
use gic_scene::Scene;
use gic_splat::{
    GaussianGradients, Gaussians, ImageGradients, RenderSettings, Shape, backward, coefficient_of_color,
    color_of_coefficient, logit, render, sh, sigmoid,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::hidden::share_albedo;
use crate::light::{IRRADIANCE_TERMS, Light, terms};
use crate::tuning::{MAX_OPACITY, WINDOW_MARGIN_PX};
use crate::{AppearanceError, AppearanceFitSettings};

/// Gaussians that know their albedo instead of their colour, and the light that they are in.
#[derive(Clone, Debug, PartialEq)]
pub struct LitGaussians {
    /// At the first frame; the degree-0 harmonics hold the albedo.
    pub gaussians: Gaussians,
    /// The light.
    pub light: Light,
}

impl LitGaussians {
    /// The Gaussians to draw when they are at `positions` [m] with outward `normals`
    /// (`gic_geometry::outward_normals`), both shape [n, 3].
    pub fn at(&self, positions: Vec<[f32; 3]>, normals: &[[f32; 3]]) -> Gaussians {
        let lit = |(sh, &normal): (&[f32; 3], &[f32; 3])| {
            let light = self.light.at(normal);
            core::array::from_fn(|c| coefficient_of_color(color_of_coefficient(sh[c]) * light[c]))
        };
        Gaussians {
            positions,
            opacities: self.gaussians.opacities.clone(),
            shape: self.gaussians.shape.clone(),
            sh_degree: self.gaussians.sh_degree,
            sh: self.gaussians.sh.iter().zip(normals).map(lit).collect(),
        }
    }
}

/// Where the Gaussians are in one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct PosedPoints {
    /// Number of the frame in the scene.
    pub frame: usize,
    /// Positions [m], shape [n, 3].
    pub positions: Vec<[f32; 3]>,
    /// Outward normals, shape [n, 3].
    pub normals: Vec<[f32; 3]>,
}

/// One step of training, told to the callback.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AppearanceProgress {
    /// Steps done.
    pub step: usize,
    /// Loss of this step.
    pub loss: f64,
    /// PSNR [dB] in the windows drawn.
    pub psnr: f64,
}

/// Trains the appearance of Gaussians on the scene's pictures of the frames in `posed`, those of the cameras `held_out`
/// excepted.
///
/// `bare` gives the scales (isotropic) and opacities to start from; its colours are not looked at. The same input gives
/// the same bits, whatever the number of threads. `callback` may end training early; what was reached is returned.
///
/// # Errors
/// Unreadable pictures, no picture of these frames, a loss that is not finite.
pub fn fit_appearance(
    scene: &Scene,
    held_out: &[usize],
    bare: &Gaussians,
    posed: &[PosedPoints],
    (settings, seed): (&AppearanceFitSettings, u64),
    callback: &mut dyn FnMut(&AppearanceProgress) -> ControlFlow<()>,
) -> Result<LitGaussians, AppearanceError> {
    let targets = pictures::training(scene, held_out)?;
    // Each frame with its pictures.
    let frames: Vec<(&PosedPoints, Vec<&Target>)> = posed
        .iter()
        .map(|p| (p, targets.iter().filter(|t| t.frame == p.frame && !t.bounds.is_empty()).collect::<Vec<_>>()))
        .filter(|(_, seen)| !seen.is_empty())
        .collect();
    if frames.is_empty() {
        return Err(AppearanceError::NothingToTrain("no picture shows the object in these frames".into()));
    }
    let mut fit = AppearanceFit::new(bare, settings);
    for step in 0..settings.steps {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(step as u64);
        let (posed, seen) = &frames[rng.random_range(0..frames.len())];
        let mut views = seen.clone();
        while views.len() > settings.views_per_step.max(1) {
            views.swap_remove(rng.random_range(0..views.len()));
        }
        let progress = fit.step(posed, &views, step)?;
        if callback(&progress).is_break() {
            break;
        }
    }
    let mut pixels = vec![0.0; bare.len()];
    for (posed, seen) in &frames {
        fit.add_covered(&mut pixels, posed, seen);
    }
    share_albedo(&mut fit.albedo, &pixels, &posed[0].positions);
    Ok(fit.lit(&posed[0].positions))
}

/// What is being trained.
struct AppearanceFit<'a> {
    settings: &'a AppearanceFitSettings,
    first_log_scales: Vec<f32>,
    albedo: Vec<[f32; 3]>,
    opacity_logits: Vec<f32>,
    log_scales: Vec<f32>,
    light: Light,
    moments: [Moments; 4],
}

/// Gradient with respect to the trained numbers.
struct AppearanceGradient {
    albedo: Vec<[f32; 3]>,
    opacity_logits: Vec<f32>,
    log_scales: Vec<f32>,
    light: [[f32; 3]; IRRADIANCE_TERMS],
}

impl<'a> AppearanceFit<'a> {
    fn new(bare: &Gaussians, settings: &'a AppearanceFitSettings) -> Self {
        let n = bare.len();
        let log_scales: Vec<f32> = match &bare.shape {
            Shape::Isotropic { scales } => scales.iter().map(|s| s.ln()).collect(),
            Shape::Anisotropic { scales, .. } => {
                scales.iter().map(|s| s.iter().map(|s| s.ln()).sum::<f32>() / 3.0).collect()
            }
        };
        let opacity = |&o: &f32| logit(f64::from(o).clamp(1.0 - MAX_OPACITY, MAX_OPACITY)) as f32;
        AppearanceFit {
            settings,
            first_log_scales: log_scales.clone(),
            albedo: vec![[0.5; 3]; n],
            opacity_logits: bare.opacities.iter().map(opacity).collect(),
            log_scales,
            light: Light::default(),
            moments: [3 * n, n, n, 3 * IRRADIANCE_TERMS].map(Moments::zeros),
        }
    }

    fn lit(&self, positions: &[[f32; 3]]) -> LitGaussians {
        let gaussians = Gaussians {
            positions: positions.to_vec(),
            opacities: self.opacity_logits.iter().map(|&x| sigmoid(x)).collect(),
            shape: Shape::Isotropic { scales: self.log_scales.iter().map(|s| s.exp()).collect() },
            sh_degree: 0,
            sh: self.albedo.iter().map(|a| a.map(coefficient_of_color)).collect(),
        };
        LitGaussians { gaussians, light: self.light }
    }

    fn step(
        &mut self,
        posed: &PosedPoints,
        views: &[&Target],
        step: usize,
    ) -> Result<AppearanceProgress, AppearanceError> {
        let drawn = self.lit(&posed.positions).at(posed.positions.clone(), &posed.normals);
        let slopes: Vec<(f64, (f64, usize), GaussianGradients)> =
            views.par_iter().map(|view| self.compare(view, &drawn)).collect::<Result<_, _>>()?;
        let loss = slopes.iter().map(|(loss, ..)| loss).sum::<f64>() / slopes.len() as f64;
        if !loss.is_finite() {
            return Err(AppearanceError::Diverged { step });
        }
        let squared = slopes.iter().fold((0.0, 0), |sum, (_, s, _)| (sum.0 + s.0, sum.1 + s.1));
        let slope = self.pull_back(&drawn, &posed.normals, slopes.iter().map(|(.., slope)| slope));
        self.descend(&slope, step);
        Ok(AppearanceProgress { step: step + 1, loss, psnr: psnr(squared) })
    }

    /// Loss, sum of squared differences and gradient of one view.
    fn compare(
        &self,
        target: &Target,
        drawn: &Gaussians,
    ) -> Result<(f64, (f64, usize), GaussianGradients), AppearanceError> {
        let b = target.bounds;
        let window = Bounds {
            x0: b.x0.saturating_sub(WINDOW_MARGIN_PX),
            y0: b.y0.saturating_sub(WINDOW_MARGIN_PX),
            x1: (b.x1 + WINDOW_MARGIN_PX).min(target.camera.width),
            y1: (b.y1 + WINDOW_MARGIN_PX).min(target.camera.height),
        };
        let camera = windowed(&target.camera, window);
        let settings = RenderSettings::pictures();
        let rendered = render(drawn, &camera, &settings);
        let (color, mask) = target.crop(window);
        let size = (camera.width, camera.height);
        let loss = picture_loss(&rendered, (&color, &mask), size, target.area, &self.settings.loss)?;
        Ok((loss.value, loss.squared, backward(drawn, &camera, &settings, &rendered, &loss.gradient)))
    }

    /// Adds the pixels that each Gaussian covers in a frame's pictures: the derivative of all that is drawn with
    /// respect to its colour.
    fn add_covered(&self, pixels: &mut [f64], posed: &PosedPoints, views: &[&Target]) {
        let mut drawn = self.lit(&posed.positions).gaussians;
        // Grey, so that no colour is cut off at black.
        drawn.sh.iter_mut().for_each(|sh| *sh = [0.0; 3]);
        let covered = |view: &&Target| {
            let (camera, settings) = (windowed(&view.camera, view.bounds), RenderSettings::pictures());
            let rendered = render(&drawn, &camera, &settings);
            let ones =
                ImageGradients { color: vec![[1.0; 3]; camera.width * camera.height], ..ImageGradients::default() };
            backward(&drawn, &camera, &settings, &rendered, &ones).sh
        };
        // One after the other, in their order: the sum is the same whatever the number of threads.
        for slopes in views.par_iter().map(covered).collect::<Vec<_>>() {
            for (sum, slope) in pixels.iter_mut().zip(slopes) {
                *sum += f64::from(slope[0]) / sh::C0;
            }
        }
    }

    /// From the gradients of drawn Gaussians, summed over views, to that of the trained numbers.
    fn pull_back<'b>(
        &self,
        drawn: &Gaussians,
        normals: &[[f32; 3]],
        views: impl Iterator<Item = &'b GaussianGradients>,
    ) -> AppearanceGradient {
        let n = drawn.len();
        let (Shape::Isotropic { scales }, lights) = (&drawn.shape, normals.iter().map(|&v| self.light.at(v))) else {
            unreachable!("these Gaussians are isotropic")
        };
        let mut slope = AppearanceGradient {
            albedo: vec![[0.0; 3]; n],
            opacity_logits: vec![0.0; n],
            log_scales: vec![0.0; n],
            light: [[0.0; 3]; IRRADIANCE_TERMS],
        };
        for view in views {
            let Shape::Isotropic { scales: d_scales } = &view.shape else {
                unreachable!("gradients have the shape of what was drawn")
            };
            for i in 0..n {
                let opacity = drawn.opacities[i];
                slope.opacity_logits[i] += view.opacities[i] * opacity * (1.0 - opacity);
                slope.log_scales[i] += d_scales[i] * scales[i];
                for c in 0..3 {
                    // So far by the lit colour.
                    slope.albedo[i][c] += view.sh[i][c] / sh::C0 as f32;
                }
            }
        }
        for (i, light) in lights.enumerate() {
            for (k, term) in terms(normals[i]).into_iter().enumerate() {
                for c in 0..3 {
                    slope.light[k][c] += slope.albedo[i][c] * self.albedo[i][c] * term;
                }
            }
            for c in 0..3 {
                slope.albedo[i][c] *= light[c];
            }
        }
        slope
    }

    fn descend(&mut self, slope: &AppearanceGradient, step: usize) {
        let s = self.settings;
        let rate = |ends| decayed(ends, step as f64 / s.steps as f64);
        let [albedo, opacity, scale, light] = &mut self.moments;
        albedo.update(self.albedo.as_flattened_mut(), slope.albedo.as_flattened(), rate(s.albedo), step + 1);
        opacity.update(&mut self.opacity_logits, &slope.opacity_logits, rate(s.opacity), step + 1);
        scale.update(&mut self.log_scales, &slope.log_scales, rate(s.scale), step + 1);
        light.update(self.light.coefficients.as_flattened_mut(), slope.light.as_flattened(), rate(s.light), step + 1);
        let (most, bound) = (logit(MAX_OPACITY) as f32, s.scale_bound.max(1.0).ln() as f32);
        self.opacity_logits.iter_mut().for_each(|x| *x = x.clamp(-most, most));
        self.albedo.as_flattened_mut().iter_mut().for_each(|a| *a = a.max(0.0));
        for (scale, first) in self.log_scales.iter_mut().zip(&self.first_log_scales) {
            *scale = scale.clamp(first - bound, first + bound);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(i: usize, k: f32) -> f32 {
        0.5 + 0.4 * (i as f32 * k).sin()
    }

    #[test]
    fn pulling_back_agrees_with_finite_differences() {
        let n = 5;
        let settings = AppearanceFitSettings::default();
        let bare = Gaussians::colorless(vec![[0.0; 3]; n], vec![0.7; n], vec![0.01; n]);
        let mut fit = AppearanceFit::new(&bare, &settings);
        let normals: Vec<[f32; 3]> = (0..n).map(|i| [0.3, 0.7, 0.1].map(|k| wave(i, k) - 0.5)).collect();
        for i in 0..n {
            fit.albedo[i] = [0.2, 0.5, 0.9].map(|k| wave(i, k));
        }
        for (k, l) in fit.light.coefficients.as_flattened_mut().iter_mut().enumerate() {
            *l += 0.3 * wave(k, 0.7);
        }
        // A loss that is linear in what is drawn.
        let positions = vec![[0.0; 3]; n];
        let drawn = |w: &AppearanceFit| w.lit(&positions).at(positions.clone(), &normals);
        let mut view = GaussianGradients::zeros(&drawn(&fit));
        view.opacities = (0..n).map(|i| wave(i, 0.31)).collect();
        view.sh = (0..n).map(|i| [0.11, 0.57, 0.23].map(|k| wave(i, k))).collect();
        view.shape = Shape::Isotropic { scales: (0..n).map(|i| 50.0 * wave(i, 0.83)).collect() };
        let loss = |w: &AppearanceFit| -> f64 {
            let g = drawn(w);
            let (Shape::Isotropic { scales: a }, Shape::Isotropic { scales: b }) = (&g.shape, &view.shape) else {
                unreachable!()
            };
            let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(a * b)).sum::<f64>();
            dot(&g.opacities, &view.opacities) + dot(a, b) + dot(g.sh.as_flattened(), view.sh.as_flattened())
        };
        let slope = fit.pull_back(&drawn(&fit), &normals, std::iter::once(&view));
        let h = 1e-2f32;
        let mut check = |got: f32, what: &str, number: &dyn for<'w> Fn(&'w mut AppearanceFit<'_>) -> &'w mut f32| {
            *number(&mut fit) += h;
            let above = loss(&fit);
            *number(&mut fit) -= 2.0 * h;
            let below = loss(&fit);
            *number(&mut fit) += h;
            let expected = (above - below) / (2.0 * f64::from(h));
            assert!(
                (f64::from(got) - expected).abs() < 2e-3 * (1.0 + expected.abs()),
                "{what}: {got} against {expected}"
            );
        };
        for i in 0..n {
            check(slope.opacity_logits[i], "opacity", &|w| &mut w.opacity_logits[i]);
            check(slope.log_scales[i], "scale", &|w| &mut w.log_scales[i]);
            for c in 0..3 {
                check(slope.albedo[i][c], "albedo", &|w| &mut w.albedo[i][c]);
            }
        }
        for k in 0..IRRADIANCE_TERMS {
            for c in 0..3 {
                check(slope.light[k][c], "light", &|w| &mut w.light.coefficients[k][c]);
            }
        }
    }

    #[test]
    fn scales_stay_within_their_bound_and_albedos_positive() {
        let settings = AppearanceFitSettings { scale_bound: 1.2, ..AppearanceFitSettings::default() };
        let bare = Gaussians::colorless(vec![[0.0; 3]; 2], vec![0.9; 2], vec![0.01; 2]);
        let mut fit = AppearanceFit::new(&bare, &settings);
        let slope = AppearanceGradient {
            albedo: vec![[1.0; 3]; 2],
            opacity_logits: vec![-1.0; 2],
            log_scales: vec![1.0, -1.0],
            light: [[0.0; 3]; IRRADIANCE_TERMS],
        };
        for step in 0..300 {
            fit.descend(&slope, step);
        }
        let Shape::Isotropic { scales } = fit.lit(&[[0.0; 3]; 2]).gaussians.shape else { unreachable!() };
        assert!((scales[0] - 0.01 / 1.2).abs() < 1e-6 && (scales[1] - 0.012).abs() < 1e-6, "{scales:?}");
        assert!(fit.albedo.as_flattened().iter().all(|&a| a == 0.0));
    }
}
