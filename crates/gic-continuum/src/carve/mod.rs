//! Carving by colours: where cameras see different colours at a place, no surface is there (Kutulakos & Seitz 2000, "A Theory of Shape by
//! Space Carving").
//!
//! Outlines never show a notch that other parts of the body surround; pictures do. Layer by layer, places of the surface are taken away
//! that look different to the cameras that see them. Three cameras seldom see the same place, but a body that is its own mirror image has the
//! same shape at all images of a place, if not the same colours: one place that two cameras see decides about all its images.
//!
//! How much colours differ on a true surface hangs on the cameras, the light and the material, and nobody gives it. But who carves too much
//! opens the body: then layers grow from one to the next, which shrink where carving comes to a surface, and the body fills its outlines no
//! longer. So the tolerance is lowered step by step until that happens. What is left then settles where colours agree best ([`agreement`]).

mod agreement;

use gic_geometry::DensityField;
use gic_scene::{Camera, Picture};
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

use crate::fill::smooth;
use crate::symmetry::Images;
use crate::{Filling, Symmetry};

/// Standard deviation of a colour, in [0, 1], and how far a place may be off in a picture [pixels].
const NOISE: f32 = 3.0 / 255.0;
const OFF: f32 = 0.5;
/// Squared differences of colours over what is expected by these, above which a place is carved: the first and the last tolerance, and what
/// leads from one to the next.
const FIRST: f32 = 2.88;
const LAST: f32 = 0.09;
const STRICTER: f32 = std::f32::consts::FRAC_1_SQRT_2;
/// Layers that are carved with one tolerance, and the share of the surface below which it has come to its end.
const LAYERS: usize = 40;
const FEW: f64 = 0.01;
/// Carving takes the body apart where a layer is so many times as large as the smallest before it.
const GROWN: f64 = 1.5;
/// A place is judged by so many colour channels or more, in the voxels around it and around its images.
const ENOUGH: f32 = 9.0;
/// A surface is seen where it lies no deeper behind what is nearest than this [voxels], and not more obliquely than at this cosine.
const DEEP: f64 = 2.7;
const OBLIQUE: f64 = 0.25;
/// Pixels are the body's own where they and those around them are covered so far.
const COVERED: f32 = 0.98;
/// The body fills its outlines while no more than this share of them gets lost.
const LOST: f64 = 1e-3;
/// Voxels around a place that tell which way its surface looks.
const VICINITY: i64 = 3;

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

impl Filling {
    /// Takes away of a body what the colours of `views` contradict at a place and at its images by `symmetry`, and moves the surface of what is
    /// left to where they agree best.
    pub fn carve(&mut self, views: &[ColouredView], symmetry: &Symmetry) {
        let views: Vec<Coloured> = views.par_iter().map(Coloured::new).collect();
        let mut body = Solid::new(&self.field, self.th_min);
        let whole = body.inside.clone();
        let filled = body.filled(&views);
        let tolerances = std::iter::successors(Some(FIRST), |tolerance| Some(STRICTER * tolerance));
        for tolerance in tolerances.take_while(|tolerance| *tolerance >= LAST) {
            let before = body.inside.clone();
            let ended = body.carve(&views, symmetry, tolerance);
            if !ended || body.filled(&views).iter().zip(&filled).any(|(now, first)| *now < first - LOST) {
                body.inside = before;
                break;
            }
        }
        self.take_away(&body, &whole);
        self.settle(&views, symmetry);
    }

    /// Takes the voxels out of the field that a body has lost of the `whole`.
    fn take_away(&mut self, body: &Solid, whole: &[bool]) {
        if body.inside == whole {
            return;
        }
        let mut carved = self.field.clone();
        let mut touched = vec![false; carved.len()];
        for i in 0..carved.len() {
            let children = || body.children(&self.field, i);
            let (left, all) =
                (children().filter(|c| body.inside[*c]).count(), children().filter(|c| whole[*c]).count());
            if left < all {
                carved.values[i] *= left as f32 / all as f32;
                carved.around(i).for_each(|k| touched[k] = true);
            }
        }
        smooth(&mut carved);
        // Elsewhere edges stay as sharp as they were.
        let voxels = self.field.values.iter_mut().zip(carved.values).zip(touched);
        voxels.filter(|(_, touched)| *touched).for_each(|((own, carved), _)| *own = carved);
    }
}

/// A picture ready to be compared with others.
struct Coloured<'a> {
    view: &'a ColouredView<'a>,
    /// What the squared difference of each colour from the others may be: its noise, and how fast it changes with place.
    variance: Vec<Vec3>,
    /// Pixels well within the outline.
    own: Vec<bool>,
}

impl Coloured<'_> {
    fn new<'a>(view: &'a ColouredView<'a>) -> Coloured<'a> {
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
        Coloured {
            view,
            variance: (0..width * height).map(|i| Vec3::splat(NOISE * NOISE) + OFF * OFF * steepest(i)).collect(),
            own: (0..width * height).map(|i| around(i).all(|k| view.mask[k] > COVERED)).collect(),
        }
    }

    /// The pixel that shows a point [m], where in the picture that is, and its depth [m].
    fn pixel(&self, point: DVec3) -> Option<(usize, DVec2, f64)> {
        let camera = self.view.camera;
        let (at, depth) = camera.project(point)?;
        let inside = at.x >= 0.0 && at.y >= 0.0 && at.x < camera.width as f64 && at.y < camera.height as f64;
        inside.then(|| (at.y as usize * camera.width + at.x as usize, at, depth))
    }

    /// Depth of the nearest of `points` [m] in each pixel, each as large as a voxel of side `spacing` [m].
    fn depths(&self, points: &[Place], spacing: f64) -> Vec<f32> {
        let camera = self.view.camera;
        let mut depths = vec![f32::INFINITY; camera.width * camera.height];
        for place in points {
            let Some((_, at, depth)) = self.pixel(place.point) else { continue };
            let reach = (0.5 * spacing * camera.focal.x / depth).round() as usize;
            let (x, y) = (at.x as usize, at.y as usize);
            for y in y.saturating_sub(reach)..(y + reach + 1).min(camera.height) {
                for x in x.saturating_sub(reach)..(x + reach + 1).min(camera.width) {
                    let nearest = &mut depths[y * camera.width + x];
                    *nearest = nearest.min(depth as f32);
                }
            }
        }
        depths
    }

    /// Colours at several ways outward of a place [m] and their variance; `None` where this view does not see it.
    fn look<const N: usize>(
        &self,
        place: &Place,
        depths: &[f32],
        deep: f64,
        ways: &[f64; N],
    ) -> Option<([Vec3; N], Vec3)> {
        let (i, _, depth) = self.pixel(place.point)?;
        let towards = (self.view.camera.centre - place.point).normalize_or_zero();
        let seen = self.own[i] && depth < f64::from(depths[i]) + deep && place.normal.dot(towards) > OBLIQUE;
        let mut colours = [Vec3::ZERO; N];
        for (colour, way) in colours.iter_mut().zip(ways).filter(|_| seen) {
            let (_, at, _) = self.pixel(place.point + *way * place.normal)?;
            *colour = Vec3::from_array(self.view.picture.sample(at.x, at.y)?);
        }
        seen.then_some((colours, self.variance[i]))
    }
}

/// A place of the surface.
struct Place {
    voxel: usize,
    /// On the surface of its voxel [m].
    point: DVec3,
    /// Outward.
    normal: DVec3,
}

/// How much colours differ at each of several depths, over what is expected, and by how many that is judged.
#[derive(Clone, Copy)]
struct Difference<const N: usize> {
    squared: [f32; N],
    freedom: f32,
}

impl<const N: usize> Difference<N> {
    const NONE: Difference<N> = Difference { squared: [0.0; N], freedom: 0.0 };

    fn add(&mut self, other: &Difference<N>) {
        self.squared.iter_mut().zip(other.squared).for_each(|(own, other)| *own += other);
        self.freedom += other.freedom;
    }
}

/// Sums of differences over the 3x3x3 voxels around each voxel; of those few that have places around them.
struct Around<const N: usize> {
    /// Place of each voxel in `sums`.
    slots: Vec<u32>,
    sums: Vec<Difference<N>>,
}

impl<const N: usize> Around<N> {
    const NO_SLOT: u32 = u32::MAX;

    fn add(&mut self, voxel: usize, difference: &Difference<N>) {
        if self.slots[voxel] == Self::NO_SLOT {
            self.slots[voxel] = self.sums.len() as u32;
            self.sums.push(Difference::NONE);
        }
        self.sums[self.slots[voxel] as usize].add(difference);
    }

    fn at(&self, voxel: usize) -> Option<&Difference<N>> {
        self.sums.get(self.slots[voxel] as usize)
    }
}

/// A body of voxels half as large as those of the field that it comes from.
struct Solid {
    grid: DensityField,
    inside: Vec<bool>,
}

impl Solid {
    fn new(field: &DensityField, level: f64) -> Solid {
        let grid = field.upsample();
        let inside = grid.values.iter().map(|v| f64::from(*v) >= level).collect();
        Solid { grid, inside }
    }

    /// The eight voxels that a voxel of the field is made of.
    fn children(&self, field: &DensityField, index: usize) -> impl Iterator<Item = usize> + '_ {
        let [x, y, z] = field.voxel(index);
        (0..8).map(move |k| self.grid.index(2 * x + (k & 1), 2 * y + (k >> 1 & 1), 2 * z + (k >> 2)))
    }

    /// Whether a voxel is inside, at some distance from another one; beyond the grid nothing is.
    fn is_inside(&self, [x, y, z]: [usize; 3], [dx, dy, dz]: [i64; 3]) -> bool {
        let at = |c: usize, d: i64, n: usize| c.checked_add_signed(d as isize).filter(|c| *c < n);
        let [nx, ny, nz] = self.grid.size;
        match (at(x, dx, nx), at(y, dy, ny), at(z, dz, nz)) {
            (Some(x), Some(y), Some(z)) => self.inside[self.grid.index(x, y, z)],
            _ => false,
        }
    }

    /// The voxels with a face that is free.
    fn surface(&self) -> Vec<Place> {
        let faces = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]];
        let is_free = |i: usize| faces.iter().any(|face| !self.is_inside(self.grid.voxel(i), *face));
        let vicinity = vicinity();
        (0..self.inside.len())
            .into_par_iter()
            .filter(|&i| self.inside[i] && is_free(i))
            .map(|voxel| {
                let normal = self.normal(voxel, &vicinity);
                let point = self.grid.centre(self.grid.voxel(voxel)) + 0.5 * self.grid.spacing * normal;
                Place { voxel, point, normal }
            })
            .collect()
    }

    /// Away from where most of the voxels around are.
    fn normal(&self, voxel: usize, vicinity: &[([i64; 3], DVec3)]) -> DVec3 {
        let at = self.grid.voxel(voxel);
        let inside = vicinity.iter().filter(|(offset, _)| self.is_inside(at, *offset));
        (-inside.map(|(_, weighted)| *weighted).sum::<DVec3>()).normalize_or_zero()
    }

    fn depths(&self, views: &[Coloured], surface: &[Place]) -> Vec<Vec<f32>> {
        views.par_iter().map(|view| view.depths(surface, self.grid.spacing)).collect()
    }

    /// The share of each view's mask that the body fills.
    fn filled(&self, views: &[Coloured]) -> Vec<f64> {
        let depths = self.depths(views, &self.surface());
        let share = |(view, depths): (&Coloured, &Vec<f32>)| {
            let pixels = view.view.mask.iter().zip(depths).filter(|(m, _)| **m >= 0.5);
            let (sum, total) = pixels.fold((0usize, 0usize), |(s, n), (_, d)| (s + usize::from(d.is_finite()), n + 1));
            sum as f64 / total.max(1) as f64
        };
        views.iter().zip(&depths).map(share).collect()
    }

    /// Carves layer by layer what colours contradict; whether that comes to an end.
    fn carve(&mut self, views: &[Coloured], symmetry: &Symmetry, tolerance: f32) -> bool {
        let images = symmetry.images();
        let mut least = usize::MAX;
        for _ in 0..LAYERS {
            let surface = self.surface();
            let around = self.differences_around(views, &surface, &[0.0]);
            let contradicted = |place: &&Place| {
                let all = self.at_images(&around, &images, place);
                all.freedom >= ENOUGH && all.squared[0] > tolerance * all.freedom
            };
            let carved: Vec<usize> = surface.par_iter().filter(contradicted).map(|place| place.voxel).collect();
            carved.iter().for_each(|i| self.inside[*i] = false);
            if carved.len() as f64 <= FEW * surface.len() as f64 {
                return true;
            }
            if carved.len() as f64 > GROWN * least as f64 {
                return false;
            }
            least = least.min(carved.len());
        }
        false
    }

    /// How much colours differ in the 3x3x3 voxels around each voxel, where places are moved outward by each of `ways` [m].
    fn differences_around<const N: usize>(&self, views: &[Coloured], surface: &[Place], ways: &[f64; N]) -> Around<N> {
        let (depths, deep) = (self.depths(views, surface), DEEP * self.grid.spacing);
        let differences: Vec<Difference<N>> =
            surface.par_iter().map(|place| difference(place, views, &depths, deep, ways)).collect();
        let mut around = Around { slots: vec![Around::<N>::NO_SLOT; self.inside.len()], sums: Vec::new() };
        for (place, difference) in surface.iter().zip(&differences).filter(|(_, d)| d.freedom > 0.0) {
            self.grid.around(place.voxel).for_each(|i| around.add(i, difference));
        }
        around
    }

    /// Their sum over a place and its images.
    fn at_images<const N: usize>(&self, around: &Around<N>, images: &Images, place: &Place) -> Difference<N> {
        let mut all = Difference::NONE;
        for image in images.of(self.grid.centre(self.grid.voxel(place.voxel))) {
            if let Some(sum) = self.grid.discretize(image).and_then(|i| around.at(i)) {
                all.add(sum);
            }
        }
        all
    }
}

/// The voxels around one that tell which way its surface looks, and their offsets, weighted [voxels].
fn vicinity() -> Vec<([i64; 3], DVec3)> {
    let side = -VICINITY..=VICINITY;
    let offsets =
        side.clone().flat_map(|z| side.clone().flat_map(move |y| (-VICINITY..=VICINITY).map(move |x| [x, y, z])));
    offsets
        .map(|offset| {
            let way = DVec3::from_array(offset.map(|c| c as f64));
            (offset, way * (-0.22 * way.length_squared()).exp())
        })
        .collect()
}

/// How much the colours of a place, moved outward by each of `ways` [m], differ between the views of each moment that see it.
fn difference<const N: usize>(
    place: &Place,
    views: &[Coloured],
    depths: &[Vec<f32>],
    deep: f64,
    ways: &[f64; N],
) -> Difference<N> {
    let mut all = Difference::NONE;
    let seen = views.iter().zip(depths).filter_map(|(view, depths)| {
        let (colours, variance) = view.look(place, depths, deep, ways)?;
        Some((view.view.moment, colours, variance.recip()))
    });
    let seen: Vec<(usize, [Vec3; N], Vec3)> = seen.collect();
    for same in seen.chunk_by(|a, b| a.0 == b.0) {
        let weight: Vec3 = same.iter().map(|(_, _, w)| *w).sum();
        for k in 0..N {
            let mean = same.iter().map(|(_, c, w)| c[k] * *w).sum::<Vec3>() / weight;
            let squared: Vec3 = same.iter().map(|(_, c, w)| *w * (c[k] - mean) * (c[k] - mean)).sum();
            all.squared[k] += squared.element_sum();
        }
        all.freedom += 3.0 * (same.len() - 1) as f32;
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::symmetry::tests::outlines::{CENTRE, VOLUME, cameras, cross, gaussians, hit, mask, views};
    use crate::symmetry::tests::turned;
    use crate::{FillSettings, MirrorPlane, fill_outlines};

    /// The cross by its outlines, carved by pictures in these colours: its volume over the true one before and after, and the share of the
    /// true body that is left.
    fn carved(colour: impl Fn(usize, DVec3) -> DVec3) -> [f64; 3] {
        let (cameras, body) = (cameras(), |p| cross(p, DVec3::ZERO));
        let masks: Vec<Vec<f32>> = cameras.iter().map(|camera| mask(camera, &body)).collect();
        let pixels = |k: usize, camera: &Camera| {
            let middle = |i: usize| DVec2::new((i % camera.width) as f64 + 0.5, (i / camera.width) as f64 + 0.5);
            let shown = |i: usize| hit(camera, middle(i), &body).map_or(DVec3::ZERO, |point| colour(k, point));
            (0..camera.width * camera.height).flat_map(|i| shown(i).as_vec3().to_array()).collect()
        };
        let picture = |(k, camera): (usize, &Camera)| Picture {
            width: camera.width,
            height: camera.height,
            rgb: pixels(k, camera),
        };
        let pictures: Vec<Picture> = cameras.iter().enumerate().map(picture).collect();
        let planes = DVec3::AXES.iter().map(|axis| {
            let normal = turned() * *axis;
            MirrorPlane { normal, offset: normal.dot(CENTRE), misfit: 0.0 }
        });
        let symmetry = Symmetry { planes: planes.collect(), alike: Vec::new() };
        let settings = FillSettings::for_size(0.32);
        let mut filling = fill_outlines(&gaussians(), &views(&cameras, &masks), &symmetry, &settings).expect("a body");
        let before = filling.volume() / VOLUME;
        let coloured: Vec<ColouredView> = (0..3)
            .map(|k| ColouredView { camera: &cameras[k], picture: &pictures[k], mask: &masks[k], moment: 0 })
            .collect();
        filling.carve(&coloured, &symmetry);
        let inner: Vec<DVec3> = (gaussians().positions.iter().map(|p| DVec3::from(p.map(f64::from))))
            .filter(|p| body(*p) < -0.006)
            .collect();
        let left = inner.iter().filter(|p| filling.field.sample(**p) >= 0.5).count();
        [before, filling.volume() / VOLUME, left as f64 / inner.len() as f64]
    }

    fn stripes(p: DVec3) -> DVec3 {
        let wave = |k: DVec3| 0.5 + 0.4 * (k.dot(p)).sin();
        DVec3::new(
            wave(DVec3::new(60.0, 35.0, 0.0)),
            wave(DVec3::new(0.0, 70.0, -40.0)),
            wave(DVec3::new(-45.0, 0.0, 65.0)),
        )
    }

    /// Notches between arms, which outlines do not show.
    #[test]
    fn colours_carve_what_outlines_leave() {
        let [before, after, left] = carved(|_, p| stripes(p));
        println!("{before:.3} by outlines, {after:.3} by colours, {left:.4} of the body left");
        assert!(before > 1.1 && (after - 1.0).abs() < 0.25 * (before - 1.0) && left > 0.995, "{before} {after} {left}");
    }

    #[test]
    fn one_colour_carves_nothing() {
        let [before, after, left] = carved(|_, _| DVec3::splat(0.6));
        assert!((after - before).abs() < 1e-4 && left > 0.995, "{before} {after} {left}");
    }

    /// Cameras that agree on no colour at all must not take the body apart.
    #[test]
    fn cameras_that_see_other_colours_carve_hardly_anything() {
        let [before, after, left] = carved(|k, p| 0.5 * stripes(p) + 0.2 * k as f64);
        assert!(after > 0.98 * before && after <= before && left > 0.995, "{before} {after} {left}");
    }
}
