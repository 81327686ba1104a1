//! Residuals of a hypothesis against the observations, and their normal equations.

use rayon::prelude::*;

use crate::forward::drawing::Shown;
use crate::forward::trajectories::{FrameSelection, Neighbour, Trajectories};
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

    /// Normal equations from a base motion and a neighbour of it per unknown.
    pub(crate) fn blocks(
        &self,
        base: &Trajectories,
        neighbours: &[Neighbour],
        steps: &[f64],
        selection: &FrameSelection,
    ) -> Vec<ResidualBlock> {
        let range = selection.first..selection.end.min(self.video.frames.len());
        let views: Vec<(usize, &MaskView)> =
            range.clone().flat_map(|o| self.video.frames[o].views.iter().map(move |view| (o, view))).collect();
        let mut blocks: Vec<ResidualBlock> = views
            .into_par_iter()
            .map(|(o, view)| self.mask_block(o, view, base, neighbours, steps, selection.pooling))
            .collect();
        let surfaces: Vec<Vec<ResidualBlock>> =
            range.into_par_iter().map(|o| self.surface_blocks(o, base, neighbours, steps)).collect();
        blocks.extend(surfaces.into_iter().flatten());
        blocks
    }

    fn mask_block(
        &self,
        o: usize,
        view: &MaskView,
        base: &Trajectories,
        neighbours: &[Neighbour],
        steps: &[f64],
        pooling: usize,
    ) -> ResidualBlock {
        let shown = base.shown(o, self.opacities);
        let compared = ComparedView::new(view, &shown, pooling);
        let nearby = compared.nearby();
        let draw = |(neighbour, step): (&Neighbour, &f64)| match neighbour {
            Neighbour::Moved(moved) => Some(nearby(&Shown { gaussians: moved.gaussians(o, self.opacities), ..shown })),
            Neighbour::Drawn(unknown) => unknown
                .concerns(view.device)
                .then(|| nearby(&Shown { drawing: &base.drawing.nudged(*unknown, *step), ..shown })),
        };
        // None of what changes nothing here.
        let moved: Vec<Option<Vec<f32>>> = neighbours.iter().zip(steps).map(draw).collect();
        let mut block = ResidualBlock::new(Modality::Mask, o, Some(view.device), steps.len());
        let mut row = vec![0.0; steps.len()];
        // A pooled pixel stands for that many working pixels.
        let weight = (pooling * pooling) as f64;
        for (i, (a, m)) in compared.drawn.iter().zip(&compared.observed).enumerate() {
            let residual = f64::from(a - m);
            let mut touched = residual != 0.0;
            for ((slot, image), step) in row.iter_mut().zip(&moved).zip(steps) {
                *slot = image.as_ref().map_or(0.0, |image| f64::from(image[i] - a) / step);
                touched |= *slot != 0.0;
            }
            if touched {
                block.add(residual, &row, weight);
            }
        }
        block.finish()
    }

    fn surface_blocks<'a>(
        &self,
        o: usize,
        base: &'a Trajectories,
        neighbours: &'a [Neighbour],
        steps: &[f64],
    ) -> Vec<ResidualBlock> {
        let frame: &ObservedFrame = &self.video.frames[o];
        let Some(surface) = &frame.surface else { return Vec::new() };
        let moved = |neighbour: &'a Neighbour| match neighbour {
            Neighbour::Moved(moved) => moved,
            Neighbour::Drawn(_) => base,
        };
        let moved: Vec<&Trajectories> = neighbours.iter().map(moved).collect();
        vec![self.surface_comparison.block((o, frame.time_s), surface, base, &moved, steps)]
    }
}
