//! A place of the surface, as carving sees it.

use glam::DVec3;

/// A place of the surface.
pub(crate) struct Place {
    pub(crate) voxel: usize,
    /// On the surface of its voxel [m].
    pub(crate) point: DVec3,
    /// Outward.
    pub(crate) normal: DVec3,
}
