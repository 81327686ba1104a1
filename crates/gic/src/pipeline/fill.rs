//! The stage `fill`: Gaussians to matter, for every frame of the video.

use std::path::Path;

use gic_continuum::{
    Agreement, Appearance, Filling, ParticleTuning, Particles, Tuning, calibrate, compare_with_masks, sample_particles,
    sample_points,
};
use gic_scene::{Camera, Hull, HullSettings, HullView, Mask};
use gic_twin::atomic;
use gic_twin::matter::write_particles;

use super::continuum::{filling_file, surface_file};
use super::field::{FIELD_FILE, FieldGrid, write_field};
use super::fill_input::FillInput;
use super::fill_summary::{FillSummary, FrameFilling};
use super::frame_filler::FrameFiller;
use super::{Run, Stage};
use crate::error::{Error, Result};

/// The body of the first frame, which is simulated.
struct FirstBody {
    particles: Particles,
    appearance: Appearance,
    /// How its finer points are drawn.
    drawn: Appearance,
    mask_iou: Vec<f64>,
    thin_share: f64,
    field: FieldGrid,
}

impl Run<'_> {
    pub(super) fn fill(&self) -> Result<()> {
        let input = self.fill_input()?;
        let (size, pixel) = size_and_pixel(&input)?;
        let mut settings = self.config.fill.for_body((size, pixel), self.scene.world.ground);
        let mut spacing = self.config.fill.particle_spacing_m;
        for folder in ["surface", "filling"] {
            atomic::create_folder(&self.path(folder))?;
        }
        let mut frames = Vec::new();
        let (mut first, mut filler) = (None::<FirstBody>, FrameFiller::new(self.config.fill.symmetry));
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
                write_field(&self.path("filling").join(FIELD_FILE), &filling)?;
                let field = FieldGrid::of(&filling.field);
                first = Some(FirstBody { particles, appearance, drawn, mask_iou: ious, thin_share, field });
                // More is seen of a body in the air than of one on the ground.
                settings.volume = Some(volume_m3);
            }
        }
        let Some(FirstBody { particles, appearance, drawn, mask_iou, thin_share, field }) = first else {
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
            is_by_outlines: filler.is_by_outlines(),
            field,
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
    filling.thin_share(&particles.positions, tuning.particles.resolved(particles.spacing))
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
