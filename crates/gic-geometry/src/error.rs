//! What can be wrong with a grid or a mesh that is asked for.

/// Why a grid or a mesh cannot be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GeometryError {
    /// A grid would not fit in memory.
    #[error("a grid of {voxels:.2e} voxels is needed, more than the limit of {limit:.0e}; use a larger grid spacing")]
    TooManyVoxels {
        /// Voxels needed.
        voxels: f64,
        /// The limit.
        limit: f64,
    },
    /// Tetrahedra cannot have such an edge.
    #[error("tetrahedron edge is {edge}, but must be above 0 m")]
    TetrahedronEdge {
        /// The edge given [m].
        edge: f64,
    },
    /// The level set encloses nothing that tetrahedra of this size could fill.
    #[error("no tetrahedron with edges of {edge} m has a part inside the body; use a smaller edge")]
    NothingInside {
        /// The edge given [m].
        edge: f64,
    },
}
