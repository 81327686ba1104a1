//! What can be wrong with the input of a metric.

/// Why a metric has no value.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum MetricError {
    /// Two inputs that must have the same number of elements do not.
    #[error("{what}: {found} elements where {expected} were expected; both sides must have the same shape")]
    Shape {
        /// Which input.
        what: &'static str,
        /// Number of elements it has.
        found: usize,
        /// Number of elements it must have.
        expected: usize,
    },
    /// There is nothing to measure.
    #[error("{what} is empty; a metric needs at least one element on both sides")]
    Empty {
        /// Which input.
        what: &'static str,
    },
    /// A rectangle of pixels is empty or reaches outside the image.
    #[error("columns {left}..{right}, rows {top}..{bottom} are not a rectangle inside an image of {width}x{height}")]
    Rectangle {
        /// First column.
        left: usize,
        /// One past the last column.
        right: usize,
        /// First row.
        top: usize,
        /// One past the last row.
        bottom: usize,
        /// Image width [pixels].
        width: usize,
        /// Image height [pixels].
        height: usize,
    },
    /// A number is NaN or infinite.
    #[error("{what}: element {index} is not a finite number; find out where it was made before measuring it")]
    NotFinite {
        /// Which input.
        what: &'static str,
        /// Index of the first such element.
        index: usize,
    },
}

/// Fails when two lengths differ.
pub(crate) fn same_length(what: &'static str, found: usize, expected: usize) -> Result<(), MetricError> {
    if found == expected { Ok(()) } else { Err(MetricError::Shape { what, found, expected }) }
}

/// Fails when a cloud is empty or holds a coordinate that is not finite.
pub(crate) fn usable_cloud(what: &'static str, points: &[[f32; 3]]) -> Result<(), MetricError> {
    if points.is_empty() {
        return Err(MetricError::Empty { what });
    }
    match points.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
        None => Ok(()),
        Some(index) => Err(MetricError::NotFinite { what, index }),
    }
}
