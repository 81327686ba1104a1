//! A tetrahedral mesh of the inside, for FEM tools: isosurface stuffing (Labelle and Shewchuk 2007).
//!
//! Space is tiled by the body-centred cubic lattice, whose tetrahedra all have dihedral angles of 60 and 90 degrees.
//! Lattice points too near to the surface are moved onto it; what then sticks out of a tetrahedron is cut off. Moving
//! first keeps the pieces that remain well shaped.

use std::collections::HashMap;

use glam::{DVec3, I64Vec3};

use crate::error::GeometryError;
use crate::field::{DensityField, MAX_VOXELS};

/// A cut nearer to a lattice point than this share of a long edge moves the point (the paper's alpha_long for its
/// safe mesh).
const SNAP_LONG: f64 = 0.24999;
/// The same for short edges.
const SNAP_SHORT: f64 = 0.41189;

/// A mesh of tetrahedra.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TetMesh {
    /// Positions [m].
    pub vertices: Vec<DVec3>,
    /// Corners of each tetrahedron; the last sees the first three counter-clockwise from inside, so volumes are
    /// positive.
    pub tetrahedra: Vec<[u32; 4]>,
}

impl TetMesh {
    /// Sum of the volumes [m^3].
    pub fn volume(&self) -> f64 {
        self.volumes().sum()
    }

    /// The volume of each tetrahedron [m^3].
    pub fn volumes(&self) -> impl Iterator<Item = f64> + '_ {
        self.tetrahedra.iter().map(|t| signed_volume(t.map(|i| self.vertices[i as usize])))
    }

    /// The smallest angle between two faces of one tetrahedron, and the largest [degrees]; (180, 0) without tetrahedra.
    pub fn dihedral_angles(&self) -> (f64, f64) {
        let (mut least, mut most) = (180.0f64, 0.0f64);
        for t in &self.tetrahedra {
            let p = t.map(|i| self.vertices[i as usize]);
            for (i, j, k, l) in [(0, 1, 2, 3), (0, 2, 1, 3), (0, 3, 1, 2), (1, 2, 0, 3), (1, 3, 0, 2), (2, 3, 0, 1)] {
                let edge = (p[j] - p[i]).normalize();
                let side = |q: DVec3| (q - p[i]).reject_from_normalized(edge);
                let angle = side(p[k]).angle_between(side(p[l])).to_degrees();
                (least, most) = (least.min(angle), most.max(angle));
            }
        }
        (least, most)
    }

    /// Faces that belong to one tetrahedron only, counter-clockwise seen from outside.
    pub fn boundary(&self) -> Vec<[u32; 3]> {
        let mut faces: Vec<([u32; 3], [u32; 3])> = Vec::with_capacity(4 * self.tetrahedra.len());
        for &[a, b, c, d] in &self.tetrahedra {
            for face in [[a, c, b], [a, b, d], [b, c, d], [a, d, c]] {
                let mut key = face;
                key.sort_unstable();
                faces.push((key, face));
            }
        }
        faces.sort_unstable();
        let alone = |i: usize| {
            (i == 0 || faces[i - 1].0 != faces[i].0) && (i + 1 == faces.len() || faces[i + 1].0 != faces[i].0)
        };
        (0..faces.len()).filter(|&i| alone(i)).map(|i| faces[i].1).collect()
    }
}

fn signed_volume([a, b, c, d]: [DVec3; 4]) -> f64 {
    (b - a).cross(c - a).dot(d - a) / 6.0
}

/// Lattice points by doubled coordinates: all even (the corners of cubic cells) or all odd (their centres).
struct Lattice {
    size: I64Vec3,
    /// Position of each point [m]; of points that are moved, where they were moved to.
    positions: Vec<DVec3>,
    /// Density less the level: positive inside, zero on the surface.
    values: Vec<f64>,
}

impl Lattice {
    fn new(field: &DensityField, level: f64, edge: f64) -> Result<Lattice, GeometryError> {
        // Half a cell of air all around, so that the surface closes.
        let low = field.origin - DVec3::splat(field.spacing + 0.5 * edge);
        let extent =
            DVec3::from_array(field.size.map(|n| n as f64)) * field.spacing + 2.0 * (field.spacing + 0.5 * edge);
        let cells = (extent / edge).ceil();
        let points = 8.0 * (cells.x + 1.0) * (cells.y + 1.0) * (cells.z + 1.0);
        let fits = points <= MAX_VOXELS;
        if !fits {
            return Err(GeometryError::TooManyVoxels { voxels: points, limit: MAX_VOXELS });
        }
        let size = 2 * cells.as_i64vec3() + 1;
        let mut lattice = Lattice { size, positions: Vec::new(), values: Vec::new() };
        for i in 0..size.element_product() {
            let position = low + 0.5 * edge * lattice.point(i as usize).as_dvec3();
            lattice.positions.push(position);
            lattice.values.push(field.sample(position) - level);
        }
        Ok(lattice)
    }

    fn point(&self, index: usize) -> I64Vec3 {
        let i = index as i64;
        I64Vec3::new(i % self.size.x, i / self.size.x % self.size.y, i / (self.size.x * self.size.y))
    }

    fn index(&self, p: I64Vec3) -> Option<usize> {
        let inside = p.cmpge(I64Vec3::ZERO).all() && p.cmplt(self.size).all();
        inside.then(|| (p.x + self.size.x * (p.y + self.size.y * p.z)) as usize)
    }

    fn is_point(p: I64Vec3) -> bool {
        p.x & 1 == p.y & 1 && p.y & 1 == p.z & 1
    }

    /// Moves every point that has a cut too near onto the nearest such cut.
    fn snap(&mut self) {
        let mut neighbours: Vec<(I64Vec3, f64)> = Vec::new();
        for axis in I64Vec3::AXES {
            neighbours.extend([(2 * axis, SNAP_LONG), (-2 * axis, SNAP_LONG)]);
        }
        for k in 0..8 {
            let d = I64Vec3::new(k & 1, k >> 1 & 1, k >> 2) * 2 - 1;
            neighbours.push((d, SNAP_SHORT));
        }
        let original = self.positions.clone();
        for i in 0..self.values.len() {
            let p = self.point(i);
            let v = self.values[i];
            if !Lattice::is_point(p) || v == 0.0 {
                continue;
            }
            let mut nearest = (f64::INFINITY, DVec3::ZERO);
            for &(d, limit) in &neighbours {
                let Some(j) = self.index(p + d) else { continue };
                let w = self.values[j];
                if w * v >= 0.0 {
                    continue;
                }
                let share = v / (v - w);
                let step = share * (original[j] - original[i]);
                if share < limit && step.length() < nearest.0 {
                    nearest = (step.length(), original[i] + step);
                }
            }
            if nearest.0.is_finite() {
                self.positions[i] = nearest.1;
                self.values[i] = 0.0;
            }
        }
    }
}

/// Collects tetrahedra and makes each vertex once.
struct Builder<'a> {
    lattice: &'a Lattice,
    mesh: TetMesh,
    of_point: HashMap<usize, u32>,
    of_cut: HashMap<(usize, usize), u32>,
}

impl Builder<'_> {
    fn point(&mut self, i: usize) -> u32 {
        let (mesh, lattice) = (&mut self.mesh, self.lattice);
        *self.of_point.entry(i).or_insert_with(|| {
            mesh.vertices.push(lattice.positions[i]);
            (mesh.vertices.len() - 1) as u32
        })
    }

    /// The vertex where the surface cuts an edge from an inside to an outside point.
    fn cut(&mut self, inside: usize, outside: usize) -> u32 {
        let (mesh, lattice) = (&mut self.mesh, self.lattice);
        *self.of_cut.entry((inside, outside)).or_insert_with(|| {
            let (v, w) = (lattice.values[inside], lattice.values[outside]);
            let share = v / (v - w);
            mesh.vertices.push(lattice.positions[inside].lerp(lattice.positions[outside], share));
            (mesh.vertices.len() - 1) as u32
        })
    }

    fn push(&mut self, mut t: [u32; 4]) {
        if signed_volume(t.map(|i| self.mesh.vertices[i as usize])) < 0.0 {
            t.swap(0, 1);
        }
        self.mesh.tetrahedra.push(t);
    }

    /// The inside part of a lattice tetrahedron. Four-sided faces between tetrahedra are split from the inside corner
    /// of the smaller index, a rule that both neighbours follow and that always leaves a prism that can be split.
    fn add(&mut self, corners: [usize; 4]) {
        let mut plus: Vec<usize> = corners.iter().copied().filter(|&i| self.lattice.values[i] > 0.0).collect();
        let zero: Vec<usize> = corners.iter().copied().filter(|&i| self.lattice.values[i] == 0.0).collect();
        let minus: Vec<usize> = corners.iter().copied().filter(|&i| self.lattice.values[i] < 0.0).collect();
        plus.sort_unstable();
        match (plus.len(), minus.len()) {
            (0, _) => {}
            (_, 0) => {
                let t = corners.map(|i| self.point(i));
                self.push(t);
            }
            (1, _) => {
                let p = plus[0];
                let mut t = vec![self.point(p)];
                t.extend(zero.iter().map(|&z| self.point(z)).collect::<Vec<_>>());
                t.extend(minus.iter().map(|&m| self.cut(p, m)).collect::<Vec<_>>());
                self.push([t[0], t[1], t[2], t[3]]);
            }
            (2, 1) => {
                let (z, p, q) = (self.point(zero[0]), self.point(plus[0]), self.point(plus[1]));
                let (c, d) = (self.cut(plus[0], minus[0]), self.cut(plus[1], minus[0]));
                self.push([z, p, q, d]);
                self.push([z, p, d, c]);
            }
            (2, _) => {
                let (p, q) = (self.point(plus[0]), self.point(plus[1]));
                let [p1, p2] = [0, 1].map(|k| self.cut(plus[0], minus[k]));
                let [q1, q2] = [0, 1].map(|k| self.cut(plus[1], minus[k]));
                self.push([p, q, q1, q2]);
                // On the surface the shorter diagonal is free to choose.
                let length =
                    |a: u32, b: u32| (self.mesh.vertices[a as usize] - self.mesh.vertices[b as usize]).length();
                if length(p1, q2) <= length(p2, q1) {
                    self.push([p, p1, p2, q2]);
                    self.push([p, p1, q2, q1]);
                } else {
                    self.push([p, p1, p2, q1]);
                    self.push([p, p2, q2, q1]);
                }
            }
            _ => {
                let [a, b, c] = [0, 1, 2].map(|k| self.point(plus[k]));
                let [ca, cb, cc] = [0, 1, 2].map(|k| self.cut(plus[k], minus[0]));
                self.push([a, b, c, cc]);
                self.push([a, b, cb, cc]);
                self.push([a, ca, cb, cc]);
            }
        }
    }
}

/// Tetrahedra that fill the space where the field is at least `level`, with edges of about `edge` [m].
///
/// # Errors
/// [`GeometryError`] where the edge is not above 0, needs too many lattice points, or is too long for the body.
pub fn tetrahedra(field: &DensityField, level: f64, edge: f64) -> Result<TetMesh, GeometryError> {
    let good = edge > 0.0 && edge.is_finite();
    if !good {
        return Err(GeometryError::TetrahedronEdge { edge });
    }
    let mut lattice = Lattice::new(field, level, edge)?;
    lattice.snap();
    let mut builder =
        Builder { lattice: &lattice, mesh: TetMesh::default(), of_point: HashMap::new(), of_cut: HashMap::new() };
    for i in 0..lattice.values.len() {
        let centre = lattice.point(i);
        if !Lattice::is_point(centre) || centre.x & 1 == 0 {
            continue;
        }
        for axis in 0..3 {
            let (e, u, v) = (I64Vec3::AXES[axis], I64Vec3::AXES[(axis + 1) % 3], I64Vec3::AXES[(axis + 2) % 3]);
            let Some(other) = lattice.index(centre + 2 * e) else { continue };
            // Around the edge between two cell centres, the four edges of the face between the cells.
            let ring = [e + u + v, e - u + v, e - u - v, e + u - v].map(|d| lattice.index(centre + d));
            for k in 0..4 {
                if let (Some(a), Some(b)) = (ring[k], ring[(k + 1) % 4]) {
                    builder.add([i, other, a, b]);
                }
            }
        }
    }
    if builder.mesh.tetrahedra.is_empty() { Err(GeometryError::NothingInside { edge }) } else { Ok(builder.mesh) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::triangle_mesh::TriangleMesh;

    fn field_of(distance: impl Fn(DVec3) -> f64, spacing: f64) -> DensityField {
        let mut field = DensityField::covering(DVec3::splat(-0.16), DVec3::splat(0.16), spacing, 1).unwrap();
        for i in 0..field.len() {
            field.values[i] = (0.5 - distance(field.centre(field.voxel(i))) / (4.0 * spacing)).clamp(0.0, 1.0) as f32;
        }
        field
    }

    #[test]
    fn ball_and_ring_are_filled_by_well_shaped_tetrahedra_with_a_closed_boundary() {
        use std::f64::consts::PI;
        let ball = field_of(|p| p.length() - 0.12, 0.01);
        let ring = field_of(|p| ((p.x.hypot(p.z) - 0.09).hypot(p.y)) - 0.04, 0.01);
        for (field, volume, radius, euler) in
            [(ball, 4.0 / 3.0 * PI * 0.12f64.powi(3), 0.12, 2), (ring, 2.0 * PI * PI * 0.09 * 0.04 * 0.04, 0.04, 0)]
        {
            let edge = 0.015f64;
            let mesh = tetrahedra(&field, 0.5, edge).unwrap();
            // Chords of length `edge` lie up to edge^2 / (8 radius) below an arc.
            let chords = 2.0 * edge * edge / (8.0 * radius * radius);
            assert!((mesh.volume() / volume - 1.0).abs() < 0.005 + chords, "{}", mesh.volume() / volume);
            let smallest =
                mesh.tetrahedra.iter().map(|t| signed_volume(t.map(|i| mesh.vertices[i as usize]))).fold(1.0, f64::min);
            assert!(smallest > 0.0, "every tetrahedron has a volume");
            let (least, most) = mesh.dihedral_angles();
            println!("{} tetrahedra, dihedral angles {least:.1} to {most:.1} degrees", mesh.tetrahedra.len());
            assert!(least > 8.0 && most < 170.0, "{least} {most}");
            let boundary =
                TriangleMesh { vertices: mesh.vertices.clone(), normals: vec![], triangles: mesh.boundary() };
            assert!(boundary.is_watertight());
            assert!((boundary.volume() / mesh.volume() - 1.0).abs() < 1e-9, "the boundary encloses the tetrahedra");
            let mut used: Vec<u32> = boundary.triangles.iter().flatten().copied().collect();
            used.sort_unstable();
            used.dedup();
            let faces = boundary.triangles.len() as i64;
            assert_eq!(used.len() as i64 - faces / 2, euler, "Euler characteristic");
        }
    }
}
