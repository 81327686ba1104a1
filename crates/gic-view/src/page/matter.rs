//! The matter of all frames, and its bytes in the page: splats, each carried by a particle.

use gic_geometry::outward_normals;
use gic_splat::color_of_coefficient;
use glam::DVec3;
use serde::Serialize;

use crate::error::Result;
use crate::render::color_scale::{PLAIN_RGB, byte_color};
use crate::render::particle_splats::{OPACITY, SCALE};
use crate::render::simulated_motion::SimulatedMotion;
use crate::skinned_gaussians::{MIN_VISIBLE_NORMAL, SkinnedGaussians, is_longer};

/// Least length of the outward normal of a particle that can be seen, where particles are the splats: these are nearly
/// opaque. Splats that are never seen are left out.
const MIN_SURFACE_NORMAL: f32 = 0.3;
/// Bytes of a page's matter; beyond, every second (third, ...) splat is left out. Budget: a page of 40 MB.
const MAX_BYTES: usize = 28_000_000;
/// Bytes of a splat: carrier u32, offset 3 x i16, size u16, colour 3 x u8, opacity u8.
const SPLAT_BYTES: usize = 16;
/// Bytes per frame of a particle (position 3 x u16, stress u16, speed u16) and of a splat (normal 3 x i8).
const PARTICLE_FRAME_BYTES: usize = 10;
const SPLAT_FRAME_BYTES: usize = 3;

/// What is drawn, in every frame.
pub(super) struct PageMatter {
    splats: Vec<Splat>,
    frames: Vec<MatterFrame>,
    /// Splats of each body.
    bodies: Vec<usize>,
    /// Light on each body's colours, as `light.json` has it; none where colours are the program's own.
    lights: Option<Vec<Vec<[f32; 3]>>>,
    spacing: f64,
}

/// A splat as its particle carries it.
struct Splat {
    /// The particle.
    carrier: u32,
    /// From the particle [m].
    offset: DVec3,
    /// Standard deviation [m].
    scale: f32,
    rgb: [f32; 3],
    opacity: f32,
}

/// One frame.
struct MatterFrame {
    positions: Vec<DVec3>,
    stress: Vec<f32>,
    speed: Vec<f32>,
    normals: Vec<[f32; 3]>,
}

/// What the script needs to read the bytes.
#[derive(Serialize)]
pub(super) struct MatterHeader {
    pub(super) particles: usize,
    pub(super) splats: usize,
    pub(super) frames: usize,
    /// Box of all particles in all frames [m]; positions are fractions of it.
    pub(super) low_m: [f64; 3],
    pub(super) high_m: [f64; 3],
    /// Largest component of an offset [m], size of a splat [m], stress [Pa], speed [m/s].
    pub(super) max_offset_m: f64,
    pub(super) max_scale_m: f64,
    pub(super) max_stress_pa: f64,
    pub(super) max_speed_m_s: f64,
    /// Distance of neighbouring splats [m].
    pub(super) spacing_m: f64,
    /// Per body, nine RGB coefficients of the light by the normal; null where colours are the program's own.
    pub(super) lights: Option<Vec<Vec<[f32; 3]>>>,
}

impl PageMatter {
    /// Reads every frame; `on_frame` is called after each, and its error ends the reading.
    pub(super) fn read(
        motion: &SimulatedMotion,
        skins: Option<&[(usize, SkinnedGaussians)]>,
        on_frame: &mut dyn FnMut(usize) -> Result<()>,
    ) -> Result<Self> {
        let first = motion.particles(0)?;
        let spacing = skins.map_or_else(|| first.spacing(), finest);
        let mut splats = Vec::new();
        let mut bodies = Vec::new();
        let mut start = 0;
        for (index, body) in motion.continua().iter().enumerate() {
            let before = splats.len();
            match skins.and_then(|skins| skins.get(index)) {
                Some((_, skin)) => splats.extend(skinned(skin, start)),
                None => splats.extend((start..start + body.particles).map(|carrier| plain(carrier, spacing, index))),
            }
            bodies.push(splats.len() - before);
            start += body.particles;
        }
        let least = if skins.is_some() { MIN_VISIBLE_NORMAL } else { MIN_SURFACE_NORMAL };
        let mut seen = vec![false; splats.len()];
        let mut frames = Vec::new();
        for index in 0..motion.trajectory.frames.len() {
            let particles = if index == 0 { first.clone() } else { motion.particles(index)? };
            let positions: Vec<[f32; 3]> = splats
                .iter()
                .map(|splat: &Splat| (particles.positions[splat.carrier as usize] + splat.offset).as_vec3().to_array())
                .collect();
            let normals = outward_normals(&positions, spacing);
            for (seen, normal) in seen.iter_mut().zip(&normals) {
                *seen |= is_longer(normal, least);
            }
            let (positions, stress, speed) = (particles.positions, particles.von_mises_pa, particles.speeds);
            frames.push(MatterFrame { positions, stress, speed, normals });
            on_frame(index)?;
        }
        let lights = skins.map(|skins| skins.iter().map(|(_, skin)| skin.light().coefficients.to_vec()).collect());
        let mut matter = Self { splats, frames, bodies, lights, spacing };
        matter.keep(&seen);
        Ok(matter)
    }

    /// Leaves out what is never seen, splats beyond what a page holds, and the particles that then carry nothing.
    fn keep(&mut self, seen: &[bool]) {
        let shown = seen.iter().filter(|&&seen| seen).count();
        let carried = self.frames.first().map_or(0, |frame| frame.positions.len()).min(shown);
        let bytes =
            shown * SPLAT_BYTES + self.frames.len() * (carried * PARTICLE_FRAME_BYTES + shown * SPLAT_FRAME_BYTES);
        let stride = bytes.div_ceil(MAX_BYTES).max(1);
        let kept: Vec<usize> = (0..seen.len()).filter(|&i| seen[i]).step_by(stride).collect();
        let mut start = 0;
        for count in &mut self.bodies {
            let end = start + *count;
            *count = kept.partition_point(|&i| i < end) - kept.partition_point(|&i| i < start);
            start = end;
        }
        // Fewer splats have to cover the same surface.
        let wider = (stride as f64).sqrt();
        self.spacing *= wider;
        let mut place = vec![None; self.frames.first().map_or(0, |frame| frame.positions.len())];
        let mut carriers = Vec::new();
        let mut splats = Vec::with_capacity(kept.len());
        for &i in &kept {
            let splat = &self.splats[i];
            let carrier = *place[splat.carrier as usize].get_or_insert_with(|| {
                carriers.push(splat.carrier as usize);
                carriers.len() as u32 - 1
            });
            splats.push(Splat { carrier, scale: splat.scale * wider as f32, ..*splat });
        }
        self.splats = splats;
        for frame in &mut self.frames {
            frame.positions = carriers.iter().map(|&i| frame.positions[i]).collect();
            frame.stress = carriers.iter().map(|&i| frame.stress[i]).collect();
            frame.speed = carriers.iter().map(|&i| frame.speed[i]).collect();
            frame.normals = kept.iter().map(|&i| frame.normals[i]).collect();
        }
    }

    /// Splats of each body.
    pub(super) fn bodies(&self) -> &[usize] {
        &self.bodies
    }

    /// Whether the splats have the colours of the video.
    pub(super) fn has_colors(&self) -> bool {
        self.lights.is_some()
    }

    pub(super) fn header(&self) -> MatterHeader {
        let points = || self.frames.iter().flat_map(|frame| &frame.positions);
        let largest = |values: &mut dyn Iterator<Item = f64>| values.filter(|v| v.is_finite()).fold(1e-9, f64::max);
        MatterHeader {
            particles: self.frames.first().map_or(0, |frame| frame.positions.len()),
            splats: self.splats.len(),
            frames: self.frames.len(),
            low_m: points().fold(DVec3::INFINITY, |low, &p| low.min(p)).to_array(),
            high_m: points().fold(DVec3::NEG_INFINITY, |high, &p| high.max(p)).to_array(),
            max_offset_m: largest(&mut self.splats.iter().map(|splat| splat.offset.abs().max_element())),
            max_scale_m: largest(&mut self.splats.iter().map(|splat| splat.scale.into())),
            max_stress_pa: largest(&mut self.frames.iter().flat_map(|f| &f.stress).map(|&v| v.into())),
            max_speed_m_s: largest(&mut self.frames.iter().flat_map(|f| &f.speed).map(|&v| v.into())),
            spacing_m: self.spacing,
            lights: self.lights.clone(),
        }
    }

    /// The bytes that the script reads, little-endian: carriers, offsets and sizes, colours and opacities of all
    /// splats; then per frame positions and stress of all particles, their speeds, and the splats' normals.
    pub(super) fn encode(&self) -> Vec<u8> {
        let head = self.header();
        let (low, high) = (DVec3::from(head.low_m), DVec3::from(head.high_m));
        let size = (high - low).max(DVec3::splat(1e-9));
        let mut bytes = Vec::new();
        let u16_of = |share: f64| ((share.clamp(0.0, 1.0) * 65535.0).round() as u16).to_le_bytes();
        self.splats.iter().for_each(|splat| bytes.extend(splat.carrier.to_le_bytes()));
        for splat in &self.splats {
            let share = splat.offset / head.max_offset_m;
            bytes.extend(share.to_array().into_iter().flat_map(|x| ((x * 32767.0).round() as i16).to_le_bytes()));
            bytes.extend(u16_of(f64::from(splat.scale) / head.max_scale_m));
        }
        for splat in &self.splats {
            bytes.extend(byte_color(splat.rgb));
            bytes.push((splat.opacity.clamp(0.0, 1.0) * 255.0).round() as u8);
        }
        for frame in &self.frames {
            for (p, &stress) in frame.positions.iter().zip(&frame.stress) {
                bytes.extend(((*p - low) / size).to_array().into_iter().flat_map(u16_of));
                bytes.extend(u16_of(f64::from(stress) / head.max_stress_pa));
            }
            for &speed in &frame.speed {
                bytes.extend(u16_of(f64::from(speed) / head.max_speed_m_s));
            }
            for normal in &frame.normals {
                bytes.extend(normal.map(|x| (x.clamp(-1.0, 1.0) * 127.0).round() as i8 as u8));
            }
        }
        bytes
    }
}

/// Smallest spacing of some bodies [m].
fn finest(skins: &[(usize, SkinnedGaussians)]) -> f64 {
    skins.iter().map(|(_, skin)| skin.spacing()).fold(f64::INFINITY, f64::min)
}

/// The splats of a body with colours of its own, whose first particle is `start`.
fn skinned(skin: &SkinnedGaussians, start: usize) -> impl Iterator<Item = Splat> + '_ {
    let albedo = skin.albedo();
    skin.parents().iter().zip(skin.offsets()).enumerate().map(move |(i, (&parent, &offset))| Splat {
        carrier: start as u32 + parent,
        offset,
        scale: albedo.scale(i),
        rgb: albedo.sh.get(i * albedo.sh_per_gaussian()).map_or(PLAIN_RGB, |sh| sh.map(color_of_coefficient)),
        opacity: albedo.opacities[i],
    })
}

/// A particle as a splat; each body has a colour.
fn plain(carrier: usize, spacing: f64, body: usize) -> Splat {
    const RGB: [[f32; 3]; 4] = [PLAIN_RGB, [0.42, 0.62, 0.80], [0.55, 0.75, 0.45], [0.75, 0.50, 0.72]];
    Splat {
        carrier: carrier as u32,
        offset: DVec3::ZERO,
        scale: (SCALE * spacing) as f32,
        rgb: RGB[body % RGB.len()],
        opacity: OPACITY,
    }
}
