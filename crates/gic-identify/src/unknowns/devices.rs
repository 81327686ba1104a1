//! What is unknown of the devices that took the pictures, and what their calibration says of it.

use gic_scene::CalibrationError;
use nalgebra::{DMatrix, DVector};

use crate::Input;
use crate::solve::prior::Prior;
use crate::unknowns::state::{DEVICE_UNKNOWNS, Unknown};

/// The place of the delay among the numbers of a device.
const DELAY: usize = DEVICE_UNKNOWNS - 1;

/// What is sought of the devices. The clock of the first is that of the motion.
pub(crate) fn unknowns(input: &Input) -> Vec<Unknown> {
    let lag = |device: usize| device > 0 && input.device_doubts[device].lags;
    let of_device = |device: usize| {
        let deviations = numbers(&input.device_doubts[device].deviation);
        let is_sought = move |k: &usize| {
            if *k == DELAY { lag(device) } else { deviations.get(*k).is_some_and(|deviation| *deviation > 0.0) }
        };
        (0..DEVICE_UNKNOWNS).filter(is_sought).map(move |k| Unknown::Device(DEVICE_UNKNOWNS * device + k))
    };
    (0..input.device_doubts.len()).flat_map(of_device).collect()
}

/// What the calibration says of the devices: nothing of their delays. `None` where it is exact.
pub(crate) fn prior(input: &Input) -> Option<Prior> {
    let of = |unknown: Unknown| match unknown {
        Unknown::Device(k) if k % DEVICE_UNKNOWNS != DELAY => {
            let doubt = &input.device_doubts[k / DEVICE_UNKNOWNS];
            let of_number = |error: &CalibrationError| numbers(error)[k % DEVICE_UNKNOWNS];
            // What was mended is the error that was there.
            Some((unknown, (-of_number(&doubt.mended), of_number(&doubt.deviation).powi(-2))))
        }
        _ => None,
    };
    let known = unknowns(input).into_iter().filter_map(of);
    let (unknowns, (means, information)): (Vec<Unknown>, (Vec<f64>, Vec<f64>)) = known.unzip();
    (!unknowns.is_empty()).then(|| Prior {
        unknowns,
        mean: DVector::from_vec(means),
        information: DMatrix::from_diagonal(&DVector::from_vec(information)),
    })
}

/// Those of an error that are sought, in their order.
fn numbers(error: &CalibrationError) -> [f64; DELAY] {
    let (turn, shift) = (error.turn_rad, error.shift_m);
    [turn.x, turn.y, turn.z, shift.x, shift.y, shift.z, error.focal]
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;

    use gic_scene::Camera;
    use glam::{DMat3, DVec2, DVec3};

    use super::*;
    use crate::forward::drawing::Drawing;
    use crate::forward::silhouette::coverage;
    use crate::forward::trajectories::{ForwardModel, FrameSelection, Trajectories};
    use crate::observe::mask_view::MaskView;
    use crate::observe::video::{ObservedFrame, ObservedVideo};
    use crate::solve::levenberg_marquardt::{Limits, minimise};
    use crate::solve::objective::Objective;
    use crate::solve::problem::Problem;
    use crate::solve::residual_block::Weights;
    use crate::solve::surface_residuals::SurfaceComparison;
    use crate::tuning::{DescentTuning, Tuning};
    use crate::unknowns::coordinates::Coordinates;
    use crate::unknowns::state::State;
    use crate::{DeviceDoubt, FitError};

    const FRAMES: usize = 8;
    const SPACING: f64 = 0.01;

    /// A block that flies and falls, drawn as a state's devices see it.
    struct Falling;

    impl ForwardModel for Falling {
        fn trajectories(&self, state: &State, _: &FrameSelection) -> Result<Trajectories, FitError> {
            let place = |i: i32| DVec3::new(f64::from(i % 9), f64::from(i / 9 % 6), f64::from(i / 54)) * SPACING;
            let (velocity, gravity) = (DVec3::new(0.6, 0.5, -0.4), DVec3::new(0.0, -9.8, 0.0));
            let time = |o: usize| 0.04 * o as f64;
            let moved = |o: usize| velocity * time(o) + 0.5 * gravity * time(o).powi(2);
            let at = |o: usize| (0..9 * 6 * 5).map(|i| (place(i) + moved(o)).as_vec3().to_array()).collect::<Vec<_>>();
            let fast = |o: usize| vec![(velocity + gravity * time(o)).as_vec3().to_array(); 9 * 6 * 5];
            Ok(Trajectories {
                positions: (0..FRAMES).map(at).collect(),
                velocities: (0..FRAMES).map(fast).collect(),
                scales: vec![vec![0.6 * SPACING as f32; 9 * 6 * 5]; FRAMES],
                drawing: Drawing::of(state),
                outward_displacements: Vec::new(),
            })
        }
    }

    fn cameras() -> Vec<Camera> {
        let facing = |world_from_camera: DMat3| Camera {
            width: 160,
            height: 160,
            focal: DVec2::splat(300.0),
            principal: DVec2::splat(80.0),
            world_from_camera,
            centre: DVec3::new(0.1, 0.0, -0.02) - world_from_camera.z_axis,
        };
        vec![facing(DMat3::IDENTITY), facing(DMat3::from_rotation_y(1.3)), facing(DMat3::from_rotation_y(-1.0))]
    }

    /// Turns and delays of three devices that a falling body shows are found as they are.
    #[test]
    fn devices_that_are_turned_and_late_are_found() {
        let input = {
            let turn_rad = DVec3::splat(0.005);
            let deviation = CalibrationError { turn_rad, ..CalibrationError::default() };
            let doubt = DeviceDoubt { deviation, lags: true, ..DeviceDoubt::default() };
            Input { device_doubts: vec![doubt; 3], ..Input::of_body(vec![DVec3::ZERO; 9 * 6 * 5], SPACING) }
        };
        let unknowns = unknowns(&input);
        let mut truth = State::new(Vec::new());
        for (k, unknown) in unknowns.iter().enumerate() {
            let Unknown::Device(place) = *unknown else { panic!("{unknown:?}") };
            let size = if place % DEVICE_UNKNOWNS == DELAY { 2e-3 } else { 4e-3 };
            truth.set(*unknown, size * (1.7 * k as f64).sin());
        }
        let selection = FrameSelection { first: 0, end: FRAMES, pooling: 1 };
        let seen = Falling.trajectories(&truth, &selection).unwrap();
        let frame = |o: usize| {
            let shown = seen.shown(o, &input.opacities);
            let drawn = |(device, camera): (usize, &Camera)| {
                let mask = shown.seen(device, camera, coverage);
                MaskView::new(device, camera, &mask, 1)
            };
            let views = cameras().iter().enumerate().map(drawn).collect();
            ObservedFrame { simulated_frame: o, time_s: 0.04 * o as f64, views, surface: None }
        };
        let video = ObservedVideo { frames: (0..FRAMES).map(frame).collect() };
        let (weights, prior) = (Weights::uniform(1e4, 1.0, FRAMES), prior(&input));
        let (comparison, descent) =
            (SurfaceComparison::new(&input, None, &Tuning::default()), DescentTuning::default());
        let problem = Problem {
            forward: &Falling,
            objective: Objective {
                video: &video,
                opacities: &input.opacities,
                surface_comparison: &comparison,
                weights: &weights,
            },
            unknowns: unknowns.clone(),
            coordinates: Coordinates { parameters: &[], tuning: &descent },
            descent: &descent,
            selection,
            prior: prior.as_ref(),
        };
        let limits = Limits::to_the_end(30, 1e-6);
        let start = State::new(Vec::new());
        let found = minimise(&problem, start, None, limits, &mut |_| Ok(ControlFlow::Continue(()))).unwrap().state;
        for unknown in unknowns {
            let (was, is) = (truth.get(unknown), found.get(unknown));
            println!("{unknown:?}: {is:.5}, truth {was:.5}");
            assert!((is - was).abs() < 2e-4, "{unknown:?}: {is} instead of {was}");
        }
    }
}
