//! What is unknown of the devices that took the pictures, and what their calibration says of it.

use gic_scene::CameraOffset;

use crate::solve::prior::Prior;
use crate::unknowns::state::Unknown;
use crate::{DeviceDoubt, Input};

/// What is sought of the devices, and what is known of it besides the pictures; of nothing where all are exact.
pub(crate) fn prior(input: &Input) -> Prior {
    let of_device = |(device, doubt): (usize, &DeviceDoubt)| {
        // What was mended is the error that was there.
        let mended = CameraOffset { error: doubt.mended, late_s: 0.0 }.numbers();
        let deviation = doubt.deviation.numbers();
        (0..CameraOffset::NUMBERS).map(move |k| (Unknown::Device(device, k), -mended[k], deviation[k]))
    };
    Prior::independent(input.device_doubts.iter().enumerate().flat_map(of_device))
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;

    use gic_scene::{CalibrationError, Camera};
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::FitError;
    use crate::forward::drawing::Drawing;
    use crate::forward::silhouette::coverage;
    use crate::forward::trajectories::{ForwardModel, FrameSelection, Trajectories};
    use crate::observe::mask_view::MaskView;
    use crate::observe::test_camera::test_camera;
    use crate::observe::video::{ObservedFrame, ObservedVideo};
    use crate::solve::levenberg_marquardt::{Limits, minimise};
    use crate::solve::objective::Objective;
    use crate::solve::problem::Problem;
    use crate::solve::residual_block::Weights;
    use crate::solve::surface_residuals::SurfaceComparison;
    use crate::tuning::{DescentTuning, Tuning};
    use crate::unknowns::coordinates::Coordinates;
    use crate::unknowns::state::State;

    /// A block whose particles lie this far apart [m] that flies and falls through so many frames, drawn as a state's
    /// devices see it.
    struct Falling {
        spacing: f64,
        frames: usize,
    }

    impl ForwardModel for Falling {
        fn trajectories(&self, state: &State, _: &FrameSelection) -> Result<Trajectories, FitError> {
            let place = |i: i32| DVec3::new(f64::from(i % 9), f64::from(i / 9 % 6), f64::from(i / 54)) * self.spacing;
            let (velocity, gravity) = (DVec3::new(0.6, 0.5, -0.4), DVec3::new(0.0, -9.8, 0.0));
            let time = |o: usize| 0.04 * o as f64;
            let moved = |o: usize| velocity * time(o) + 0.5 * gravity * time(o).powi(2);
            let at = |o: usize| (0..9 * 6 * 5).map(|i| (place(i) + moved(o)).as_vec3().to_array()).collect::<Vec<_>>();
            let fast = |o: usize| vec![(velocity + gravity * time(o)).as_vec3().to_array(); 9 * 6 * 5];
            Ok(Trajectories {
                positions: (0..self.frames).map(at).collect(),
                velocities: (0..self.frames).map(fast).collect(),
                scales: vec![vec![0.6 * self.spacing as f32; 9 * 6 * 5]; self.frames],
                drawing: Drawing::of(state),
                outward_displacements: Vec::new(),
            })
        }
    }

    fn cameras() -> Vec<Camera> {
        let facing = |turn: DMat3| test_camera(160, 300.0, turn, DVec3::new(0.1, 0.0, -0.02) - turn.z_axis);
        vec![facing(DMat3::IDENTITY), facing(DMat3::from_rotation_y(1.3)), facing(DMat3::from_rotation_y(-1.0))]
    }

    /// Turns and delays of three devices that a falling body shows are found as they are.
    #[test]
    fn devices_that_are_turned_and_late_are_found() {
        let model = Falling { spacing: 0.01, frames: 8 };
        let error = CalibrationError { turn_rad: DVec3::splat(0.005), ..CalibrationError::default() };
        let doubt = |late_s: f64| DeviceDoubt {
            mended: CalibrationError::default(),
            deviation: CameraOffset { error, late_s },
        };
        let device_doubts = [0.0, f64::INFINITY, f64::INFINITY].map(doubt).to_vec();
        let input = Input { device_doubts, ..Input::of_body(vec![DVec3::ZERO; 9 * 6 * 5], model.spacing) };
        let prior = prior(&input);
        let mut truth = State::new(Vec::new());
        for (k, unknown) in prior.unknowns.iter().enumerate() {
            let Unknown::Device(_, number) = *unknown else { panic!("{unknown:?}") };
            let size = if number + 1 == CameraOffset::NUMBERS { 2e-3 } else { 4e-3 };
            truth.set(*unknown, size * (1.7 * k as f64).sin());
        }
        let selection = FrameSelection { first: 0, end: model.frames, pooling: 1 };
        let seen = model.trajectories(&truth, &selection).unwrap();
        let frame = |o: usize| {
            let shown = seen.shown(o, &input.opacities);
            let drawn = |(device, camera): (usize, &Camera)| {
                let mask = shown.seen(device, camera, coverage);
                MaskView::new(device, camera, &mask, 1)
            };
            let views = cameras().iter().enumerate().map(drawn).collect();
            ObservedFrame { simulated_frame: o, time_s: 0.04 * o as f64, views, surface: None }
        };
        let video = ObservedVideo { frames: (0..model.frames).map(frame).collect() };
        let weights = Weights::uniform(1e4, 1.0, model.frames);
        let (comparison, descent) =
            (SurfaceComparison::new(&input, None, &Tuning::default()), DescentTuning::default());
        let problem = Problem {
            forward: &model,
            objective: Objective {
                video: &video,
                opacities: &input.opacities,
                surface_comparison: &comparison,
                weights: &weights,
            },
            unknowns: prior.unknowns.clone(),
            coordinates: Coordinates { parameters: &[], tuning: &descent },
            descent: &descent,
            selection,
            prior: Some(&prior),
        };
        let limits = Limits::to_the_end(30, 1e-6);
        let start = State::new(Vec::new());
        let found = minimise(&problem, start, None, limits, &mut |_| Ok(ControlFlow::Continue(()))).unwrap().state;
        for unknown in prior.unknowns.iter().copied() {
            let (was, is) = (truth.get(unknown), found.get(unknown));
            println!("{unknown:?}: {is:.5}, truth {was:.5}");
            assert!((is - was).abs() < 2e-4, "{unknown:?}: {is} instead of {was}");
        }
    }
}
