//! Poses and intrinsics as formats store them, checked and converted to the one camera convention.

use glam::{DMat3, DVec2, DVec3};
use thiserror::Error;

use crate::lens::Lens;

/// Why a camera's pose or intrinsics cannot be used.
#[derive(Clone, Debug, PartialEq, Error)]
pub(super) enum CameraError {
    #[error("the camera-to-world matrix must have 3 or 4 rows of 4 numbers")]
    PoseShape,
    #[error("the camera's position is not finite")]
    Position,
    #[error("the rotation is not orthonormal")]
    NotOrthonormal,
    #[error("the rotation is mirrored (determinant -1)")]
    Mirrored,
    #[error("{0} must hold three finite numbers")]
    Vector(&'static str),
    #[error("it is not in this file")]
    Missing,
    #[error("{0}")]
    Json(String),
    #[error("the intrinsic matrix must have 3 rows of 3 numbers")]
    IntrinsicShape,
    #[error("the focal lengths must be positive and the principal point finite")]
    Intrinsics,
    #[error("{0} distortion coefficients; up to 8 are supported, in OpenCV's order k1 k2 p1 p2 k3 k4 k5 k6")]
    Distortion(usize),
    #[error("skew {0} is not supported; undistort the pictures first")]
    Skew(f64),
    /// nerfstudio's keys.
    #[error("{0}")]
    Keys(&'static str),
}

/// A camera model that is not supported, as its file calls it.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("{0}")]
pub(super) struct UnsupportedModel(pub(super) String);

/// Rotation (columns: right, down, forward) and centre from a camera-to-world matrix with three or four rows of four,
/// written for OpenGL's axes: x right, y up, looking along -z.
pub(super) fn from_opengl_c2w(rows: &[Vec<f64>]) -> Result<(DMat3, DVec3), CameraError> {
    if !(3..=4).contains(&rows.len()) || rows.iter().any(|row| row.len() != 4) {
        return Err(CameraError::PoseShape);
    }
    let column = |c: usize| DVec3::new(rows[0][c], rows[1][c], rows[2][c]);
    let rotation = DMat3::from_cols(column(0), -column(1), -column(2));
    check_rotation(rotation)?;
    let centre = column(3);
    if !centre.is_finite() {
        return Err(CameraError::Position);
    }
    Ok((rotation, centre))
}

/// Refuses matrices that are no rotation: not finite, scaled, sheared or mirrored.
pub(super) fn check_rotation(rotation: DMat3) -> Result<(), CameraError> {
    let deviation = rotation.transpose() * rotation - DMat3::IDENTITY;
    // Phrased so that NaN fails.
    if !deviation.to_cols_array().iter().all(|value| value.abs() < 1e-2) {
        return Err(CameraError::NotOrthonormal);
    }
    if rotation.determinant() < 0.0 {
        return Err(CameraError::Mirrored);
    }
    Ok(())
}

/// Focal lengths and principal point [pixels] from a 3x3 intrinsic matrix.
pub(super) fn from_intrinsic_matrix(rows: &[Vec<f64>]) -> Result<(DVec2, DVec2), CameraError> {
    if rows.len() != 3 || rows.iter().any(|row| row.len() != 3) {
        return Err(CameraError::IntrinsicShape);
    }
    let (focal, principal) = (DVec2::new(rows[0][0], rows[1][1]), DVec2::new(rows[0][2], rows[1][2]));
    if !(focal.x > 0.0 && focal.y > 0.0 && focal.is_finite() && principal.is_finite()) {
        return Err(CameraError::Intrinsics);
    }
    if rows[0][1].abs() > 1e-6 * focal.x {
        return Err(CameraError::Skew(rows[0][1]));
    }
    Ok((focal, principal))
}

/// The lens of distortion coefficients in OpenCV's order, which may be none.
pub(super) fn lens(distortion: &[f64]) -> Result<Option<Lens>, CameraError> {
    let lens = Lens::of_opencv(distortion).ok_or(CameraError::Distortion(distortion.len()))?;
    Ok(lens.unless_trivial())
}
