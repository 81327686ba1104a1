//! The surface of a body as a triangle mesh: marching cubes (Lorensen and Cline 1987) on the density field,
//! watertight by construction.
//!
//! The 256 cases of marching cubes are derived instead of tabulated. On every face of a cube of eight voxel centres
//! the level set enters and leaves through edges whose ends lie on different sides; on a face with two inside corners
//! across a diagonal, inside corners are kept apart. Both cubes that share a face see the same four values, so they
//! agree on its segments, and the loops that the segments form close up into a surface where every edge belongs to
//! exactly two triangles.

use glam::DVec3;

use crate::field::DensityField;
use crate::triangle_mesh::TriangleMesh;

/// Corners of a cube: bit 0 of the index is x, bit 1 is y, bit 2 is z. Faces as four corners, counter-clockwise seen
/// from outside.
const FACES: [[usize; 4]; 6] = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
/// Vertices stay this share of an edge away from its ends, so that no triangle collapses to a point.
const CLEARANCE: f64 = 1e-3;

/// The surface where the interpolated field is `level`, as a closed mesh [m]; the field is zero outside its grid, and
/// inside is where it is at least `level`.
pub fn marching_cubes(field: &DensityField, level: f64) -> TriangleMesh {
    // Nodes are voxel centres, with one layer of zeros around.
    let size = field.size.map(|n| n + 2);
    let node = |x: usize, y: usize, z: usize| x + size[0] * (y + size[1] * z);
    let value = |x: usize, y: usize, z: usize| -> f64 {
        let inner = |c: usize, n: usize| (1..=n).contains(&c);
        if inner(x, field.size[0]) && inner(y, field.size[1]) && inner(z, field.size[2]) {
            f64::from(field.values[field.index(x - 1, y - 1, z - 1)])
        } else {
            0.0
        }
    };
    let mut mesh = TriangleMesh::default();
    // The vertex on the edge from a node along each axis, if made already.
    let mut vertex_on = vec![[u32::MAX; 3]; size[0] * size[1] * size[2]];
    let mut next = [[0usize; 8]; 8];
    for z in 0..size[2] - 1 {
        for y in 0..size[1] - 1 {
            for x in 0..size[0] - 1 {
                let corner = |k: usize| [x + (k & 1), y + (k >> 1 & 1), z + (k >> 2)];
                let values: [f64; 8] = std::array::from_fn(|k| {
                    let [x, y, z] = corner(k);
                    value(x, y, z)
                });
                let inside = values.map(|v| v >= level);
                if inside.iter().all(|&i| i) || !inside.iter().any(|&i| i) {
                    continue;
                }
                let mut crossing = |mesh: &mut TriangleMesh, from: usize, to: usize| -> u32 {
                    let (low, high) = (from.min(to), from.max(to));
                    let [lx, ly, lz] = corner(low);
                    let axis = (high - low).trailing_zeros() as usize;
                    let slot = &mut vertex_on[node(lx, ly, lz)][axis];
                    if *slot == u32::MAX {
                        let share = (level - values[low]) / (values[high] - values[low]);
                        let mut p = DVec3::new(lx as f64, ly as f64, lz as f64);
                        p[axis] += share.clamp(CLEARANCE, 1.0 - CLEARANCE);
                        let position = field.origin + field.spacing * (p - 0.5);
                        *slot = mesh.vertices.len() as u32;
                        mesh.normals.push((-field.gradient(position)).normalize_or(DVec3::Y));
                        mesh.vertices.push(position);
                    }
                    *slot
                };
                for face in FACES {
                    link_face(face, &inside, &mut next);
                }
                // Follow the loops; a directed edge (inside corner, outside corner) names a vertex.
                for from in 0..8 {
                    for axis in 0..3 {
                        let to = from ^ (1 << axis);
                        if next[from][to] == 0 {
                            continue;
                        }
                        let mut loop_edges = Vec::with_capacity(12);
                        let (mut a, mut b) = (from, to);
                        while next[a][b] != 0 {
                            loop_edges.push((a, b));
                            let code = std::mem::take(&mut next[a][b]) - 1;
                            (a, b) = (code / 8, code % 8);
                        }
                        let corners: Vec<u32> = loop_edges.iter().map(|&(a, b)| crossing(&mut mesh, a, b)).collect();
                        close_loop(&loop_edges, &corners, field, &mut mesh);
                    }
                }
            }
        }
    }
    mesh
}

/// Fills a loop of crossings with triangles: a fan around one of them, none of whose diagonals lies in a face of the
/// cube (where the neighbouring cube might use the same one); around the loop's centre where there is no such fan.
fn close_loop(edges: &[(usize, usize)], corners: &[u32], field: &DensityField, mesh: &mut TriangleMesh) {
    let n = corners.len();
    let in_one_face = |i: usize, j: usize| {
        let ((a, b), (c, d)) = (edges[i], edges[j]);
        a & b & c & d != 0 || a | b | c | d != 7
    };
    match (0..n).find(|&hub| (2..n - 1).all(|k| !in_one_face(hub, (hub + k) % n))) {
        Some(hub) => {
            for k in 1..n - 1 {
                mesh.triangles.push([corners[hub], corners[(hub + k) % n], corners[(hub + k + 1) % n]]);
            }
        }
        None => {
            let centre = corners.iter().map(|&c| mesh.vertices[c as usize]).sum::<DVec3>() / n as f64;
            let hub = mesh.vertices.len() as u32;
            mesh.vertices.push(centre);
            mesh.normals.push((-field.gradient(centre)).normalize_or(DVec3::Y));
            for k in 0..n {
                mesh.triangles.push([hub, corners[k], corners[(k + 1) % n]]);
            }
        }
    }
}

/// Links the crossings of one face of a cube: after the crossing where the boundary of the face, counter-clockwise
/// seen from outside the cube, enters the inside comes the crossing where it leaves again. `next[in][out]` holds the
/// following crossing of the loop as `8 * in + out + 1`.
fn link_face(face: [usize; 4], inside: &[bool; 8], next: &mut [[usize; 8]; 8]) {
    for k in 0..4 {
        let (outer, inner) = (face[k], face[(k + 1) % 4]);
        if inside[outer] || !inside[inner] {
            continue;
        }
        // The run of inside corners that starts here: separate runs on one face stay separate.
        let mut last = (k + 1) % 4;
        while inside[face[(last + 1) % 4]] {
            last = (last + 1) % 4;
        }
        let leaving = 8 * face[last] + face[(last + 1) % 4];
        next[inner][outer] = leaving + 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn field_of(distance: impl Fn(DVec3) -> f64, spacing: f64, half: f64) -> DensityField {
        let mut field = DensityField::covering(DVec3::splat(-half), DVec3::splat(half), spacing, 1).unwrap();
        for i in 0..field.len() {
            field.values[i] = (0.5 - distance(field.centre(field.voxel(i))) / (4.0 * spacing)).clamp(0.0, 1.0) as f32;
        }
        field
    }

    #[test]
    fn ball_has_its_volume_area_and_normals() {
        let radius = 0.1;
        let mesh = marching_cubes(&field_of(|p| p.length() - radius, 0.01, 0.13), 0.5);
        assert!(mesh.is_watertight());
        let volume = 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3);
        assert!((mesh.volume() / volume - 1.0).abs() < 0.01, "{}", mesh.volume() / volume);
        assert!((mesh.area() / (4.0 * std::f64::consts::PI * radius.powi(2)) - 1.0).abs() < 0.01);
        for (p, n) in mesh.vertices.iter().zip(&mesh.normals) {
            assert!(n.dot(p.normalize()) > 0.99);
        }
        let points = mesh.sample(0.01, 1);
        assert!((points.len() as f64 * 1e-4 / mesh.area() - 1.0).abs() < 0.01);
        assert!(points.iter().all(|s| (s.position.length() - radius).abs() < 1e-3));
    }

    #[test]
    fn a_body_that_fills_the_grid_is_closed_at_its_border() {
        let mut field = DensityField::covering(DVec3::ZERO, DVec3::ONE, 0.5, 1).unwrap();
        field.values.fill(1.0);
        let mesh = marching_cubes(&field, 0.5);
        assert!(mesh.is_watertight());
        // Two voxels a side: the level set cuts the edges and corners of the unit cube.
        assert!((mesh.volume() - 0.7083).abs() < 1e-3, "{}", mesh.volume());
    }

    proptest! {
        #[test]
        fn any_field_gives_a_watertight_mesh(values in prop::collection::vec(0.0f32..1.0, 125)) {
            // Noise has every one of the 256 cases and every ambiguous face.
            let field = DensityField { origin: DVec3::ZERO, spacing: 0.1, size: [5, 5, 5], values };
            let mesh = marching_cubes(&field, 0.5);
            prop_assert!(mesh.is_watertight());
            prop_assert!(mesh.volume() >= 0.0);
        }
    }
}
