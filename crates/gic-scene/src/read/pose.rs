//! Poses and intrinsics as formats store them, checked and converted to the one camera convention.

use glam::{DMat3, DVec2, DVec3};

/// The axes of the camera frame that a camera-to-world matrix is written for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Axes {
    /// x right, y up, looks along -z (OpenGL, Blender, nerfstudio, PAC-NeRF, Spring-Gaus synthetic).
    OpenGl,
}

/// Rotation (columns: right, down, forward) and centre from a camera-to-world matrix with three or four rows of four.
pub(crate) fn from_c2w(rows: &[Vec<f64>], axes: Axes) -> Result<(DMat3, DVec3), String> {
    if !(3..=4).contains(&rows.len()) || rows.iter().any(|row| row.len() != 4) {
        return Err("the camera-to-world matrix must have 3 or 4 rows of 4 numbers".into());
    }
    let column = |c: usize| DVec3::new(rows[0][c], rows[1][c], rows[2][c]);
    let rotation = match axes {
        Axes::OpenGl => DMat3::from_cols(column(0), -column(1), -column(2)),
    };
    check_rotation(rotation)?;
    let centre = column(3);
    if !centre.is_finite() {
        return Err("the camera's position is not finite".into());
    }
    Ok((rotation, centre))
}

/// Refuses matrices that are no rotation: not finite, scaled, sheared or mirrored.
pub(crate) fn check_rotation(rotation: DMat3) -> Result<(), String> {
    let deviation = rotation.transpose() * rotation - DMat3::IDENTITY;
    // Phrased so that NaN fails.
    if !deviation.to_cols_array().iter().all(|value| value.abs() < 1e-2) {
        return Err("the rotation is not orthonormal".into());
    }
    if rotation.determinant() < 0.0 {
        return Err("the rotation is mirrored (determinant -1)".into());
    }
    Ok(())
}

/// Focal lengths and principal point [pixels] from a 3x3 intrinsic matrix.
pub(crate) fn from_intrinsic_matrix(rows: &[Vec<f64>]) -> Result<(DVec2, DVec2), String> {
    if rows.len() != 3 || rows.iter().any(|row| row.len() != 3) {
        return Err("the intrinsic matrix must have 3 rows of 3 numbers".into());
    }
    let (focal, principal) = (DVec2::new(rows[0][0], rows[1][1]), DVec2::new(rows[0][2], rows[1][2]));
    if !(focal.x > 0.0 && focal.y > 0.0 && focal.is_finite() && principal.is_finite()) {
        return Err("the focal lengths must be positive and the principal point finite".into());
    }
    if rows[0][1].abs() > 1e-6 * focal.x {
        return Err(format!("skew {} is not supported; undistort the pictures first", rows[0][1]));
    }
    Ok((focal, principal))
}
