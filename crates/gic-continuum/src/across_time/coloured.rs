//! A picture ready to be compared with others, and which places of the surface it shows.

use gic_scene::{Camera, Picture};
use glam::{DVec2, DVec3, Vec3};

use super::MomentView;
use super::curve::{AtDepths, SeenColours};
use crate::evidence::pixel_index;
use crate::tuning::Tuning;

/// A picture ready to be compared with others.
pub(super) struct Coloured<'a> {
    camera: &'a Camera,
    picture: &'a Picture,
    /// What the squared difference of each colour from the others may be: its noise, and how much it changes within
    /// the error of its place.
    variance: Vec<Vec3>,
    /// Pixels well within the outline.
    own: Vec<bool>,
}

impl Coloured<'_> {
    /// What a `view` saw, of which the `picture` is compared; `error_px` is how far what it shows may be from where it
    /// is looked for, as a standard deviation, and `noise` that of a colour.
    pub(super) fn new<'a>(
        view: &'a MomentView,
        picture: &'a Picture,
        (error_px, noise): (f32, f32),
        tuning: &Tuning,
    ) -> Coloured<'a> {
        let (width, height) = (picture.width, picture.height);
        let colour = |x: usize, y: usize| Vec3::from_array(picture.at(x, y));
        let near = |x: usize, n: usize| x.saturating_sub(1)..=(x + 1).min(n - 1);
        let slope = |x: usize, y: usize| {
            let (xs, ys) = (near(x, width), near(y, height));
            let along = colour(*xs.end(), y) - colour(*xs.start(), y);
            let across = colour(x, *ys.end()) - colour(x, *ys.start());
            0.25 * (along * along + across * across)
        };
        let slopes: Vec<Vec3> = (0..width * height).map(|i| slope(i % width, i / width)).collect();
        let around = |i: usize| {
            let (x, y) = (i % width, i / width);
            near(y, height).flat_map(move |y| near(x, width).map(move |x| y * width + x))
        };
        let steepest = |i: usize| around(i).map(|k| slopes[k]).fold(Vec3::ZERO, Vec3::max);
        let covered = 1.0 - tuning.iterations.tolerance as f32;
        let is_covered = |i: usize| view.mask.coverage[i] > covered;
        Coloured {
            camera: &view.camera,
            picture,
            variance: (0..width * height)
                .map(|i| Vec3::splat(noise * noise) + error_px * error_px * steepest(i))
                .collect(),
            own: (0..width * height).map(|i| around(i).all(is_covered)).collect(),
        }
    }

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
        let (i, _, depth) = self.pixel(point)?;
        let towards = (self.camera.centre - point).normalize_or_zero();
        let seen = self.own[i]
            && depth < f64::from(depths[i]) + visibility.depth
            && normal.dot(towards) > visibility.least_cosine;
        let mut colours = outward.map(|_| Vec3::ZERO);
        for (colour, distance) in colours.iter_mut().zip(outward).filter(|_| seen) {
            let (i, at, _) = self.pixel(point + *distance * normal)?;
            if !self.own[i] {
                return None;
            }
            *colour = Vec3::from_array(self.picture.sample(at.x, at.y)?);
        }
        seen.then_some(SeenColours { colours, variance: self.variance[i] })
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
