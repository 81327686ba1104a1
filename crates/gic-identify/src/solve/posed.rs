//! A motion whose pose at each observation is the one that the observation's masks want.
//!
//! How a body drifts and turns after contact hangs on its shape as much as on its material, and the error grows: where
//! a third of the surface is unseen, the right material is a tenth of the body's size off after nine frames. How the
//! body deforms hangs far less on that. So the material is told by the deformation as long as the shape is known in
//! part only: a shift and a turn about the centre are free at each observation. They are eliminated by their own
//! least-squares fit (variable projection: Golub & Pereyra 1973), which goes on from the observation before.

use gic_geometry::Pose;
use gic_optimize::{FIRST_DAMPING, damped_step};
use glam::DVec3;
use nalgebra::{DMatrix, DVector, Matrix6, Vector6};
use rayon::prelude::*;

use crate::FitError;
use crate::forward::drawing::{Drawing, Shown};
use crate::forward::footprint::IsotropicGaussians;
use crate::forward::trajectories::{ForwardModel, FrameSelection, Trajectories};
use crate::observe::mask_view::MaskView;
use crate::observe::video::ObservedVideo;
use crate::solve::compared_view::ComparedView;
use crate::unknowns::state::State;

/// Steps of Gauss-Newton's method at each observation. Always as many, so that the pose is a smooth function of the
/// motion. Budget.
const STEPS: usize = 2;
/// Finite differences move the body by this share of a Gaussian's width. Convention.
const DIFFERENCE_WIDTHS: f64 = 0.2;

/// A model of motion with free poses.
pub(crate) struct Posed<'a> {
    pub model: &'a dyn ForwardModel,
    pub video: &'a ObservedVideo,
    /// Of the particles' Gaussians, shape [n].
    pub opacities: &'a [f32],
    /// The first observation whose pose is free; those before have the model's.
    pub first: usize,
}

impl ForwardModel for Posed<'_> {
    fn trajectories(&self, state: &State, selection: &FrameSelection) -> Result<Trajectories, FitError> {
        let mut trajectories = self.model.trajectories(state, selection)?;
        let mut pose = Pose::default();
        for o in selection.first.max(self.first)..selection.end.min(trajectories.positions.len()) {
            let body = Body::new(trajectories.gaussians(o, self.opacities));
            pose = body.pose(&self.video.frames[o].views, selection.pooling, pose);
            trajectories.positions[o] = body.placed(pose);
        }
        Ok(trajectories)
    }
}

/// The body at an observation, where the model has it.
struct Body<'a> {
    gaussians: IsotropicGaussians<'a>,
    centre: DVec3,
    /// Root mean square distance from the centre [m].
    size: f64,
    /// Step of the finite differences [m].
    difference: f64,
}

impl Body<'_> {
    fn new(gaussians: IsotropicGaussians) -> Body {
        let points = || gaussians.positions.iter().map(|p| DVec3::from(p.map(f64::from)));
        let centre = points().sum::<DVec3>() / points().len().max(1) as f64;
        let size = mean(points().map(|p| p.distance_squared(centre))).sqrt().max(f64::MIN_POSITIVE);
        let difference = DIFFERENCE_WIDTHS * mean(gaussians.scales.iter().map(|s| f64::from(*s)));
        Body { gaussians, centre, size, difference }
    }

    /// The pose that `views` want, sought from `pose`.
    fn pose(&self, views: &[MaskView], pooling: usize, mut pose: Pose) -> Pose {
        for _ in 0..STEPS {
            let here = self.placed(pose);
            let nudged: [Vec<[f32; 3]>; 6] = std::array::from_fn(|k| {
                let amounts = std::array::from_fn(|j| if j == k { self.difference } else { 0.0 });
                self.placed(pose.then(Pose::small(amounts, self.size)))
            });
            let pulls: Vec<(Matrix6<f64>, Vector6<f64>)> =
                views.par_iter().map(|view| self.pull(view, pooling, &here, &nudged)).collect();
            let hessian: Matrix6<f64> = pulls.iter().map(|(hessian, _)| *hessian).sum();
            let gradient: Vector6<f64> = pulls.iter().map(|(_, gradient)| *gradient).sum();
            let hessian = DMatrix::from_column_slice(6, 6, hessian.as_slice());
            let gradient = DVector::from_column_slice(gradient.as_slice());
            // By the mean curvature: what no picture tells, as the turn of a ball, stays.
            let damping = FIRST_DAMPING * hessian.trace() / 6.0 + f64::MIN_POSITIVE;
            let found = damped_step(&hessian, &gradient, |_| damping);
            let Some(found) = found.filter(|found| found.iter().all(|s| s.is_finite())) else { break };
            pose = pose.then(Pose::small(std::array::from_fn(|k| found[k]), self.size));
        }
        pose
    }

    /// Of half the squared difference between a view's mask and the drawing of the particles `here` [m], the curvature
    /// and the gradient by the amounts of [`Pose::small`], each of which moves them to where they are `nudged` [m].
    fn pull(
        &self,
        view: &MaskView,
        pooling: usize,
        here: &[[f32; 3]],
        nudged: &[Vec<[f32; 3]>; 6],
    ) -> (Matrix6<f64>, Vector6<f64>) {
        let drawing = Drawing::of_factor(self.gaussians.factor);
        let shown = |positions| Shown { gaussians: self.at(positions), velocities: &[], drawing: &drawing };
        let compared = ComparedView::new(view, &shown(here), pooling);
        let nearby = compared.nearby();
        let nudged = nudged.each_ref().map(|positions| nearby(&shown(positions)));
        let (mut hessian, mut gradient) = (Matrix6::zeros(), Vector6::zeros());
        for (i, (drawn, observed)) in compared.drawn.iter().zip(&compared.observed).enumerate() {
            let slope = Vector6::from_fn(|k, _| f64::from(nudged[k][i] - drawn) / self.difference);
            if slope != Vector6::zeros() {
                hessian += slope * slope.transpose();
                gradient += slope * f64::from(drawn - observed);
            }
        }
        (hessian, gradient)
    }

    /// Where the particles are at a pose [m].
    fn placed(&self, pose: Pose) -> Vec<[f32; 3]> {
        let moved = |p: &[f32; 3]| pose.moved(DVec3::from(p.map(f64::from)), self.centre).as_vec3().to_array();
        self.gaussians.positions.iter().map(moved).collect()
    }

    /// The Gaussians with the particles elsewhere.
    fn at<'a>(&'a self, positions: &'a [[f32; 3]]) -> IsotropicGaussians<'a> {
        IsotropicGaussians { positions, ..self.gaussians }
    }
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len().max(1) as f64;
    values.sum::<f64>() / count
}

#[cfg(test)]
mod tests {
    use gic_scene::Camera;
    use glam::DMat3;
    use proptest::prelude::*;

    use super::*;
    use crate::forward::silhouette::coverage;
    use crate::observe::test_camera::test_camera;
    use crate::observe::video::ObservedFrame;
    use crate::tuning::MaskTuning;

    const SPACING: f64 = 0.01;

    /// An L of particles, which has no mirror plane of its own but one [m].
    fn body() -> Vec<DVec3> {
        let place = |i: i32| DVec3::new(f64::from(i % 14), f64::from(i / 14 % 10), f64::from(i / 140)) * SPACING;
        (0..14 * 10 * 6).map(place).filter(|p| p.x < 0.05 || p.y < 0.04).collect()
    }

    fn cameras() -> Vec<Camera> {
        let facing = |turn: DMat3| test_camera(160, 400.0, turn, DVec3::new(0.05, 0.05, 0.03) - turn.z_axis);
        vec![facing(DMat3::IDENTITY), facing(DMat3::from_rotation_y(1.2)), facing(DMat3::from_rotation_x(1.0))]
    }

    /// A model whose motion is what it holds, whatever the state.
    struct Given(Vec<Vec<[f32; 3]>>);

    impl ForwardModel for Given {
        fn trajectories(&self, _: &State, _: &FrameSelection) -> Result<Trajectories, FitError> {
            Ok(Trajectories {
                scales: self.0.iter().map(|positions| vec![0.6 * SPACING as f32; positions.len()]).collect(),
                positions: self.0.clone(),
                velocities: Vec::new(),
                drawing: Drawing::of_factor(1.0),
                outward_displacements: Vec::new(),
            })
        }
    }

    /// The motion `given`, with the poses that masks of the motion `shown` want.
    fn posed(shown: &[Vec<[f32; 3]>], given: Vec<Vec<[f32; 3]>>) -> Vec<Vec<[f32; 3]>> {
        let model = Given(shown.to_vec());
        let selection = FrameSelection { first: 0, end: shown.len(), pooling: MaskTuning::default().blur_pooling };
        let seen = model.trajectories(&State::new(Vec::new()), &selection).unwrap();
        let opacities = vec![0.9; shown[0].len()];
        let frame = |o: usize| {
            let drawn = |camera: &Camera| coverage(seen.gaussians(o, &opacities), camera);
            let view = |(k, camera): (usize, &Camera)| MaskView::new(k, camera, &drawn(camera), 1);
            let views = cameras().iter().enumerate().map(view).collect();
            ObservedFrame { simulated_frame: o, time_s: 0.0, views, surface: None }
        };
        let video = ObservedVideo { frames: (0..shown.len()).map(frame).collect() };
        let model = Given(given);
        let motion = Posed { model: &model, video: &video, opacities: &opacities, first: 0 };
        motion.trajectories(&State::new(Vec::new()), &selection).unwrap().positions
    }

    /// The body, stretched along y by a factor, then at a pose.
    fn stretched(stretch: f64, pose: Pose) -> Vec<[f32; 3]> {
        let stretched = |p: DVec3| (p * DVec3::new(1.0, stretch, 1.0)).as_vec3().to_array();
        let positions: Vec<[f32; 3]> = body().into_iter().map(stretched).collect();
        let (scales, opacities) = (vec![0.6 * SPACING as f32; positions.len()], vec![0.9; positions.len()]);
        let gaussians =
            IsotropicGaussians { positions: &positions, opacities: &opacities, scales: &scales, factor: 1.0 };
        Body::new(gaussians).placed(pose)
    }

    fn root_mean_square(a: &[[f32; 3]], b: &[[f32; 3]]) -> f64 {
        let squared = |(a, b): (&[f32; 3], &[f32; 3])| glam::Vec3::from(*a).distance_squared((*b).into());
        (f64::from(a.iter().zip(b).map(squared).sum::<f32>()) / a.len() as f64).sqrt()
    }

    /// A drift and a turn that grow, as those of a wrong shape do: up to a fifth of the body's length and 17 degrees.
    #[test]
    fn a_drift_and_a_turn_are_taken_back() {
        let drift = |o: usize| Pose::small([2.0, -1.5, 1.0, 1.5, 2.5, -2.0].map(|a| 0.002 * a * o as f64), 0.05);
        let shown: Vec<_> = (0..6).map(|_| stretched(1.0, Pose::default())).collect();
        let given: Vec<_> = (0..6).map(|o| stretched(1.0, drift(o))).collect();
        for (o, found) in posed(&shown, given.clone()).iter().enumerate() {
            let (before, after) = (root_mean_square(&given[o], &shown[o]), root_mean_square(found, &shown[o]));
            println!("{o}: {:.2} mm, {:.2} mm before", 1e3 * after, 1e3 * before);
            assert!(after < 0.05 * before + 2e-4, "{o}: {after} of {before}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(8))]
        #[test]
        fn what_is_deformed_stays_deformed(
            amounts in prop::array::uniform6(-0.01f64..0.01),
            stretch in 0.9f64..1.1,
        ) {
            let given = stretched(stretch, Pose::small(amounts, 0.05));
            let found = &posed(&[stretched(1.0, Pose::default())], vec![given.clone()])[0];
            let apart = |positions: &[[f32; 3]], i: usize| {
                glam::Vec3::from(positions[i]).distance(positions[positions.len() - 1 - i].into())
            };
            for i in 0..given.len() / 2 {
                prop_assert!((apart(&given, i) - apart(found, i)).abs() < 1e-5);
            }
        }
    }
}
