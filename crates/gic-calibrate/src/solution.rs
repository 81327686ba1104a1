//! What an adjusted bundle says of cameras and corners.

use crate::bundle::Bundle;
use crate::lens::LENS_UNKNOWNS;
use crate::rig::Rig;

/// An adjusted bundle, without the sightings that it borrows.
pub(crate) struct Solution {
    /// Where everything is.
    pub(crate) rig: Rig,
    /// Per corner: number of the view, where it is seen, seen minus predicted [pixels], whether it counts.
    pub(crate) corners: Vec<CornerReport>,
    /// Per camera.
    pub(crate) deviations: Vec<CameraCovariance>,
}

/// A corner, and how far off it is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CornerReport {
    pub(crate) view: usize,
    pub(crate) seen: [f64; 2],
    pub(crate) residual: [f64; 2],
    pub(crate) is_kept: bool,
}

/// What a camera's part of the covariance says.
#[derive(Clone, Debug, Default)]
pub(crate) struct CameraCovariance {
    /// Of the lens's unknowns, shape [8, 8]; `None` for a known lens.
    pub(crate) lens: Option<nalgebra::DMatrix<f64>>,
    /// Of the centre [m], shape [3, 3].
    pub(crate) centre: Option<nalgebra::DMatrix<f64>>,
}

impl Solution {
    pub(crate) fn of(bundle: Bundle) -> Solution {
        let corner = |n: usize| CornerReport {
            view: bundle.corners[n].view,
            seen: bundle.corners[n].seen.into(),
            residual: bundle.residual(n).into(),
            is_kept: bundle.corners[n].is_kept,
        };
        let corners = (0..bundle.corners.len()).map(corner).collect();
        let covariance = bundle.covariance();
        let part = |first: usize, count: usize| {
            covariance.as_ref().map(|all| all.view((first, first), (count, count)).into_owned())
        };
        let deviations = (0..bundle.rig.lenses.len())
            .map(|camera| CameraCovariance {
                lens: bundle.lens_at(camera).and_then(|first| part(first, LENS_UNKNOWNS)),
                centre: part(bundle.camera_at(camera) + 3, 3),
            })
            .collect();
        Solution { corners, deviations, rig: bundle.rig }
    }
}
