//! The gripper.

/// The gripper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gripper {
    /// Sides of a pad [m]: across and along the finger; the latter points up where it can.
    pub pad_m: [f64; 2],
    /// Coulomb coefficient of the pads.
    pub friction: f64,
    /// How far the object is lifted [m].
    pub lift_m: f64,
}

impl Default for Gripper {
    /// The fingertips of a Robotiq 2F-85, of rubber.
    fn default() -> Self {
        Self { pad_m: [0.022, 0.0375], friction: 0.5, lift_m: 0.05 }
    }
}
