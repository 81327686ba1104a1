//! The constitutive laws.

pub(crate) mod elastic;
mod hencky;
pub(crate) mod law;
pub(crate) mod material;
pub(crate) mod newtonian;
pub(crate) mod non_newtonian;
pub(crate) mod plasticine;
pub(crate) mod sand;
#[cfg(test)]
mod tests;
