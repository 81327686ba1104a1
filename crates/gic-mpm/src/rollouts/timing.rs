//! How time goes on in a world.

use crate::{Stepping, World};

/// What of the world the frames need beside its bodies.
#[derive(Clone, Copy)]
pub(crate) struct Timing {
    pub(super) frame_seconds: f64,
    pub(super) stepping: Stepping,
}

impl Timing {
    pub(crate) fn of(world: &World) -> Self {
        Self { frame_seconds: 1.0 / world.frame_rate_hz, stepping: world.stepping }
    }
}
