//! What the free flight tells of the cameras: that they lag, and that their calibration is off.

use std::borrow::Cow;

use glam::DVec3;

use crate::camera::Camera;
use crate::error::SceneError;
use crate::flight::{CameraOffset, FlightView, FreeFlight, Seek};
use crate::lens::Lens;
use crate::picture::Mask;
use crate::scene::Scene;
use crate::view::View;

/// Fewest frames of flight that tell velocity, acceleration and delays. Derived: a parabola has three points.
const FEWEST_FRAMES: usize = 3;

impl Scene {
    /// The free flight of the first frames, its acceleration [m/s^2] given or sought, and with what is to be sought of
    /// the cameras, where it is needed. `None` where the outlines show none, or no camera stands still.
    fn find_flight(&self, acceleration: Option<DVec3>, seek: Seek) -> Result<Option<FreeFlight>, SceneError> {
        if self.is_static() || !self.has_fixed_cameras() {
            return Ok(None);
        }
        let views = |frame: usize| {
            let masks = self.load_masks(self.views_at(frame))?;
            let view = |(view, mask): (&View, Mask)| FlightView {
                index: view.camera,
                camera: self.camera_of(view).clone(),
                lag_s: view.time_s - self.times[frame],
                mask,
            };
            Ok::<_, SceneError>(self.views_at(frame).iter().zip(masks).map(view).collect())
        };
        Ok(FreeFlight::find(&self.times, acceleration, seek, views)?.filter(|flight| flight.frames() >= FEWEST_FRAMES))
    }

    /// The same scene with the times at which its pictures were taken and the cameras that took them: where the free
    /// flight shows that cameras lag or are not where the scene says, they are as it shows. The acceleration of the
    /// flight [m/s^2] is given, or sought. Only the first `frames` are looked at.
    ///
    /// # Errors
    /// Masks that cannot be read.
    pub fn corrected(&self, acceleration: Option<DVec3>, frames: usize, seek: Seek) -> Result<Scene, SceneError> {
        let flight = self.first_frames(frames).find_flight(acceleration, seek)?;
        let Some(shown) = flight.as_ref() else { return Ok(self.clone()) };
        let (late, off) = (shown.delays.iter().any(|delay| *delay != 0.0), !shown.errors.is_empty());
        if !late && !off {
            return Ok(Scene { flight, ..self.clone() });
        }
        let mut scene = self.clone();
        if late {
            scene = Scene { delays_s: shown.delays.clone(), ..scene.delayed(&shown.delays) };
        }
        if off {
            scene = scene.mended(shown);
        }
        // On the frames' new times and with the new cameras.
        Ok(Scene { flight: scene.first_frames(frames).find_flight(acceleration, Seek::default())?, ..scene })
    }

    /// The same scene with the cameras' errors mended that a flight shows.
    fn mended(&self, flight: &FreeFlight) -> Scene {
        let mut scene = self.clone();
        for (index, error) in flight.errors.iter().enumerate() {
            let stated = &self.cameras[index];
            scene.cameras[index] = error.mended(stated);
            scene.lenses[index] =
                Some(Lens::Mended { stated: self.lenses[index].clone().map(Box::new), error: *error });
        }
        Scene {
            calibration_errors: flight.errors.clone(),
            calibration_error_deviations: flight.error_deviations.clone(),
            ..scene
        }
    }

    /// The same scene with cameras that differ from its own by these offsets, as a fit to the whole video found; as it
    /// is where none was found. Times count from the same moment as before.
    #[must_use]
    pub fn as_fitted(&self, found: &[CameraOffset]) -> Scene {
        let mut scene = self.clone();
        if found.is_empty() {
            return scene;
        }
        for (camera, offset) in scene.cameras.iter_mut().zip(found) {
            *camera = offset.error.mended(camera);
        }
        for view in &mut scene.views {
            view.time_s += found.get(view.camera).map_or(0.0, |offset| offset.late_s);
        }
        let of_frame = |(frame, known): (usize, &f64)| {
            let times = scene.views_at(frame).iter().map(|view| view.time_s);
            times.min_by(f64::total_cmp).unwrap_or(*known)
        };
        let times = self.times.iter().enumerate().map(of_frame).collect();
        Scene { times, ..scene }
    }

    /// A camera that sees the body at its frame's time as the view's camera saw it at the view's own: moved against the
    /// flight. The view's camera itself where the view does not lag, and after the flight.
    pub fn camera_at_frame(&self, view: &View) -> Cow<'_, Camera> {
        let camera = self.camera_of(view);
        let flies = |flight: &&FreeFlight| view.frame < flight.frames() && self.lags(view);
        match self.flight.as_ref().filter(flies) {
            None => Cow::Borrowed(camera),
            Some(flight) => {
                let start = self.times[0];
                Cow::Owned(flight.camera_between(camera, view.time_s - start, self.times[view.frame] - start))
            }
        }
    }

    /// Whether all views of a frame show the body at one time: they were taken then, or in flight.
    pub fn is_seen_at_once(&self, frame: usize) -> bool {
        self.flight.as_ref().is_some_and(|flight| frame < flight.frames())
            || !self.views_at(frame).iter().any(|view| self.lags(view))
    }
}
