//! What a hypothesis predicts: the motion by free flight or simulation, the outlines that it draws, and the shapes that
//! the body may have.

pub(crate) mod drawing;
pub(crate) mod flight;
pub(crate) mod footprint;
pub(crate) mod occlusion;
pub(crate) mod outline_window;
pub(crate) mod shape;
pub(crate) mod silhouette;
pub(crate) mod simulation;
pub(crate) mod splat_widths;
pub(crate) mod surface_membership;
pub(crate) mod thinned;
pub(crate) mod trajectories;
pub(crate) mod world;
