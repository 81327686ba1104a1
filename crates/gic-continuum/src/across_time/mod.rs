//! The shape of the first moment, by the pictures of all moments.
//!
//! Once the motion is known, every moment is a view of one body: one that tumbles shows three cameras dozens of sides
//! (shape from silhouette across time: Cheung, Baker & Kanade 2005). The motion comes from a simulation that was fitted
//! to the video with the shape as it was known before, so it errs, too. What lies outside of the [`hull`] of all
//! moments is taken away first. Then, round by round:
//!
//! 1. [`tracked`] carries the surface through the motion, each place with the affine map of the particles around it.
//! 2. [`pose_fit`] lays the body of each moment after the flight into its outlines, for its turn is what errs most.
//! 3. [`contour`] finds the places that make the silhouettes' edges: the mask tells how far each lies off.
//! 4. [`colours`] tries each place at several depths: at the right one, all moments see the same colour there. What the
//!    [`curve`] of their differences says of the depth is its weight.
//! 5. Mirror images of a place, where the body has any, are further views of it: what is wanted of them is shared.
//! 6. Each place moves to where all want it, as far as its neighbours [`share`] in that; the field is carried along.
//!    Once depths are at their finest, strides have momentum.
//!
//! The depths lie as far apart as the surface is off, and half as far whenever it has settled, that is its steps shrink
//! no more or are finer than such depths resolve, and no place is further off: what stands out by a tenth of the body
//! differs in colour at all depths nearby, and agrees only further in.
//!
//! The last round is kept whose outlines miss by no more than those of any round, but for what an outline tells:
//! colours of a noisy film pull places about.
//!
//! An outline tells that the body touches a ray, not where. A place of a contour is told where all that makes the same
//! edge reaches no further along the ray than the grid resolves; colours tell places by themselves. What is told in no
//! moment is in doubt.
//!
//! How far a moment's outlines miss after its pose is fitted is the error of its motion: what a moment says counts by
//! that, so that no tolerance has to be given.

mod coloured;
mod colours;
mod contour;
mod curve;
mod displacement;
mod hull;
mod pose_fit;
mod share;
mod silhouette;
#[cfg(test)]
mod tests;
mod tracked;
mod unit;

use gic_geometry::{DensityField, Neighbours, Pose};
use gic_scene::{Camera, Mask, Picture};
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use self::colours::{ShadeFree, wanted_by_colours};
use self::contour::{ContourPoint, MomentOutlines, OUTLINE_ERROR_PX};
use self::displacement::Displacement;
use self::share::shared;
use self::silhouette::MARGIN_PX;
use self::tracked::{CarriedSurface, MovedSurface, TrackedSurface};
use self::unit::Unit;
use crate::{AcrossTimeTuning, Filling, Symmetry, Tuning};

/// One moment of a motion, and the pictures of it.
#[derive(Clone, Debug)]
pub struct Moment {
    /// Where the particles are [m], shape [n], in the order of the body's.
    pub positions: Vec<DVec3>,
    /// Whether nothing was touched before: then the pose is known.
    pub flies: bool,
    /// What the cameras saw.
    pub views: Vec<MomentView>,
}

/// What a camera saw of a moment.
#[derive(Clone, Debug)]
pub struct MomentView {
    /// The camera.
    pub camera: Camera,
    /// Its picture.
    pub picture: Picture,
    /// The body's coverage of it.
    pub mask: Mask,
}

impl MomentView {
    /// What a camera saw around a mask: the rest of the picture is cut away. `None` of an empty mask.
    pub fn around_mask(camera: &Camera, picture: &Picture, mask: &Mask) -> Option<MomentView> {
        let seen = mask.bounding_box()?;
        let (x0, y0) = (seen.x0.saturating_sub(MARGIN_PX), seen.y0.saturating_sub(MARGIN_PX));
        let (x1, y1) = ((seen.x1 + MARGIN_PX).min(mask.width), (seen.y1 + MARGIN_PX).min(mask.height));
        let (width, height) = (x1 - x0, y1 - y0);
        let cut = |values: &[f32], channels: usize| {
            let row = |y: usize| channels * (y * mask.width + x0)..channels * (y * mask.width + x1);
            (y0..y1).flat_map(|y| values[row(y)].iter().copied()).collect::<Vec<f32>>()
        };
        let principal = camera.principal - DVec2::new(x0 as f64, y0 as f64);
        Some(MomentView {
            camera: Camera { width, height, principal, ..camera.clone() },
            picture: Picture { width, height, rgb: cut(&picture.rgb, 3) },
            mask: Mask { width, height, coverage: cut(&mask.coverage, 1) },
        })
    }
}

/// How the shape of the first moment was settled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct AcrossTime {
    /// The round that was kept.
    pub rounds: usize,
    /// How far outlines were off, median over all moments, before [m].
    pub gap_before_m: f64,
    /// The same afterwards [m].
    pub gap_after_m: f64,
    /// Share of the surface that some moment's colours or outlines tell.
    pub seen: f64,
    /// How far the surface was moved, mean distance over it [m].
    pub moved_m: f64,
    /// How well an outline tells where the surface is, as a standard deviation [m].
    pub outline_error_m: f64,
}

impl AcrossTime {
    /// Whether the surface was moved by less than outlines tell: then a motion of the new body shows nothing new.
    pub fn is_settled(&self) -> bool {
        self.moved_m <= self.outline_error_m
    }
}

impl Filling {
    /// Moves the surface, which is some `off_m` off (infinitely where that is not known), to where the pictures of all
    /// `moments` want it; `particles` are those of the first moment [m], `spacing` apart, that the moments carry on,
    /// and `symmetry` its mirror planes. `None` where `stop` says so, and where nothing is seen.
    pub fn settle_across_time(
        &mut self,
        (particles, spacing): (&[DVec3], f64),
        (moments, off_m): (&[Moment], f64),
        symmetry: &Symmetry,
        tuning: &Tuning,
        stop: &dyn Fn() -> bool,
    ) -> Option<AcrossTime> {
        let observed = Observed::new(moments, (particles, spacing), tuning);
        let mut poses = vec![Pose::default(); moments.len()];
        let (_, seen, gap_before_m) = observed.look_at(self, &mut poses, true)?;
        let before = self.field.clone();
        hull::cut(self, &observed, &poses, &seen);
        let first = self.field.clone();
        let mut unit = Unit::new(off_m, first.spacing, tuning.iterations.most_rounds);
        let (mut moved, mut stride) = (Displacement::none(&first), Displacement::none(&first));
        let (mut least_gap_m, mut kept) = (f64::INFINITY, None);
        for round in 1..=tuning.iterations.most_rounds {
            if stop() {
                return None;
            }
            let Some((surface, seen, gap_after_m)) = observed.look_at(self, &mut poses, false) else { break };
            let by_colours = wanted_by_colours(&surface, &seen, moments, &observed.pictures, (&unit, tuning));
            let contours = seen.iter().flat_map(SeenMoment::points);
            let wanted = observed.wanted(&surface.mesh.vertices, (&by_colours, contours), symmetry, &unit);
            pose_fit::follow(&mut poses, moments, &seen);
            least_gap_m = gap_after_m.min(least_gap_m);
            let outline_error_m = OUTLINE_ERROR_PX * median(seen.iter().map(|seen| seen.pixel).collect())?;
            if gap_after_m <= least_gap_m.hypot(outline_error_m) {
                let moved_m = exchanged_m3(&before, &self.field) / surface.mesh.area();
                let report =
                    AcrossTime { rounds: round, gap_before_m, gap_after_m, seen: 0.0, moved_m, outline_error_m };
                let vertices = surface.mesh.vertices.clone();
                kept = Some(Kept { report, field: self.field.clone(), vertices, by_colours, seen });
            }
            let neighbour_deviation = tuning.across_time.neighbour_deviation * unit.fineness();
            let outward = shared(&surface.adjacent, &wanted, neighbour_deviation, tuning);
            let further = Displacement::of(&first, &surface.mesh, &outward, unit.m, &tuning.across_time);
            stride = further.after(&stride, unit.momentum());
            moved = moved.then(&stride);
            self.field.values = moved.carry(&first);
            if unit.settle(&outward).is_break() {
                break;
            }
        }
        let Some(kept) = kept else {
            self.field = before;
            return None;
        };
        let untold = observed.untold(&kept, symmetry, &unit);
        self.doubt = doubt_of_voxels(&kept.field, &kept.vertices, &untold);
        self.field = kept.field;
        Some(AcrossTime { seen: 1.0 - f64::from(untold.iter().sum::<f32>()) / untold.len() as f64, ..kept.report })
    }
}

/// The round that is kept, and what was seen in it.
struct Kept {
    report: AcrossTime,
    field: DensityField,
    vertices: Vec<DVec3>,
    by_colours: Vec<(f64, f64)>,
    seen: Vec<SeenMoment>,
}

/// The moments, ready to be compared with a body.
struct Observed<'a> {
    moments: &'a [Moment],
    outlines: Vec<MomentOutlines<'a>>,
    pictures: Vec<Vec<ShadeFree>>,
    /// Particles of the first moment [m], which the moments carry on.
    particles: &'a [DVec3],
    /// How far they are apart [m].
    spacing: f64,
    tuning: &'a Tuning,
}

impl<'a> Observed<'a> {
    fn new(moments: &'a [Moment], (particles, spacing): (&'a [DVec3], f64), tuning: &'a Tuning) -> Observed<'a> {
        let shade_free = |moment: &Moment| moment.views.iter().map(|view| ShadeFree::new(view, tuning)).collect();
        Observed {
            moments,
            outlines: moments.par_iter().map(MomentOutlines::new).collect(),
            pictures: moments.par_iter().map(shade_free).collect(),
            particles,
            spacing,
            tuning,
        }
    }

    /// A body's surface, what is seen of it in each moment, and how far outlines miss, the median of the moments [m].
    /// At `is_first` the poses are fitted before. `None` where most moments show no outline of the body: they tell
    /// nothing of it.
    fn look_at(
        &self,
        body: &Filling,
        poses: &mut [Pose],
        is_first: bool,
    ) -> Option<(TrackedSurface, Vec<SeenMoment>, f64)> {
        let surface = TrackedSurface::new(body.surface_mesh(), self.particles, self.spacing);
        let carried: Vec<CarriedSurface> =
            self.moments.par_iter().map(|moment| surface.carried(&moment.positions)).collect();
        if is_first {
            pose_fit::first(poses, &carried, self.moments, &self.outlines);
        }
        let all = carried.par_iter().zip(poses).zip(&self.outlines);
        let mut seen: Vec<SeenMoment> =
            all.map(|((carried, pose), outlines)| SeenMoment::new(carried.moved(pose), outlines)).collect();
        find_errors_of_motion(&mut seen);
        let gap_m = median(seen.iter().map(|seen| seen.miss).collect()).filter(|gap| gap.is_finite())?;
        Some((surface, seen, gap_m))
    }

    /// How far outward each of `vertices` [m] wants to be by its colours and by points of contours, and with which
    /// weight, in units.
    fn wanted<'b>(
        &self,
        vertices: &[DVec3],
        (by_colours, contours): (&[(f64, f64)], impl Iterator<Item = (&'b SeenMoment, &'b ContourPoint)>),
        symmetry: &Symmetry,
        unit: &Unit,
    ) -> Vec<(f64, f64)> {
        let mut wanted = by_colours.to_vec();
        add_contours(&mut wanted, contours, (unit.m, &self.tuning.across_time));
        share_with_images(&mut wanted, vertices, symmetry, unit.voxel_m());
        wanted
    }

    /// 1 for each place of the surface that neither colours nor outlines tell in any moment, and 0 for the others.
    fn untold(&self, kept: &Kept, symmetry: &Symmetry, unit: &Unit) -> Vec<f32> {
        let told_m = self.tuning.particles.resolved(self.spacing);
        let telling = kept.seen.iter().flat_map(|moment| moment.telling(kept.field.spacing, told_m));
        let told = self.wanted(&kept.vertices, (&kept.by_colours, telling), symmetry, unit);
        told.iter().map(|(_, weight)| f32::from(u8::from(*weight <= 0.0))).collect()
    }
}

/// A moment's surface, and where its edges in the pictures lie.
struct SeenMoment {
    surface: MovedSurface,
    contour: Vec<ContourPoint>,
    /// How far outlines miss, as a standard deviation [m].
    miss: f64,
    /// The part of that which is not the shape's, but the motion's [m].
    motion_error: f64,
    /// Width of a pixel there [m].
    pixel: f64,
}

impl SeenMoment {
    fn new(surface: MovedSurface, outlines: &MomentOutlines) -> SeenMoment {
        let contour = outlines.contour(&surface);
        let pixel = outlines.pixel(&surface);
        let miss = contour::deviation(&contour, pixel);
        SeenMoment { miss, motion_error: miss, pixel, surface, contour }
    }

    /// The points of its contours.
    fn points(&self) -> impl Iterator<Item = (&SeenMoment, &ContourPoint)> {
        self.contour.iter().map(move |point| (self, point))
    }

    /// Those that tell where the surface is: points that lie within `reach_m` of the ray through one reach no further
    /// than `told_m` along it.
    fn telling(&self, reach_m: f64, told_m: f64) -> impl Iterator<Item = (&SeenMoment, &ContourPoint)> {
        let extents = contour::extents(&self.contour, reach_m / self.pixel);
        self.points().zip(extents).filter(move |(_, extent)| *extent <= told_m).map(|(point, _)| point)
    }
}

/// The shape is the same in all moments: what a moment misses by more than the best one is its motion's error.
fn find_errors_of_motion(seen: &mut [SeenMoment]) {
    let least = seen.iter().map(|moment| moment.miss).fold(f64::INFINITY, f64::min);
    for moment in seen {
        let outline = OUTLINE_ERROR_PX * moment.pixel;
        moment.motion_error = (moment.miss * moment.miss - least * least).max(0.0).sqrt().hypot(outline);
    }
}

/// Adds what contours want: each point of one is an observation of its place's displacement.
fn add_contours<'a>(
    wanted: &mut [(f64, f64)],
    contours: impl Iterator<Item = (&'a SeenMoment, &'a ContourPoint)>,
    (unit, tuning): (f64, &AcrossTimeTuning),
) {
    let mut sums = vec![(0.0, 0.0); wanted.len()];
    for (moment, point) in contours {
        let error = moment.motion_error.hypot(tuning.deformation_error * point.deformation);
        let weight = point.weight(moment.miss) * (unit / error).powi(2);
        let (sum, total) = &mut sums[point.vertex];
        // A displacement d along the normal moves the contour by `alignment` d towards the mask's outline.
        *sum += weight * point.alignment * point.gap / unit;
        *total += weight * point.alignment * point.alignment;
    }
    for ((at, weight), (sum, total)) in wanted.iter_mut().zip(sums).filter(|(_, (_, total))| *total > 0.0) {
        *at = (*weight * *at + sum) / (*weight + total);
        *weight += total;
    }
}

/// Adds to each of the `vertices` [m] what is wanted of its images by `symmetry`: of vertices within a voxel of side
/// `spacing` [m] of them.
fn share_with_images(wanted: &mut [(f64, f64)], vertices: &[DVec3], symmetry: &Symmetry, spacing: f64) {
    if symmetry.planes.is_empty() {
        return;
    }
    let (tree, images, own) = (Neighbours::new(vertices, spacing), symmetry.images(), wanted.to_vec());
    wanted.par_iter_mut().zip(vertices).for_each(|(wanted, vertex)| {
        let nearest = images.of(*vertex).map(|image| tree.nearest::<1>(image)[0]);
        let near = nearest.filter(|(squared, _)| *squared <= spacing * spacing).map(|(_, i)| own[i]);
        let (sum, total) = near.fold((0.0, 0.0), |(sum, total), (at, weight)| (sum + weight * at, total + weight));
        *wanted = (if total > 0.0 { sum / total } else { 0.0 }, total);
    });
}

/// How much each voxel of a body is in doubt: as much as the place of its surface that is nearest.
fn doubt_of_voxels(field: &DensityField, vertices: &[DVec3], doubts: &[f32]) -> Vec<f32> {
    let tree = Neighbours::new(vertices, field.spacing);
    let doubt = |i: usize| doubts[tree.nearest::<1>(field.centre(field.voxel(i)))[0].1];
    let is_full = |i: usize| field.values[i] > 0.0;
    (0..field.len()).into_par_iter().map(|i| if is_full(i) { doubt(i) } else { 0.0 }).collect()
}

/// How much matter lies elsewhere in one field than in the other [m^3]: of a surface that moves, its area times the
/// mean distance.
fn exchanged_m3(before: &DensityField, after: &DensityField) -> f64 {
    let pairs = before.values.iter().zip(&after.values);
    before.spacing.powi(3) * pairs.map(|(before, after)| f64::from((after - before).abs())).sum::<f64>()
}

/// Standard deviation of Gaussian numbers of these absolute values, robustly; `None` of nothing.
fn robust_deviation(absolute: Vec<f64>) -> Option<f64> {
    median(absolute).map(|middle| 1.4826 * middle)
}

/// The median; `None` of nothing.
fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}
