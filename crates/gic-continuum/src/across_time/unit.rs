//! How far apart the depths lie at which colours are compared, from coarse to fine.

use std::ops::ControlFlow;

use super::curve::{DEPTH_STEP, RESOLUTION};

/// The unit that depths and moves are measured in, and how steps go on in it.
pub(super) struct Unit {
    /// Its length [m].
    pub(super) m: f64,
    finest_m: f64,
    last_step: f64,
    /// Rounds in this unit so far.
    rounds: usize,
    most_rounds: usize,
}

impl Unit {
    /// Of a surface that is some `off_m` off, whose field's voxels have this `side_m`, for `most_rounds` in all. Depths
    /// are a voxel apart at most: a picture that fits the voxels shows nothing finer, and larger steps jump over where
    /// colours agree. At the finest they are a quarter of one.
    pub(super) fn new(off_m: f64, side_m: f64, most_rounds: usize) -> Unit {
        let finest_m = 0.5 * side_m;
        let m = off_m.clamp(finest_m, side_m / DEPTH_STEP);
        // Twice a voxel, a voxel, half of one.
        Unit { m, finest_m, last_step: f64::INFINITY, rounds: 0, most_rounds: most_rounds / 3 }
    }

    pub(super) fn is_finest(&self) -> bool {
        self.m <= self.finest_m
    }

    /// Side of the field's voxels [m].
    pub(super) fn voxel_m(&self) -> f64 {
        2.0 * self.finest_m
    }

    /// The finest unit over this one.
    pub(super) fn fineness(&self) -> f64 {
        self.finest_m / self.m
    }

    /// Takes note of moves `outward` [units]: the unit is halved once the surface has settled, which breaks where there
    /// is no finer one. Steps that shrink no more are noise, and those that a coarse unit does not resolve are left to
    /// the next one, unless some place is still off by more than the unit.
    pub(super) fn settle(&mut self, outward: &[f64]) -> ControlFlow<()> {
        let step = (outward.iter().map(|d| d * d).sum::<f64>() / outward.len() as f64).sqrt();
        let is_near = outward.iter().all(|d| d.abs() <= 1.0);
        let has_settled = step >= self.last_step || !self.is_finest() && step <= RESOLUTION;
        self.rounds += 1;
        if !(has_settled && is_near || self.rounds >= self.most_rounds) {
            self.last_step = step;
            return ControlFlow::Continue(());
        }
        if self.is_finest() {
            return ControlFlow::Break(());
        }
        *self = Unit { m: self.finest_m.max(0.5 * self.m), last_step: f64::INFINITY, rounds: 0, ..*self };
        ControlFlow::Continue(())
    }

    /// Share of the last stride that the next one goes on with (Nesterov 1983): places that little is known of would
    /// creep after their neighbours. Coarser depths show no slope, but where colours agree best, some of them by
    /// chance.
    pub(super) fn momentum(&self) -> f32 {
        if self.is_finest() { self.rounds as f32 / (self.rounds as f32 + 3.0) } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_unit_is_halved_when_steps_shrink_no_more() {
        let mut unit = Unit::new(f64::INFINITY, 0.01, 30);
        assert_eq!((unit.m, unit.fineness(), unit.momentum()), (0.02, 0.25, 0.0));
        for (step, m) in [(0.5, 0.02), (0.4, 0.02), (0.45, 0.01), (0.5, 0.01), (0.6, 0.005), (0.2, 0.005)] {
            assert!(unit.settle(&[step, -step]).is_continue());
            assert_eq!(unit.m, m, "{step}");
        }
        assert!(unit.is_finest() && unit.momentum() == 0.25);
        assert!(unit.settle(&[0.3]).is_break());
    }

    #[test]
    fn a_coarse_unit_leaves_what_it_does_not_resolve_to_the_next() {
        let mut unit = Unit::new(0.01, 0.01, 30);
        assert!(unit.settle(&[0.06, -0.06]).is_continue());
        assert!(unit.is_finest());
        assert!(unit.settle(&[0.06, -0.06]).is_continue());
        assert!(unit.settle(&[0.05, -0.05]).is_continue());
        assert!(unit.settle(&[0.05, -0.05]).is_break());
    }

    /// As long as a place is far off, but not for ever.
    #[test]
    fn a_place_that_is_far_off_holds_the_unit() {
        let mut unit = Unit::new(0.013, 0.01, 30);
        for _ in 0..9 {
            assert!(unit.settle(&[0.1, -1.5]).is_continue());
            assert_eq!(unit.m, 0.013);
        }
        assert!(unit.settle(&[0.1, -1.5]).is_continue());
        assert_eq!(unit.m, 0.0065);
    }
}
