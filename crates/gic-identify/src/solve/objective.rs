//! Residuals of a hypothesis against the observations, and their normal equations.

use rayon::prelude::*;

use crate::forward::trajectories::{FrameSelection, Trajectories};
use crate::observe::mask_view::MaskView;
use crate::observe::video::{ObservedFrame, ObservedVideo};
use crate::solve::compared_view::ComparedView;
use crate::solve::normal_equations::Normal;
use crate::solve::residual_block::{Modality, ResidualBlock, Weights};
use crate::solve::surface_residuals::SurfaceComparison;

/// The observations as a function of a hypothesis.
#[derive(Clone, Copy)]
pub(crate) struct Objective<'a> {
    pub video: &'a ObservedVideo,
    pub opacities: &'a [f32],
    pub surface_comparison: &'a SurfaceComparison,
    pub weights: &'a Weights,
}

impl Objective<'_> {
    /// Half the weighted sum of squares.
    pub(crate) fn cost(&self, trajectories: &Trajectories, selection: &FrameSelection) -> f64 {
        let blocks = self.blocks(trajectories, &[], &[], selection);
        Normal::sum(&blocks, self.weights, 0).cost
    }

    /// Normal equations from a base motion and one perturbed motion per unknown.
    pub(crate) fn blocks(
        &self,
        base: &Trajectories,
        perturbed: &[Trajectories],
        steps: &[f64],
        selection: &FrameSelection,
    ) -> Vec<ResidualBlock> {
        let range = selection.first..selection.end.min(self.video.frames.len());
        let views: Vec<(usize, &MaskView)> =
            range.clone().flat_map(|o| self.video.frames[o].views.iter().map(move |view| (o, view))).collect();
        let mut blocks: Vec<ResidualBlock> = views
            .into_par_iter()
            .map(|(o, view)| self.mask_block(o, view, base, perturbed, steps, selection.pooling))
            .collect();
        let surfaces: Vec<Vec<ResidualBlock>> =
            range.into_par_iter().map(|o| self.surface_blocks(o, base, perturbed, steps)).collect();
        blocks.extend(surfaces.into_iter().flatten());
        blocks
    }

    fn mask_block(
        &self,
        o: usize,
        view: &MaskView,
        base: &Trajectories,
        perturbed: &[Trajectories],
        steps: &[f64],
        pooling: usize,
    ) -> ResidualBlock {
        let compared = ComparedView::new(view, base.gaussians(o, self.opacities), pooling);
        let draw = |trajectories: &Trajectories| compared.drawn(trajectories.gaussians(o, self.opacities));
        let reference = draw(base);
        let moved: Vec<Vec<f32>> = perturbed.iter().map(draw).collect();
        let mut block = ResidualBlock::new(Modality::Mask, o, Some(view.camera_index), steps.len());
        let mut row = vec![0.0; steps.len()];
        // A pooled pixel stands for that many working pixels.
        let weight = (pooling * pooling) as f64;
        for (i, (a, m)) in reference.iter().zip(&compared.observed).enumerate() {
            let residual = f64::from(a - m);
            let mut touched = residual != 0.0;
            for ((slot, image), step) in row.iter_mut().zip(&moved).zip(steps) {
                *slot = f64::from(image[i] - a) / step;
                touched |= *slot != 0.0;
            }
            if touched {
                block.add(residual, &row, weight);
            }
        }
        block.finish()
    }

    fn surface_blocks(
        &self,
        o: usize,
        base: &Trajectories,
        perturbed: &[Trajectories],
        steps: &[f64],
    ) -> Vec<ResidualBlock> {
        let frame: &ObservedFrame = &self.video.frames[o];
        let Some(surface) = &frame.surface else { return Vec::new() };
        vec![self.surface_comparison.block((o, frame.time_s), surface, base, perturbed, steps)]
    }
}
