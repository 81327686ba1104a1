//! From particles to Gaussians: in the colours of a scale, or as the video showed them.

use std::path::Path;

use gic_splat::{Channels, Gaussians, RenderSettings, Shape};
use gic_twin::matter::read_particles;

use super::color_scale::{ColorScale, Coloring};
use super::simulated_motion::{FrameParticles, SimulatedMotion};
use crate::error::{Result, ViewError};
use crate::skinned_gaussians::SkinnedGaussians;

/// Standard deviation of a particle's Gaussian in units of the particles' spacing: closed surfaces, sharp outlines.
const SCALE: f64 = 0.55;
/// Opacity of a particle.
const OPACITY: f32 = 0.95;

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
            return Ok(Self::Skinned(skins(motion)?));
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

/// The colours of every body, from the run folder in which its matter lies.
pub(crate) fn skins(motion: &SimulatedMotion) -> Result<Vec<(usize, SkinnedGaussians)>> {
    let without_colors = |continuum: &str| ViewError::Usage {
        problem: format!("{continuum} has no colours beside it"),
        hint: Some("colours come with `gic run SCENE -o RUN`; use --color stress, speed or plain without them".into()),
    };
    motion
        .continua()
        .into_iter()
        .map(|(count, continuum)| {
            let continuum = continuum.ok_or_else(|| without_colors("a twin that is a shape"))?;
            let path = Path::new(&continuum);
            let rest = read_particles(path)?.positions;
            let skin = SkinnedGaussians::load(path.parent().unwrap_or(Path::new("")), &rest)?;
            // The colours belong to the particles of their run, which must be the simulated ones.
            let skin = skin.filter(|_| rest.len() == count).ok_or_else(|| without_colors(&continuum))?;
            Ok((count, skin))
        })
        .collect()
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
