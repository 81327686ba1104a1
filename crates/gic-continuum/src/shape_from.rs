//! Two ways to a body's shape, and which of them is taken.
//!
//! | | by depths | by outlines |
//! |---|---|---|
//! | evidence | depths and masks of each frame by itself | masks and colours of all frames in which the body is rigid |
//! | steps | [`crate::fill`], [`crate::Completion`] | [`crate::fill_outlines`], [`Filling::carve`] |
//! | symmetry | mirror planes of the surface, if there are any | three mirror planes of the outlines, a condition |
//!
//! Depths are taken unless they are known to be poor. The Gaussians of a body that only three cameras see fill its
//! hull, which is twice the body, and their depths empty what is full: the surface that they leave shows fewer mirror
//! planes than the body has. Outlines are right to a fraction of a pixel even then. But without three planes at right
//! angles nothing tells how the body moves between the frames, and few outlines leave too much. So outlines are taken
//! where the surface shows fewer than three planes and the outlines show three.

use crate::{Filling, Symmetry};

/// Views that must have a mask before mirror planes are looked for: one view tells nothing of a body's far side.
pub(crate) const FEWEST_VIEWS: usize = 2;

/// What makes a body's shape.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ShapeFrom<Outlines> {
    /// Depths and masks.
    Depths,
    /// Outlines of the frames in which the body is rigid, given by whatever knows these.
    Outlines(Outlines),
}

impl<Outlines> ShapeFrom<Outlines> {
    /// The decision, made once, at the first frame: of the body that its depths make, of the mirror planes that this
    /// body's surface shows, and of what the outlines show, which is asked for only where it matters and is `None`
    /// where they show no three planes.
    ///
    /// # Errors
    /// Those of `by_outlines`.
    pub fn decide<E>(
        by_depths: &Filling,
        by_surface: Option<&Symmetry>,
        by_outlines: impl FnOnce() -> Result<Option<Outlines>, E>,
    ) -> Result<ShapeFrom<Outlines>, E> {
        let surface_is_known = by_surface.is_some_and(|symmetry| symmetry.planes.len() == 3);
        if surface_is_known || by_depths.views_used < FEWEST_VIEWS {
            return Ok(ShapeFrom::Depths);
        }
        Ok(by_outlines()?.map_or(ShapeFrom::Depths, ShapeFrom::Outlines))
    }
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use glam::DVec3;

    use super::*;
    use crate::MirrorPlane;

    fn decide(views_used: usize, planes: Option<usize>, outlines: Option<()>) -> ShapeFrom<()> {
        let body = Filling::of_body((DVec3::ZERO, DVec3::ONE), 0.5, 0.1, |p| p.length() - 0.5).expect("a small grid");
        let body = Filling { views_used, ..body };
        let plane = MirrorPlane { normal: DVec3::X, offset: 0.0, misfit: 0.0 };
        let symmetry = planes.map(|n| Symmetry { planes: vec![plane; n], interchangeable_planes: Vec::new() });
        let Ok(shape) = ShapeFrom::decide(&body, symmetry.as_ref(), || Ok::<_, Infallible>(outlines));
        shape
    }

    #[test]
    fn outlines_make_the_body_where_they_show_more_than_its_surface() {
        for planes in [None, Some(1), Some(2)] {
            assert_eq!(decide(3, planes, Some(())), ShapeFrom::Outlines(()), "{planes:?}");
            assert_eq!(decide(3, planes, None), ShapeFrom::Depths, "{planes:?}");
        }
        assert_eq!(decide(11, Some(3), Some(())), ShapeFrom::Depths);
        assert_eq!(decide(1, None, Some(())), ShapeFrom::Depths);
    }
}
