//! How trajectories change with single numbers of the world: central differences of rollouts side by side.

use glam::DVec3;
use rayon::prelude::*;

use super::simulator::rollout;
use super::unknown::Unknown;
use crate::World;
use crate::error::SimulationError;
use crate::options::{Options, Precision};

/// Derivatives of frames with respect to one number of the world, per unit of the number.
#[derive(Clone, Debug, PartialEq)]
pub struct Tangent {
    /// Of the positions [m], shape [frames, n].
    pub positions: Vec<Vec<DVec3>>,
    /// Of the velocities [m/s], shape [frames, n].
    pub velocities: Vec<Vec<DVec3>>,
}

/// Derivatives of the frames listed in `frames` with respect to each of `unknowns`, by central differences: two
/// rollouts for each, side by side. The relative step is the cube root of the precision's resolution, which balances
/// the errors of truncation and rounding; in single precision a derivative has three digits.
///
/// # Errors
/// As [`rollout`], and [`Unknown::set`] where the step leaves the range of a parameter.
pub fn jacobian(
    world: &World,
    options: &Options,
    frames: &[usize],
    unknowns: &[Unknown],
) -> Result<Vec<Tangent>, SimulationError> {
    let resolution = match options.precision {
        Precision::F32 => f64::from(f32::EPSILON),
        Precision::F64 => f64::EPSILON,
    };
    let tangent = |unknown: &Unknown| {
        let value = unknown.get(world)?;
        let step = resolution.cbrt() * unknown.scale(value);
        let moved = |step: f64| States::of(&unknown.set(world, value + step)?, options, frames);
        let (ahead, behind) = rayon::join(|| moved(step), || moved(-step));
        Ok(ahead?.less(&behind?, 0.5 / step))
    };
    unknowns.par_iter().map(tangent).collect()
}

/// Positions and velocities of some frames.
struct States(Vec<[Vec<DVec3>; 2]>);

impl States {
    fn of(world: &World, options: &Options, frames: &[usize]) -> Result<Self, SimulationError> {
        let mut all = Vec::new();
        let count = frames.iter().max().map_or(0, |last| last + 1);
        rollout(world, options, count, |frame| {
            let is_wanted = frames.contains(&frame.index);
            all.push(if is_wanted { [frame.positions, frame.velocities] } else { Default::default() });
        })?;
        Ok(Self(frames.iter().map(|frame| all[*frame].clone()).collect()))
    }

    fn less(&self, other: &Self, factor: f64) -> Tangent {
        let of = |kind: usize| {
            let frames = self.0.iter().zip(&other.0);
            let difference = |(a, b): (&DVec3, &DVec3)| (*a - *b) * factor;
            frames.map(|(a, b)| a[kind].iter().zip(&b[kind]).map(difference).collect()).collect()
        };
        Tangent { positions: of(0), velocities: of(1) }
    }
}
