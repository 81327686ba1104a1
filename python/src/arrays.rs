//! From arrays to the engine's vectors and back.

use glam::DVec3;
use numpy::{Element, IntoPyArray, PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;

/// The rows of an array of shape [n, 3].
///
/// # Errors
/// An array that is not contiguous.
pub(crate) fn vectors(array: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<DVec3>> {
    Ok(array.as_slice()?.chunks_exact(3).map(DVec3::from_slice).collect())
}

/// Vectors one after the other.
pub(crate) fn flat(vectors: &[DVec3]) -> impl Iterator<Item = f64> + '_ {
    vectors.iter().flat_map(DVec3::to_array)
}

/// Numbers as an array, without a copy.
///
/// # Errors
/// Another number of numbers than the shape has.
pub(crate) fn shaped<'py, T: Element>(
    py: Python<'py>,
    numbers: Vec<T>,
    shape: &[usize],
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    let array: Bound<'py, PyArray1<T>> = numbers.into_pyarray(py);
    array.reshape(shape)
}
