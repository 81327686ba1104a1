//! A world with few enough particles for a page.

use std::collections::BTreeMap;

use gic_mpm::{Body, Stepping, World};
use glam::DVec3;

use crate::tuning::{CELL_SPACINGS, FRAME_RATE_HZ, MAX_PARTICLES, SPACING_GROWTH};

/// The world with at most [`MAX_PARTICLES`] particles a body, on the grid that suits them, at the page's frame rate.
///
/// All particles in a cube of a lattice become one with their volume, at their centre, so that mass and centre of mass
/// stay. A body that is small enough stays as it is.
pub fn reduced(world: &World) -> World {
    let mut reduced = world.clone();
    for body in &mut reduced.bodies {
        if body.positions.len() > MAX_PARTICLES {
            let spacing = thin(body);
            reduced.grid_spacing_m = reduced.grid_spacing_m.max(CELL_SPACINGS * spacing);
        }
    }
    reduced.frame_rate_hz = FRAME_RATE_HZ;
    reduced.stepping = Stepping::STABLE;
    reduced
}

/// Puts the particles of a body together; returns the side of the cubes [m].
fn thin(body: &mut Body) -> f64 {
    let factor = |p: usize| body.volume_factors.get(p).copied().unwrap_or(1.0);
    let volume: f64 = (0..body.positions.len()).map(factor).sum::<f64>() * body.particle_volume_m3;
    let mut spacing = (volume / MAX_PARTICLES as f64).cbrt();
    let lumps = loop {
        let mut lumps: BTreeMap<[i64; 3], (f64, DVec3)> = BTreeMap::new();
        for (p, position) in body.positions.iter().enumerate() {
            let cube = (*position / spacing).floor().to_array().map(|x| x as i64);
            let (sum, moment) = lumps.entry(cube).or_default();
            *sum += factor(p);
            *moment += factor(p) * position;
        }
        if lumps.len() <= MAX_PARTICLES {
            break lumps;
        }
        spacing *= SPACING_GROWTH;
    };
    let cubes = body.particle_volume_m3 / spacing.powi(3);
    body.positions = lumps.values().map(|(sum, moment)| *moment / *sum).collect();
    body.volume_factors = lumps.values().map(|(sum, _)| sum * cubes).collect();
    body.particle_volume_m3 = spacing.powi(3);
    body.own_velocities_m_s.clear();
    spacing
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live_simulation::tests::falling_block;

    #[test]
    fn mass_and_centre_stay() {
        let mut world = falling_block();
        let body = &mut world.bodies[0];
        let fine = 0.3 * body.particle_volume_m3.cbrt();
        body.particle_volume_m3 /= 27.0;
        let corners = body.positions.clone();
        body.positions = (0..27)
            .flat_map(|n| {
                let offset = DVec3::new(f64::from(n / 9), f64::from(n / 3 % 3), f64::from(n % 3)) * fine;
                corners.iter().map(move |p| *p + offset)
            })
            .collect();
        body.volume_factors = (0..body.positions.len()).map(|p| 1.0 + 0.3 * (p as f64).sin()).collect();
        let small = reduced(&world);
        assert!(
            small.bodies[0].positions.len() <= MAX_PARTICLES && small.bodies[0].positions.len() > MAX_PARTICLES / 2
        );
        let moments = |world: &World| {
            let masses = world.bodies[0].masses_kg();
            let mass: f64 = masses.iter().sum();
            let moment: DVec3 = masses.iter().zip(&world.bodies[0].positions).map(|(m, p)| *m * *p).sum();
            (mass, moment / mass)
        };
        let ((mass, centre), (small_mass, small_centre)) = (moments(&world), moments(&small));
        assert!((small_mass / mass - 1.0).abs() < 1e-12);
        assert!(centre.distance(small_centre) < 1e-12);
    }
}
