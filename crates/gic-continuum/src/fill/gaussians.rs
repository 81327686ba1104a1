//! Which of the Gaussians count, and the box around them.

use gic_geometry::{DensityField, Neighbours};
use gic_splat::{Gaussians, Shape};
use glam::DVec3;
use rayon::prelude::*;

use crate::evidence::Evidence;
use crate::{ContinuumError, FillSettings};

/// The Gaussians that count: finite, opaque enough, outside no mask, and no flecks.
pub(super) fn usable_gaussians(
    gaussians: &Gaussians,
    masks: &[Evidence],
    settings: &FillSettings,
) -> Result<Gaussians, ContinuumError> {
    let tuning = &settings.tuning.gaussians;
    let counts = |i: usize| {
        let point = centre(gaussians.positions[i]);
        gaussians.opacities[i] >= settings.min_opacity
            && gaussians.scale(i) > 0.0
            && point.is_finite()
            && settings.ground.is_none_or(|g| g.height(point) >= -settings.finest_spacing())
            && masks.iter().all(|view| view.evidence_at(point).is_none_or(|seen| seen.coverage >= 0.5))
    };
    let total = gaussians.positions.len();
    let needed = tuning.fleck_neighbours + 1;
    let enough = |kept: usize| {
        if kept >= needed { Ok(()) } else { Err(ContinuumError::TooFewGaussians { total, kept, needed }) }
    };
    let kept: Vec<usize> = (0..total).into_par_iter().filter(|&i| counts(i)).collect();
    enough(kept.len())?;
    let usable = select(gaussians, &kept);
    let usable = drop_isolated(&usable, tuning.fleck_distance * settings.size, tuning.fleck_neighbours);
    enough(usable.positions.len())?;
    Ok(usable)
}

/// Without the Gaussians that have no more than `most` within `radius` [m] around them, themselves included. A fleck
/// that hovers inside the hull agrees with every image, since each view that could call it empty draws the fleck
/// itself; but matter has neighbours.
fn drop_isolated(gaussians: &Gaussians, radius: f64, most: usize) -> Gaussians {
    let centres: Vec<DVec3> = gaussians.positions.iter().map(|p| centre(*p)).collect();
    let neighbours = Neighbours::new(&centres, radius);
    let around = |point: DVec3| {
        let mut count = 0;
        neighbours.within(point, radius, |_, _, _| count += 1);
        count
    };
    let kept: Vec<usize> = (0..centres.len()).into_par_iter().filter(|&i| around(centres[i]) > most).collect();
    select(gaussians, &kept)
}

/// Some of the Gaussians, without their colours.
fn select(gaussians: &Gaussians, kept: &[usize]) -> Gaussians {
    let pick = |v: &Vec<[f32; 3]>| kept.iter().map(|&i| v[i]).collect();
    Gaussians {
        positions: pick(&gaussians.positions),
        opacities: kept.iter().map(|&i| gaussians.opacities[i]).collect(),
        shape: match &gaussians.shape {
            Shape::Isotropic { scales } => Shape::Isotropic { scales: kept.iter().map(|&i| scales[i]).collect() },
            Shape::Anisotropic { scales, rotations } => {
                Shape::Anisotropic { scales: pick(scales), rotations: kept.iter().map(|&i| rotations[i]).collect() }
            }
        },
        // Only alpha and depth are drawn: one colour coefficient each is enough.
        sh_degree: 0,
        sh: vec![[0.0; 3]; kept.len()],
    }
}

/// The lower quartile and the median of the scales [m].
pub(super) fn quartiles_of_scale(gaussians: &Gaussians) -> [f64; 2] {
    let mut scales: Vec<f32> = (0..gaussians.len()).map(|i| gaussians.scale(i)).collect();
    scales.sort_by(f32::total_cmp);
    [scales.len() / 4, scales.len() / 2].map(|i| f64::from(scales[i]))
}

/// Line 7: a field of zeros over the bounding box of the Gaussians, at the spacing of the last level; coarser levels
/// pool its voxels. The box is widened by the Gaussians' extent and by a few voxels of air.
pub(super) fn initialize_field(gaussians: &Gaussians, settings: &FillSettings) -> Result<DensityField, ContinuumError> {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for p in &gaussians.positions {
        let point = centre(*p);
        low = low.min(point);
        high = high.max(point);
    }
    let [_, scale] = quartiles_of_scale(gaussians);
    let tuning = &settings.tuning;
    // What the filters of a level look at, and the last one.
    let filtered = (tuning.filling.filter_rounds + 1) as f64;
    let margin = tuning.gaussians.extent * scale + filtered * settings.finest_spacing();
    let multiple = 1 << (settings.levels - 1);
    Ok(DensityField::covering(low - margin, high + margin, settings.finest_spacing(), multiple)?)
}

/// A Gaussian's centre in double precision [m].
pub(super) fn centre(position: [f32; 3]) -> DVec3 {
    DVec3::from(position.map(f64::from))
}
