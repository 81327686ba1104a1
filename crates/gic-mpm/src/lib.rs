//! A differentiable material point method (MLS-MPM: APIC, quadratic B-splines, explicit symplectic steps; paper section
//! 4.3).
//!
//! | folder | what it holds |
//! |---|---|
//! | `laws` | the constitutive laws and their adjoints, a file each; their parameters |
//! | `colliders` | rigid obstacles: shape, path, contact law |
//! | `substep` | p2g, grid update, g2p and their adjoints: a readable twin and the fast engine |
//! | `rollouts` | frames from substeps; gradients of rollouts, and their check |
//! | `math` | 3x3 matrices and their eigenvectors over any number |

mod budget;
mod colliders;
mod doubt;
mod error;
mod forecast;
mod laws;
mod math;
mod options;
mod rollouts;
mod substep;
mod validate;
mod world;

pub use budget::{Budget, Forecast};
pub use colliders::collider::Collider;
pub use colliders::contact::Contact;
pub use colliders::path::ColliderPath;
pub use colliders::shape::Primitive;
pub use doubt::Doubt;
pub use error::{LossGradientError, SimulationError, StateMismatch};
pub use gic_simd::Level;
pub use laws::kind::MaterialKind;
pub use laws::law::Rules;
pub use laws::material::{Material, MaterialError};
pub use options::{Ball, Options, Precision};
pub use rollouts::frame::{ContactForce, Deformation, Frame};
pub use rollouts::gradcheck::{GRADCHECK_TOLERANCE, GradcheckRow, gradcheck, gradcheck_materials, gradcheck_world};
pub use rollouts::gradient::{BodyGradient, FrameAdjoint, Gradient};
pub use rollouts::jacobian::{Tangent, jacobian};
pub use rollouts::recording::{Recording, gradient};
pub use rollouts::simulator::{Simulator, rollout};
pub use rollouts::snapshot::Snapshot;
pub use rollouts::unknown::Unknown;
pub use substep::stencil::STENCIL_REACH_CELLS;
pub use world::{Body, Stepping, World};
