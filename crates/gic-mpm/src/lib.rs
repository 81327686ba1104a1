//! A differentiable material point method (MLS-MPM: APIC, quadratic B-splines, explicit symplectic steps; paper section 4.3).

mod collider;
mod contact;
mod eigen;
mod error;
mod fast;
mod gradcheck;
mod gradient;
mod grid;
mod jacobian;
mod law;
mod mat3;
mod material;
mod options;
mod rollout;
mod scalar;
mod scene;
mod simulator;
mod state;
mod stencil;
#[cfg(test)]
mod substep_tests;
mod validate;
mod world;

pub use collider::{Collider, Contact, Motion, Primitive};
pub use error::SimulationError;
pub use gic_simd::Level;
pub use gradcheck::{GradcheckRow, gradcheck, gradcheck_materials, gradcheck_world};
pub use gradient::{BodyGradient, Gradient, gradient};
pub use jacobian::{Differences, Jacobian, Unknown, jacobian};
pub use law::Rules;
pub use material::{Material, MaterialError};
pub use options::{Options, Precision};
pub use rollout::{ContactForce, Frame};
pub use simulator::{Simulator, Snapshot, rollout};
pub use world::{Body, Stepping, World};
