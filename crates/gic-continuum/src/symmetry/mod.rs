//! Mirror planes of a body, and what they tell of its parts that no view sees.
//!
//! Most things that people make are mirror images of themselves. Where a body is, each place of it is looked at a second time, from the
//! other side of the plane: the underside of an arm by the views of another arm's top. A plane is believed where the surface that is seen
//! lies on its own mirror image, to a small part of the size; a body without such planes stays as it is.
//!
//! 1. Planes of all directions near the body's middle are scored by how far a few mirrored surface points lie from the surface; the best
//!    are fitted by iterated least squares (point-to-plane distances: Chen & Medioni 1992).
//! 2. Up to three at right angles to each other are kept, and fitted together.
//! 3. They are moved to where the outlines agree with each other's mirror images (see [`outline`]): outlines are sharper than surfaces.
//! 4. The signed distances from the surface at a place and at all its mirror images are averaged, each by how well the views know the
//!    surface there.

mod outline;

use gic_geometry::{DensityField, KdTree};
use gic_optimize::damped_step;
use glam::{DAffine3, DMat3, DVec3};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::{Filling, MaskedView};

/// Directions of planes that are tried, evenly over a half sphere: 8 degrees apart.
const DIRECTIONS: usize = 400;
/// Directions that are tried at right angles to one plane.
const CIRCLE: usize = 48;
/// Offsets that are tried along each of them, and how far they are apart over the body's size.
const OFFSETS: i32 = 3;
const OFFSET_STEP: f64 = 0.02;
/// Of those the best that are this far apart (cosine) are fitted.
const CANDIDATES: usize = 12;
const DISTINCT: f64 = 0.95;
/// Points that score a plane, that fit one among several, and that fit the best.
const FEW: usize = 150;
const SEVERAL: usize = 600;
const MANY: usize = 2000;
/// A mirrored point counts as this far off at most, over the body's size, so that a handle on one side only is not overlooked.
const FARTHEST: f64 = 0.1;
/// A plane whose mirrored points are off by more than this, in the mean and over the body's size, is none. Of the bodies we measure on,
/// true planes have .003 to .008, those of a toy that has only one .016 and more.
const LARGEST_MISFIT: f64 = 1.0 / 110.0;
/// Within this of the surface, over the body's size, distances are measured from its plane.
const CLOSE: f64 = 0.02;
/// ... and this far inside of a surface that no view sees, as notches are filled too far.
const OVERFILLED: f64 = 0.015;
/// A body has kept its shape while its planes fit at most so many times worse than at first.
const UNDEFORMED: f64 = 1.2;
/// Rounds of fitting, and how much of the mean curvature is added to each unknown's, so that one without effect stays where it is.
const ROUNDS: usize = 25;
const DAMPING: f64 = 1e-3;
/// A fit ends with a step that turns planes by less than this [rad], and shifts them by less than this times the body's size.
const ARRIVED: f64 = 1e-4;
/// What no view sees counts as this much of what one does.
const UNSEEN_SHARE: f64 = 1e-3;
/// Distances are known up to so many voxels.
const BAND: f64 = 6.0;
/// Voxels over which the density falls from 1 to 0 across the surface.
const RAMP: f64 = 1.5;

/// Mirror planes at right angles to each other.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Symmetry {
    /// The planes, at most three.
    pub planes: Vec<MirrorPlane>,
    /// Which of three planes may change places: the body is the same along their normals, as a bar with a square section is along two. Looked for
    /// in outlines only.
    pub alike: Vec<[usize; 2]>,
}

/// A plane whose two sides are mirror images.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MirrorPlane {
    /// Unit normal.
    pub normal: DVec3,
    /// Distance of the plane from the origin along its normal [m].
    pub offset: f64,
    /// How far mirrored points of the surface lie from it, in the mean [m].
    pub misfit: f64,
}

impl MirrorPlane {
    /// The mirror image of a point [m].
    pub fn mirror(&self, point: DVec3) -> DVec3 {
        point - 2.0 * (self.normal.dot(point) - self.offset) * self.normal
    }

    /// The plane with another normal, as far from a point [m] as before.
    pub(crate) fn turned(&self, normal: DVec3, point: DVec3) -> MirrorPlane {
        MirrorPlane { normal, offset: self.offset + (normal - self.normal).dot(point), ..*self }
    }
}

impl Symmetry {
    /// The mirror planes of a body, none where the part of its surface that is seen has none.
    fn of(surface: &KnownSurface) -> Symmetry {
        let mut planes: Vec<MirrorPlane> = Vec::new();
        while planes.len() < 3 && surface.seen.len() >= FEW {
            let Some(more) = surface.with_another(&planes) else { break };
            planes = more;
        }
        Symmetry { planes, alike: Vec::new() }
    }

    /// How far mirrored points of the surface lie from it, the mean of the planes [m].
    pub fn misfit(&self) -> f64 {
        self.planes.iter().map(|plane| plane.misfit).sum::<f64>() / self.planes.len().max(1) as f64
    }

    /// Whether a body that was found to be as symmetric as `rest` before still has this symmetry.
    fn is_still(&self, rest: &Symmetry) -> bool {
        self.planes.len() == rest.planes.len() && self.misfit() <= UNDEFORMED * rest.misfit()
    }

    /// The maps of the body onto itself.
    pub(crate) fn images(&self) -> Images<'_> {
        Images { planes: &self.planes, turns: self.turns() }
    }

    /// Where three planes meet [m]; `None` of fewer.
    pub(crate) fn centre(&self) -> Option<DVec3> {
        let [a, b, c] = self.planes.as_slice() else { return None };
        Some(a.offset * a.normal + b.offset * b.normal + c.offset * c.normal)
    }

    /// The maps that let planes that are alike change places, other than the identity.
    fn turns(&self) -> Vec<DAffine3> {
        let Some(centre) = self.centre() else { return Vec::new() };
        let mut orders = vec![[0, 1, 2]];
        let mut k = 0;
        while k < orders.len() {
            for &[a, b] in &self.alike {
                let mut order = orders[k];
                order.swap(a, b);
                if !orders.contains(&order) {
                    orders.push(order);
                }
            }
            k += 1;
        }
        let axes = |order: [usize; 3]| {
            let [a, b, c] = order.map(|i| self.planes[i].normal);
            DMat3::from_cols(a, b, c)
        };
        let turn = |order: &[usize; 3]| {
            let turn = axes(*order) * axes(orders[0]).transpose();
            DAffine3::from_mat3_translation(turn, centre - turn * centre)
        };
        orders[1..].iter().map(turn).collect()
    }
}

/// The maps of a body onto itself.
pub(crate) struct Images<'a> {
    planes: &'a [MirrorPlane],
    turns: Vec<DAffine3>,
}

impl Images<'_> {
    /// All images of a point [m]: first itself, then its mirror images and their mirror images, then those of where it is turned to.
    pub(crate) fn of(&self, point: DVec3) -> impl Iterator<Item = DVec3> + '_ {
        let turned = self.turns.iter().map(move |turn| turn.transform_point3(point));
        std::iter::once(point).chain(turned).flat_map(move |start| {
            (0..1usize << self.planes.len()).map(move |subset| {
                let chosen = self.planes.iter().enumerate().filter(|(k, _)| subset >> k & 1 == 1);
                chosen.fold(start, |image, (_, plane)| plane.mirror(image))
            })
        })
    }
}

/// Completes a body by its symmetry in the frames of a video, as long as it keeps the shape that it has in the first.
#[derive(Debug, Default)]
pub struct Completion {
    /// The symmetry of the first frame's surface, once that is known.
    rest: Option<Symmetry>,
    /// What the first frame was completed by.
    first: Option<Symmetry>,
    /// Whether it has changed its shape since.
    deformed: bool,
}

impl Completion {
    /// Completes the next frame, which these views show.
    pub fn next(&mut self, filling: &mut Filling, views: &[MaskedView]) {
        if self.deformed {
            return;
        }
        let surface = KnownSurface::new(filling);
        let symmetry = Symmetry::of(&surface);
        let rest = self.rest.get_or_insert_with(|| symmetry.clone());
        self.deformed = rest.planes.is_empty() || !symmetry.is_still(rest);
        if !self.deformed {
            // Outlines are sharper than surfaces.
            let sharper = symmetry.on_outlines(views).map(|sharper| surface.measured(sharper));
            let symmetry = sharper.unwrap_or(symmetry);
            filling.complete(&symmetry, &surface);
            self.first.get_or_insert(symmetry);
        }
    }

    /// The symmetry by which the first frame's body was completed; `None` before that, or where it has no mirror planes.
    pub fn first(&self) -> Option<&Symmetry> {
        self.first.as_ref()
    }
}

impl Filling {
    /// Completes a body with this surface by its mirror images: afterwards what no view sees is what its images show.
    fn complete(&mut self, symmetry: &Symmetry, surface: &KnownSurface) {
        if symmetry.planes.is_empty() {
            return;
        }
        let (distances, doubts) = surface.distances(self);
        let (band, images) = (BAND * self.field.spacing, symmetry.images());
        let look = |point: DVec3| {
            // Beyond the grid there is nothing.
            let Some(i) = self.field.discretize(point) else { return (band, 0.0) };
            (sample(&distances, point, band), f64::from(doubts.values[i]))
        };
        let merged: Vec<(f32, f32)> = (0..self.field.len())
            .into_par_iter()
            .map(|i| {
                let (mut sum, mut total, mut doubt) = (0.0, 0.0, 1.0f64);
                for image in images.of(self.field.centre(self.field.voxel(i))) {
                    let (distance, doubtful) = look(image);
                    let share = UNSEEN_SHARE + (1.0 - doubtful).powi(2);
                    sum += share * distance;
                    total += share;
                    doubt = doubt.min(doubtful);
                }
                let distance = sum / total / self.field.spacing;
                ((0.5 - distance / RAMP).clamp(0.0, 1.0) as f32, doubt as f32)
            })
            .collect();
        for (i, (density, doubt)) in merged.into_iter().enumerate() {
            self.field.values[i] = density;
            if let Some(own) = self.doubt.get_mut(i) {
                *own = own.min(doubt);
            }
        }
    }
}

/// Trilinear interpolation of what is `beyond` outside of the grid.
fn sample(field: &DensityField, point: DVec3, beyond: f64) -> f64 {
    let inner = 0.5 * field.spacing;
    let (low, high) = (field.origin + inner, field.centre(field.size.map(|n| n - 1)));
    if point.cmplt(low).any() || point.cmpgt(high).any() { beyond } else { field.sample(point) }
}

/// The surface of a body as points.
struct KnownSurface {
    points: Vec<DVec3>,
    normals: Vec<DVec3>,
    /// How much each is in doubt.
    doubts: Vec<f32>,
    tree: KdTree,
    /// The points that a view sees, spread evenly over the surface in whatever order.
    seen: Vec<DVec3>,
    middle: DVec3,
    /// Largest side of the body's box [m].
    size: f64,
}

impl KnownSurface {
    fn new(filling: &Filling) -> KnownSurface {
        let samples = filling.surface_mesh().sample(filling.field.spacing, 0);
        let points: Vec<DVec3> = samples.iter().map(|s| s.position).collect();
        let doubts: Vec<f32> = points.iter().map(|p| filling.doubt_of_surface(*p)).collect();
        let (low, high) =
            points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
        let single: Vec<[f32; 3]> = points.iter().map(|p| p.as_vec3().to_array()).collect();
        KnownSurface {
            normals: samples.iter().map(|s| s.normal).collect(),
            seen: points.iter().zip(&doubts).filter(|(_, d)| **d < 0.3).map(|(p, _)| *p).collect(),
            tree: KdTree::new(&single),
            middle: points.iter().sum::<DVec3>() / points.len().max(1) as f64,
            size: (high - low).max_element().max(0.0),
            points,
            doubts,
        }
    }

    /// About `count` of the points that are seen, always the same ones.
    fn some(&self, count: usize) -> impl Iterator<Item = DVec3> + '_ {
        self.seen.iter().step_by(self.seen.len().div_ceil(count).max(1)).copied()
    }

    /// Signed distance of a point from the surface [m], the direction in which it is measured, and how far it counts at most: less inside of
    /// what no view sees. Close to the surface it is the distance from its plane there.
    fn look(&self, point: DVec3) -> (f64, DVec3, f64) {
        let Some((i, squared)) = self.tree.nearest(point.as_vec3().to_array()) else {
            return (f64::INFINITY, DVec3::Y, FARTHEST * self.size);
        };
        let offset = point - self.points[i];
        let along = offset.dot(self.normals[i]);
        let inside_most = FARTHEST + f64::from(self.doubts[i]) * (OVERFILLED - FARTHEST);
        let most = self.size * if along < 0.0 { inside_most } else { FARTHEST };
        let distance = f64::from(squared).sqrt();
        if distance < CLOSE * self.size {
            return (along, self.normals[i], most);
        }
        (distance * along.signum(), offset * along.signum() / distance, most)
    }

    /// How far mirrored points lie from the surface, in the mean [m].
    fn misfit(&self, plane: &MirrorPlane, count: usize) -> f64 {
        let off = |p| {
            let (distance, _, most) = self.look(plane.mirror(p));
            distance.abs().min(most)
        };
        let (sum, total) = self.some(count).fold((0.0, 0usize), |(sum, n), p| (sum + off(p), n + 1));
        sum / total.max(1) as f64
    }

    /// The planes and the best other one at right angles to them, fitted together; `None` where no other one fits.
    fn with_another(&self, planes: &[MirrorPlane]) -> Option<Vec<MirrorPlane>> {
        let mut tried: Vec<MirrorPlane> = normals(planes, CIRCLE)
            .into_par_iter()
            .flat_map_iter(|normal| {
                (-OFFSETS..=OFFSETS).map(move |step| {
                    let offset = normal.dot(self.middle) + f64::from(step) * OFFSET_STEP * self.size;
                    let plane = MirrorPlane { normal, offset, misfit: 0.0 };
                    MirrorPlane { misfit: self.misfit(&plane, FEW), ..plane }
                })
            })
            .collect();
        tried.sort_by(|a, b| a.misfit.total_cmp(&b.misfit));
        let mut distinct = Vec::<MirrorPlane>::new();
        for plane in tried {
            if distinct.len() < CANDIDATES && distinct.iter().all(|d| d.normal.dot(plane.normal).abs() < DISTINCT) {
                distinct.push(plane);
            }
        }
        let fitted = |plane| self.fit([planes, &[plane]].concat(), SEVERAL);
        let fits: Vec<Vec<MirrorPlane>> = distinct.into_par_iter().map(fitted).collect();
        let last = |fit: &[MirrorPlane]| fit[planes.len()].misfit;
        let best = fits.into_iter().min_by(|a, b| last(a).total_cmp(&last(b)))?;
        let best = self.fit(best, MANY);
        (last(&best) <= LARGEST_MISFIT * self.size).then_some(best)
    }

    /// Turns planes that are at right angles together and shifts each, so that `count` mirrored points come to lie on the surface: least
    /// squares of the distances, those weighted by their inverse, round by round.
    fn fit(&self, mut planes: Vec<MirrorPlane>, count: usize) -> Vec<MirrorPlane> {
        let unknowns = 3 + planes.len();
        for _ in 0..ROUNDS {
            let (mut matrix, mut pull) = (DMatrix::zeros(unknowns, unknowns), DVector::zeros(unknowns));
            for (k, plane) in planes.iter().enumerate() {
                for p in self.some(count) {
                    let (distance, normal, most) = self.look(plane.mirror(p));
                    if distance.abs() >= most {
                        continue;
                    }
                    let from_middle = p - self.middle;
                    let height = plane.normal.dot(p) - plane.offset;
                    // The image p - 2 h n moves by -2 (dn . (p - m)) n - 2 h dn + 2 dc n where dn = turn x n and c is measured from m.
                    let along = normal.dot(plane.normal);
                    let turned = -2.0 * (along * plane.normal.cross(from_middle) + height * plane.normal.cross(normal));
                    let mut row = DVector::zeros(unknowns);
                    row.rows_mut(0, 3).copy_from_slice(&turned.to_array());
                    row[3 + k] = 2.0 * along;
                    let weight = 1.0 / distance.abs().max(1e-3 * self.size);
                    pull += &row * (weight * distance);
                    matrix.ger(weight, &row, &row, 1.0);
                }
            }
            let mean = matrix.diagonal().sum() / unknowns as f64;
            let damping = |own: f64| DAMPING * own + 1e-9 * mean + f64::MIN_POSITIVE;
            let Some(step) = damped_step(&matrix, &pull, damping) else { break };
            let turn = DVec3::new(step[0], step[1], step[2]);
            let rotation = glam::DQuat::from_scaled_axis(turn.clamp_length_max(0.1));
            let arrived = turn.length() < ARRIVED && step.rows_range(3..).amax() < ARRIVED * self.size;
            for (k, plane) in planes.iter_mut().enumerate() {
                *plane = plane.turned(rotation * plane.normal, self.middle);
                plane.offset += step[3 + k].clamp(-0.05 * self.size, 0.05 * self.size);
            }
            if arrived {
                break;
            }
        }
        for plane in &mut planes {
            plane.misfit = self.misfit(plane, count);
        }
        planes
    }

    /// The planes with how far mirrored points of this surface lie from it.
    fn measured(&self, mut symmetry: Symmetry) -> Symmetry {
        symmetry.planes.iter_mut().for_each(|plane| plane.misfit = self.misfit(plane, MANY));
        symmetry
    }

    /// Signed distance from the surface [m] at each voxel, cut to the band, and how much the surface next to it is in doubt.
    fn distances(&self, filling: &Filling) -> (DensityField, DensityField) {
        let field = &filling.field;
        let band = BAND * field.spacing;
        let of = |i: usize| -> (f32, f32) {
            let point = field.centre(field.voxel(i));
            let inside = f64::from(field.values[i]) >= filling.th_min;
            let Some((nearest, squared)) = self.tree.nearest(point.as_vec3().to_array()) else {
                return (band as f32, 0.0);
            };
            let distance = f64::from(squared).sqrt();
            let doubt = if inside || distance < band { self.doubts[nearest] } else { 0.0 };
            if distance > 2.0 * field.spacing {
                let sign = if inside { -1.0 } else { 1.0 };
                return ((sign * distance.min(band)) as f32, doubt);
            }
            ((point - self.points[nearest]).dot(self.normals[nearest]) as f32, doubt)
        };
        let (distances, doubts): (Vec<f32>, Vec<f32>) = (0..field.len()).into_par_iter().map(of).unzip();
        (DensityField { values: distances, ..*field }, DensityField { values: doubts, ..*field })
    }
}

/// Directions at right angles to planes, evenly: over a half sphere, `circle` of them over a half circle, or the one that is left.
pub(crate) fn normals(planes: &[MirrorPlane], circle: usize) -> Vec<DVec3> {
    match planes {
        [] => (0..DIRECTIONS).map(|k| direction(k, DIRECTIONS)).collect(),
        [one] => {
            let (a, b) = one.normal.any_orthonormal_pair();
            let angle = |k: usize| std::f64::consts::PI * k as f64 / circle as f64;
            (0..circle).map(|k| angle(k).cos() * a + angle(k).sin() * b).collect()
        }
        [one, other, ..] => vec![one.normal.cross(other.normal).normalize_or(DVec3::Y)],
    }
}

/// The k-th of `count` directions, evenly over a half sphere (a Fibonacci spiral).
pub(crate) fn direction(k: usize, count: usize) -> DVec3 {
    let golden = std::f64::consts::PI * (1.0 + 5f64.sqrt());
    let z = (k as f64 + 0.5) / count as f64;
    let (sin, cos) = (golden * (k as f64 + 0.5)).sin_cos();
    let radius = (1.0 - z * z).sqrt();
    DVec3::new(radius * cos, radius * sin, z)
}

#[cfg(test)]
pub(crate) mod tests {
    pub(crate) use super::outline::tests as outlines;

    use glam::DQuat;
    use proptest::prelude::*;

    use super::*;

    const VOXEL: f64 = 0.006;

    /// Distance from a box around the origin [m], negative inside.
    fn cuboid(p: DVec3, half: DVec3) -> f64 {
        let q = p.abs() - half;
        q.max(DVec3::ZERO).length() + q.max_element().min(0.0)
    }

    /// Three bars of different lengths, crosswise.
    pub(crate) fn cross(p: DVec3) -> f64 {
        let bars = [DVec3::new(0.16, 0.04, 0.04), DVec3::new(0.04, 0.13, 0.04), DVec3::new(0.04, 0.04, 0.145)];
        bars.map(|half| cuboid(p, half)).into_iter().fold(f64::INFINITY, f64::min)
    }

    pub(crate) fn turned() -> DQuat {
        DQuat::from_euler(glam::EulerRot::XYZ, 0.4, 0.7, -0.3)
    }

    fn centre() -> DVec3 {
        DVec3::new(0.03, 0.5, -0.02)
    }

    fn filled(distance: impl Fn(DVec3) -> f64) -> Filling {
        let reach = DVec3::splat(0.24);
        Filling::of_body((centre() - reach, centre() + reach), VOXEL, 1.5 * VOXEL, distance).expect("a body")
    }

    /// Whether a place of the cross, in its own frame, lies low in one of the notches between its arms.
    fn in_notch(p: DVec3) -> bool {
        p.x > 0.0 && p.y < 0.0 && p.z.abs() < 0.04 && p.x - p.y < 0.12
    }

    /// The cross with a notch that no view looks into and that is filled.
    fn overfilled() -> Filling {
        let own = |p: DVec3| turned().inverse() * (p - centre());
        let mut filling = filled(|p| if in_notch(own(p)) { cross(own(p)).min(-VOXEL) } else { cross(own(p)) });
        let near = |p: DVec3| {
            DVec3::AXES.iter().any(|a| in_notch(own(p + 3.0 * VOXEL * *a)) || in_notch(own(p - 3.0 * VOXEL * *a)))
        };
        filling.doubt = (0..filling.field.len())
            .map(|i| {
                let place = filling.field.centre(filling.field.voxel(i));
                f32::from(u8::from(near(place) && cross(own(place)) > -0.5 * VOXEL))
            })
            .collect();
        filling
    }

    #[test]
    fn the_planes_of_a_cross_are_found_and_empty_a_notch_that_no_view_sees() {
        let mut filling = overfilled();
        let truth = filled(|p| cross(turned().inverse() * (p - centre()))).volume();
        let before = filling.volume() / truth - 1.0;
        let surface = KnownSurface::new(&filling);
        let symmetry = Symmetry::of(&surface);
        assert_eq!(symmetry.planes.len(), 3);
        for plane in &symmetry.planes {
            let own = turned().inverse() * plane.normal;
            let angle = own.abs().max_element().min(1.0).acos().to_degrees();
            let off = plane.normal.dot(centre()) - plane.offset;
            assert!(angle < 0.5 && off.abs() < 0.001, "{angle} degrees, {off} m");
        }
        filling.complete(&symmetry, &surface);
        let after = filling.volume() / truth - 1.0;
        println!("volume {before:+.4} before, {after:+.4} after");
        assert!(before > 0.01 && after.abs() < 0.005, "{before} before, {after} after");
    }

    #[test]
    fn a_body_without_mirror_planes_stays_as_it_is() {
        // Four balls of different sizes at the corners of a crooked tetrahedron.
        let balls = [
            (DVec3::new(0.0, 0.0, 0.0), 0.06),
            (DVec3::new(0.13, 0.02, 0.0), 0.045),
            (DVec3::new(0.03, 0.12, 0.02), 0.035),
            (DVec3::new(-0.02, 0.05, 0.11), 0.05),
        ];
        let body = |p: DVec3| balls.iter().map(|(c, r)| (p - centre() - *c).length() - r).fold(f64::INFINITY, f64::min);
        let mut filling = filled(body);
        let surface = KnownSurface::new(&filling);
        let symmetry = Symmetry::of(&surface);
        assert_eq!(symmetry.planes, Vec::new());
        let before = filling.field.clone();
        filling.complete(&symmetry, &surface);
        assert_eq!(filling.field, before);
    }

    #[test]
    fn a_body_that_no_view_sees_has_no_planes() {
        let mut filling = filled(|p| cross(turned().inverse() * (p - centre())));
        filling.doubt = vec![1.0; filling.field.len()];
        assert_eq!(Symmetry::of(&KnownSurface::new(&filling)).planes, Vec::new());
    }

    #[test]
    fn a_body_that_has_changed_its_shape_is_left_alone() {
        let sheared =
            |p: DVec3, by: f64| cross(turned().inverse() * (p - centre() - by * (p.y - centre().y) * DVec3::X));
        let mut completion = Completion::default();
        completion.next(&mut filled(|p| sheared(p, 0.0)), &[]);
        for shear in [0.3, 0.0] {
            let mut later = filled(|p| sheared(p, shear));
            let before = later.field.clone();
            completion.next(&mut later, &[]);
            assert_eq!(later.field, before, "sheared by {shear}");
        }
        assert_eq!(completion.first().map(|first| first.planes.len()), Some(3));
    }

    proptest! {
        #[test]
        fn images_are_as_far_from_each_other_as_their_points(
            turn in prop::array::uniform3(-1.0f64..1.0),
            offsets in prop::array::uniform3(-1.0f64..1.0),
            a in prop::array::uniform3(-1.0f64..1.0),
            b in prop::array::uniform3(-1.0f64..1.0),
            pairs in 0usize..4,
        ) {
            let rotation = DQuat::from_scaled_axis(DVec3::from_array(turn));
            let planes = DVec3::AXES.iter().zip(offsets);
            let planes = planes.map(|(axis, offset)| MirrorPlane { normal: rotation * *axis, offset, misfit: 0.0 });
            let alike = [[0, 2], [1, 2], [0, 1]][..pairs].to_vec();
            let symmetry = Symmetry { planes: planes.collect(), alike };
            let (a, b) = (DVec3::from_array(a), DVec3::from_array(b));
            let images: Vec<DVec3> = symmetry.images().of(a).collect();
            prop_assert_eq!(images.len(), 8 * [1, 2, 6, 6][pairs]);
            for (image, other) in images.iter().zip(symmetry.images().of(b)) {
                prop_assert!((image.distance(other) - a.distance(b)).abs() < 1e-12);
                // The images of an image are those of the point.
                let again: Vec<DVec3> = symmetry.images().of(*image).collect();
                prop_assert!(images.iter().all(|i| again.iter().any(|j| i.distance(*j) < 1e-12)));
            }
        }
    }
}
