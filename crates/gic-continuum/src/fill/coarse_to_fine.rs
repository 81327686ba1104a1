//! Lines 8 to 15 of Algorithm 1: the density field from the coarsest to the finest level.

use gic_geometry::DensityField;
use gic_splat::Gaussians;
use rayon::prelude::*;

use super::gaussians::centre;
use super::internal::InternalParticles;
use crate::FillSettings;

/// Weight of each of the two neighbours along an axis in the mean of three.
pub(super) const MEAN: f32 = 1.0 / 3.0;
/// The same in the binomial filter, which is gentler.
const BINOMIAL: f32 = 0.25;

/// Lines 8 to 15: from the coarsest to the finest level, upsample, mean-filter and reassign.
pub(super) fn coarse_to_fine(
    particles: &InternalParticles,
    gaussians: &Gaussians,
    settings: &FillSettings,
) -> DensityField {
    let mut levels = vec![(particles.inside.clone(), particles.doubtful.clone())];
    for _ in 1..settings.levels {
        let (inside, doubtful) = &levels[levels.len() - 1];
        levels.push((inside.pool(), doubtful.pool()));
    }
    let mut field: Option<DensityField> = None;
    for (inside, doubtful) in levels.iter().rev() {
        // On the first level nothing is known yet of what is in doubt: as likely as not.
        let mut current =
            field.map_or_else(|| DensityField { values: vec![0.5; inside.len()], ..*inside }, |f| f.upsample());
        reassign(&mut current, inside, doubtful, gaussians, settings);
        for _ in 0..settings.tuning.filling.filter_rounds {
            current.mean_filter(MEAN);
            reassign(&mut current, inside, doubtful, gaussians, settings);
        }
        field = Some(current);
    }
    field.expect("there is at least one level")
}

/// Lines 11 and 14: the share that is certainly inside counts fully, the share in doubt at the field's own density, the
/// rest not at all. Voxels that hold a Gaussian where nothing else is dense get density 1: parts thinner than a voxel.
fn reassign(
    field: &mut DensityField,
    inside: &DensityField,
    doubtful: &DensityField,
    gaussians: &Gaussians,
    settings: &FillSettings,
) {
    for ((value, &inside), &doubtful) in field.values.iter_mut().zip(&inside.values).zip(&doubtful.values) {
        *value = inside + doubtful * *value;
    }
    let thin: Vec<usize> = gaussians
        .positions
        .par_iter()
        .filter_map(|p| field.discretize(centre(*p)))
        .filter(|&i| !dense_nearby(field, i, settings.th_min as f32))
        .collect();
    for i in thin {
        field.values[i] = 1.0;
    }
}

/// Whether any voxel of the 3x3x3 around one reaches a density.
fn dense_nearby(field: &DensityField, index: usize, density: f32) -> bool {
    field.around(index).any(|i| field.values[i] >= density)
}

/// A last gentle filter, so that the level set is smooth; parts so thin that they would vanish keep their density.
pub(crate) fn smooth(field: &mut DensityField) {
    let before = field.values.clone();
    field.mean_filter(BINOMIAL);
    let lost: Vec<usize> =
        (0..before.len()).into_par_iter().filter(|&i| before[i] >= 0.5 && !dense_nearby(field, i, 0.5)).collect();
    for i in lost {
        field.values[i] = before[i];
    }
}
