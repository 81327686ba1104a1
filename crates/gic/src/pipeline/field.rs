//! The body of the first frame as voxels, in files: what refinement moves, and what drawings are sampled from.

use std::path::Path;

use gic_continuum::Filling;
use gic_geometry::DensityField;
use gic_twin::matter::{read_particles, write_particles};
use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::stage::REFINED;
use super::{FillSummary, Run};
use crate::error::Result;

/// Name of the file of the voxels, inside the folder of the stage that makes them.
pub(super) const FIELD_FILE: &str = "field.ply";

/// Where the voxels of a field lie.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FieldGrid {
    /// Lower corner of the first voxel [m].
    pub origin_m: [f64; 3],
    /// Voxels along x, y, z.
    pub size: [usize; 3],
    /// Side of a voxel [m].
    pub spacing_m: f64,
}

impl FieldGrid {
    pub(super) fn of(field: &DensityField) -> FieldGrid {
        FieldGrid { origin_m: field.origin.into(), size: field.size, spacing_m: field.spacing }
    }
}

/// Writes the voxels of a body that are not empty or are in doubt.
pub(super) fn write_field(path: &Path, filling: &Filling) -> Result<()> {
    let field = &filling.field;
    let doubt = |i: usize| filling.doubt.get(i).copied().unwrap_or(0.0);
    let told: Vec<usize> = (0..field.len()).filter(|i| field.values[*i] > 0.0 || doubt(*i) > 0.0).collect();
    let rows = told.into_iter().map(|i| {
        let [x, y, z] = field.centre(field.voxel(i)).as_vec3().to_array();
        [x, y, z, field.values[i], doubt(i)]
    });
    Ok(write_particles(path, ["x", "y", "z", "density", "doubt"], rows)?)
}

impl Run<'_> {
    /// The body as filling found it.
    ///
    /// # Errors
    /// A missing or damaged file.
    pub(super) fn filling(&self) -> Result<Filling> {
        self.filling_in(&self.path("filling"), &self.fill_summary()?)
    }

    /// The refined body.
    ///
    /// # Errors
    /// A missing or damaged file.
    pub(super) fn refined_filling(&self) -> Result<Filling> {
        self.filling_in(&self.path(REFINED), &self.refined()?.summary)
    }

    fn filling_in(&self, folder: &Path, summary: &FillSummary) -> Result<Filling> {
        let ply = read_particles(&folder.join(FIELD_FILE))?;
        let FieldGrid { origin_m, size, spacing_m } = summary.field;
        let voxels = size.iter().product();
        let mut field =
            DensityField { origin: DVec3::from(origin_m), spacing: spacing_m, size, values: vec![0.0; voxels] };
        let mut doubt = vec![0.0; voxels];
        for (i, position) in ply.positions.iter().enumerate() {
            if let Some(voxel) = field.discretize(*position) {
                field.values[voxel] = ply.densities[i];
                doubt[voxel] = ply.doubts[i];
            }
        }
        let first = summary.frames.first();
        let (gaussians_used, views_used) = first.map_or((0, 0), |first| (first.gaussians, first.views));
        Ok(Filling { field, doubt, th_min: self.config.fill.th_min, gaussians_used, views_used })
    }
}
