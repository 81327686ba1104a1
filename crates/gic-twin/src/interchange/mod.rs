//! A twin in the formats of other simulators: MuJoCo (MJCF), OpenUSD, and a plain particle set.

mod embedding;
mod mjcf;
mod particle_set;
mod usd;

pub use embedding::EmbeddedPoints;
pub use mjcf::write_mjcf;
pub use particle_set::write_particle_set;
pub use usd::{MotionSamples, write_usd};

use gic_geometry::TetMesh;
use glam::DVec3;

use crate::error::{Result, TwinError};
use crate::twin::Twin;

/// Young's modulus [Pa] and Poisson's ratio for simulators that know elastic solids only.
///
/// # Errors
/// The twin is a fluid or loose grains.
fn elastic_solid(twin: &Twin, format: &str) -> Result<[f64; 2]> {
    use gic_mpm::Material::{Newtonian, Sand};
    match (&twin.material, twin.material.elastic_moduli()) {
        (Newtonian { .. } | Sand { .. }, _) | (_, None) => Err(TwinError::Usage {
            problem: format!("{format} describes elastic solids, and the twin's material is {}", twin.material.model()),
            hint: Some("export its particles with --format particles, for simulators with such a law".into()),
        }),
        (_, Some(moduli)) => Ok(moduli),
    }
}

/// Mass of each vertex [kg]: a quarter of each tetrahedron around it.
fn vertex_masses(mesh: &TetMesh, density_kg_m3: f64) -> Vec<f64> {
    let mut masses = vec![0.0; mesh.vertices.len()];
    for tetrahedron in &mesh.tetrahedra {
        let share = 0.25 * density_kg_m3 * volume(corners(mesh, tetrahedron));
        tetrahedron.iter().for_each(|&i| masses[i as usize] += share);
    }
    masses
}

fn corners(mesh: &TetMesh, tetrahedron: &[u32; 4]) -> [DVec3; 4] {
    tetrahedron.map(|i| mesh.vertices[i as usize])
}

fn volume([a, b, c, d]: [DVec3; 4]) -> f64 {
    (b - a).cross(c - a).dot(d - a) / 6.0
}

/// The least height of a tetrahedron over one of its faces [m].
fn least_height(mesh: &TetMesh) -> f64 {
    let height = |t: &[u32; 4]| {
        let [a, b, c, d] = corners(mesh, t);
        let area = |p: DVec3, q: DVec3, r: DVec3| 0.5 * (q - p).cross(r - p).length();
        let largest = area(a, b, c).max(area(a, b, d)).max(area(a, c, d)).max(area(b, c, d));
        3.0 * volume([a, b, c, d]) / largest
    };
    mesh.tetrahedra.iter().map(height).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masses_sum_to_the_whole_and_heights_are_those_of_the_corner_of_a_cube() {
        let vertices = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
        let mesh = TetMesh { vertices, tetrahedra: vec![[0, 1, 2, 3]] };
        let masses = vertex_masses(&mesh, 12.0);
        assert!(masses.iter().all(|m| (m - 0.5).abs() < 1e-12));
        assert!((least_height(&mesh) - 1.0 / 3f64.sqrt()).abs() < 1e-12);
    }
}
