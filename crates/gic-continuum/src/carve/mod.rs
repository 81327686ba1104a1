//! Carving by colours: where cameras see different colours at a place, no surface is there (Kutulakos & Seitz 2000, "A
//! Theory of Shape by Space Carving").
//!
//! Outlines never show a notch that other parts of the body surround; pictures do. Layer by layer, places of the
//! surface are taken away that look different to the cameras that see them. Three cameras seldom see the same place,
//! but a body that is its own mirror image has the same shape at all images of a place, if not the same colours: one
//! place that two cameras see decides about all its images.
//!
//! How much colours differ on a true surface hangs on the cameras, the light and the material, and nobody gives it. But
//! who carves too much opens the body: then layers grow from one to the next, which shrink where carving comes to a
//! surface, and the body fills its outlines no longer. So the tolerance is lowered step by step until that happens.
//! What is left then settles where colours agree best ([`settle`]).

mod coloured;
mod difference;
mod displacement;
mod place;
mod settle;
mod solid;

use rayon::prelude::*;

use self::solid::{Solid, reach};
use crate::fill::smooth;
use crate::tuning::CarvingTuning;
use crate::{Filling, Symmetry, Tuning};

pub use self::coloured::ColouredView;
pub(crate) use self::{
    coloured::{Coloured, Visibility},
    difference::{SeenColours, difference_of},
    displacement::Displacement,
    place::Place,
    settle::{Curve, DEPTH_STEP, depths_of_sweep, outward, smoothed},
};

/// How far from its pixel's centre a place is looked up [pixels].
const HALF_PIXEL: f32 = 0.5;

/// How far behind what is nearest a place is still seen, on voxels of half a field's side [m].
pub(crate) fn visible_depth(half_voxel: f64, tuning: &CarvingTuning) -> f64 {
    reach(tuning.smoothing_deviation) * half_voxel
}

impl Filling {
    /// Takes away of a body what the colours of `views` contradict at a place and at its images by `symmetry`, and
    /// moves the surface of what is left to where they agree best.
    pub fn carve(&mut self, views: &[ColouredView], symmetry: &Symmetry, tuning: &Tuning) {
        let noise = tuning.carving.colour_noise;
        let views: Vec<Coloured> =
            views.par_iter().map(|view| Coloured::new(view, HALF_PIXEL, noise, tuning)).collect();
        let mut body = Solid::new(&self.field, self.th_min);
        let whole = body.inside.clone();
        let filled = body.filled(&views, tuning);
        for tolerance in tolerances(&tuning.carving) {
            let before = body.inside.clone();
            let ended = body.carve_layers(&views, symmetry, tolerance, tuning);
            if !ended || body.loses_outlines(&views, &filled, tuning.carving.lost_outline, tuning) {
                body.inside = before;
                break;
            }
        }
        self.take_away(&body, &whole);
        self.settle(&views, symmetry, tuning);
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

/// The tolerances with which a body is carved, one after the other.
fn tolerances(carving: &CarvingTuning) -> impl Iterator<Item = f32> {
    let (first, factor, last) = (carving.first_tolerance, carving.tolerance_factor, carving.last_tolerance);
    let all = std::iter::successors(Some(first), move |tolerance| Some(factor * tolerance));
    all.take_while(move |tolerance| *tolerance >= last)
}

#[cfg(test)]
mod tests {
    use gic_scene::{Camera, Picture};
    use glam::{DVec2, DVec3};

    use super::*;
    use crate::test_cross::{CENTRE, VOLUME, cameras, cross, gaussians, hit, mask, turned, views};
    use crate::{FillSettings, MirrorPlane, fill_outlines};

    /// The cross by its outlines, carved by pictures in these colours: its volume over the true one before and after,
    /// and the share of the true body that is left.
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
        let symmetry = Symmetry { planes: planes.collect(), interchangeable_planes: Vec::new() };
        let settings = FillSettings::for_size(0.32);
        let mut filling = fill_outlines(&gaussians(), &views(&cameras, &masks), &symmetry, &settings).expect("a body");
        let before = filling.volume() / VOLUME;
        let coloured: Vec<ColouredView> = (0..3)
            .map(|k| ColouredView { camera: &cameras[k], picture: &pictures[k], mask: &masks[k], moment: 0 })
            .collect();
        filling.carve(&coloured, &symmetry, &settings.tuning);
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
