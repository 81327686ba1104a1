//! What stays the same during a training: settings, pictures, and what follows from both.

use std::collections::{BTreeMap, BTreeSet};

use gic_scene::{FreeFlight, Scene};
use glam::DVec3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::pictures::{self, Target};
use crate::settings::MIN_SYNCHRONOUS;
use crate::tuning::MIN_GAUSSIANS;
use crate::{MotionError, TrainSettings};

/// What stays the same during a training: settings and pictures.
pub(super) struct Training<'a> {
    pub(super) settings: &'a TrainSettings,
    pub(super) seed: u64,
    pub(super) targets: Vec<Target>,
    /// The same at half their size, if training starts with them.
    pub(super) halved: Vec<Target>,
    pub(super) held_out: Vec<Target>,
    /// Indices into `targets` of each trained frame, in the order of time.
    pub(super) frames: Vec<Vec<usize>>,
    pub(super) is_static: bool,
    pub(super) max_gaussians: usize,
    pub(super) sh_degree: usize,
    /// The warm-up uses the first frame (several cameras see it), not all of them (one moving camera).
    pub(super) synchronous: bool,
    /// There will be a base motion.
    pub(super) tracks: bool,
    /// The flight whose frames are one, where there is one.
    pub(super) flight: Option<FreeFlight>,
}

impl<'a> Training<'a> {
    pub(super) fn new(scene: &Scene, settings: &'a TrainSettings, seed: u64) -> Result<Self, MotionError> {
        let targets = pictures::training(scene, &settings.held_out)?;
        let held_out = match settings.evaluate_every {
            0 => Vec::new(),
            _ if settings.held_out.is_empty() => Vec::new(),
            _ => pictures::held_out(scene, &settings.held_out)?,
        };
        if targets.iter().all(|t| t.area == 0.0) {
            let reason = match targets.is_empty() {
                true => "every camera is held out",
                false => "no mask shows the object; check the masks with `gic inspect`",
            };
            return Err(MotionError::NothingToTrain(reason.into()));
        }
        let frames = by_frame(&targets);
        let synchronous = frames[0].len() >= MIN_SYNCHRONOUS;
        let seen: Vec<f64> = targets.iter().map(|t| t.area).filter(|&area| area > 0.0).collect();
        let mean_area = seen.iter().sum::<f64>() / seen.len() as f64;
        let asked_for = (settings.gaussians_per_pixel * mean_area).max(MIN_GAUSSIANS as f64) as usize;
        let max_gaussians = asked_for.min(settings.max_gaussians.unwrap_or(usize::MAX));
        let cameras: BTreeSet<usize> = targets.iter().map(|t| t.camera_index).collect();
        let sh_degree = settings.sh_degree.unwrap_or(match cameras.len() {
            50.. => 3,
            20.. => 1,
            _ => 0,
        });
        let is_static = frames.len() == 1;
        let mut training = Training {
            settings,
            seed,
            halved: if settings.half_size > 0.0 {
                targets.par_iter().map(Target::halved).collect()
            } else {
                Vec::new()
            },
            targets,
            held_out,
            frames,
            is_static,
            max_gaussians,
            sh_degree,
            synchronous,
            tracks: false,
            flight: None,
        };
        let time = |frame: &Vec<usize>| training.targets[frame[0]].time;
        let ascending = training.frames.windows(2).all(|pair| time(&pair[0]) < time(&pair[1]));
        training.tracks = !is_static && ascending && settings.affine_steps > 0 && training.centres().is_some();
        if training.tracks
            && let Some(flight) = &scene.flight
        {
            training.join_flight(flight);
        }
        Ok(training)
    }

    /// Makes one frame of those of a flight: every moment of it is a view of the body of the first, by a camera that
    /// is moved against the flight.
    fn join_flight(&mut self, flight: &FreeFlight) {
        let time = self.targets[self.frames[0][0]].time;
        for target in self.targets.iter_mut().chain(&mut self.halved).filter(|t| t.frame < flight.frames()) {
            target.camera = flight.camera_between(&target.camera, flight.times[target.frame], 0.0);
            (target.frame, target.time) = (0, time);
        }
        self.frames = by_frame(&self.targets);
        self.flight = Some(flight.clone());
    }

    /// Random numbers of one step, so that a resumed run draws the same as an uninterrupted one.
    pub(super) fn rng(&self, step: usize) -> ChaCha8Rng {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(step as u64 + 1);
        rng
    }

    /// For each frame the point nearest to the rays through its masks' centres; `None` when a frame has too few views
    /// for that.
    pub(super) fn centres(&self) -> Option<Vec<DVec3>> {
        let centre = |frame: &Vec<usize>| {
            let seen = frame.iter().map(|&i| &self.targets[i]).filter(|t| t.area > 0.0);
            (seen.clone().count() >= MIN_SYNCHRONOUS).then(|| pictures::mask_centre(seen))?
        };
        self.frames.iter().map(centre).collect()
    }
}

/// Indices of the targets of each frame, in the order of the frames.
fn by_frame(targets: &[Target]) -> Vec<Vec<usize>> {
    let mut by_frame: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (i, target) in targets.iter().enumerate() {
        by_frame.entry(target.frame).or_default().push(i);
    }
    by_frame.into_values().collect()
}
