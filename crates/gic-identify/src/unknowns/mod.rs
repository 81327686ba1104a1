//! What is sought: material parameters, initial motion, and nuisances, as coordinates of a search.

pub(crate) mod coordinates;
pub(crate) mod devices;
pub(crate) mod parameter;
pub(crate) mod state;
