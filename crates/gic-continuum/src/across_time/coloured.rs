//! Which places of the surface a view shows, and in which colours.

use gic_scene::Camera;
use glam::{DVec2, DVec3, Vec3};

use super::colours::ShadeFree;
use super::curve::{AtDepths, SeenColours};
use crate::evidence::pixel_index;

/// What a view shows of the body.
pub(super) struct Coloured<'a> {
    pub(super) camera: &'a Camera,
    pub(super) picture: &'a ShadeFree,
    /// How far what it shows may be from where it is looked for, as a standard deviation [pixels].
    pub(super) error_px: f32,
    /// Standard deviation of a colour.
    pub(super) noise: f32,
}

impl Coloured<'_> {
    /// The pixel that shows a point [m], where in the picture that is, and its depth [m].
    fn pixel(&self, point: DVec3) -> Option<(usize, DVec2, f64)> {
        let (at, depth) = self.camera.project(point)?;
        Some((pixel_index(self.camera, at)?, at, depth))
    }

    /// Depth of the nearest of `points` [m] in each pixel, each as large as a voxel of side `spacing` [m].
    pub(super) fn depths(&self, points: &[DVec3], spacing: f64) -> Vec<f32> {
        let camera = self.camera;
        let mut depths = vec![f32::INFINITY; camera.width * camera.height];
        for point in points {
            let Some((_, at, depth)) = self.pixel(*point) else { continue };
            let half_width = (0.5 * spacing * camera.focal.x / depth).round() as usize;
            let (x, y) = (at.x as usize, at.y as usize);
            for y in y.saturating_sub(half_width)..(y + half_width + 1).min(camera.height) {
                for x in x.saturating_sub(half_width)..(x + half_width + 1).min(camera.width) {
                    let nearest = &mut depths[y * camera.width + x];
                    *nearest = nearest.min(depth as f32);
                }
            }
        }
        depths
    }

    /// What this view shows of a place [m] moved by each of `outward` [m] along its normal; `None` where it does not
    /// see it, and where any of these lies beside what it shows of the body: the background's colour tells nothing, and
    /// depths that fewer views show look better or worse by chance.
    pub(super) fn along_normal(
        &self,
        (point, normal): (DVec3, DVec3),
        depths: &[f32],
        visibility: &Visibility,
        outward: &AtDepths<f64>,
    ) -> Option<SeenColours> {
        let towards = (self.camera.centre - point).normalize_or_zero();
        if normal.dot(towards) <= visibility.least_cosine {
            return None;
        }
        let (i, _, depth) = self.pixel(point)?;
        let ShadeFree { picture, steepest, own, .. } = self.picture;
        if !own[i] || depth >= f64::from(depths[i]) + visibility.depth {
            return None;
        }
        let mut colours = outward.map(|_| Vec3::ZERO);
        for (colour, distance) in colours.iter_mut().zip(outward) {
            let (i, at, _) = self.pixel(point + *distance * normal)?;
            if !own[i] {
                return None;
            }
            *colour = Vec3::from_array(picture.sample(at.x, at.y)?);
        }
        // Its noise, and how much it changes within the error of its place.
        let variance = Vec3::splat(self.noise * self.noise) + self.error_px * self.error_px * steepest[i];
        Some(SeenColours { colours, variance })
    }
}

/// Which places of the surface a camera sees.
#[derive(Clone, Copy)]
pub(super) struct Visibility {
    /// How far behind what is nearest they may lie [m].
    pub(super) depth: f64,
    /// Least cosine between their normal and the direction to the camera.
    pub(super) least_cosine: f64,
}
