//! A picture ready to be compared with others, and which places of the surface it shows.

use gic_scene::{Camera, Picture};
use glam::{DVec2, DVec3, Vec3};

use super::place::Place;
use crate::evidence::pixel_index;
use crate::tuning::Tuning;

/// A camera and its picture of the body in one moment.
#[derive(Clone, Copy, Debug)]
pub struct ColouredView<'a> {
    /// The camera; of another moment, moved to where it would have seen the body as it lies.
    pub camera: &'a Camera,
    /// Its picture.
    pub picture: &'a Picture,
    /// Coverage of the object in [0, 1], row-major, shape [height * width].
    pub mask: &'a [f32],
    /// Colours of different moments are not compared: the light is another one.
    pub moment: usize,
}

/// A picture ready to be compared with others.
pub(crate) struct Coloured<'a> {
    pub(super) view: &'a ColouredView<'a>,
    /// What the squared difference of each colour from the others may be: its noise, and how much it changes within
    /// the error of its place.
    variance: Vec<Vec3>,
    /// Pixels well within the outline.
    own: Vec<bool>,
}

impl Coloured<'_> {
    /// `error_px` is how far what the picture shows may be from where it is looked for, as a standard deviation, and
    /// `noise` that of a colour.
    pub(crate) fn new<'a>(view: &'a ColouredView<'a>, error_px: f32, noise: f32, tuning: &Tuning) -> Coloured<'a> {
        let (width, height) = (view.camera.width, view.camera.height);
        let colour = |x: usize, y: usize| Vec3::from_array(view.picture.at(x, y));
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
        Coloured {
            view,
            variance: (0..width * height)
                .map(|i| Vec3::splat(noise * noise) + error_px * error_px * steepest(i))
                .collect(),
            own: (0..width * height).map(|i| around(i).all(|k| view.mask[k] > covered)).collect(),
        }
    }

    /// The pixel that shows a point [m], where in the picture that is, and its depth [m].
    fn pixel(&self, point: DVec3) -> Option<(usize, DVec2, f64)> {
        let camera = self.view.camera;
        let (at, depth) = camera.project(point)?;
        Some((pixel_index(camera, at)?, at, depth))
    }

    /// Depth of the nearest of `points` [m] in each pixel, each as large as a voxel of side `spacing` [m].
    pub(crate) fn depths(&self, points: &[Place], spacing: f64) -> Vec<f32> {
        let camera = self.view.camera;
        let mut depths = vec![f32::INFINITY; camera.width * camera.height];
        for place in points {
            let Some((_, at, depth)) = self.pixel(place.point) else { continue };
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

    /// Colours of a place moved by each of `outward` [m] along its normal, and their variance; `None` where this view
    /// does not see it, and where any of these lies beside what it shows of the body: the background's colour tells
    /// nothing, and depths that fewer views show look better or worse by chance.
    pub(crate) fn colours_along_normal<const N: usize>(
        &self,
        place: &Place,
        depths: &[f32],
        visibility: &Visibility,
        outward: &[f64; N],
    ) -> Option<([Vec3; N], Vec3)> {
        let (i, _, depth) = self.pixel(place.point)?;
        let towards = (self.view.camera.centre - place.point).normalize_or_zero();
        let seen = self.own[i]
            && depth < f64::from(depths[i]) + visibility.depth
            && place.normal.dot(towards) > visibility.least_cosine;
        let mut colours = [Vec3::ZERO; N];
        for (colour, distance) in colours.iter_mut().zip(outward).filter(|_| seen) {
            let (i, at, _) = self.pixel(place.point + *distance * place.normal)?;
            if !self.own[i] {
                return None;
            }
            *colour = Vec3::from_array(self.view.picture.sample(at.x, at.y)?);
        }
        seen.then_some((colours, self.variance[i]))
    }
}

/// Which places of the surface a camera sees.
#[derive(Clone, Copy)]
pub(crate) struct Visibility {
    /// How far behind what is nearest they may lie [m].
    pub(crate) depth: f64,
    /// Least cosine between their normal and the direction to the camera.
    pub(crate) least_cosine: f64,
}
