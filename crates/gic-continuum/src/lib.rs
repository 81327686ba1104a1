//! From Gaussians to matter (paper section 4.2): the density field by coarse-to-fine filling, particles for simulation, the
//! Gaussian-informed continuum, surfaces and meshes.

mod carve;
mod error;
mod evidence;
mod export;
mod fill;
mod particles;
mod settings;
mod surface;
mod symmetry;
mod tetrahedra;
mod volume;

pub use carve::ColouredView;
pub use error::ContinuumError;
pub use evidence::MaskedView;
pub use export::{ExportError, write_mesh_ply, write_msh, write_obj, write_particles_ply, write_stl};
pub use fill::{DensityField, Filling, MAX_VOXELS, fill, fill_outlines};
pub use particles::{
    Agreement, Appearance, Drawing, Particles, Placement, agreement, calibrate, compare_with_masks, informed_gaussians,
    sample_particles, sample_points,
};
pub use settings::{FillSettings, GroundPlane, Unseen};
pub use surface::{SurfacePoint, TriangleMesh};
pub use symmetry::{Completion, MirrorPlane, Symmetry};
pub use tetrahedra::TetMesh;
