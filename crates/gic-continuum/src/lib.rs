//! From Gaussians to matter (paper section 4.2): the density field by coarse-to-fine filling, particles for simulation, the
//! Gaussian-informed continuum, surfaces and meshes.

mod colours;
mod error;
mod export;
mod field;
mod fill;
mod informed;
mod internal;
mod outline;
mod overview;
mod particles;
mod settings;
mod surface;
mod symmetry;
mod tetrahedra;
mod unseen;
mod view;
mod volume;

pub use colours::ColouredView;
pub use error::ContinuumError;
pub use export::{ExportError, write_mesh_ply, write_msh, write_obj, write_particles_ply, write_stl};
pub use field::{DensityField, MAX_VOXELS};
pub use fill::{Filling, fill, fill_outlines};
pub use informed::{Agreement, Appearance, Drawing, agreement, calibrate, compare_with_masks, informed_gaussians};
pub use particles::{Particles, Placement, sample_particles, sample_points};
pub use settings::{FillSettings, GroundPlane, Unseen};
pub use surface::{SurfacePoint, TriangleMesh};
pub use symmetry::{Completion, MirrorPlane, Symmetry};
pub use tetrahedra::TetMesh;
pub use view::MaskedView;
