//! A differentiable material point method (MLS-MPM: APIC, quadratic B-splines, explicit symplectic steps; paper section 4.3).

mod collider;
// Until the engine calls them all.
#[allow(dead_code)]
mod law;
#[allow(dead_code)]
mod mat3;
mod material;
mod world;

pub use collider::{Collider, Contact, Motion, Primitive};
pub use law::Rules;
pub use material::{Material, MaterialError};
pub use world::{Body, Stepping, World};
