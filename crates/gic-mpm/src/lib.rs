//! A differentiable material point method (MLS-MPM: APIC, quadratic B-splines, explicit symplectic steps; paper section 4.3).

mod collider;
mod material;
mod world;

pub use collider::{Collider, Contact, Motion, Primitive};
pub use material::Material;
pub use world::{Body, Stepping, World};
