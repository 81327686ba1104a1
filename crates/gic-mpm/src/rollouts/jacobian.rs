//! Derivatives of all positions with respect to a few unknowns, by finite differences of independent rollouts, one per
//! core.

use glam::DVec3;
use rayon::prelude::*;

use super::frame::Frame;
use super::simulator::rollout;
use super::unknown::Unknown;
use crate::World;
use crate::error::SimulationError;
use crate::options::Options;

/// How a derivative is approximated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Differences {
    /// (f(x + h) - f(x)) / h: P + 1 rollouts.
    #[default]
    Forward,
    /// (f(x + h) - f(x - h)) / 2h: 2 P + 1 rollouts, an order more accurate.
    Central,
}

/// A rollout and its derivatives.
#[derive(Clone, Debug)]
pub struct Jacobian {
    /// The rollout itself.
    pub frames: Vec<Frame>,
    /// `columns[unknown][frame][particle]`: derivative of the position [m per unit of the unknown].
    pub columns: Vec<Vec<Vec<DVec3>>>,
}

/// Simulates `frames` frames (frame 0 included) and differentiates all positions with respect to `unknowns`, each moved
/// by its step (absolute, in its own unit). The rollouts run in parallel, each on one thread; the result does not
/// depend on the thread count.
///
/// In f32, steps of about 1e-3 of the value balance rounding against curvature.
///
/// # Errors
/// As [`rollout`], and as [`Unknown::set`].
pub fn jacobian(
    world: &World,
    options: &Options,
    frames: usize,
    unknowns: &[(Unknown, f64)],
    differences: Differences,
) -> Result<Jacobian, SimulationError> {
    let mut worlds = vec![world.clone()];
    for (unknown, step) in unknowns {
        let value = unknown.get(world)?;
        worlds.push(unknown.set(world, value + step)?);
        if differences == Differences::Central {
            worlds.push(unknown.set(world, value - step)?);
        }
    }
    let options = Options { parallel: false, ..options.clone() };
    let mut rollouts: Vec<Vec<Frame>> = worlds
        .par_iter()
        .with_max_len(1)
        .map(|world| {
            let mut all = Vec::with_capacity(frames);
            rollout(world, &options, frames, |frame| all.push(frame)).map(|()| all)
        })
        .collect::<Result<_, _>>()?;
    let moved = rollouts.split_off(1);
    let base = rollouts.swap_remove(0);
    let columns = match differences {
        Differences::Forward => {
            moved.iter().zip(unknowns).map(|(plus, (_, step))| difference(plus, &base, *step)).collect()
        }
        Differences::Central => moved
            .chunks_exact(2)
            .zip(unknowns)
            .map(|(pair, (_, step))| difference(&pair[0], &pair[1], 2.0 * step))
            .collect(),
    };
    Ok(Jacobian { frames: base, columns })
}

fn difference(plus: &[Frame], minus: &[Frame], step: f64) -> Vec<Vec<DVec3>> {
    let of_frame = |(plus, minus): (&Frame, &Frame)| {
        plus.positions.iter().zip(&minus.positions).map(|(plus, minus)| (*plus - *minus) / step).collect()
    };
    plus.iter().zip(minus).map(of_frame).collect()
}
