//! What the outlines alone tell of the motion before contact, whatever the body's shape.

use gic_scene::{FlightView, FreeFlight, Mask, Seek};
use glam::DVec3;
use nalgebra::{DMatrix, DVector, Matrix3, Matrix6};

use crate::forward::flight::substep;
use crate::solve::prior::Prior;
use crate::unknowns::state::{State, Unknown};
use crate::{Input, Observation, Settings, View};

/// Velocity and angular velocity of the body's centre by epipolar tangency (decision 51), with gravity known. `None`
/// where masks are not used, the velocity is given, or the outlines show no common flight.
pub(crate) fn motion_by_outlines(input: &Input, settings: &Settings, excluded: &[usize]) -> Option<Prior> {
    if !settings.target.masks() || settings.velocity_m_s.is_some() {
        return None;
    }
    let times: Vec<f64> = input.observations.iter().map(|observation| observation.time_s).collect();
    let views =
        |frame: usize| Ok::<_, std::convert::Infallible>(flight_views(input, &input.observations[frame], excluded));
    let Ok(flight) = FreeFlight::find(&times, Some(input.gravity_m_s2), Seek::default(), views);
    flight.and_then(|flight| of_centre(input, &flight))
}

fn flight_views(input: &Input, observation: &Observation, excluded: &[usize]) -> Vec<FlightView> {
    let view = |view: &View| {
        let camera = input.cameras[view.camera].clone();
        let mask = Mask { width: camera.width, height: camera.height, coverage: view.mask.clone() };
        FlightView { index: view.camera, camera, lag_s: 0.0, mask }
    };
    observation.views.iter().filter(|view| !excluded.contains(&view.camera)).map(view).collect()
}

/// The motion of the particles' centre, as the simulator's steps make it, instead of that of the flight's own point.
fn of_centre(input: &Input, flight: &FreeFlight) -> Option<Prior> {
    let arm = input.centre() - flight.about;
    // Symplectic Euler falls by g dt / 2 a second more than a parabola.
    let stepping = 0.5 * substep(input) * input.gravity_m_s2;
    let velocity = flight.velocity + flight.angular_velocity.cross(arm) - stepping;
    let mut moved = Matrix6::identity();
    let turned = Matrix3::new(0.0, arm.z, -arm.y, -arm.z, 0.0, arm.x, arm.y, -arm.x, 0.0);
    moved.fixed_view_mut::<3, 3>(0, 3).copy_from(&turned);
    let information = (moved * flight.covariance * moved.transpose()).try_inverse()?;
    let axes = [Unknown::Velocity, Unknown::Angular].map(|of| (0..3).map(of).collect::<Vec<_>>());
    Some(Prior {
        unknowns: axes.concat(),
        mean: DVector::from_vec([velocity, flight.angular_velocity].map(|v| v.to_array()).concat()),
        information: DMatrix::from_iterator(6, 6, information.iter().copied()),
    })
    .filter(|prior| prior.information.iter().all(|entry| entry.is_finite()))
}

/// Whether the body turns: by more than so many standard deviations about some axis.
pub(crate) fn turns(motion: &Prior, significance: f64) -> bool {
    (3..6)
        .any(|k| motion.mean[k].abs() > significance * motion.deviation_of(motion.unknowns[k]).unwrap_or(f64::INFINITY))
}

/// The likeliest velocity, and angular velocity where the body turns, put into a state.
pub(crate) fn put(motion: &Prior, turns: bool, state: &mut State) {
    let of = |mean: &DVector<f64>, k: usize| DVec3::new(mean[k], mean[k + 1], mean[k + 2]);
    if turns {
        (state.velocity, state.angular) = (of(&motion.mean, 0), of(&motion.mean, 3));
        return;
    }
    // Given that it does not turn: the velocity v with P_vv (v - m_v) + P_vw (0 - m_w) = 0.
    let information = &motion.information;
    let (own, cross) = (information.view((0, 0), (3, 3)), information.view((0, 3), (3, 3)));
    let shift = own.into_owned().try_inverse().map(|inverse| inverse * cross * motion.mean.rows(3, 3));
    state.velocity = of(&motion.mean, 0) + shift.map_or(DVec3::ZERO, |shift| DVec3::new(shift[0], shift[1], shift[2]));
}
