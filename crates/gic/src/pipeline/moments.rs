//! The moments of a video that a fit explains: where it has the body, and what the cameras saw.

use std::borrow::Cow;

use gic_continuum::{Moment, MomentView};
use gic_identify::{Estimates, Input};
use gic_scene::{Camera, Scene, View};
use glam::DVec3;

use super::Run;
use super::identify::motion_of;
use crate::error::{Error, Result};

impl Run<'_> {
    /// The moments of the first observations, which a fit `explained`, with what the cameras saw of them, as it found
    /// these to be.
    pub(super) fn moments(&self, input: &Input, found: &Estimates, explained: usize) -> Result<Vec<Moment>> {
        let last = input.observations.iter().take(explained).next_back();
        let last = last.map_or(0, |observation| input.frame_at(observation.time_s));
        // What a camera saw between two ticks hangs on the next one, too.
        let motion = motion_of(input, found, last + 1).map_err(Error::stage("simulating a fit"))?;
        let motion = Motion { positions: motion, rate_hz: input.frame_rate_hz };
        let cameras = self.scene.as_fitted(&found.devices);
        let free_s = input.observations.get(found.free_frames).map_or(f64::INFINITY, |first| first.time_s);
        let mut moments: Vec<(usize, Moment)> = Vec::new();
        for frame in 0..self.scene.times.len() {
            let at_once = self.scene.is_seen_at_once(frame);
            let time_of = |view: &View| if at_once { self.scene.times[frame] } else { view.time_s };
            let is_explained = |view: &&View| input.frame_at(time_of(view)) <= last;
            let views: Vec<View> = self.scene.views_at(frame).iter().filter(is_explained).cloned().collect();
            let pictures = self.scene.load_all(&views).map_err(Error::stage("reading pictures"))?;
            for (view, (picture, mask)) in views.iter().zip(pictures) {
                let tick = input.frame_at(time_of(view));
                let camera = motion.camera_at(tick, view, &cameras, at_once);
                let moment = moments.iter_mut().find(|(at, _)| *at == tick);
                match (moment, MomentView::around_mask(&camera, &picture, &mask)) {
                    (_, None) => (),
                    (Some((_, moment)), Some(seen)) => moment.views.push(seen),
                    (None, Some(seen)) => {
                        let positions = motion.positions[tick].clone();
                        let moment = Moment { positions, flies: time_of(view) < free_s, views: vec![seen] };
                        moments.push((tick, moment));
                    }
                }
            }
        }
        moments.sort_by_key(|(tick, _)| *tick);
        Ok(moments.into_iter().map(|(_, moment)| moment).collect())
    }
}

/// Where particles are at the ticks of a clock.
struct Motion {
    /// Shape [ticks][n] [m].
    positions: Vec<Vec<DVec3>>,
    rate_hz: f64,
}

impl Motion {
    /// A camera that sees the body at a tick as that of a view of the video, found to be one of `cameras`, saw it when
    /// the picture was taken: against the free flight where all are taken as of one time, else against the body's mean
    /// velocity.
    fn camera_at<'a>(&self, tick: usize, view: &View, cameras: &'a Scene, at_once: bool) -> Cow<'a, Camera> {
        let found = cameras.view(view.camera, view.frame).unwrap_or(view);
        if at_once {
            return cameras.camera_at_frame(found);
        }
        let late_ticks = found.time_s * self.rate_hz - tick as f64;
        let camera = cameras.camera_of(found).clone();
        Cow::Owned(Camera { centre: camera.centre - late_ticks * self.step(tick), ..camera })
    }

    /// How far the body moves from one tick to the next [m].
    fn step(&self, tick: usize) -> DVec3 {
        let mean = |tick: usize| self.positions[tick].iter().sum::<DVec3>() / self.positions[tick].len().max(1) as f64;
        mean(tick + 1) - mean(tick)
    }
}
