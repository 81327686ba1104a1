//! Mirror planes of a body, and what they tell of its parts that no view sees.
//!
//! Most things that people make are mirror images of themselves. Where a body is, each place of it is looked at a
//! second time, from the other side of the plane: the underside of an arm by the views of another arm's top. A plane is
//! believed where the surface that is seen lies on its own mirror image, to a small part of the size, and the outlines
//! agree; a body without such planes stays as it is.
//!
//! 1. [`surface`] finds up to three planes at right angles in the surface.
//! 2. [`outline`] moves them to where the outlines agree with each other's mirror images, because outlines are sharper
//!    than surfaces; and finds them in outlines alone where too little of the surface is known.
//! 3. [`completion`] averages the body with its mirror images, each by how well the views know the surface there.

mod completion;
mod outline;
mod planes;
mod surface;

pub(crate) use outline::Outline;
pub(crate) use planes::direction;
pub use {
    completion::Completion,
    planes::{MirrorPlane, Symmetry},
};

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};
    use proptest::prelude::*;

    use super::surface::KnownSurface;
    use super::*;
    use crate::test_cross::{cameras, masks, turned, upright_cross, views};
    use crate::{Filling, Tuning};

    const VOXEL: f64 = 0.006;

    fn centre() -> DVec3 {
        DVec3::new(0.03, 0.5, -0.02)
    }

    fn filled(distance: impl Fn(DVec3) -> f64) -> Filling {
        let reach = DVec3::splat(0.24);
        let body =
            Filling::of_body((centre() - reach, centre() + reach), VOXEL, 1.5 * VOXEL, distance).expect("a body");
        Filling { views_used: 2, ..body }
    }

    /// Whether a place of the cross, in its own frame, lies low in one of the notches between its arms.
    fn in_notch(p: DVec3) -> bool {
        p.x > 0.0 && p.y < 0.0 && p.z.abs() < 0.04 && p.x - p.y < 0.12
    }

    /// The cross with a notch that no view looks into and that is filled.
    fn overfilled() -> Filling {
        let own = |p: DVec3| turned().inverse() * (p - centre());
        let mut filling =
            filled(|p| if in_notch(own(p)) { upright_cross(own(p)).min(-VOXEL) } else { upright_cross(own(p)) });
        let near = |p: DVec3| {
            DVec3::AXES.iter().any(|a| in_notch(own(p + 3.0 * VOXEL * *a)) || in_notch(own(p - 3.0 * VOXEL * *a)))
        };
        filling.doubt = (0..filling.field.len())
            .map(|i| {
                let place = filling.field.centre(filling.field.voxel(i));
                f32::from(u8::from(near(place) && upright_cross(own(place)) > -0.5 * VOXEL))
            })
            .collect();
        filling
    }

    /// Whether the completion changes a body that three cameras see.
    fn completes(completion: &mut Completion, body: &dyn Fn(DVec3) -> f64) -> bool {
        let cameras = cameras();
        let masks = masks(&cameras, body);
        let mut filling = filled(body);
        let before = filling.field.clone();
        completion.next(&mut filling, &views(&cameras, &masks), &Tuning::default());
        filling.field != before
    }

    #[test]
    fn the_planes_of_a_cross_are_found_and_empty_a_notch_that_no_view_sees() {
        let mut filling = overfilled();
        let truth = filled(|p| upright_cross(turned().inverse() * (p - centre()))).volume();
        let before = filling.volume() / truth - 1.0;
        let tuning = Tuning::default();
        let surface = KnownSurface::new(&filling, &tuning.symmetry);
        let symmetry = surface.symmetry();
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
        let tuning = Tuning::default();
        let surface = KnownSurface::new(&filling, &tuning.symmetry);
        let symmetry = surface.symmetry();
        assert_eq!(symmetry.planes, Vec::new());
        let before = filling.field.clone();
        filling.complete(&symmetry, &surface);
        assert_eq!(filling.field, before);
    }

    #[test]
    fn a_body_that_no_view_sees_has_no_planes() {
        let mut filling = filled(|p| upright_cross(turned().inverse() * (p - centre())));
        filling.doubt = vec![1.0; filling.field.len()];
        assert_eq!(KnownSurface::new(&filling, &Tuning::default().symmetry).symmetry().planes, Vec::new());
    }

    #[test]
    fn a_body_that_has_changed_its_shape_is_left_alone() {
        let sheared =
            |p: DVec3, by: f64| upright_cross(turned().inverse() * (p - centre() - by * (p.y - centre().y) * DVec3::X));
        let mut completion = Completion::default();
        let completed = [0.0, 0.3, 0.0].map(|shear| completes(&mut completion, &|p| sheared(p, shear)));
        assert_eq!(completed, [true, false, false]);
        assert_eq!(completion.first().map(|first| first.planes.len()), Some(3));
    }

    #[test]
    fn a_thin_part_that_is_on_one_side_only_shows_in_the_outlines() {
        let own = |p: DVec3| turned().inverse() * (p - centre());
        let tail = |p: DVec3| {
            let along = DVec3::new(0.6, 0.5, 0.624);
            let t = p.dot(along).clamp(0.0, 0.22);
            (p - t * along).length() - 0.008
        };
        let body = |p: DVec3| upright_cross(own(p)).min(tail(own(p)));
        assert_eq!(KnownSurface::new(&filled(body), &Tuning::default().symmetry).symmetry().planes.len(), 3);
        let mut completion = Completion::default();
        assert!(!completes(&mut completion, &body));
        assert_eq!(completion.first(), None);
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
            let interchangeable_planes = [[0, 2], [1, 2], [0, 1]][..pairs].to_vec();
            let symmetry = Symmetry { planes: planes.collect(), interchangeable_planes };
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
