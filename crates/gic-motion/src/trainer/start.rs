//! The state before the first step.

use gic_optimize::Moments;
use gic_scene::Scene;
use gic_splat::{coefficient_of_color, logit};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::state::State;
use super::training::Training;
use crate::gaussians::density::ScreenGradients;
use crate::gaussians::first_points::{self, FirstPoints};
use crate::gaussians::parameters::{ParameterMoments, Parameters, rest_per_gaussian};
use crate::gaussians::smoothing::SmoothingGraph;
use crate::pictures::{self, Ball, Target};
use crate::tuning::{MIN_GAUSSIANS, NETWORK_UNIT_RADII, TOLERATED_MISS_SHARE};
use crate::{Domain, GaussianShape, InitialPoints, MotionError, MotionNetwork};

impl Training<'_> {
    /// The state before the first step.
    pub(super) fn start(&self, scene: &Scene) -> Result<State, MotionError> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let seen: Vec<&Target> = match self.synchronous {
            true => self.frames[0].iter().map(|&i| &self.targets[i]).collect(),
            false => self.targets.iter().collect(),
        };
        let Some(ball) = pictures::ball(&seen) else {
            let reason =
                "the masks' rays do not meet: at least two views of the object are needed, in front of their cameras";
            return Err(MotionError::NothingToTrain(reason.into()));
        };
        let points = self.first_points(scene, &seen, &ball, &mut rng)?;
        let times = self.frames.iter().map(|f| self.targets[f[0]].time);
        let (start, end) = times.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| (a.min(t), b.max(t)));
        let start = start + self.flight.as_ref().and_then(|flight| flight.times.last()).copied().unwrap_or_default();
        let domain = Domain {
            centre: ball.centre.to_array(),
            extent: NETWORK_UNIT_RADII * ball.radius,
            start,
            duration: if end > start { end - start } else { 1.0 },
        };
        let (spacing, parameters) = (points.spacing, self.first_parameters(points));
        let network = MotionNetwork::random(self.settings.network, &mut rng);
        Ok(State {
            step: 0,
            domain,
            spacing,
            moments: ParameterMoments::zeros(&parameters),
            screen: ScreenGradients::zeros(parameters.len()),
            smoothing_graph: SmoothingGraph::default(),
            base: None,
            parameters,
            network_moments: Moments::zeros(network.parameters.len()),
            network,
            network_steps: 0,
            mean_loss: f64::NAN,
            lowest_loss: None,
            mean: None,
            best: None,
            stale: 0,
        })
    }

    /// How many Gaussians to start with.
    fn first_count(&self, seen: &[&Target]) -> usize {
        // A ball that looks like `area` pixels has four times that surface.
        let area = seen.iter().map(|t| t.area).sum::<f64>() / seen.len() as f64;
        let count = 4.0 * area / self.settings.initial_spacing_px.powi(2);
        (count as usize).clamp(MIN_GAUSSIANS, self.max_gaussians)
    }

    /// Round Gaussians, all alike, at coloured points.
    fn first_parameters(&self, points: FirstPoints) -> Parameters {
        let n = points.positions.len();
        let (axes, turned) = match self.settings.shape {
            GaussianShape::Isotropic => (1, 0),
            GaussianShape::Anisotropic => (3, 1),
        };
        Parameters {
            log_scales: vec![(self.settings.first_scale * points.spacing).ln() as f32; axes * n],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; turned * n],
            opacity_logits: vec![logit(self.settings.first_opacity) as f32; n],
            sh_dc: points.colors.iter().map(|c| c.map(coefficient_of_color)).collect(),
            sh_rest: vec![[0.0; 3]; n * rest_per_gaussian(self.sh_degree)],
            positions: points.positions,
            sh_degree: self.sh_degree,
        }
    }

    fn first_points(
        &self,
        scene: &Scene,
        seen: &[&Target],
        ball: &Ball,
        rng: &mut impl Rng,
    ) -> Result<FirstPoints, MotionError> {
        let count = self.first_count(seen);
        match self.settings.initial {
            InitialPoints::Random => return Ok(first_points::random(ball, count, rng)),
            InitialPoints::Auto if !scene.points.is_empty() => {
                let points = first_points::sparse(scene, seen);
                if points.positions.len() >= MIN_GAUSSIANS {
                    return Ok(points);
                }
            }
            _ => {}
        }
        let inset = self.settings.initial_inset;
        let misses = if self.synchronous || self.is_static { 0.0 } else { TOLERATED_MISS_SHARE };
        first_points::hull_surface(seen, misses, (count, inset), rng).ok_or_else(|| {
            let reason = "the masks have no common visual hull: a camera's pose or axes are wrong (see `gic inspect`)";
            MotionError::NothingToTrain(reason.into())
        })
    }
}
