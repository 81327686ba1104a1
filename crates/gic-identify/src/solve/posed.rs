//! A motion whose pose at each observation is the one that the observation wants.
//!
//! How a body drifts and turns after contact hangs on its shape as much as on its material, and the error grows: where
//! a third of the surface is unseen, the right material is a tenth of the body's size off after nine frames. How the
//! body deforms hangs far less on that. So the material is told by the deformation as long as the shape is known in
//! part only: a shift and a turn about the centre are free at each observation. They are eliminated by their own
//! least-squares fit (variable projection: Golub & Pereyra 1973): one step of Gauss-Newton's method from where the two
//! observations before lead, which is near, so that the pose is a smooth function of the motion.

use gic_geometry::Pose;
use gic_optimize::{FIRST_DAMPING, damped_step};
use glam::DVec3;

use crate::FitError;
use crate::forward::trajectories::{ForwardModel, FrameSelection, Trajectories};
use crate::solve::normal_equations::Normal;
use crate::solve::objective::Objective;
use crate::unknowns::state::State;

/// Finite differences move the body by this share of a Gaussian's width. Convention.
const DIFFERENCE_WIDTHS: f64 = 0.2;

/// A model of motion with free poses.
pub(crate) struct Posed<'a> {
    pub model: &'a dyn ForwardModel,
    pub objective: Objective<'a>,
    /// The first observation whose pose is free; those before have the model's.
    pub first: usize,
}

impl ForwardModel for Posed<'_> {
    fn trajectories(&self, state: &State, selection: &FrameSelection) -> Result<Trajectories, FitError> {
        let mut trajectories = self.model.trajectories(state, selection)?;
        let (mut before, mut pose) = (Pose::default(), Pose::default());
        for o in selection.first.max(self.first)..selection.end.min(trajectories.positions.len()) {
            let near = pose.onwards(before);
            (before, pose) = (pose, self.step(&trajectories, (o, selection.pooling), near));
            let positions = &mut trajectories.positions[o];
            *positions = placed(positions, pose);
        }
        Ok(trajectories)
    }
}

impl Posed<'_> {
    /// A step from a pose near that of observation `o` to this.
    fn step(&self, trajectories: &Trajectories, (o, pooling): (usize, usize), near: Pose) -> Pose {
        let size = size(&trajectories.positions[o]);
        let difference = DIFFERENCE_WIDTHS * mean(trajectories.scales[o].iter().map(|s| f64::from(*s)));
        let nudged = |k: usize| {
            let amounts: [f64; 6] = std::array::from_fn(|j| if j == k { difference } else { 0.0 });
            alone(trajectories, o, near.then(Pose::small(amounts, size)))
        };
        let nudged: Vec<Trajectories> = (0..6).map(nudged).collect();
        let only = FrameSelection { first: o, end: o + 1, pooling };
        let blocks = self.objective.blocks(&alone(trajectories, o, near), &nudged, &[difference; 6], &only);
        let normal = Normal::sum(&blocks, self.objective.weights, 6);
        // By the mean curvature: what no picture tells, as the turn of a ball, stays.
        let damping = FIRST_DAMPING * normal.hessian.trace() / 6.0 + f64::MIN_POSITIVE;
        let found = damped_step(&normal.hessian, &normal.gradient, |_| damping);
        let found = found.filter(|found| found.iter().all(|s| s.is_finite()));
        found.map_or(near, |found| near.then(Pose::small(std::array::from_fn(|k| found[k]), size)))
    }
}

/// Observation `o` alone, at a pose.
fn alone(trajectories: &Trajectories, o: usize, pose: Pose) -> Trajectories {
    let positions = &trajectories.positions[o];
    let mut alone = Trajectories {
        positions: vec![Vec::new(); trajectories.positions.len()],
        scales: vec![Vec::new(); trajectories.scales.len()],
        splat_factor: trajectories.splat_factor,
        outward_displacements: trajectories.outward_displacements.clone(),
    };
    alone.positions[o] = placed(positions, pose);
    alone.scales[o].clone_from(&trajectories.scales[o]);
    alone
}

/// A body at a pose.
fn placed(positions: &[[f32; 3]], pose: Pose) -> Vec<[f32; 3]> {
    let centre = centre(positions);
    positions.iter().map(|p| pose.moved(DVec3::from(p.map(f64::from)), centre).as_vec3().to_array()).collect()
}

fn centre(positions: &[[f32; 3]]) -> DVec3 {
    positions.iter().map(|p| DVec3::from(p.map(f64::from))).sum::<DVec3>() / positions.len().max(1) as f64
}

/// Root mean square distance from the centre [m].
fn size(positions: &[[f32; 3]]) -> f64 {
    let centre = centre(positions);
    let squared = |p: &[f32; 3]| DVec3::from(p.map(f64::from)).distance_squared(centre);
    mean(positions.iter().map(squared)).sqrt().max(f64::MIN_POSITIVE)
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len().max(1) as f64;
    values.sum::<f64>() / count
}

#[cfg(test)]
mod tests {
    use gic_scene::Camera;
    use glam::{DMat3, DVec2};
    use proptest::prelude::*;

    use super::*;
    use crate::forward::silhouette::coverage;
    use crate::observe::mask_view::MaskView;
    use crate::observe::video::{ObservedFrame, ObservedVideo};
    use crate::solve::residual_block::Weights;
    use crate::solve::surface_residuals::SurfaceComparison;
    use crate::tuning::MaskTuning;
    use crate::{Input, Tuning};

    const SPACING: f64 = 0.01;

    /// An L of particles, which has no mirror plane of its own but one [m].
    fn body() -> Vec<DVec3> {
        let place = |i: i32| DVec3::new(f64::from(i % 14), f64::from(i / 14 % 10), f64::from(i / 140)) * SPACING;
        (0..14 * 10 * 6).map(place).filter(|p| p.x < 0.05 || p.y < 0.04).collect()
    }

    fn cameras() -> Vec<Camera> {
        let facing = |world_from_camera: DMat3| Camera {
            width: 160,
            height: 160,
            focal: DVec2::splat(400.0),
            principal: DVec2::splat(80.0),
            world_from_camera,
            centre: DVec3::new(0.05, 0.05, 0.03) - world_from_camera.z_axis,
        };
        vec![facing(DMat3::IDENTITY), facing(DMat3::from_rotation_y(1.2)), facing(DMat3::from_rotation_x(1.0))]
    }

    /// A model whose motion is what it holds, whatever the state.
    struct Given(Vec<Vec<[f32; 3]>>);

    impl ForwardModel for Given {
        fn trajectories(&self, _: &State, _: &FrameSelection) -> Result<Trajectories, FitError> {
            Ok(Trajectories {
                scales: self.0.iter().map(|positions| vec![0.6 * SPACING as f32; positions.len()]).collect(),
                positions: self.0.clone(),
                splat_factor: 1.0,
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
        let comparison = SurfaceComparison::new(&Input::of_body(body(), SPACING), None, &Tuning::default());
        let weights = Weights::uniform(1.0, 1.0, shown.len());
        let objective =
            Objective { video: &video, opacities: &opacities, surface_comparison: &comparison, weights: &weights };
        let model = Given(given);
        let motion = Posed { model: &model, objective, first: 0 };
        motion.trajectories(&State::new(Vec::new()), &selection).unwrap().positions
    }

    /// The body, stretched along y by a factor, then at a pose.
    fn stretched(stretch: f64, pose: Pose) -> Vec<[f32; 3]> {
        let stretched = |p: DVec3| (p * DVec3::new(1.0, stretch, 1.0)).as_vec3().to_array();
        placed(&body().into_iter().map(stretched).collect::<Vec<_>>(), pose)
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
            // At first nothing says how fast they grow.
            let most = if o < 3 { 0.4 } else { 0.01 };
            assert!(after <= most * before + 1e-4, "{o}: {after} of {before}");
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
