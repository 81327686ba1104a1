//! Where each place of the surface has the same colour in all moments that show it.
//!
//! The light on a place changes as it turns: it scales the colour, and the direction in the space of colours stays. So
//! directions are compared.

use std::ops::RangeInclusive;

use gic_scene::Picture;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::coloured::{Coloured, Visibility};
use super::curve::{AtDepths, Curve, DEPTH_STEP, SeenColours, deeper, depths};
use super::tracked::TrackedSurface;
use super::unit::Unit;
use super::{Moment, MomentView, SeenMoment, robust_deviation};
use crate::tuning::Tuning;

/// Below this brightness a colour has no direction. Derived: a few steps of eight bits.
const DARK: f32 = 0.05;

/// A picture without its shades, ready to be compared with others.
pub(super) struct ShadeFree {
    pub(super) picture: Picture,
    /// Standard deviation of its colours' noise, which is larger the darker they were.
    noise: f32,
    /// The steepest slope of the colours within a pixel of each, squared [1/pixel^2].
    pub(super) steepest: Vec<Vec3>,
    /// Pixels well within the outline.
    pub(super) own: Vec<bool>,
}

impl ShadeFree {
    pub(super) fn new(view: &MomentView, tuning: &Tuning) -> ShadeFree {
        let rgb = view.picture.rgb.chunks_exact(3).flat_map(|c| {
            let colour = Vec3::from_slice(c);
            (colour / colour.length().max(DARK)).to_array()
        });
        let (width, height) = (view.picture.width, view.picture.height);
        let picture = Picture { width, height, rgb: rgb.collect() };
        let around = |i: usize| {
            let (x, y) = (i % width, i / width);
            near(y, height).flat_map(move |y| near(x, width).map(move |x| y * width + x))
        };
        let slopes: Vec<Vec3> = (0..width * height).map(|i| squared_slope(&picture, i)).collect();
        let steepest = |i: usize| around(i).map(|k| slopes[k]).fold(Vec3::ZERO, Vec3::max);
        let covered = 1.0 - tuning.iterations.tolerance as f32;
        let is_covered = |i: usize| view.mask.coverage[i] > covered;
        ShadeFree {
            noise: noise(&picture, &view.mask.coverage),
            steepest: (0..width * height).map(steepest).collect(),
            own: (0..width * height).map(|i| around(i).all(is_covered)).collect(),
            picture,
        }
    }
}

/// A pixel of `count` in a row, and those beside it.
fn near(at: usize, count: usize) -> RangeInclusive<usize> {
    at.saturating_sub(1)..=(at + 1).min(count - 1)
}

/// By differences of the pixels beside it.
fn squared_slope(picture: &Picture, i: usize) -> Vec3 {
    let (x, y) = (i % picture.width, i / picture.width);
    let colour = |x: usize, y: usize| Vec3::from_array(picture.at(x, y));
    let (xs, ys) = (near(x, picture.width), near(y, picture.height));
    let along = colour(*xs.end(), y) - colour(*xs.start(), y);
    let across = colour(x, *ys.end()) - colour(x, *ys.start());
    0.25 * (along * along + across * across)
}

/// Standard deviation of the noise of a picture's colours where it is covered: of white noise, second differences have
/// six times its variance. A smooth texture has none.
fn noise(picture: &Picture, coverage: &[f32]) -> f32 {
    let inner = (1..picture.height * picture.width).filter(|i| (1..picture.width - 1).contains(&(i % picture.width)));
    let colour = |i: usize| Vec3::from_slice(&picture.rgb[3 * i..]);
    let covered = inner.filter(|i| coverage[i - 1].min(coverage[*i]).min(coverage[i + 1]) > 0.99);
    let bends = covered.flat_map(|i| (colour(i - 1) - 2.0 * colour(i) + colour(i + 1)).abs().to_array());
    robust_deviation(bends.map(f64::from).collect()).map_or(0.0, |deviation| (deviation / 6f64.sqrt()) as f32)
}

/// The pictures of a moment, and its surface as they see it.
struct MomentColours<'a> {
    views: Vec<Coloured<'a>>,
    /// Depth of what is nearest in each pixel of each view [m].
    depths: Vec<Vec<f32>>,
    /// The places of the surface, moved [m], and their normals.
    places: Vec<(DVec3, DVec3)>,
    /// How much longer a way along each normal has become.
    stretch: Vec<f64>,
    /// How many times as uncertain each place's colours are because of its deformation.
    inflation: Vec<f32>,
}

impl<'a> MomentColours<'a> {
    /// `error_px` is how far the moment's motion errs, `voxel_m` the side of the field's voxels.
    fn new(
        seen: &SeenMoment,
        (moment, pictures): (&'a Moment, &'a [ShadeFree]),
        error_px: f64,
        voxel_m: f64,
        tuning: &Tuning,
    ) -> Self {
        let mesh = &seen.surface.mesh;
        let error_px = error_px.hypot(0.5) as f32;
        let coloured = |(view, picture): (&'a MomentView, &'a ShadeFree)| {
            let noise = picture.noise.max(tuning.across_time.colour_noise);
            Coloured { camera: &view.camera, picture, error_px, noise }
        };
        let views: Vec<Coloured> = moment.views.iter().zip(pictures).map(coloured).collect();
        let depths = views.iter().map(|view| view.depths(&mesh.vertices, voxel_m)).collect();
        let places = mesh.vertices.iter().copied().zip(mesh.normals.iter().copied()).collect();
        let stretch = seen.surface.outward.iter().zip(&mesh.normals).map(|(out, normal)| out.dot(*normal)).collect();
        let inflation = seen.surface.deformation.iter().map(|deformation| {
            let ratio = tuning.across_time.deformation_error * deformation / seen.motion_error;
            (1.0 + ratio * ratio) as f32
        });
        MomentColours { views, depths, places, stretch, inflation: inflation.collect() }
    }

    /// What its views show of a place, moved by each of `outward` [m].
    fn of(
        &self,
        vertex: usize,
        outward: &AtDepths<f64>,
        visibility: &Visibility,
    ) -> impl Iterator<Item = SeenColours> + '_ {
        let (place, stretch, inflation) = (self.places[vertex], self.stretch[vertex], self.inflation[vertex]);
        let (outward, visibility) = (outward.map(|distance| stretch * distance), *visibility);
        self.views.iter().zip(&self.depths).filter_map(move |(view, depths)| {
            let seen = view.along_normal(place, depths, &visibility, &outward)?;
            Some(SeenColours { variance: inflation * seen.variance, ..seen })
        })
    }
}

/// How far outward each place wants to be by its colours, and with which weight, in units.
pub(super) fn wanted_by_colours(
    surface: &TrackedSurface,
    seen: &[SeenMoment],
    moments: &[Moment],
    pictures: &[Vec<ShadeFree>],
    (unit, tuning): (&Unit, &Tuning),
) -> Vec<(f64, f64)> {
    let colours: Vec<MomentColours> = (seen.par_iter().zip(moments).zip(pictures))
        .map(|((seen, moment), pictures)| {
            // The surface may lie between two depths, half a step from either.
            let error_px = seen.motion_error.hypot(0.5 * DEPTH_STEP * unit.m) / seen.pixel;
            MomentColours::new(seen, (moment, pictures), error_px, unit.voxel_m(), tuning)
        })
        .collect();
    let depths = depths(unit.m);
    // What lies no deeper than places share in a move is seen as well as what is nearest.
    let visibility =
        Visibility { depth: unit.voxel_m() * tuning.across_time.reach(), least_cosine: tuning.facing_cosine };
    let own = |vertex: usize| -> Curve {
        let all = colours.iter().flat_map(|moment| moment.of(vertex, &depths, &visibility));
        Curve::of(&all.collect::<Vec<SeenColours>>())
    };
    let own: Vec<Curve> = (0..surface.adjacent.len()).into_par_iter().map(own).collect();
    let around = |vertex: usize| {
        let others = surface.adjacent[vertex].iter().map(|other| own[*other]);
        Curve::mean(std::iter::once(own[vertex]).chain(others))
    };
    let curves: Vec<Curve> = (0..own.len()).into_par_iter().map(around).collect();
    // A motion that errs makes colours differ, too. At the finest depths what is left lies within their reach.
    let may_be_deeper = !unit.is_finest() && moments.iter().all(|moment| moment.flies);
    let deeper = if may_be_deeper { deeper(&curves) } else { vec![0.0; curves.len()] };
    curves.par_iter().zip(deeper).map(|(curve, deeper)| curve.surface(deeper)).collect()
}
