//! Gaussians that widen where matter thins out.
//!
//! The outline of a diluted continuum (a sand pile that spread) is that of its density field, not of particles of the
//! size that they had at rest: with constant widths the re-rendered outline of the given sand scenes shrinks by 10 %
//! between the first and the last frame, which the friction angle would have to explain. The width follows the local
//! number density n, relative to the particle's own neighbourhood at rest: `sigma = sigma_0 (n_0 / n)^gamma`. Matter
//! that holds together thins out as a bulk, alike in all directions, and stays covered with gamma = 1/3. Grains part
//! along the ground, and a heap ends in sheets, which stay covered with 1/2 (decision 89).

use gic_geometry::densities;
use gic_mpm::MaterialKind;
use glam::DVec3;

use crate::tuning::SurfaceTuning;

/// How dense matter is around each particle at rest.
#[derive(Clone, Debug)]
pub(crate) struct SplatWidths {
    radius: f64,
    rest: Vec<f32>,
    /// Standard deviations at rest [m].
    scales: Vec<f32>,
    /// The exponent gamma.
    exponent: f64,
}

impl SplatWidths {
    /// `spacing` is the particles' mean distance at rest [m].
    pub(crate) fn new(
        positions: &[DVec3],
        scales: &[f32],
        spacing: f64,
        kind: MaterialKind,
        tuning: &SurfaceTuning,
    ) -> SplatWidths {
        let radius = tuning.neighbourhood_spacings * spacing;
        let rest = densities(positions, radius);
        let exponent = if kind == MaterialKind::Sand { 1.0 / 2.0 } else { 1.0 / 3.0 };
        SplatWidths { radius, rest, scales: scales.to_vec(), exponent }
    }

    /// Standard deviations at rest [m], shape [n].
    pub(crate) fn rest_scales(&self) -> &[f32] {
        &self.scales
    }

    /// Standard deviations [m] of particles at `positions`, shape [n].
    pub(crate) fn scales(&self, positions: &[DVec3]) -> Vec<f32> {
        let densities = densities(positions, self.radius);
        let widened = |((scale, now), rest): ((&f32, f32), &f32)| scale * (rest / now).powf(self.exponent as f32);
        self.scales.iter().zip(densities).zip(&self.rest).map(widened).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widths_follow_the_expansion_of_the_whole_and_ignore_motion() {
        let points: Vec<DVec3> = (0..1000)
            .map(|i| DVec3::new(f64::from(i % 10), f64::from(i / 10 % 10), f64::from(i / 100)) * 0.01)
            .collect();
        let of = |kind| SplatWidths::new(&points, &vec![0.005; 1000], 0.01, kind, &SurfaceTuning::default());
        let splat_widths = of(MaterialKind::Elastic);
        let moved: Vec<DVec3> = points.iter().map(|p| *p + DVec3::new(0.3, -0.1, 0.2)).collect();
        assert!(splat_widths.scales(&moved).iter().all(|s| (s - 0.005).abs() < 1e-6));
        let grown: Vec<DVec3> = points.iter().map(|p| *p * 1.1).collect();
        let mean = splat_widths.scales(&grown).iter().sum::<f32>() / 1000.0;
        assert!((mean / 0.005 - 1.1).abs() < 0.06, "{mean}");
        let grains = of(MaterialKind::Sand).scales(&grown).iter().sum::<f32>() / 1000.0;
        assert!(grains > mean * 1.03, "{grains} {mean}");
        // 1.1^3 of the density, of which the heap's edge has the root.
        assert!((grains / 0.005 - 1.1f32.powf(1.5)).abs() < 0.03, "{grains}");
    }
}
