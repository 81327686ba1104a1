//! Where the object is, from its masks alone: the rays through the masks' centres meet in it.

use glam::{DMat3, DVec2, DVec3};

use super::Target;

/// A ball around the object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ball {
    /// Centre in the world [m].
    pub centre: DVec3,
    /// Radius [m].
    pub radius: f64,
}

/// The point nearest to the rays through the centres of the masks (least squares); `None` when the rays do not fix one.
pub fn mask_centre<'a>(targets: impl Iterator<Item = &'a Target>) -> Option<DVec3> {
    let (mut a, mut b, mut rays) = (DMat3::ZERO, DVec3::ZERO, 0);
    for target in targets.filter(|t| t.area > 0.0) {
        let through = target.camera.unproject(DVec2::from_array(target.centre), 1.0);
        let d = (through - target.camera.centre).normalize();
        let across = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        a += across;
        b += across * target.camera.centre;
        rays += 1;
    }
    let centre = a.inverse() * b;
    (rays >= 2 && centre.is_finite()).then_some(centre)
}

/// A ball that holds what the masks of `targets` show: centred where their rays meet, as wide as the widest mask.
pub fn ball(targets: &[&Target]) -> Option<Ball> {
    let centre = mask_centre(targets.iter().copied())?;
    let mut radius = 0.0f64;
    for target in targets.iter().filter(|t| t.area > 0.0) {
        let (_, depth) = target.camera.project(centre)?;
        let b = &target.bounds;
        let reach = |near: usize, far: usize, c: f64| (c - near as f64).max(far as f64 - c);
        let half = DVec2::new(reach(b.x0, b.x1, target.centre[0]), reach(b.y0, b.y1, target.centre[1]));
        radius = radius.max((half / target.camera.focal).length() * depth);
    }
    (radius > 0.0).then_some(Ball { centre, radius })
}
