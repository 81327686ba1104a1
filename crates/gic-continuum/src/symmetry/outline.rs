//! Mirror planes from outlines alone, for a body of which too little surface is known.
//!
//! A body that is its own mirror image looks to a camera's mirror image as it looks to the camera, mirrored. So each
//! ray along an outline must somewhere pass within all the other outlines and all their mirror images: silhouette
//! coherence (Hernandez, Schmitt & Cipolla 2007, who find the motion of a turntable by it). Three cameras and three
//! planes make twenty-four outlines, which a wrong plane contradicts by pixels.

use gic_geometry::distance_transform;
use gic_scene::{Camera, Hull, HullSettings, HullView, Mask};
use glam::{DVec2, DVec3};
use nalgebra::DVector;
use rayon::prelude::*;

use super::planes::{Images, MirrorPlane, Symmetry, normals_beside};
use crate::MaskedView;
use crate::tuning::SymmetryTuning;

/// One view's outline.
pub(crate) struct Outline {
    camera: Camera,
    /// Signed distance of each pixel's centre from the outline, positive inside [pixels], row-major.
    distance: Vec<f32>,
}

impl Outline {
    pub(crate) fn new(camera: &Camera, mask: &[f32]) -> Outline {
        let inside: Vec<bool> = mask.iter().map(|m| *m >= 0.5).collect();
        let outside: Vec<bool> = inside.iter().map(|i| !i).collect();
        let (to_outside, to_inside) =
            (distance_transform(&outside, camera.width), distance_transform(&inside, camera.width));
        let signed = |(out, into): (f32, f32)| if out > 0.0 { out - 0.5 } else { 0.5 - into };
        Outline { camera: camera.clone(), distance: to_outside.into_iter().zip(to_inside).map(signed).collect() }
    }

    /// How far within the outline a point [m] appears, at its own depth [m]; infinitely where this view does not see
    /// it.
    pub(crate) fn depth(&self, point: DVec3) -> f64 {
        let focal = 0.5 * (self.camera.focal.x + self.camera.focal.y);
        f64::from(self.signed_distance_px(point)) * self.camera.to_camera(point).z / focal
    }

    /// How far within the outline a point [m] appears [pixels]; infinitely where this view does not see it.
    fn signed_distance_px(&self, point: DVec3) -> f32 {
        self.camera.project(point).and_then(|(pixel, _)| self.at_pixel(pixel)).unwrap_or(f32::INFINITY)
    }

    /// How far within the outline image coordinates are, and which way the outline lies from there or, from outside of
    /// it, away from it: a unit vector. `None` outside the picture [pixels].
    pub(crate) fn gap_px(&self, pixel: DVec2) -> Option<(f64, DVec2)> {
        let at = |x: f64, y: f64| self.at_pixel(pixel + DVec2::new(x, y)).map(f64::from);
        let slope = DVec2::new(at(-0.5, 0.0)? - at(0.5, 0.0)?, at(0.0, -0.5)? - at(0.0, 0.5)?);
        Some((at(0.0, 0.0)?, slope.try_normalize()?))
    }

    /// How far within the outline image coordinates are [pixels]; `None` outside the picture.
    pub(crate) fn at_pixel(&self, pixel: DVec2) -> Option<f32> {
        let (w, h) = (self.camera.width, self.camera.height);
        let (x, y) = (pixel.x - 0.5, pixel.y - 0.5);
        if !(x >= 0.0 && y >= 0.0 && x < w as f64 - 1.0 && y < h as f64 - 1.0) {
            return None;
        }
        let (i, j) = (x as usize, y as usize);
        let (s, t) = ((x - i as f64) as f32, (y - j as f64) as f32);
        let at = |i: usize, j: usize| self.distance[j * w + i];
        let row = |j: usize| at(i, j) + s * (at(i + 1, j) - at(i, j));
        Some(row(j) + t * (row(j + 1) - row(j)))
    }
}

/// The outlines of a rigid body.
struct Outlines<'a> {
    tuning: &'a SymmetryTuning,
    views: Vec<Outline>,
    /// Places along rays that touch the outlines, with how far they are within the outlines of all views, the innermost
    /// first.
    rays: Vec<Vec<(f32, DVec3)>>,
    /// Cells of the hull.
    hull: Vec<DVec3>,
    middle: DVec3,
    /// Largest side of the hull's box [m].
    size: f64,
    /// Half of its diagonal [m].
    half_diagonal: f64,
}

impl Outlines<'_> {
    /// `None` where masks are missing or empty, or have no hull in common.
    fn new<'a>(views: &[MaskedView], tuning: &'a SymmetryTuning) -> Option<Outlines<'a>> {
        let masked = views.iter().filter_map(|view| Some((view.camera, view.mask?)));
        let masks: Vec<(&Camera, Mask)> = masked
            .map(|(camera, mask)| {
                (camera, Mask { width: camera.width, height: camera.height, coverage: mask.to_vec() })
            })
            .collect();
        let hull_views: Vec<HullView> = masks.iter().map(|(camera, mask)| HullView { camera, mask }).collect();
        let hull = Hull::carve(&hull_views, &HullSettings::default())?;
        let (low, high) = hull.bounds();
        let points = hull.points();
        let mut outlines = Outlines {
            tuning,
            views: masks.par_iter().map(|(camera, mask)| Outline::new(camera, &mask.coverage)).collect(),
            rays: Vec::new(),
            middle: points.iter().sum::<DVec3>() / points.len() as f64,
            size: (high - low).max_element(),
            half_diagonal: 0.5 * (high - low).length(),
            hull: points,
        };
        outlines.rays = outlines.views.iter().flat_map(|view| outlines.rays_of(view)).collect();
        Some(outlines)
    }

    fn rays_of<'a>(&'a self, view: &'a Outline) -> impl Iterator<Item = Vec<(f32, DVec3)>> + 'a {
        let (width, tuning) = (view.camera.width, self.tuning);
        // A closed line of pixels: what touches the outside along a side or at a corner.
        let touching = |(i, d): (usize, &f32)| (*d > 0.0 && *d < 1.0).then_some(i);
        let pixels: Vec<usize> = view.distance.iter().enumerate().filter_map(touching).collect();
        let depth = view.camera.to_camera(self.middle).z;
        let (rays, count) = (tuning.outline_rays.min(pixels.len()), tuning.outline_rays);
        (0..rays).map(move |k| {
            let i = pixels[k * pixels.len() / rays];
            let pixel = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let along = |n: usize| self.half_diagonal * (2.0 * n as f64 / (count - 1) as f64 - 1.0);
            let places = (0..count).map(|n| view.camera.unproject(pixel, (depth + along(n)).max(1e-3)));
            let known = places.map(|p| (self.within_all(p), p)).filter(|(d, _)| *d > -tuning.farthest_miss_px);
            let mut places: Vec<(f32, DVec3)> = known.collect();
            places.sort_by(|a, b| b.0.total_cmp(&a.0));
            places
        })
    }

    /// How far within the outlines of all views a point appears [pixels].
    fn within_all(&self, point: DVec3) -> f32 {
        self.views.iter().map(|view| view.signed_distance_px(point)).fold(f32::INFINITY, f32::min)
    }

    /// The same with all mirror images of the outlines; no more than `own`, what it is without them, and looked at no
    /// further once it is less than `least`.
    fn within_images(&self, point: DVec3, own: f32, images: &Images, least: f32) -> f32 {
        let mut within = own;
        for image in images.of(point).skip(1) {
            for view in &self.views {
                within = within.min(view.signed_distance_px(image));
                if within <= least {
                    return within;
                }
            }
        }
        within
    }

    /// How far each ray misses the body that all outlines and their images leave [pixels]; zero where it touches.
    fn misses(&self, symmetry: &Symmetry) -> DVector<f64> {
        let images = symmetry.images();
        let miss = |ray: &Vec<(f32, DVec3)>| {
            let mut best = -self.tuning.farthest_miss_px;
            for &(own, place) in ray {
                if own <= best || best >= 0.0 {
                    break;
                }
                best = best.max(self.within_images(place, own, &images, best));
            }
            f64::from(-best.min(0.0))
        };
        DVector::from_iterator(self.rays.len(), self.rays.iter().map(miss))
    }

    /// Planes fitted so that no ray misses, and how far they miss, root mean square [pixels].
    fn fit(&self, start: &Symmetry) -> (f64, Symmetry) {
        let half_a_pixel = 0.5 * self.pixel() / self.size;
        start.fitted((self.middle, self.size), half_a_pixel, |planes| self.misses(planes))
    }

    /// Side of a pixel at the body, the mean of the views [m].
    fn pixel(&self) -> f64 {
        let pixel = |view: &Outline| view.camera.to_camera(self.middle).z / view.camera.focal.x;
        self.views.iter().map(pixel).sum::<f64>() / self.views.len().max(1) as f64
    }

    /// The volume, in cells of the hull, that all outlines and their images leave.
    fn volume(&self, symmetry: &Symmetry) -> usize {
        let images = symmetry.images();
        self.hull.iter().filter(|p| self.within_images(**p, f32::INFINITY, &images, 0.0) > 0.0).count()
    }

    /// Three planes at right angles that agree with all outlines. Of several sets that agree as well, which a body with
    /// more planes than three has, that which leaves the least of the hull.
    fn planes(&self) -> Option<Symmetry> {
        let tuning = self.tuning;
        let through = |normal: DVec3| MirrorPlane { normal, offset: normal.dot(self.middle), misfit: 0.0 };
        let starts: Vec<Symmetry> = normals_beside(&[], tuning.outline_normals)
            .into_iter()
            .map(through)
            .flat_map(|first| {
                let seconds = normals_beside(&[first], tuning.outline_normals).into_iter().map(through);
                seconds.map(move |second| vec![first, second, through(first.normal.cross(second.normal))])
            })
            .map(|planes| Symmetry { planes, interchangeable_planes: Vec::new() })
            .collect();
        let mut rated: Vec<(f64, Symmetry)> =
            starts.into_par_iter().map(|start| (self.misses(&start).norm_squared(), start)).collect();
        rated.sort_by(|a, b| a.0.total_cmp(&b.0));
        rated.truncate(tuning.candidates);
        let fits: Vec<(f64, Symmetry)> = rated.into_par_iter().map(|(_, start)| self.fit(&start)).collect();
        let least = fits.iter().map(|(miss, _)| *miss).fold(f64::INFINITY, f64::min);
        let agreeing =
            fits.into_iter().filter(|(miss, _)| *miss <= tuning.largest_miss_px.min(tuning.same_misfit * least));
        let agreeing: Vec<_> = agreeing.collect();
        let complete =
            agreeing.into_par_iter().map(|(miss, symmetry)| self.with_interchangeable_planes(miss, symmetry));
        complete.map(|(miss, s)| self.measured(miss, s)).min_by_key(|s| self.volume(s))
    }

    /// With planes changing places where that agrees with the outlines, too. A body with a square section, or a round
    /// one, has more planes than three, and twice or six times the images.
    fn with_interchangeable_planes(&self, miss: f64, symmetry: Symmetry) -> (f64, Symmetry) {
        [[0, 1], [1, 2], [0, 2]].into_iter().fold((miss, symmetry), |(miss, symmetry), pair| {
            let interchangeable_planes = [&symmetry.interchangeable_planes[..], &[pair]].concat();
            let more = self.fit(&Symmetry { interchangeable_planes, ..symmetry.clone() });
            if more.0 <= self.tuning.largest_miss_px { more } else { (miss, symmetry) }
        })
    }

    /// The planes with their misfit in metres at the body.
    fn measured(&self, miss: f64, mut symmetry: Symmetry) -> Symmetry {
        let misfit = miss * self.pixel();
        symmetry.planes.iter_mut().for_each(|plane| plane.misfit = misfit);
        symmetry
    }
}

impl Symmetry {
    /// Three mirror planes at right angles that all outlines of a body agree with; none where there are no three. Fewer
    /// are not looked for: three outlines of anything agree with some plane.
    pub fn of_outlines(views: &[MaskedView], tuning: &SymmetryTuning) -> Symmetry {
        let found = Outlines::new(views, tuning).and_then(|outlines| outlines.planes());
        found.unwrap_or_default()
    }

    /// The planes, fitted to the outlines; `None` where they do not agree.
    pub(super) fn on_outlines(&self, views: &[MaskedView], tuning: &SymmetryTuning) -> Option<Symmetry> {
        let outlines = Outlines::new(views, tuning)?;
        let (miss, symmetry) = outlines.fit(self);
        (miss <= tuning.largest_miss_px).then(|| outlines.measured(miss, symmetry))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_cross::{CENTRE, VOLUME, cameras, cross, gaussians, masks, turned, views};
    use crate::{FillSettings, fill_outlines};

    fn of_outlines(views: &[MaskedView]) -> Symmetry {
        Symmetry::of_outlines(views, &SymmetryTuning::default())
    }

    fn assert_planes(symmetry: &Symmetry, centre: DVec3) {
        assert_eq!(symmetry.planes.len(), 3);
        for plane in &symmetry.planes {
            let own = turned().inverse() * plane.normal;
            let angle = own.abs().max_element().min(1.0).acos().to_degrees();
            let off = plane.normal.dot(centre) - plane.offset;
            println!("{angle:.2} degrees, {:.2} mm", 1e3 * off);
            assert!(angle < 1.0 && off.abs() < 0.003, "{angle} degrees, {off} m");
        }
    }

    #[test]
    fn three_outlines_tell_three_planes() {
        let cameras = cameras();
        let at = |moved: DVec3| {
            let masks = masks(&cameras, &|p| cross(p, moved));
            of_outlines(&views(&cameras, &masks))
        };
        let symmetry = at(DVec3::ZERO);
        assert_planes(&symmetry, CENTRE);
        assert_eq!(symmetry.interchangeable_planes, Vec::<[usize; 2]>::new(), "its arms are 16, 13 and 14.5 cm long");
        let moved = DVec3::new(0.01, -0.05, 0.02);
        assert_planes(&at(moved), CENTRE + moved);
    }

    /// What two outlines hardly tell the same cameras do once the cross has flown on: they see it from elsewhere.
    #[test]
    fn planes_of_what_flies_are_told_by_two_moments() {
        let cameras = &cameras()[1..];
        let at = |moved: DVec3| masks(cameras, &|p| cross(p, moved));
        let flown = DVec3::new(0.12, -0.25, 0.08);
        let beside: Vec<Camera> =
            cameras.iter().map(|camera| Camera { centre: camera.centre - flown, ..camera.clone() }).collect();
        let (first, later) = (at(DVec3::ZERO), at(flown));
        let (first, later) = (views(cameras, &first), views(&beside, &later));
        let worst = |symmetry: &Symmetry| {
            let off = |plane: &MirrorPlane| (turned().inverse() * plane.normal).abs().max_element().min(1.0).acos();
            symmetry.planes.iter().map(off).fold(0.0, f64::max).to_degrees()
        };
        let (alone, together) = (of_outlines(&first), of_outlines(&[first, later].concat()));
        println!("{:.2} degrees off alone ({}), {:.2} together", worst(&alone), alone.planes.len(), worst(&together));
        assert_eq!(together.planes.len(), 3);
        assert!(worst(&together) < 0.5 && worst(&alone) > 0.5);
    }

    /// Two of three bars are of one length.
    #[test]
    fn planes_of_equal_bars_are_interchangeable() {
        let lengths = DVec3::new(0.15, 0.12, 0.15);
        let body = |p: DVec3| {
            let own = (turned().inverse() * (p - CENTRE)).abs();
            let bar = |axis: DVec3| (own - axis * lengths - (DVec3::ONE - axis) * 0.04).max_element();
            DVec3::AXES.into_iter().map(bar).fold(f64::INFINITY, f64::min)
        };
        let cameras = cameras();
        let masks = masks(&cameras, &body);
        let symmetry = of_outlines(&views(&cameras, &masks));
        assert_eq!(symmetry.interchangeable_planes.len(), 1, "{symmetry:?}");
        // Along the interchangeable planes lie the two long bars, or what is between them.
        let [a, b] = symmetry.interchangeable_planes[0].map(|k| turned().inverse() * symmetry.planes[k].normal);
        assert!(a.y.abs() < 0.03 && b.y.abs() < 0.03, "{a} {b}");
        assert_eq!(symmetry.images().of(CENTRE).count(), 16);
    }

    /// Three outlines leave twice the body; with their mirror images, a half more than it.
    #[test]
    fn outlines_and_their_images_make_the_body() {
        let cameras = cameras();
        let masks = masks(&cameras, &|p| cross(p, DVec3::ZERO));
        let (views, gaussians, settings) = (views(&cameras, &masks), gaussians(), FillSettings::for_size(0.3));
        let volume = |symmetry: &Symmetry| {
            let filling = fill_outlines(&gaussians, &views, symmetry, &settings).expect("a body");
            assert_eq!(filling.views_used, 3);
            filling.volume() / VOLUME
        };
        let (alone, mirrored) = (volume(&Symmetry::default()), volume(&of_outlines(&views)));
        println!("{alone:.3} by three outlines, {mirrored:.3} with their images");
        assert!(alone > 1.5 && mirrored < 0.85 * alone && mirrored > 0.97, "{alone} {mirrored}");
    }

    #[test]
    fn a_body_without_mirror_planes_has_none() {
        let balls = [
            (DVec3::new(-0.02, 0.0, 0.0), 0.07),
            (DVec3::new(0.13, 0.02, 0.0), 0.045),
            (DVec3::new(0.03, 0.12, 0.02), 0.03),
            (DVec3::new(-0.02, 0.05, 0.13), 0.05),
        ];
        let body = |p: DVec3| balls.iter().map(|(c, r)| (p - CENTRE - *c).length() - r).fold(f64::INFINITY, f64::min);
        let cameras = cameras();
        let masks = masks(&cameras, &body);
        assert_eq!(of_outlines(&views(&cameras, &masks)).planes, Vec::new());
        assert_eq!(of_outlines(&[]).planes, Vec::new());
    }

    #[test]
    fn a_mirrored_camera_sees_the_mirror_image() {
        let planes = [DVec3::new(0.6, 0.0, 0.8), DVec3::new(-0.8, 0.0, 0.6)];
        let planes = planes.map(|normal| MirrorPlane { normal, offset: normal.dot(CENTRE), misfit: 0.0 });
        let symmetry = Symmetry { planes: planes.to_vec(), interchangeable_planes: Vec::new() };
        let (camera, point) = (&cameras()[0], CENTRE + DVec3::new(0.1, -0.05, 0.03));
        let seen = camera.project(point).unwrap();
        let images: Vec<DVec3> = symmetry.images().of(point).skip(1).collect();
        assert_eq!(images.len(), 3);
        for (mirrored, image) in symmetry.mirrored_cameras(camera).iter().zip(images) {
            let found = mirrored.project(image).unwrap();
            assert!(found.0.distance(seen.0) < 1e-9 && (found.1 - seen.1).abs() < 1e-12);
        }
    }
}
