//! The stage `fill`: Gaussians to matter, for every frame of the video.

use std::path::{Path, PathBuf};

use gic_continuum::{
    AcrossTime, Agreement, Appearance, Drawing, FillSettings, Filling, MirrorPlane, ParticleTuning, Particles, Tuning,
    calibrate, compare_with_masks, sample_particles, sample_points,
};
use gic_scene::{Camera, Hull, HullSettings, HullView, Mask};
use gic_twin::atomic;
use gic_twin::matter::{read_particles, write_particles};
use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::fill_input::FillInput;
use super::frame_filler::FrameFiller;
use super::refine::FOLDER as REFINED;
use super::{Run, Stage};
use crate::error::{Error, Result};

/// `fill.json`: what filling found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FillSummary {
    /// Largest side of the object's box at the first frame [m].
    pub object_size_m: f64,
    /// Side of the finest voxels [m].
    pub voxel_spacing_m: f64,
    /// Distance of neighbouring particles [m].
    pub particle_spacing_m: f64,
    /// Rest volume of a particle [m^3].
    pub particle_volume_m3: f64,
    /// Number of particles.
    pub particles: usize,
    /// Share of them in parts of the body that are thinner than two cells of the simulation's grid, which does not
    /// resolve how they bend; `None` in runs that were filled without that figure.
    #[serde(default)]
    pub thin_share: Option<f64>,
    /// Share of the surface that pictures of any frame tell, by outlines or by colours that agree; `None` of a body
    /// that was not refined.
    #[serde(default)]
    pub told_share: Option<f64>,
    /// Standard deviation of a particle's Gaussian, in units of the particle spacing.
    pub splat_scale: f64,
    /// Opacity of a particle of density 1.
    pub splat_opacity: f32,
    /// Standard deviation of the Gaussians of the finer drawing, in units of its own spacing.
    pub drawing_scale: f64,
    /// Agreement of the re-rendered continuum with the mask of each camera at the first frame, intersection over union.
    pub mask_iou: Vec<f64>,
    /// Mirror planes of the body at the first frame.
    #[serde(default)]
    pub mirror_planes: Vec<MirrorPlane>,
    /// Frames whose outlines alone made the body of the first, because the surface showed none of the symmetry that
    /// they show; 0 where the surface made it.
    #[serde(default)]
    pub outline_frames: usize,
    /// Every frame.
    pub frames: Vec<FrameFilling>,
}

/// The body of the first frame, which is simulated.
struct FirstBody {
    particles: Particles,
    appearance: Appearance,
    /// How its finer points are drawn.
    drawn: Appearance,
    mask_iou: Vec<f64>,
    thin_share: f64,
}

impl FillSummary {
    /// What to know of the body before its parameters are believed, in words: which part of its surface is a guess, and
    /// which the simulation's grid does not resolve. Shares below a hundredth are not mentioned.
    pub fn remarks(&self) -> Vec<String> {
        let percent = |share: f64| Some(100.0 * share).filter(|percent| *percent >= 1.0);
        let untold = self.told_share.and_then(|told| percent(1.0 - told));
        let thin = self.thin_share.and_then(percent);
        let guess = |percent| format!("no picture tells where {percent:.0} % of the surface lies");
        let unresolved = |percent| {
            format!(
                "{percent:.0} % of the body is thinner than two cells of the grid, which does not resolve its bending"
            )
        };
        untold.map(guess).into_iter().chain(thin.map(unresolved)).collect()
    }
}

/// The filling of one frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameFilling {
    /// Number of the frame.
    pub frame: usize,
    /// Its time [s].
    pub time_s: f64,
    /// Volume of the body [m^3].
    pub volume_m3: f64,
    /// Gaussians that counted.
    pub gaussians: usize,
    /// Views that had a mask.
    pub views: usize,
    /// Points on the surface.
    pub surface_points: usize,
    /// Mean overlap of the re-rendered body with the frame's masks, intersection over union; `None` where no view
    /// has a mask.
    #[serde(default)]
    pub mask_iou: Option<f64>,
}

/// The Gaussian-informed continuum at the first frame, and the surface in every frame.
pub struct Continuum {
    /// What filling found.
    pub summary: FillSummary,
    /// The particles.
    pub particles: Particles,
    /// How they are drawn.
    pub appearance: Appearance,
    /// The surface in every frame.
    pub surfaces: Vec<Surface>,
    /// How the stage `refine` settled the body; `None` of one that filling made.
    refined: Option<AcrossTime>,
    /// Side of a cell of the grid to simulate it on [m]: of the fit that refined it, or twice the distance of the
    /// particles.
    pub(super) grid_spacing_m: f64,
}

impl Continuum {
    /// How far the surface is off where it is not in doubt, as a standard deviation [m]; `None` where nothing has
    /// measured it.
    pub(super) fn surface_error_m(&self) -> Option<f64> {
        self.refined.map(|settled| settled.gap_after_m).filter(|gap_m| *gap_m > 0.0)
    }
}

/// Points on the surface of a body.
#[derive(Clone, Debug, Default)]
pub struct Surface {
    /// Positions [m], shape [n].
    pub points: Vec<DVec3>,
    /// How much each is in doubt, in [0, 1], shape [n]: 1 where no view sees the surface.
    pub doubts: Vec<f32>,
}

/// Name of the file of a frame's surface, inside the run folder.
pub(crate) fn surface_file(frame: usize) -> PathBuf {
    format!("surface/{frame:04}.ply").into()
}

/// Name of the file of a frame's matter, inside the run folder.
pub(crate) fn filling_file(frame: usize) -> PathBuf {
    format!("filling/{frame:04}.ply").into()
}

impl Run<'_> {
    pub(super) fn fill(&self) -> Result<()> {
        let input = self.fill_input()?;
        let (size, mut settings) = self.fill_settings(&input)?;
        let mut spacing = self.config.fill.particle_spacing_m;
        for folder in ["surface", "filling"] {
            atomic::create_folder(&self.path(folder))?;
        }
        let mut frames = Vec::new();
        let (mut first, mut filler) = (None::<FirstBody>, self.frame_filler());
        let count = input.frames();
        for (frame, &time_s) in input.scene.times[..count].iter().enumerate() {
            self.check_interrupt(Stage::Fill)?;
            let masks = input.masks(frame)?;
            let views = input.masked_views(frame, &masks);
            let filling = filler.next(&input, frame, &views, &settings)?;
            let spacing =
                *spacing.get_or_insert_with(|| self.particle_spacing(size, &filling, &settings.tuning.particles));
            let tuning = &settings.tuning;
            let place = |spacing| match frame {
                0 => sample_particles(&filling, spacing, &tuning.particles),
                // Only the first frame's particles are simulated and need volumes of their own.
                _ => sample_points(&filling, spacing),
            };
            let particles = place(spacing).map_err(Error::filling(frame))?;
            let points = place(tuning.particles.drawing_spacing * spacing).map_err(Error::filling(frame))?;
            let surface_points = self.write_frame(frame, &filling, &particles)?;
            let drawn = match &first {
                Some(first) => first.drawn,
                None => calibrate(&points, &views, tuning).map_err(Error::filling(frame))?,
            };
            let volume_m3 = filling.volume();
            let ious = overlaps(&compare_with_masks(&points, &drawn, &views));
            frames.push(FrameFilling {
                frame,
                time_s,
                volume_m3,
                gaussians: filling.gaussians_used,
                views: filling.views_used,
                surface_points,
                mask_iou: mean_overlap(&ious),
            });
            let values = [("volume_m3", volume_m3), ("surface_points", surface_points as f64)];
            self.events.step(Stage::Fill.name(), "", frame as u64 + 1, Some(count as u64), &values);
            if frame == 0 {
                let appearance = calibrate(&particles, &views, tuning).map_err(Error::filling(frame))?;
                let thin_share = thin_share(&filling, &particles, tuning);
                first = Some(FirstBody { particles, appearance, drawn, mask_iou: ious, thin_share });
                // More is seen of a body in the air than of one on the ground.
                settings.volume = Some(volume_m3);
            }
        }
        let Some(FirstBody { particles, appearance, drawn, mask_iou, thin_share }) = first else {
            return Err(Error::Usage { problem: "the scene has no frames".into(), hint: None });
        };
        write_body(&self.path("continuum.ply"), &particles)?;
        let planes = filler.symmetry().map_or(&[][..], |symmetry| {
            self.events.note(Stage::Fill.name(), filler.symmetry_summary(symmetry));
            &symmetry.planes
        });
        let mean = mean_overlap(&mask_iou).unwrap_or_default();
        self.events.note(
            Stage::Fill.name(),
            format!(
                "{} particles; re-rendered masks at the first frame agree to {mean:.4} (IoU)",
                particles.positions.len()
            ),
        );
        let summary = FillSummary {
            object_size_m: size,
            voxel_spacing_m: settings.finest_spacing(),
            particle_spacing_m: particles.spacing,
            particle_volume_m3: particles.volume,
            particles: particles.positions.len(),
            thin_share: Some(thin_share),
            told_share: None,
            splat_scale: appearance.scale,
            splat_opacity: appearance.opacity,
            drawing_scale: drawn.scale,
            mask_iou,
            mirror_planes: planes.to_vec(),
            outline_frames: filler.outline_frames(),
            frames,
        };
        Ok(atomic::write_json(&self.path("fill.json"), &summary)?)
    }

    /// Distance of neighbouring particles [m]: two a grid cell along each axis, for the object as filled at the first
    /// frame.
    fn particle_spacing(&self, size: f64, filling: &Filling, tuning: &ParticleTuning) -> f64 {
        let spacing = tuning.spacing * round_length(filling.volume().cbrt() / tuning.cells_across);
        let voxels = 1e3 * filling.field.spacing;
        let text = format!("object {size:.3} m, finest voxels {voxels:.2} mm, particles {:.2} mm apart", 1e3 * spacing);
        self.events.note(Stage::Fill.name(), text);
        spacing
    }

    /// The finer points to draw the continuum with, and how they are drawn.
    ///
    /// # Errors
    /// Those of filling.
    pub fn drawing(&self, continuum: &Continuum) -> Result<(Drawing, Appearance)> {
        let filling = if continuum.refined.is_some() { self.refined_filling()? } else { self.first_filling()? };
        let tuning = &self.config.fill.tuning.particles;
        let spacing = tuning.drawing_spacing * continuum.particles.spacing;
        let drawing = Drawing::new(&filling, &continuum.particles, spacing, tuning).map_err(Error::filling(0))?;
        Ok((drawing, Appearance { scale: continuum.summary.drawing_scale, ..continuum.appearance }))
    }

    /// Fills the first frame again.
    pub(super) fn first_filling(&self) -> Result<Filling> {
        let input = self.fill_input()?;
        let masks = input.masks(0)?;
        let (_, settings) = self.fill_settings(&input)?;
        self.frame_filler().next(&input, 0, &input.masked_views(0, &masks), &settings)
    }

    fn frame_filler(&self) -> FrameFiller {
        FrameFiller::new(self.config.fill.symmetry)
    }

    /// The largest side of the object at the first frame [m], and how it is filled.
    fn fill_settings(&self, input: &FillInput) -> Result<(f64, FillSettings)> {
        let (size, pixel) = size_and_pixel(input)?;
        Ok((size, self.config.fill.for_body((size, pixel), self.scene.world.ground)))
    }

    /// The masks of a frame, in the order of its views.
    pub(super) fn masks(&self, frame: usize) -> Result<Vec<Mask>> {
        self.scene.load_masks(self.scene.views_at(frame)).map_err(Error::stage("reading masks"))
    }

    fn write_frame(&self, frame: usize, filling: &Filling, particles: &Particles) -> Result<usize> {
        let surface = filling.surface_mesh().sample(particles.spacing, self.config.seed);
        let rows = surface.iter().map(|p| {
            let ([x, y, z], [nx, ny, nz]) = (p.position.as_vec3().to_array(), p.normal.as_vec3().to_array());
            [x, y, z, nx, ny, nz, filling.doubt_of_surface(p.position)]
        });
        write_particles(&self.path(surface_file(frame)), ["x", "y", "z", "nx", "ny", "nz", "doubt"], rows)?;
        let rows = particles.positions.iter().map(|p| p.as_vec3().to_array());
        write_particles(&self.path(filling_file(frame)), ["x", "y", "z"], rows)?;
        Ok(surface.len())
    }

    /// The body as well as it is known: as refined, where it is.
    ///
    /// # Errors
    /// Missing or damaged files.
    pub fn continuum(&self) -> Result<Continuum> {
        if !self.refines() {
            return self.filled();
        }
        let record = self.refined()?;
        let continuum = self.continuum_of(record.summary, &self.path(REFINED))?;
        Ok(Continuum { refined: Some(record.settled), grid_spacing_m: record.grid_spacing_m, ..continuum })
    }

    /// The result of filling.
    ///
    /// # Errors
    /// Missing or damaged files.
    pub(crate) fn filled(&self) -> Result<Continuum> {
        self.continuum_of(atomic::read_json(&self.path("fill.json"))?, &self.folder)
    }

    fn continuum_of(&self, summary: FillSummary, folder: &Path) -> Result<Continuum> {
        let ply = read_particles(&folder.join("continuum.ply"))?;
        let particles = Particles {
            positions: ply.positions,
            volume: summary.particle_volume_m3,
            volume_factors: ply.volume_factors.iter().map(|f| if f.is_nan() { 1.0 } else { *f as f32 }).collect(),
            densities: ply.densities,
            surface: ply.surface.iter().map(|s| *s > 0.5).collect(),
            doubts: known_doubts(&ply.doubts),
            spacing: summary.particle_spacing_m,
        };
        let appearance = Appearance { scale: summary.splat_scale, opacity: summary.splat_opacity };
        let surfaces = summary
            .frames
            .iter()
            .map(|frame| {
                let ply = read_particles(&self.path(surface_file(frame.frame)))?;
                Ok(Surface { doubts: known_doubts(&ply.doubts), points: ply.positions })
            })
            .collect::<Result<_>>()?;
        let grid_spacing_m = 2.0 * particles.spacing;
        Ok(Continuum { summary, particles, appearance, surfaces, refined: None, grid_spacing_m })
    }
}

/// Doubts as read from a file; 0 where the file has none.
fn known_doubts(read: &[f32]) -> Vec<f32> {
    read.iter().map(|d| if d.is_nan() { 0.0 } else { *d }).collect()
}

/// Largest side of the box around the visual hull at the first frame, and how wide a pixel is there, the median of the
/// cameras [m].
fn size_and_pixel(input: &FillInput) -> Result<(f64, f64)> {
    let masks = input.masks(0)?;
    let views: Vec<HullView> =
        input.cameras(0).iter().zip(&masks).map(|(camera, mask)| HullView { camera, mask }).collect();
    let hull = Hull::carve(&views, &HullSettings::default()).ok_or_else(|| Error::Usage {
        problem: "the masks of the first frame have no common visual hull".into(),
        hint: Some("look at the scene with `gic inspect`: masks are empty, or camera poses do not fit them".into()),
    })?;
    let (low, high) = hull.bounds();
    let pixel = |camera: &Camera| camera.to_camera(0.5 * (low + high)).z / camera.focal.min_element();
    let mut pixels: Vec<f64> = input.cameras(0).iter().map(pixel).collect();
    pixels.sort_by(f64::total_cmp);
    Ok(((high - low).max_element(), pixels[pixels.len() / 2]))
}

/// Writes the particles of a body at time 0 with their attributes.
pub(super) fn write_body(path: &Path, particles: &Particles) -> Result<()> {
    let rows = (0..particles.positions.len()).map(|i| {
        let [x, y, z] = particles.positions[i].as_vec3().to_array();
        let [density, factor, doubt] = [particles.densities[i], particles.volume_factors[i], particles.doubts[i]];
        [x, y, z, density, f32::from(particles.surface[i]), factor, doubt]
    });
    Ok(write_particles(path, ["x", "y", "z", "density", "surface", "volume_factor", "doubt"], rows)?)
}

/// Mean overlap of the views that have a mask; `None` where none has.
pub(super) fn mean_overlap(overlaps: &[f64]) -> Option<f64> {
    (!overlaps.is_empty()).then(|| overlaps.iter().sum::<f64>() / overlaps.len() as f64)
}

/// Overlaps of the views that have a mask.
pub(super) fn overlaps(agreements: &[Option<Agreement>]) -> Vec<f64> {
    agreements.iter().flatten().map(|agreement| agreement.iou).collect()
}

/// Share of the particles in parts that are thinner than two cells of the simulation's grid.
pub(super) fn thin_share(filling: &Filling, particles: &Particles, tuning: &Tuning) -> f64 {
    filling.thin_share(&particles.positions, 2.0 * particles.spacing / tuning.particles.spacing)
}

/// The nearest of the round numbers ... 0.01, 0.015, 0.02, 0.03, 0.05, 0.07, 0.1 ... [m], by ratio. Grid nodes lie on
/// multiples of the spacing, and most grounds at zero or at round heights, so that the plane lies on nodes.
fn round_length(length: f64) -> f64 {
    let decade = 10f64.powf(length.log10().floor());
    let distance = |candidate: &f64| (candidate / length).ln().abs();
    let candidates = [1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0].map(|m| m * decade);
    candidates.into_iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(length)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_round_by_ratio() {
        for (length, round) in [
            (0.0221, 0.02),
            (0.0249, 0.03),
            (0.0163, 0.015),
            (0.034, 0.03),
            (0.0075, 0.007),
            (0.0096, 0.01),
            (1.2, 1.0),
        ] {
            assert!((round_length(length) / round - 1.0).abs() < 1e-12, "{length} to {}", round_length(length));
        }
    }
}
