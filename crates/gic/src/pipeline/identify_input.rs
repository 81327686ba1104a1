//! What identification gets: the body of the first frame, and what every frame shows.

use std::borrow::Cow;
use std::collections::BTreeMap;

use gic_identify::{DeviceDoubt, Input, Observation, Settings, View};
use gic_scene::{CalibrationError, Camera, CameraOffset};
use gic_twin::twin::Obstacle;

use super::clock::Clock;
use super::surroundings::Surroundings;
use super::{Continuum, Run, Stage};
use crate::error::{Error, Result};

impl Run<'_> {
    pub(super) fn identify_input(&self, continuum: &Continuum, surroundings: &Surroundings) -> Result<Input> {
        let config = &self.config.identify;
        let Some(frame_rate_hz) = self.scene.frame_rate else {
            return Err(Error::Usage {
                problem: "the frames of the scene are not evenly spaced in time".into(),
                hint: Some("give the frame rate with --frame-rate-hz".into()),
            });
        };
        let particles = &continuum.particles;
        let (grid_spacing_m, substeps_per_frame) = config.resolution(continuum.grid_spacing_m());
        let scale = (continuum.appearance.scale * particles.spacing) as f32;
        let mut cameras = self.scene.cameras.clone();
        let mut devices: Vec<usize> = (0..cameras.len()).collect();
        let clock = Clock::of(&self.scene.moments().times, frame_rate_hz);
        let mut observations = Vec::new();
        for frame in 0..self.scene.times.len() {
            observations.extend(self.observe(frame, continuum, &clock, (&mut cameras, &mut devices))?);
        }
        let volume_m3 = particles.volume * particles.volume_factors.iter().map(|share| f64::from(*share)).sum::<f64>();
        Ok(Input {
            positions: particles.positions.clone(),
            particle_volume_m3: particles.volume,
            volume_factors: particles.volume_factors.iter().map(|factor| f64::from(*factor)).collect(),
            opacities: particles.densities.iter().map(|d| continuum.appearance.opacity * d).collect(),
            scales: vec![scale; particles.positions.len()],
            doubts: particles.doubts.clone(),
            surface_error_m: continuum.surface_error_m(),
            cameras,
            devices,
            device_doubts: self.device_doubts(),
            observations,
            frame_rate_hz: clock.rate_hz(),
            gravity_m_s2: surroundings.gravity_m_s2,
            colliders: surroundings.obstacles.iter().map(Obstacle::to_collider).collect(),
            world_doubt: surroundings.doubt,
            was_filmed: self.was_filmed(),
            density_kg_m3: density_of(config, volume_m3),
            grid_spacing_m,
            substeps_per_frame: clock.substeps(substeps_per_frame),
        })
    }

    /// Tells on which grid the body is simulated, and what of it no picture shows.
    pub(super) fn note_resolution(&self, continuum: &Continuum) {
        let (grid_spacing_m, substeps_per_frame) = self.config.identify.resolution(continuum.grid_spacing_m());
        let grid = format!("grid {:.2} mm, {substeps_per_frame} substeps a frame", 1e3 * grid_spacing_m);
        let known = std::iter::once(grid).chain(continuum.summary.remarks());
        self.events.note(Stage::Identify.name(), known.collect::<Vec<_>>().join("; "));
    }

    /// What a frame shows: all at its time where its views can be taken as of one time, else each at its own.
    fn observe(
        &self,
        frame: usize,
        continuum: &Continuum,
        clock: &Clock,
        (cameras, devices): (&mut Vec<Camera>, &mut Vec<usize>),
    ) -> Result<Vec<Observation>> {
        let views = self.scene.views_at(frame).iter().zip(self.masks(frame)?);
        if !self.scene.is_seen_at_once(frame) {
            let mut moments: BTreeMap<usize, Observation> = BTreeMap::new();
            for (view, mask) in views {
                let observation = moments.entry(clock.tick(view.time_s)).or_default();
                observation.time_s = view.time_s;
                observation.views.push(View { camera: view.camera, mask: mask.coverage });
            }
            return Ok(moments.into_values().collect());
        }
        let mut place = |view: &gic_scene::View| match self.scene.camera_at_frame(view) {
            Cow::Borrowed(_) => view.camera,
            Cow::Owned(moved) => {
                cameras.push(moved);
                devices.push(view.camera);
                cameras.len() - 1
            }
        };
        // A scan has no surface in later frames, and where outlines made the first body those of later ones are poor.
        let surface = continuum.surfaces.get(frame).filter(|_| frame == 0 || !continuum.summary.is_by_outlines);
        let surface = surface.cloned().unwrap_or_default();
        Ok(vec![Observation {
            time_s: self.scene.times[frame],
            surface: surface.points,
            surface_doubts: surface.doubts,
            views: views.map(|(view, mask)| View { camera: place(view), mask: mask.coverage }).collect(),
        }])
    }

    /// How well each camera is known; empty where all are as they are said to be.
    fn device_doubts(&self) -> Vec<DeviceDoubt> {
        let Some(flight) = self.scene.flight.as_ref().filter(|_| self.has_real_cameras()) else { return Vec::new() };
        let doubt = |(device, camera): (usize, &Camera)| {
            let mended = self.scene.calibration_errors.get(device).copied();
            let error = mended.map(|_| CalibrationError::deviation(camera.centre.distance(flight.about)));
            // The clock of the first is the scene's.
            let lags = device > 0 && !self.scene.delays_s.is_empty();
            DeviceDoubt {
                mended: mended.unwrap_or_default(),
                deviation: CameraOffset {
                    error: error.unwrap_or_default(),
                    late_s: if lags { f64::INFINITY } else { 0.0 },
                },
            }
        };
        self.scene.cameras.iter().enumerate().map(doubt).collect()
    }

    /// Observations of the first `frames` of the video.
    pub(super) fn observations_of(&self, frames: usize, input: &Input) -> usize {
        let end = self.scene.times.get(frames).copied().unwrap_or(f64::INFINITY);
        input.observations.partition_point(|observation| observation.time_s < end)
    }

    /// Frames of the video that the first `observations` show.
    pub(super) fn frames_of(&self, observations: usize, input: &Input) -> usize {
        (0..=self.scene.times.len()).take_while(|frames| self.observations_of(*frames, input) <= observations).count()
            - 1
    }

    pub(super) fn identify_settings(&self, input: &Input) -> Settings {
        let config = &self.config.identify;
        let frames = config.frames.map(|frames| self.observations_of(frames, input));
        Settings { frames, ..config.clone() }
    }
}

/// Density [kg/m^3] of an object that fills a volume [m^3]: of its mass, where that is known.
fn density_of(settings: &gic_identify::Settings, volume_m3: f64) -> f64 {
    settings.mass_kg.map_or(settings.density_kg_m3, |mass_kg| mass_kg / volume_m3)
}
