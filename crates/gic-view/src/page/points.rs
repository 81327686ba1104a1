//! Points of all frames, and their bytes in the page.

use gic_geometry::outward_normals;
use glam::DVec3;

use crate::error::{Result, ViewError};
use crate::render::color_scale::{ColorScale, PLAIN_RGB, byte_color};
use crate::render::simulated_motion::{FrameParticles, SimulatedMotion};
use crate::skinned_gaussians::{SkinnedGaussians, colors};

/// Points whose normal is shorter than this in every frame are never at the surface, and are left out.
const MIN_SURFACE_NORMAL: f32 = 0.3;
/// Points x frames that a page holds at most; beyond, every second (third, ...) point is left out.
const MAX_POINT_FRAMES: usize = 600_000;

/// Points that can be seen, in every frame.
pub(super) struct PagePoints {
    frames: Vec<PointFrame>,
    spacing: f64,
    has_colors: bool,
}

/// The points of one frame.
struct PointFrame {
    positions: Vec<[f32; 3]>,
    colors: Vec<[u8; 3]>,
    stress: Vec<f32>,
    speed: Vec<f32>,
}

impl PagePoints {
    /// Reads every frame; `on_frame` is called after each and returns whether to stop.
    pub(super) fn read(
        motion: &SimulatedMotion,
        skins: Option<Vec<(usize, SkinnedGaussians)>>,
        on_frame: &mut dyn FnMut(usize) -> bool,
    ) -> Result<Self> {
        let mut frames = Vec::new();
        let mut spacing = 0.0;
        let mut at_surface: Vec<bool> = Vec::new();
        for index in 0..motion.trajectory.frames.len() {
            let particles = motion.particles(index)?;
            if index == 0 {
                spacing = skins.as_ref().map_or_else(|| particles.spacing(), |skins| finest(skins));
            }
            let frame = frame(&particles, skins.as_deref());
            at_surface.resize(frame.positions.len(), false);
            for (seen, normal) in at_surface.iter_mut().zip(outward_normals(&frame.positions, spacing)) {
                *seen |= normal.iter().map(|x| x * x).sum::<f32>() > MIN_SURFACE_NORMAL * MIN_SURFACE_NORMAL;
            }
            frames.push(frame);
            if on_frame(index) {
                return Err(ViewError::interrupted(String::new()));
            }
        }
        let seen: Vec<usize> = (0..at_surface.len()).filter(|&i| at_surface[i]).collect();
        let stride = (seen.len() * frames.len()).div_ceil(MAX_POINT_FRAMES).max(1);
        let kept: Vec<usize> = seen.into_iter().step_by(stride).collect();
        frames.iter_mut().for_each(|frame| frame.keep(&kept));
        // Fewer points have to cover the same surface.
        Ok(Self { frames, spacing: spacing * (stride as f64).sqrt(), has_colors: skins.is_some() })
    }

    /// Points in every frame.
    pub(super) fn len(&self) -> usize {
        self.frames.first().map_or(0, |frame| frame.positions.len())
    }

    /// Distance of neighbouring points [m].
    pub(super) fn spacing(&self) -> f64 {
        self.spacing
    }

    /// Whether the points have the colours of the video.
    pub(super) fn has_colors(&self) -> bool {
        self.has_colors
    }

    /// Lowest and highest coordinates [m].
    pub(super) fn bounds(&self) -> (DVec3, DVec3) {
        let points = self.frames.iter().flat_map(|frame| &frame.positions).map(|p| DVec3::from(p.map(f64::from)));
        points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)))
    }

    /// The bytes that the page's script reads: per frame, positions as fractions of the bounds (3 x u16), colours (3 x
    /// u8), stress and speed as fractions of their scales (u8).
    pub(super) fn encode(&self, [stress, speed]: &[ColorScale; 2]) -> Vec<u8> {
        let (low, high) = self.bounds();
        let size = (high - low).max(DVec3::splat(1e-9));
        let mut bytes = Vec::with_capacity(11 * self.len() * self.frames.len());
        for frame in &self.frames {
            for p in &frame.positions {
                let share = (DVec3::from(p.map(f64::from)) - low) / size;
                bytes.extend(share.to_array().into_iter().flat_map(|x| ((x * 65535.0).round() as u16).to_le_bytes()));
            }
            bytes.extend(frame.colors.as_flattened());
            for (values, scale) in [(&frame.stress, stress), (&frame.speed, speed)] {
                bytes.extend(values.iter().map(|&v| (scale.share(v) * 255.0).round() as u8));
            }
        }
        bytes
    }
}

/// Smallest spacing of some bodies [m].
fn finest(skins: &[(usize, SkinnedGaussians)]) -> f64 {
    skins.iter().map(|(_, skin)| skin.spacing()).fold(f64::INFINITY, f64::min)
}

fn frame(particles: &FrameParticles, skins: Option<&[(usize, SkinnedGaussians)]>) -> PointFrame {
    let Some(skins) = skins else {
        return PointFrame {
            positions: particles.positions.iter().map(|p| p.as_vec3().to_array()).collect(),
            colors: vec![byte_color(PLAIN_RGB); particles.positions.len()],
            stress: particles.von_mises_pa.clone(),
            speed: particles.speeds.clone(),
        };
    };
    let mut all = PointFrame { positions: Vec::new(), colors: Vec::new(), stress: Vec::new(), speed: Vec::new() };
    let mut start = 0;
    for (count, skin) in skins {
        let drawn = skin.at(&particles.positions[start..start + count]);
        all.colors.extend(colors(&drawn).map(byte_color));
        all.positions.extend(drawn.positions);
        let carriers = || skin.parents().iter().map(|&i| start + i as usize);
        all.stress.extend(carriers().map(|i| particles.von_mises_pa[i]));
        all.speed.extend(carriers().map(|i| particles.speeds[i]));
        start += count;
    }
    all
}

impl PointFrame {
    fn keep(&mut self, kept: &[usize]) {
        self.positions = kept.iter().map(|&i| self.positions[i]).collect();
        self.colors = kept.iter().map(|&i| self.colors[i]).collect();
        self.stress = kept.iter().map(|&i| self.stress[i]).collect();
        self.speed = kept.iter().map(|&i| self.speed[i]).collect();
    }
}
