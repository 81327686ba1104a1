//! The Gaussian-informed continuum (paper eq. 7): particles as isotropic Gaussians, of which only alpha is drawn.

use gic_splat::{Gaussians, RenderSettings, Shape, render};
use glam::DVec3;

use super::sample::Particles;
use crate::tuning::Tuning;
use crate::{ContinuumError, MaskedView};

/// How particles are drawn: what eq. 7 leaves open, found from the masks by [`calibrate`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Appearance {
    /// Standard deviation of a Gaussian in units of the particle spacing.
    pub scale: f64,
    /// Opacity of a particle of density 1.
    pub opacity: f32,
}

/// Agreement of drawn alpha with a mask.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agreement {
    /// Intersection over union, both thresholded at one half.
    pub iou: f64,
    /// Area of alpha less area of the mask, over area of the mask (sums of antialiased coverage).
    pub signed_area_error: f64,
}

/// The triplets (position, scale, opacity) of eq. 7 as Gaussians: sigma_F times the appearance's opacity, the lattice's
/// spacing times its scale. Colours are black. `positions` [m] may be those of any time, in the order of the particles.
pub fn informed_gaussians(positions: &[DVec3], particles: &Particles, appearance: &Appearance) -> Gaussians {
    let scale = (appearance.scale * particles.spacing) as f32;
    Gaussians {
        positions: positions.iter().map(|p| p.as_vec3().to_array()).collect(),
        opacities: particles.densities.iter().map(|d| appearance.opacity * d).collect(),
        shape: Shape::Isotropic { scales: vec![scale; positions.len()] },
        sh_degree: 0,
        sh: vec![[0.0; 3]; positions.len()],
    }
}

/// Draws the particles into every view that has a mask and compares; `None` for views without.
pub fn compare_with_masks(
    particles: &Particles,
    appearance: &Appearance,
    views: &[MaskedView],
) -> Vec<Option<Agreement>> {
    let gaussians = informed_gaussians(&particles.positions, particles, appearance);
    views
        .iter()
        .map(|view| {
            let mask = view.mask?;
            let alpha = render(&gaussians, view.camera, &RenderSettings::masks()).alpha;
            Some(agreement(&alpha, mask))
        })
        .collect()
}

/// Compares drawn alpha with a mask of the same size.
pub fn agreement(alpha: &[f32], mask: &[f32]) -> Agreement {
    let (mut both, mut either) = (0.0f64, 0.0f64);
    let (mut drawn, mut covered) = (0.0f64, 0.0f64);
    for (&a, &m) in alpha.iter().zip(mask) {
        both += f64::from(u8::from(a >= 0.5 && m >= 0.5));
        either += f64::from(u8::from(a >= 0.5 || m >= 0.5));
        drawn += f64::from(a);
        covered += f64::from(m);
    }
    Agreement {
        iou: if either > 0.0 { both / either } else { 1.0 },
        signed_area_error: if covered > 0.0 { drawn / covered - 1.0 } else { drawn },
    }
}

/// The scale at which the drawn area equals the masks' area, summed over the views: a bisection, because the
/// area grows with the scale, which is no larger than a spacing.
///
/// # Errors
/// No view has a mask.
pub fn calibrate(particles: &Particles, views: &[MaskedView], tuning: &Tuning) -> Result<Appearance, ContinuumError> {
    let opacity = tuning.particles.opacity;
    if views.iter().all(|v| v.mask.is_none()) {
        return Err(ContinuumError::NoMasks { views: views.len() });
    }
    let excess = |scale: f64| -> f64 {
        let gaussians = informed_gaussians(&particles.positions, particles, &Appearance { scale, opacity });
        views
            .iter()
            .filter_map(|view| {
                let covered: f64 = view.mask?.iter().map(|&m| f64::from(m)).sum();
                let drawn = render(&gaussians, view.camera, &RenderSettings::masks()).alpha;
                Some(drawn.iter().map(|&a| f64::from(a)).sum::<f64>() - covered)
            })
            .sum()
    };
    let (mut low, mut high) = (0.0, 1.0);
    while high - low > tuning.iterations.tolerance {
        let middle = 0.5 * (low + high);
        if excess(middle) > 0.0 { high = middle } else { low = middle }
    }
    Ok(Appearance { scale: 0.5 * (low + high), opacity })
}
