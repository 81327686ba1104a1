//! Gaussians that widen where matter thins out.
//!
//! The outline of a diluted continuum (a sand pile that spread) is that of its density field, not of particles of the
//! size that they had at rest: with constant widths the re-rendered outline of the given sand scenes shrinks by 7 %
//! between the first and the last frame, which the friction angle would have to explain. The width follows the local
//! number density to the power -1/3, relative to the particle's own neighbourhood at rest, so that the surface (half of
//! a neighbourhood) is no splat_widths.

use gic_geometry::densities;
use glam::DVec3;

use crate::tuning::SurfaceTuning;

/// How dense matter is around each particle at rest.
#[derive(Clone, Debug)]
pub(crate) struct SplatWidths {
    radius: f64,
    rest: Vec<f32>,
    /// Standard deviations at rest [m].
    scales: Vec<f32>,
}

impl SplatWidths {
    /// `spacing` is the particles' mean distance at rest [m].
    pub(crate) fn new(positions: &[DVec3], scales: &[f32], spacing: f64, tuning: &SurfaceTuning) -> SplatWidths {
        let radius = tuning.neighbourhood_spacings * spacing;
        SplatWidths { radius, rest: densities(positions, radius), scales: scales.to_vec() }
    }

    /// Standard deviations at rest [m], shape [n].
    pub(crate) fn rest_scales(&self) -> &[f32] {
        &self.scales
    }

    /// Standard deviations [m] for particles at `positions`, shape [n].
    pub(crate) fn scales(&self, positions: &[DVec3]) -> Vec<f32> {
        densities(positions, self.radius)
            .iter()
            .zip(&self.rest)
            .zip(&self.scales)
            .map(|((now, rest), scale)| scale * (rest / now).cbrt())
            .collect()
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
        let splat_widths = SplatWidths::new(&points, &vec![0.005; 1000], 0.01, &SurfaceTuning::default());
        let moved: Vec<DVec3> = points.iter().map(|p| *p + DVec3::new(0.3, -0.1, 0.2)).collect();
        assert!(splat_widths.scales(&moved).iter().all(|s| (s - 0.005).abs() < 1e-6));
        let grown: Vec<DVec3> = points.iter().map(|p| *p * 1.1).collect();
        let mean = splat_widths.scales(&grown).iter().sum::<f32>() / 1000.0;
        assert!((mean / 0.005 - 1.1).abs() < 0.06, "{mean}");
    }
}
