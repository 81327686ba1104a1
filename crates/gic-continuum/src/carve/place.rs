//! A place of the surface, as carving sees it.

use glam::DVec3;

/// A place of the surface.
pub(super) struct Place {
    pub(super) voxel: usize,
    /// On the surface of its voxel [m].
    pub(super) point: DVec3,
    /// Outward.
    pub(super) normal: DVec3,
}
