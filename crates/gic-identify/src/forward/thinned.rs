//! The same scene on a coarser grid, to choose among starts cheaply.

use std::collections::BTreeMap;

use crate::Input;
use crate::tuning::SearchTuning;

/// A thinned continuum.
pub(crate) struct ThinnedContinuum {
    /// Indices of the particles that stay.
    pub ids: Vec<usize>,
    /// Their opacities.
    pub opacities: Vec<f32>,
    /// Their standard deviations, grown to fill the gaps [m].
    pub scales: Vec<f32>,
}

impl ThinnedContinuum {
    /// One particle for each cell of the search's grid: the one nearest to the centre of its cell's particles.
    pub(crate) fn new(input: &Input, tuning: &SearchTuning) -> ThinnedContinuum {
        let factor = tuning.coarse_factor;
        let side = factor * input.particle_volume_m3.cbrt();
        let mut cells: BTreeMap<[i64; 3], Vec<usize>> = BTreeMap::new();
        for (i, p) in input.positions.iter().enumerate() {
            let cell = (*p / side).floor();
            cells.entry([cell.x as i64, cell.y as i64, cell.z as i64]).or_default().push(i);
        }
        let full = factor.powi(3);
        let mut ids: Vec<usize> = cells
            .values()
            // A corner of the body that barely enters a cell would count as a whole one.
            .filter(|members| (members.len() as f64 / full).round() > 0.0)
            .map(|members| {
                let mean = members.iter().map(|i| input.positions[*i]).sum::<glam::DVec3>() / members.len() as f64;
                let distance = |i: &usize| input.positions[*i].distance_squared(mean);
                *members.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).expect("a cell has members")
            })
            .collect();
        if ids.is_empty() {
            ids = (0..input.positions.len()).collect();
        }
        let growth = (input.positions.len() as f64 / ids.len() as f64).cbrt() as f32;
        ThinnedContinuum {
            opacities: ids.iter().map(|i| input.opacities[*i]).collect(),
            scales: ids.iter().map(|i| input.scales[*i] * growth).collect(),
            ids,
        }
    }
}
