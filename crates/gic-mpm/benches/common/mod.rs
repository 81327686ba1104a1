//! The world of benches and examples.

use gic_mpm::{Body, Collider, Contact, Material, Stepping, World};
use glam::DVec3;

/// A stiff elastic solid and a plastic one that yields on impact.
pub(crate) fn materials() -> [Material; 2] {
    [
        Material::Elastic { youngs_modulus_pa: 3e5, poisson_ratio: 0.3 },
        Material::Plasticine { youngs_modulus_pa: 1e6, poisson_ratio: 0.3, yield_stress_pa: 5e3 },
    ]
}

/// A cube of `side^3` particles, 8 per cell, falling on the ground, in substeps of 1/4800 s.
pub(crate) fn falling_cube(material: Material, side: usize, substeps_per_frame: usize) -> World {
    let at = |i: usize| DVec3::new((i % side) as f64, (i / side % side) as f64, (i / (side * side)) as f64);
    World {
        bodies: vec![Body {
            material,
            density_kg_m3: 1000.0,
            particle_volume_m3: 1e-6,
            volume_factors: Vec::new(),
            positions: (0..side.pow(3)).map(|i| (at(i) + 0.5) * 0.01 + DVec3::Y * 0.03).collect(),
            velocity_m_s: DVec3::new(0.5, -2.0, 0.25),
            angular_velocity_rad_s: DVec3::ZERO,
            own_velocities_m_s: Vec::new(),
        }],
        colliders: vec![Collider::plane(DVec3::ZERO, DVec3::Y, Contact::Sticky)],
        gravity_m_s2: DVec3::new(0.0, -9.8, 0.0),
        grid_spacing_m: 0.02,
        frame_rate_hz: 4800.0 / substeps_per_frame as f64,
        stepping: Stepping::at_least(substeps_per_frame),
    }
}
