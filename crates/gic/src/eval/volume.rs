//! How much room true particles take up: bodies are squeezed when they land, and sand loosens when it spreads.

use gic_geometry::DensityField;
use glam::DVec3;

use crate::error::{Error, Result};

/// Standard deviation of the smoothing, and side of the voxels, in particle spacings.
const SMOOTHING_SPACINGS: f64 = 0.6;
const VOXEL_SPACINGS: f64 = 0.5;
/// Reach of the smoothing, in standard deviations.
const KERNEL_CUTOFF: f64 = 3.5;

/// Volume [m^3] where particles [m], which lie `spacing` metres apart at rest, are at least half as dense as most of
/// them are inside (their upper quartile). Flat boundaries come out half a spacing outside the last layer; edges lose a
/// little, so compare only volumes found by this.
pub(super) fn occupied(particles: &[[f32; 3]], spacing: f64) -> Result<f64> {
    let points: Vec<DVec3> = particles.iter().map(|p| DVec3::from(p.map(f64::from))).collect();
    let low = points.iter().fold(DVec3::INFINITY, |low, p| low.min(*p)) - 3.0 * spacing;
    let high = points.iter().fold(DVec3::NEG_INFINITY, |high, p| high.max(*p)) + 3.0 * spacing;
    let mut field =
        DensityField::covering(low, high, VOXEL_SPACINGS * spacing, 1).map_err(Error::stage("measuring the truth"))?;
    let deviation = SMOOTHING_SPACINGS * spacing;
    let peak = (SMOOTHING_SPACINGS * (2.0 * std::f64::consts::PI).sqrt()).powi(-3);
    let reach = (KERNEL_CUTOFF * SMOOTHING_SPACINGS / VOXEL_SPACINGS).ceil() as i64;
    let [nx, ny, nz] = field.size;
    for &p in &points {
        let at = ((p - field.origin) / field.spacing).floor();
        let around = |c: f64, n: usize| {
            let c = c as i64;
            (c - reach).max(0) as usize..((c + reach + 1).max(0) as usize).min(n)
        };
        for z in around(at.z, nz) {
            for y in around(at.y, ny) {
                for x in around(at.x, nx) {
                    let squared = field.centre([x, y, z]).distance_squared(p);
                    let index = field.index(x, y, z);
                    field.values[index] += (peak * (-0.5 * squared / (deviation * deviation)).exp()) as f32;
                }
            }
        }
    }
    let mut densities: Vec<f64> = points.iter().map(|p| field.sample(*p)).collect();
    densities.sort_by(f64::total_cmp);
    Ok(field.volume(0.5 * densities[densities.len() * 3 / 4]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lattice_takes_up_its_own_volume_and_a_stretched_one_more() {
        let lattice = |stretch: f32| -> Vec<[f32; 3]> {
            let place = |i: usize| i as f32 * 0.01;
            (0..20 * 20 * 20).map(|i| [stretch * place(i % 20), place(i / 20 % 20), place(i / 400)]).collect()
        };
        let whole = 8000.0 * 1e-6;
        let rest = occupied(&lattice(1.0), 0.01).unwrap();
        assert!((rest / whole - 1.0).abs() < 0.02, "{}", rest / whole);
        let stretched = occupied(&lattice(1.1), 0.01).unwrap();
        assert!((stretched / rest - 1.1).abs() < 0.01, "{}", stretched / rest);
    }
}
