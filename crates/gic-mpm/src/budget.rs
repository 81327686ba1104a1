//! What a simulation may take, and what one will.

/// What a simulation may take at most.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Budget {
    /// Memory [bytes].
    pub memory_bytes: f64,
    /// Time [s], as a [`Forecast`] estimates it.
    pub seconds: f64,
}

impl Default for Budget {
    /// 16 GiB and a day.
    fn default() -> Self {
        Self { memory_bytes: (1u64 << 34) as f64, seconds: 86_400.0 }
    }
}

/// What a simulation will take, from the world at its start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Forecast {
    /// Particles.
    pub particles: usize,
    /// Frames, the initial state included.
    pub frames: usize,
    /// Substeps of the first frame.
    pub substeps_per_frame: usize,
    /// Memory [bytes], to a factor of about two.
    pub memory_bytes: f64,
    /// Time on one core [s], to a factor of about three; what happens on the way can change it.
    pub seconds: f64,
}
