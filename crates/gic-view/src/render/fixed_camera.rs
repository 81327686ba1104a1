//! Pictures of particles that are at hand, all from one place and on one scale: for commands that simulate on their
//! own.

use gic_scene::{Camera, Picture};
use glam::DVec3;

use super::color_scale::ColorScale;
use super::labels::{Moment, label};
use super::particle_splats::ParticleSplats;
use super::shade::{Backdrop, Environment, compose};
use super::shadow::FloorShadow;
use super::simulated_motion::FrameParticles;
use super::viewpoint;

/// A camera that stands still before a table, and what colours mean.
pub struct FixedCameraRenderer {
    camera: Camera,
    splats: ParticleSplats,
    spacing: f64,
    up: DVec3,
    table: DVec3,
}

impl FixedCameraRenderer {
    /// A camera that looks from the side `from` and a little above at everything within `bounds` [m], on a table
    /// through the point `table` [m]; colours run from blue at no von Mises stress to red at `most_pa`; particles are
    /// `spacing` metres apart. `size` is width and height [pixels].
    pub fn new(
        bounds: (DVec3, DVec3),
        (up, from, table): (DVec3, DVec3, DVec3),
        size: [usize; 2],
        most_pa: f64,
        spacing: f64,
    ) -> Self {
        let camera = viewpoint::beside(bounds, up, from, size);
        let splats = ParticleSplats::ColorMapped { scale: ColorScale::stress(most_pa), spacing };
        Self { camera, splats, spacing, up, table }
    }

    /// What the colours mean, in a sentence.
    pub fn legend(&self) -> String {
        self.splats.legend()
    }

    /// A picture with the scale of the colours; `time_s` is written into it.
    pub fn picture(&self, particles: &FrameParticles, time_s: Option<f64>) -> Picture {
        let rendered = gic_splat::render(&self.splats.gaussians(particles), &self.camera, &self.splats.settings());
        let plane = (self.table, self.up);
        let shadow = FloorShadow::of(&particles.positions, self.spacing, plane);
        let environment = Environment { backdrop: Backdrop::Floor(vec![plane]), up: self.up };
        let mut picture = compose(&rendered, &self.camera, &environment, self.splats.is_lit(), shadow.as_ref());
        let moment = time_s.map(|time_s| Moment { time_s, predicted: false });
        label(&mut picture, self.splats.scale(), moment);
        picture
    }
}
