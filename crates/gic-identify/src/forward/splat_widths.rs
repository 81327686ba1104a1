//! Gaussians that widen where matter thins out.
//!
//! The outline of a diluted continuum (a sand pile that spread) is that of its density field, not of particles of the
//! size that they had at rest: with constant widths the re-rendered outline of the given sand scenes shrinks by 7 %
//! between the first and the last frame, which the friction angle would have to explain. The width follows the local
//! number density n, relative to the particle's own neighbourhood at rest: `sigma = sigma_0 (n_0 / n)^gamma`. A bulk
//! that thins out alike in all directions stays covered with gamma = 1/3, a sheet with 1/2, a thread with 1. What a
//! pile does lies between, so gamma is an unknown of the joint stage.

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
    /// The exponent gamma, before anything is known.
    exponent: f64,
}

impl SplatWidths {
    /// `spacing` is the particles' mean distance at rest [m].
    pub(crate) fn new(positions: &[DVec3], scales: &[f32], spacing: f64, tuning: &SurfaceTuning) -> SplatWidths {
        let radius = tuning.neighbourhood_spacings * spacing;
        let rest = densities(positions, radius);
        SplatWidths { radius, rest, scales: scales.to_vec(), exponent: tuning.thinning_exponent }
    }

    /// Standard deviations at rest [m], shape [n].
    pub(crate) fn rest_scales(&self) -> &[f32] {
        &self.scales
    }

    /// How much thinner matter is around particles at `positions` than at rest, as a logarithm, shape [n].
    pub(crate) fn dilutions(&self, positions: &[DVec3]) -> Vec<f32> {
        densities(positions, self.radius).iter().zip(&self.rest).map(|(now, rest)| (rest / now).ln()).collect()
    }

    /// Standard deviations [m] of particles with these dilutions, shape [n], with so much added to the exponent.
    pub(crate) fn scales(&self, dilutions: &[f32], added: f64) -> Vec<f32> {
        let exponent = (self.exponent + added) as f32;
        self.scales.iter().zip(dilutions).map(|(scale, dilution)| scale * (exponent * dilution).exp()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::forward::trajectories::Trajectories;
    use crate::unknowns::state::Unknown;

    #[test]
    fn widths_follow_the_expansion_of_the_whole_and_ignore_motion() {
        let points: Vec<DVec3> = (0..1000)
            .map(|i| DVec3::new(f64::from(i % 10), f64::from(i / 10 % 10), f64::from(i / 100)) * 0.01)
            .collect();
        let splat_widths = SplatWidths::new(&points, &vec![0.005; 1000], 0.01, &SurfaceTuning::default());
        let moved: Vec<DVec3> = points.iter().map(|p| *p + DVec3::new(0.3, -0.1, 0.2)).collect();
        let scales = |positions: &[DVec3]| splat_widths.scales(&splat_widths.dilutions(positions), 1.0 / 3.0 - 0.5);
        assert!(scales(&moved).iter().all(|s| (s - 0.005).abs() < 1e-6));
        let grown: Vec<DVec3> = points.iter().map(|p| *p * 1.1).collect();
        let mean = scales(&grown).iter().sum::<f32>() / 1000.0;
        assert!((mean / 0.005 - 1.1).abs() < 0.06, "{mean}");
    }

    /// A step of the exponent is one of the drawing: no motion has to be simulated for it.
    #[test]
    fn the_exponent_is_an_unknown_of_the_drawing() {
        let points: Vec<DVec3> = (0..64).map(|i| DVec3::new(f64::from(i % 8), f64::from(i / 8), 0.0) * 0.01).collect();
        let splat_widths = SplatWidths::new(&points, &[0.005; 64], 0.01, &SurfaceTuning::default());
        let spread: Vec<DVec3> = points.iter().map(|p| *p * DVec3::new(1.5, 1.2, 1.0)).collect();
        let dilutions = splat_widths.dilutions(&spread);
        let drawn = Trajectories {
            positions: Vec::new(),
            scales: vec![splat_widths.scales(&dilutions, 0.1)],
            dilutions: vec![dilutions.clone()],
            splat_factor: 1.0,
            outward_displacements: Vec::new(),
        };
        let stepped = drawn.drawn(Unknown::Thinning, 0.2);
        let expected = splat_widths.scales(&dilutions, 0.3);
        assert!(dilutions.iter().all(|dilution| *dilution > 0.1));
        assert!(stepped.scales[0].iter().zip(&expected).all(|(a, b)| (a / b - 1.0).abs() < 1e-5));
    }
}
