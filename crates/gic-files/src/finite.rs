//! Numbers that are none do not reach a file: no reader expects them.

use std::io;

/// A number that is not finite, by its place.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{place}` is {number}, and only finite numbers are written; this is a fault of gic, please report it")]
pub struct NotFinite {
    /// Keys and list positions, as in `intervals_95.poisson_ratio[0]`.
    pub place: String,
    /// What it is: `NaN`, `inf` or `-inf`.
    pub number: String,
}

impl From<NotFinite> for io::Error {
    fn from(reason: NotFinite) -> Self {
        io::Error::new(io::ErrorKind::InvalidData, reason)
    }
}

/// Checks that every number of a row is finite; `place` names one by its index.
///
/// # Errors
/// [`NotFinite`] with the place of the first that is not.
pub fn require_finite_numbers(numbers: &[f32], place: impl FnOnce(usize) -> String) -> Result<(), NotFinite> {
    match numbers.iter().position(|number| !number.is_finite()) {
        None => Ok(()),
        Some(i) => Err(NotFinite { place: place(i), number: numbers[i].to_string() }),
    }
}
