//! Points, grids and meshes in space: neighbours, normals, fields, surfaces.
//!
//! Positions are in metres in whichever frame the caller works in. Grids are x fastest, then y, then z.

mod distance_transform;
mod error;
mod field;
mod kd_tree;
mod marching_cubes;
mod mesh_files;
mod neighbours;
mod outward_normals;
mod plane;
mod pose;
mod surroundings;
mod tetrahedra;
mod triangle_mesh;
mod volume;
mod weighted_sum;

pub use distance_transform::distance_transform;
pub use error::GeometryError;
pub use field::{DensityField, MAX_VOXELS};
pub use kd_tree::{KdTree, squared_distance};
pub use marching_cubes::marching_cubes;
pub use mesh_files::{MeshNotes, write_mesh_ply, write_msh, write_obj, write_stl};
pub use neighbours::Neighbours;
pub use outward_normals::outward_normals;
pub use plane::Plane;
pub use pose::Pose;
pub use surroundings::{Surroundings, densities, offsets};
pub use tetrahedra::{TetMesh, tetrahedra};
pub use triangle_mesh::{SurfacePoint, TriangleMesh};
