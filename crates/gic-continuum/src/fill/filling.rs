//! What filling makes of one frame: the body as a density field.

use gic_geometry::{DensityField, TetMesh, TriangleMesh, marching_cubes};
use glam::DVec3;

use crate::ContinuumError;

/// The density field of one frame, and what it was made from.
#[derive(Clone, Debug)]
pub struct Filling {
    /// F(t) at the finest level.
    pub field: DensityField,
    /// How much the matter in each voxel of the field is in doubt, in [0, 1]: 1 at a boundary that no view sees, 0 well
    /// below it, or, where moments settled the surface, 1 where none of them tells of the nearest place of it; empty
    /// where nothing is.
    pub doubt: Vec<f32>,
    /// The level of the body's boundary in the field, the paper's th_min.
    pub th_min: f64,
    /// Gaussians that counted.
    pub gaussians_used: usize,
    /// Views that had a mask.
    pub views_used: usize,
}

impl Filling {
    /// A body that is known: `distance` is the signed distance from its surface [m], negative inside, in the box from
    /// `low` to `high` [m]. The density ramps from 1 to 0 over `ramp` [m] across the surface; nothing is in doubt, and
    /// no Gaussians were used.
    ///
    /// # Errors
    /// Those of [`DensityField::covering`].
    pub fn of_body(
        (low, high): (DVec3, DVec3),
        spacing: f64,
        ramp: f64,
        distance: impl Fn(DVec3) -> f64,
    ) -> Result<Filling, ContinuumError> {
        let mut field = DensityField::covering(low, high, spacing, 1)?;
        for i in 0..field.len() {
            field.values[i] = (0.5 - distance(field.centre(field.voxel(i))) / ramp).clamp(0.0, 1.0) as f32;
        }
        let doubt = Vec::new();
        Ok(Filling { field, doubt, th_min: 0.5, gaussians_used: 0, views_used: 0 })
    }

    /// Volume of the body [m^3]: where the interpolated field is at least th_min.
    pub fn volume(&self) -> f64 {
        self.field.volume(self.th_min)
    }

    /// The surface at level th_min as a closed triangle mesh.
    pub fn surface_mesh(&self) -> TriangleMesh {
        marching_cubes(&self.field, self.th_min)
    }

    /// Tetrahedra that fill the level set th_min, with edges of about `edge` [m].
    ///
    /// # Errors
    /// Those of [`gic_geometry::tetrahedra`].
    pub fn tetrahedra(&self, edge: f64) -> Result<TetMesh, ContinuumError> {
        Ok(gic_geometry::tetrahedra(&self.field, self.th_min, edge)?)
    }

    /// How much the body's boundary at a point of it [m] is in doubt, in [0, 1]: 1 where no view sees it, falling to 0
    /// some voxels away from there.
    pub fn doubt_of_surface(&self, point: DVec3) -> f32 {
        // The voxel that holds the point may lie outside, where nothing is in doubt.
        let voxels = self.field.discretize(point).into_iter().flat_map(|i| self.field.around(i));
        voxels.filter_map(|i| self.doubt.get(i)).copied().fold(0.0, f32::max)
    }
}
