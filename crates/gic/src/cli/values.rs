//! Values of flags from their texts.

use std::fmt;
use std::str::FromStr;

use gic_grasp::MAX_REFINEMENT;

/// Longest side of a picture [pixels].
const LONGEST_SIDE_PX: usize = 8192;

/// Most threads: more than any machine has cores for.
const MOST_THREADS: usize = 1024;

/// What a value must be.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub(crate) enum ValueError {
    #[error("must be a whole number of at least 1")]
    Count,
    #[error("must be a whole number from 1 to {MOST_THREADS}")]
    Threads,
    #[error("must be like 640x480, each side at most {LONGEST_SIDE_PX}")]
    Size,
    #[error("must be like 0.022x0.0375, two lengths in metres")]
    Pad,
    #[error("must be a length in metres above 0")]
    Length,
    #[error("must be a number of at least 0")]
    Coefficient,
    #[error("must be a whole number from 1 to {MAX_REFINEMENT}")]
    Refinement,
    #[error("must be a number of seconds of at least 0")]
    Seconds,
    #[error("must be a number above 0")]
    PositiveNumber,
}

pub(crate) fn positive(text: &str) -> Result<usize, ValueError> {
    text.parse().ok().filter(|n| *n >= 1).ok_or(ValueError::Count)
}

pub(crate) fn threads(text: &str) -> Result<usize, ValueError> {
    text.parse().ok().filter(|n| (1..=MOST_THREADS).contains(n)).ok_or(ValueError::Threads)
}

pub(crate) fn size(text: &str) -> Result<[usize; 2], ValueError> {
    let sides: Option<Vec<usize>> = text.split('x').map(|side| side.parse().ok()).collect();
    let sides: [usize; 2] = sides.and_then(|sides| sides.try_into().ok()).ok_or(ValueError::Size)?;
    if sides.iter().all(|side| (1..=LONGEST_SIDE_PX).contains(side)) { Ok(sides) } else { Err(ValueError::Size) }
}

/// A pad's sides, across and along the finger [m].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pad(pub(crate) [f64; 2]);

impl FromStr for Pad {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<Self, ValueError> {
        let sides: Option<Vec<f64>> = text.split('x').map(|side| length(side).ok()).collect();
        sides.and_then(|sides| sides.try_into().ok()).map(Pad).ok_or(ValueError::Pad)
    }
}

impl fmt::Display for Pad {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.0[0], self.0[1])
    }
}

pub(crate) fn length(text: &str) -> Result<f64, ValueError> {
    finite(text).filter(|metres| *metres > 0.0).ok_or(ValueError::Length)
}

pub(crate) fn coefficient(text: &str) -> Result<f64, ValueError> {
    finite(text).filter(|coefficient| *coefficient >= 0.0).ok_or(ValueError::Coefficient)
}

pub(crate) fn refinement(text: &str) -> Result<usize, ValueError> {
    text.parse().ok().filter(|n| (1..=MAX_REFINEMENT).contains(n)).ok_or(ValueError::Refinement)
}

pub(crate) fn positive_number(text: &str) -> Result<f64, ValueError> {
    finite(text).filter(|times| *times > 0.0).ok_or(ValueError::PositiveNumber)
}

pub(crate) fn seconds(text: &str) -> Result<f64, ValueError> {
    finite(text).filter(|seconds| *seconds >= 0.0).ok_or(ValueError::Seconds)
}

fn finite(text: &str) -> Option<f64> {
    text.parse().ok().filter(|number: &f64| number.is_finite())
}
