//! Pictures of particles that are at hand, all from one place and on one scale: for commands that simulate on their
//! own.

use gic_scene::{Camera, Picture};
use glam::DVec3;

use super::color_scale::ColorScale;
use super::particle_splats::ParticleSplats;
use super::shade::{Backdrop, Environment, compose};
use super::simulated_motion::FrameParticles;
use super::viewpoint;

/// A camera that stands still, and what colours mean.
pub struct FixedCameraRenderer {
    camera: Camera,
    splats: ParticleSplats,
    up: DVec3,
}

impl FixedCameraRenderer {
    /// A camera that looks from the side `from` and a little above at everything within `bounds` [m]; colours run from
    /// blue at no von Mises stress to red at `most_pa`; particles are `spacing` metres apart. `size` is width and
    /// height [pixels].
    pub fn new(bounds: (DVec3, DVec3), up: DVec3, from: DVec3, size: [usize; 2], most_pa: f64, spacing: f64) -> Self {
        let camera = viewpoint::beside(bounds, up, from, size);
        Self { camera, splats: ParticleSplats::ColorMapped { scale: ColorScale::stress(most_pa), spacing }, up }
    }

    /// What the colours mean, in a sentence.
    pub fn legend(&self) -> String {
        self.splats.legend()
    }

    /// A picture over light grey.
    pub fn picture(&self, particles: &FrameParticles) -> Picture {
        let rendered = gic_splat::render(&self.splats.gaussians(particles), &self.camera, &self.splats.settings());
        let environment = Environment { backdrop: Backdrop::Floor(Vec::new()), up: self.up };
        compose(&rendered, &self.camera, &environment, self.splats.is_lit())
    }
}
