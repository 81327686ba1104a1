//! From particles to Gaussians: in the colours of a scale, or as the video showed them.

use std::path::Path;

use gic_splat::{Channels, Gaussians, RenderSettings, Shape, coefficient_of_color};
use gic_twin::events::Events;
use gic_twin::matter::read_particles;
use glam::DVec3;

use super::color_scale::{ColorScale, Coloring};
use super::simulated_motion::{FrameParticles, SimulatedMotion};
use crate::error::{Result, ViewError};
use crate::skinned_gaussians::SkinnedGaussians;

/// Standard deviation of a particle's Gaussian in units of the particles' spacing: closed surfaces, sharp outlines.
pub(crate) const SCALE: f64 = 0.55;
/// Opacity of a particle.
pub(crate) const OPACITY: f32 = 0.95;

/// Brightness of obstacles.
const OBSTACLE_GREY: f32 = 0.5;

/// What is drawn for particles.
pub(super) enum ParticleSplats {
    /// The particles, `spacing` metres apart, in the colours of a scale.
    ColorMapped { scale: ColorScale, spacing: f64 },
    /// The bodies in their own colours, each with its number of particles.
    Skinned(Vec<(usize, SkinnedGaussians)>),
}

impl ParticleSplats {
    pub(super) fn new(coloring: Coloring, motion: &SimulatedMotion, first: &FrameParticles) -> Result<Self> {
        if coloring == Coloring::Appearance {
            return skins(motion)?.map(Self::Skinned).ok_or_else(|| ViewError::Usage {
                problem: "the simulated matter has no colours beside it".into(),
                hint: Some(
                    "colours come with `gic run SCENE -o RUN`; use --color stress, speed or plain without them".into(),
                ),
            });
        }
        Ok(Self::ColorMapped { scale: ColorScale::new(coloring, &motion.trajectory), spacing: first.spacing() })
    }

    /// What the colours mean, in a sentence.
    pub(super) fn legend(&self) -> String {
        match self {
            Self::ColorMapped { scale, .. } => scale.legend(),
            Self::Skinned(_) => "colour: as in the video".into(),
        }
    }

    /// The scale of the colours; `None` where they are the bodies' own.
    pub(super) fn scale(&self) -> Option<&ColorScale> {
        match self {
            Self::ColorMapped { scale, .. } => Some(scale),
            Self::Skinned(_) => None,
        }
    }

    /// Whether the colours hold the light already.
    pub(super) fn is_lit(&self) -> bool {
        matches!(self, Self::Skinned(_))
    }

    pub(super) fn gaussians(&self, particles: &FrameParticles) -> Gaussians {
        match self {
            Self::ColorMapped { scale, spacing } => {
                let n = particles.positions.len();
                Gaussians {
                    positions: particles.positions.iter().map(|p| p.as_vec3().to_array()).collect(),
                    opacities: vec![OPACITY; n],
                    shape: Shape::Isotropic { scales: vec![(SCALE * spacing) as f32; n] },
                    sh_degree: 0,
                    sh: scale.harmonics(particles),
                }
            }
            Self::Skinned(skins) => {
                let mut start = 0;
                let bodies = skins.iter().map(|(n, skin)| {
                    let own = start..start + n;
                    start += n;
                    skin.visible(&particles.positions[own])
                });
                concatenated(bodies)
            }
        }
    }

    /// Distance of neighbouring splats [m].
    pub(super) fn spacing(&self) -> f64 {
        match self {
            Self::ColorMapped { spacing, .. } => *spacing,
            Self::Skinned(skins) => skins.iter().map(|(_, skin)| skin.spacing()).fold(f64::INFINITY, f64::min),
        }
    }

    /// Adds points of obstacles [m], grey.
    pub(super) fn add_obstacles(&self, gaussians: &mut Gaussians, points: &[DVec3]) {
        gaussians.positions.extend(points.iter().map(|p| p.as_vec3().to_array()));
        gaussians.opacities.resize(gaussians.positions.len(), OPACITY);
        gaussians.sh.resize(gaussians.positions.len(), [coefficient_of_color(OBSTACLE_GREY); 3]);
        if let Shape::Isotropic { scales } = &mut gaussians.shape {
            scales.resize(gaussians.positions.len(), (SCALE * self.spacing()) as f32);
        }
    }

    pub(super) fn settings(&self) -> RenderSettings {
        match self {
            // The filter of masks: true outlines, no fringe.
            Self::ColorMapped { .. } => {
                RenderSettings { channels: Channels::ColorAlphaDepth, ..RenderSettings::masks() }
            }
            // As the colours were trained.
            Self::Skinned(_) => RenderSettings::default(),
        }
    }
}

/// The colours of every body, from the run folder in which its matter lies; `None` where a body has none.
///
/// # Errors
/// Matter that is missing or is not what was simulated, damaged colours.
pub(crate) fn skins(motion: &SimulatedMotion) -> Result<Option<Vec<(usize, SkinnedGaussians)>>> {
    let mut skins = Vec::new();
    let mut began = Vec::new();
    for body in motion.continua() {
        let Some(file) = body.file.filter(|file| SkinnedGaussians::beside(file)) else { return Ok(None) };
        let rest = read_particles(&file)?.positions;
        began.extend(rest.iter().map(|&p| body.shift_m.map_or(p, |shift| p + shift)));
        let run = file.parent().unwrap_or(Path::new(""));
        let Some(skin) = SkinnedGaussians::load(run, &rest)?.filter(|_| rest.len() == body.particles) else {
            return Err(foreign(&file));
        };
        skins.push((body.particles, skin));
        // The colours belong to the particles of their run, which must be the simulated ones.
        if began.len() == motion.trajectory.particles && !motion.trajectory.began_with(began.iter().copied()) {
            return Err(foreign(&file));
        }
    }
    Ok(Some(skins))
}

/// The colours of every body; `None`, and a warning, where they cannot be read.
pub(crate) fn skins_or_warning(
    motion: &SimulatedMotion,
    stage: &str,
    events: &Events,
) -> Option<Vec<(usize, SkinnedGaussians)>> {
    skins(motion).unwrap_or_else(|error| {
        events.warn(stage, format!("without the colours of the video: {error}"));
        None
    })
}

fn foreign(file: &Path) -> ViewError {
    ViewError::Usage {
        problem: format!("{} is not the matter that was simulated, so its colours are others, too", file.display()),
        hint: Some("simulate the twin beside it anew, or use --color stress, speed or plain".into()),
    }
}

/// All Gaussians of several isotropic sets without direction-dependent colours.
fn concatenated(sets: impl Iterator<Item = Gaussians>) -> Gaussians {
    let mut all = Gaussians::colorless(Vec::new(), Vec::new(), Vec::new());
    let mut widths = Vec::new();
    for set in sets {
        all.positions.extend(set.positions);
        all.opacities.extend(set.opacities);
        all.sh.extend(set.sh);
        if let Shape::Isotropic { scales } = set.shape {
            widths.extend(scales);
        }
    }
    all.shape = Shape::Isotropic { scales: widths };
    all
}
