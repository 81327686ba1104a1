//! Two ways to a body's first shape, and which of them is taken.
//!
//! | | by depths | by outlines |
//! |---|---|---|
//! | evidence | depths and masks | masks and their mirror images |
//! | steps | [`crate::fill`], [`crate::Completion`] | [`crate::fill_outlines`] |
//! | symmetry | mirror planes of the surface, if there are any | three mirror planes of the outlines, a condition |
//!
//! Depths are taken unless they are known to be poor. The Gaussians of a body that only three cameras see fill its
//! hull, which is twice the body, and their depths empty what is full: the surface that they leave shows fewer mirror
//! planes than the body has. Outlines are right to a fraction of a pixel even then, but a few of them leave too much
//! where no mirror images add to them. So outlines are taken where the surface shows fewer than three planes and the
//! outlines show three.

use crate::{Filling, Symmetry};

/// Views that must have a mask before mirror planes are looked for: one view tells nothing of a body's far side.
pub(crate) const FEWEST_VIEWS: usize = 2;

/// What makes a body's first shape.
#[derive(Clone, Debug, PartialEq)]
pub enum ShapeFrom {
    /// Depths and masks.
    Depths,
    /// Outlines and their images by these mirror planes.
    Outlines(Symmetry),
}

impl ShapeFrom {
    /// The decision: of the body that its depths make, of the mirror planes that this body's surface shows, and of
    /// those that the outlines show, which are asked for only where they matter.
    pub fn decide(
        by_depths: &Filling,
        by_surface: Option<&Symmetry>,
        by_outlines: impl FnOnce() -> Symmetry,
    ) -> ShapeFrom {
        let surface_is_known = by_surface.is_some_and(|symmetry| symmetry.planes.len() == 3);
        if surface_is_known || by_depths.views_used < FEWEST_VIEWS {
            return ShapeFrom::Depths;
        }
        let symmetry = by_outlines();
        if symmetry.planes.is_empty() { ShapeFrom::Depths } else { ShapeFrom::Outlines(symmetry) }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::MirrorPlane;

    fn planes(count: usize) -> Symmetry {
        let plane = MirrorPlane { normal: DVec3::X, offset: 0.0, misfit: 0.0 };
        Symmetry { planes: vec![plane; count], interchangeable_planes: Vec::new() }
    }

    fn decide(views_used: usize, by_surface: Option<usize>, by_outlines: usize) -> ShapeFrom {
        let body = Filling::of_body((DVec3::ZERO, DVec3::ONE), 0.5, 0.1, |p| p.length() - 0.5).expect("a small grid");
        let body = Filling { views_used, ..body };
        ShapeFrom::decide(&body, by_surface.map(planes).as_ref(), || planes(by_outlines))
    }

    #[test]
    fn outlines_make_the_body_where_they_show_more_than_its_surface() {
        for by_surface in [None, Some(1), Some(2)] {
            assert_eq!(decide(3, by_surface, 3), ShapeFrom::Outlines(planes(3)), "{by_surface:?}");
            assert_eq!(decide(3, by_surface, 0), ShapeFrom::Depths, "{by_surface:?}");
        }
        assert_eq!(decide(11, Some(3), 3), ShapeFrom::Depths);
        assert_eq!(decide(1, None, 3), ShapeFrom::Depths);
    }
}
