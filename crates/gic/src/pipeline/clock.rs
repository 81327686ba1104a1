//! The simulator's clock: ticks so close that every picture was taken at one.

use gic_mpm::Stepping;

/// How far a picture may be from its tick [frames]. Budget: a body at 3 m/s filmed at 60 Hz moves half a millimetre.
const LARGEST_ERROR_FRAMES: f64 = 0.01;

/// Frames, each cut into a whole number of ticks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Clock {
    frame_rate_hz: f64,
    ticks_per_frame: usize,
}

impl Clock {
    /// The slowest clock that ticks at all `times` [s]: one tick a frame where no camera lags.
    pub(super) fn of(times: &[f64], frame_rate_hz: f64) -> Self {
        let finest = (0.5 / LARGEST_ERROR_FRAMES).ceil() as usize;
        let fits = |clock: &Self| {
            let error =
                |time: &f64| (time * frame_rate_hz - clock.tick(*time) as f64 / clock.ticks_per_frame as f64).abs();
            times.iter().all(|time| error(time) <= LARGEST_ERROR_FRAMES)
        };
        let clocks = (1..finest).map(|ticks_per_frame| Self { frame_rate_hz, ticks_per_frame });
        clocks.into_iter().find(fits).unwrap_or(Self { frame_rate_hz, ticks_per_frame: finest })
    }

    /// Ticks a second.
    pub(super) fn rate_hz(&self) -> f64 {
        self.frame_rate_hz * self.ticks_per_frame as f64
    }

    /// The tick nearest to a time [s].
    pub(super) fn tick(&self, time: f64) -> usize {
        (time * self.rate_hz()).round().max(0.0) as usize
    }

    /// Substeps of a tick, of at most the length that so many a frame have.
    pub(super) fn substeps(&self, per_frame: usize) -> usize {
        per_frame.div_ceil(self.ticks_per_frame)
    }

    /// The stepping of a tick, given that of a frame.
    pub(super) fn stepping(&self, of_frame: Stepping) -> Stepping {
        Stepping { least_substeps_per_frame: self.substeps(of_frame.least_substeps_per_frame), ..of_frame }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_ticks_when_pictures_are_taken() {
        let even: Vec<f64> = (0..14).map(|frame| f64::from(frame) / 24.0).collect();
        assert_eq!(Clock::of(&even, 24.0).ticks_per_frame, 1);
        let half: Vec<f64> = (0..8).map(|half| f64::from(half) / 48.0).collect();
        let clock = Clock::of(&half, 24.0);
        assert_eq!((clock.ticks_per_frame, clock.tick(half[3]), clock.substeps(7)), (2, 3, 4));
        for lag in 0..40 {
            let time = (1.0 + f64::from(lag) / 40.0) / 60.0;
            let clock = Clock::of(&[time], 60.0);
            let off = clock.tick(time) as f64 / clock.rate_hz() - time;
            assert!(off.abs() * 60.0 < LARGEST_ERROR_FRAMES + 1e-9, "{lag}: {off} {clock:?}");
        }
    }
}
