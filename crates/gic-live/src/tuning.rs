//! The tuned numbers of this crate.

/// Most particles of a simulation in a page. Budget: a soft solid at true speed in one thread, drawn beside it.
pub const MAX_PARTICLES: usize = 3000;

/// Frames that are simulated in a second of the twin's time [1/s]. Budget: those of a screen.
pub const FRAME_RATE_HZ: f64 = 60.0;

/// Cells of the grid along the distance of two particles. Derived: eight particles in a cell, as twins have them.
pub(crate) const CELL_SPACINGS: f64 = 2.0;

/// By how much the spacing grows while there are too many particles. Budget: as many as fit, to a tenth.
pub(crate) const SPACING_GROWTH: f64 = 1.02;

/// How far from the pointer's ray a particle can be grabbed [spacings]. Derived: no ray slips between neighbours.
pub(crate) const GRAB_REACH_SPACINGS: f64 = 1.0;

/// Radius of what a hand holds, as a share of the body's largest side. Budget: a grip, not a pinprick.
pub(crate) const HAND_RADIUS_SHARE: f64 = 0.5;

/// How fast what is held follows the pointer [1/s]. Derived: half of the way in a frame, so that it does not overshoot.
pub(crate) const HAND_RATE_HZ: f64 = 0.5 * FRAME_RATE_HZ;

/// Highest speed of what is held, in largest sides of the body a second. Budget: a jerk that no solid is torn by.
pub(crate) const HAND_SPEED_SIDES_HZ: f64 = 20.0;
