//! Homographies of four points, and the pose of a tag that one tells.

use nalgebra::{Isometry3, Matrix3, Rotation3, SMatrix, SVector, Translation3, UnitQuaternion};

use crate::board::CORNERS;
use crate::lens::Lens;

/// The homography that maps four places to four others, its last element 1; `None` where three lie on a line.
pub(crate) fn homography(from: &[[f64; 2]; 4], to: &[[f64; 2]; 4]) -> Option<Matrix3<f64>> {
    let mut left = SMatrix::<f64, 8, 8>::zeros();
    let mut right = SVector::<f64, 8>::zeros();
    for (k, ([x, y], [u, v])) in from.iter().zip(to).enumerate() {
        left.row_mut(2 * k).copy_from_slice(&[*x, *y, 1.0, 0.0, 0.0, 0.0, -u * x, -u * y]);
        left.row_mut(2 * k + 1).copy_from_slice(&[0.0, 0.0, 0.0, *x, *y, 1.0, -v * x, -v * y]);
        (right[2 * k], right[2 * k + 1]) = (*u, *v);
    }
    let h = left.lu().solve(&right)?;
    let map = Matrix3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], 1.0);
    map.iter().all(|value| value.is_finite()).then_some(map)
}

/// Where a tag with sides of `side_m` lies before a camera: the rotation next to the homography's first two columns
/// (Zhang 2000).
pub(crate) fn camera_from_tag(lens: &Lens, corners: &[[f64; 2]; 4], side_m: f64) -> Option<Isometry3<f64>> {
    let directions = corners.map(|corner| {
        let direction = lens.direction(corner);
        [direction.x, direction.y]
    });
    let h = homography(&CORNERS.map(|corner| corner.map(|c| c * side_m)), &directions)?;
    let scale = 2.0 / (h.column(0).norm() + h.column(1).norm());
    let (x, y) = (h.column(0) * scale, h.column(1) * scale);
    let svd = Matrix3::from_columns(&[x, y, x.cross(&y)]).svd(true, true);
    let rotation = svd.u? * svd.v_t?;
    let place = h.column(2) * scale;
    (place.z > 0.0 && rotation.determinant() > 0.0).then(|| {
        let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
        Isometry3::from_parts(Translation3::from(place), turn)
    })
}
