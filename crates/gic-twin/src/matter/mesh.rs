//! Closed triangle meshes: reading, checking, filling with particles.

use std::collections::{BTreeMap, HashMap};
use std::io::BufReader;
use std::path::Path;

use gic_files::FileError;
use glam::DVec3;

use crate::error::{Result, TwinError};

/// Triangles over shared vertices.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Positions [m], shape [n]; equal positions are one vertex.
    pub vertices: Vec<DVec3>,
    /// Corners of each triangle, counter-clockwise seen from outside, shape [m].
    pub triangles: Vec<[u32; 3]>,
}

/// What edges say about a mesh.
enum Watertightness {
    /// Every edge is passed equally often in both directions.
    Oriented,
    /// Every edge belongs to an even number of triangles, but some triangles are turned inside out.
    Unoriented,
    /// Some edge belongs to an odd number of triangles.
    Open { edges: usize, first: [DVec3; 2] },
}

impl Mesh {
    /// A mesh of polygons, cut into fans of triangles; vertices at exactly the same place become one.
    pub(super) fn from_polygons(
        path: &Path,
        positions: Vec<DVec3>,
        polygons: impl Iterator<Item = Vec<u32>>,
    ) -> Result<Self> {
        let content = |problem: String| {
            TwinError::File(FileError::Content {
                path: path.to_owned(),
                problem,
                hint: Some("write the mesh again from the program that made it".into()),
            })
        };
        if let Some(i) = positions.iter().position(|p| !p.is_finite()) {
            return Err(content(format!("vertex {i} is not finite")));
        }
        let mut places = HashMap::new();
        let mut mesh = Self::default();
        let mut weld = |p: DVec3| {
            // Adding zero turns -0 into 0, so that equal coordinates have equal bits.
            let key = p.to_array().map(|c| (c + 0.0).to_bits());
            *places.entry(key).or_insert_with(|| {
                mesh.vertices.push(p);
                (mesh.vertices.len() - 1) as u32
            })
        };
        let welded: Vec<u32> = positions.into_iter().map(&mut weld).collect();
        for (face, corners) in polygons.enumerate() {
            if corners.len() < 3 || corners.iter().any(|&c| c as usize >= welded.len()) {
                return Err(content(format!("face {face} does not name three or more existing vertices")));
            }
            let corner = |i: usize| welded[corners[i] as usize];
            for i in 1..corners.len() - 1 {
                let triangle = [corner(0), corner(i), corner(i + 1)];
                // A triangle with two equal corners has no area, and its edges cancel.
                if triangle[0] != triangle[1] && triangle[1] != triangle[2] && triangle[2] != triangle[0] {
                    mesh.triangles.push(triangle);
                }
            }
        }
        Ok(mesh)
    }

    fn watertightness(&self) -> Watertightness {
        // Per undirected edge: how often it occurs, and how often forwards minus backwards.
        let mut edges: BTreeMap<(u32, u32), (u32, i32)> = BTreeMap::new();
        for t in &self.triangles {
            for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                let entry = edges.entry((a.min(b), a.max(b))).or_default();
                entry.0 += 1;
                entry.1 += if a < b { 1 } else { -1 };
            }
        }
        let open: Vec<_> = edges.iter().filter(|(_, (count, _))| count % 2 == 1).collect();
        if let Some(((a, b), _)) = open.first() {
            let first = [self.vertices[*a as usize], self.vertices[*b as usize]];
            Watertightness::Open { edges: open.len(), first }
        } else if edges.values().all(|(_, balance)| *balance == 0) {
            Watertightness::Oriented
        } else {
            Watertightness::Unoriented
        }
    }

    /// Refuses a mesh that has no inside.
    pub(super) fn check_closed(&self, path: &Path) -> Result<()> {
        let problem = match self.watertightness() {
            _ if self.triangles.is_empty() => "holds no triangles".to_owned(),
            Watertightness::Open { edges, first: [a, b] } => format!(
                "is not watertight: {edges} edges have a triangle on one side only, the first between ({}, {}, {}) and \
                 ({}, {}, {})",
                a.x, a.y, a.z, b.x, b.y, b.z
            ),
            Watertightness::Oriented | Watertightness::Unoriented => return Ok(()),
        };
        Err(TwinError::File(FileError::Content {
            path: path.to_owned(),
            problem,
            hint: Some(
                "close its holes first, for example with Blender's 3D-Print toolbox or MeshLab's `Close Holes`".into(),
            ),
        }))
    }

    /// Smallest and largest coordinates [m].
    pub fn bounds(&self) -> (DVec3, DVec3) {
        self.vertices.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), &v| (low.min(v), high.max(v)))
    }

    /// Particles [m] inside the mesh on an axis-aligned lattice of `spacing` [m], centred in its bounding box, z
    /// fastest.
    ///
    /// Inside is where the winding number is not zero, so overlapping shells count as one and a shell turned inwards is
    /// a cavity; a mesh with triangles turned inside out falls back to counting crossings.
    pub fn sample(&self, spacing: f64) -> Vec<DVec3> {
        let oriented = matches!(self.watertightness(), Watertightness::Oriented);
        let (low, high) = self.bounds();
        let counts = (high - low).to_array().map(|side| ((side / spacing + 1e-6).floor() as usize).max(1));
        let centre = (low + high) / 2.0;
        let at = |i: usize, axis: usize| centre[axis] + (i as f64 - (counts[axis] as f64 - 1.0) / 2.0) * spacing;
        let columns = self.crossings(&counts, at);
        let mut particles = Vec::new();
        for i in 0..counts[0] {
            for j in 0..counts[1] {
                let mut crossings = columns[i * counts[1] + j].iter().peekable();
                let (mut winding, mut parity) = (0, false);
                for k in 0..counts[2] {
                    let z = at(k, 2);
                    while let Some((_, direction)) = crossings.next_if(|c| c.0 < z) {
                        winding += direction;
                        parity = !parity;
                    }
                    if if oriented { winding != 0 } else { parity } {
                        particles.push(DVec3::new(at(i, 0), at(j, 1), z));
                    }
                }
            }
        }
        particles
    }

    /// Where each lattice column along z passes through the mesh: height [m] and direction (+1 inwards), ascending.
    fn crossings(&self, counts: &[usize; 3], at: impl Fn(usize, usize) -> f64) -> Vec<Vec<(f64, i32)>> {
        let mut columns = vec![Vec::new(); counts[0] * counts[1]];
        for t in &self.triangles {
            let corners = t.map(|v| self.vertices[v as usize]);
            let range = |axis: usize| {
                let (low, high) = corners
                    .iter()
                    .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), c| (l.min(c[axis]), h.max(c[axis])));
                let spacing = if counts[axis] > 1 { at(1, axis) - at(0, axis) } else { 1.0 };
                // One column more on each side than strictly needed, against rounding.
                let first = ((low - at(0, axis)) / spacing).floor() - 1.0;
                let last = ((high - at(0, axis)) / spacing).ceil() + 1.0;
                first.max(0.0) as usize..(last + 1.0).clamp(0.0, counts[axis] as f64) as usize
            };
            for i in range(0) {
                for j in range(1) {
                    if let Some(crossing) = crossing(corners, at(i, 0), at(j, 1)) {
                        columns[i * counts[1] + j].push(crossing);
                    }
                }
            }
        }
        for column in &mut columns {
            column.sort_by(|a, b| a.0.total_cmp(&b.0));
        }
        columns
    }
}

/// Where the upward line through (x, y) passes a triangle: height [m] and +1 where it enters the solid, -1 where it
/// leaves.
fn crossing(corners: [DVec3; 3], x: f64, y: f64) -> Option<(f64, i32)> {
    let [a, b, c] = corners;
    let weights = [side(b, c, x, y), side(c, a, x, y), side(a, b, x, y)];
    let left = weights.map(|w| w.1);
    if left[0] != left[1] || left[1] != left[2] {
        return None;
    }
    let total: f64 = weights.iter().map(|w| w.0).sum();
    // All three on one side with no area at all: the triangle stands upright under the line and its neighbours decide.
    let height =
        if total == 0.0 { a.z } else { (weights[0].0 * a.z + weights[1].0 * b.z + weights[2].0 * c.z) / total };
    // Counter-clockwise from above means an outward normal that points up: the upward line leaves there.
    Some((height, if left[0] { -1 } else { 1 }))
}

/// Twice the signed area of (a, b, (x, y)) seen from above, and whether (x, y) lies to the left of a -> b.
///
/// Both triangles of an edge must agree on its side to the last bit, else a line may slip through between them: the
/// area is computed with the edge's ends in a fixed order, and a point exactly on the edge is moved by an infinitesimal
/// (e, e^2).
fn side(a: DVec3, b: DVec3, x: f64, y: f64) -> (f64, bool) {
    let swap = (a.x, a.y, a.z) > (b.x, b.y, b.z);
    let (p, q) = if swap { (b, a) } else { (a, b) };
    let (dx, dy) = (q.x - p.x, q.y - p.y);
    let area = dx * (y - p.y) - dy * (x - p.x);
    let left = if area != 0.0 {
        area > 0.0
    } else if dy != 0.0 {
        dy < 0.0
    } else {
        dx > 0.0
    };
    if swap { (-area, !left) } else { (area, left) }
}

/// Reads the triangles of every object of an OBJ file as one mesh.
pub(super) fn read_obj(path: &Path) -> Result<Mesh> {
    let file = gic_files::input::open(path).map_err(TwinError::read(path))?;
    let options = tobj::LoadOptions { triangulate: true, ..Default::default() };
    // Materials have no meaning here; a missing material file must not hinder.
    let (models, _) = tobj::load_obj_buf(&mut BufReader::new(file), &options, |_| Ok(Default::default()))
        .map_err(FileError::syntax(path, "OBJ"))?;
    let mut positions = Vec::new();
    let mut polygons = Vec::new();
    for model in models {
        let offset = positions.len() as u32;
        positions
            .extend(model.mesh.positions.chunks_exact(3).map(|p| DVec3::new(p[0] as f64, p[1] as f64, p[2] as f64)));
        polygons.extend(model.mesh.indices.chunks_exact(3).map(|t| t.iter().map(|i| i + offset).collect()));
    }
    Mesh::from_polygons(path, positions, polygons.into_iter())
}

/// Reads an STL file, binary or ASCII.
pub(super) fn read_stl(path: &Path) -> Result<Mesh> {
    let file = gic_files::input::open(path).map_err(TwinError::read(path))?;
    let syntax = FileError::syntax(path, "STL");
    let mut positions = Vec::new();
    let mut reader = BufReader::new(file);
    for triangle in stl_io::create_stl_reader(&mut reader).map_err(&syntax)? {
        let corners = triangle.map_err(&syntax)?.vertices;
        positions.extend(corners.iter().map(|v| DVec3::new(v[0] as f64, v[1] as f64, v[2] as f64)));
    }
    let polygons = (0..positions.len() as u32 / 3).map(|t| vec![3 * t, 3 * t + 1, 3 * t + 2]);
    Mesh::from_polygons(path, positions, polygons)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A box with outward faces.
    fn cuboid(low: DVec3, high: DVec3) -> Mesh {
        let pick = |i: usize, axis: usize| if i >> axis & 1 == 0 { low[axis] } else { high[axis] };
        let vertices = (0..8).map(|i| DVec3::new(pick(i, 0), pick(i, 1), pick(i, 2))).collect();
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        Mesh::from_polygons(Path::new("box"), vertices, quads.iter().map(|q| q.to_vec())).unwrap()
    }

    fn join(a: &Mesh, b: &Mesh) -> Mesh {
        let mut mesh = a.clone();
        let offset = a.vertices.len() as u32;
        mesh.vertices.extend(&b.vertices);
        mesh.triangles.extend(b.triangles.iter().map(|t| t.map(|v| v + offset)));
        mesh
    }

    #[test]
    fn a_box_of_whole_cells_has_exactly_their_particles() {
        let mesh = cuboid(DVec3::ZERO, DVec3::new(0.3, 0.2, 0.1));
        assert_eq!(mesh.sample(0.01).len(), 30 * 20 * 10);
    }

    #[test]
    fn a_missing_triangle_is_refused_with_the_place() {
        let mut mesh = cuboid(DVec3::ZERO, DVec3::ONE);
        mesh.triangles.pop();
        let message = mesh.check_closed(Path::new("open.obj")).unwrap_err().to_string();
        assert!(message.contains("open.obj") && message.contains("not watertight: 3 edges"), "{message}");
    }

    #[test]
    fn an_inward_shell_is_a_cavity_and_an_overlap_counts_once() {
        let outer = cuboid(DVec3::ZERO, DVec3::ONE);
        let mut inner = cuboid(DVec3::splat(0.3), DVec3::splat(0.7));
        assert_eq!(join(&outer, &inner).sample(0.1).len(), 1000);
        inner.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        assert_eq!(join(&outer, &inner).sample(0.1).len(), 1000 - 64);
    }

    #[test]
    fn turned_triangles_fall_back_to_parity() {
        let mut mesh = cuboid(DVec3::ZERO, DVec3::ONE);
        mesh.triangles[3].swap(0, 1);
        assert!(mesh.check_closed(Path::new("box")).is_ok());
        assert_eq!(mesh.sample(0.1).len(), 1000);
    }

    proptest! {
        // Lattice columns of this octahedron run exactly through its vertices and edges; none may slip through.
        #[test]
        fn an_octahedron_is_filled_where_its_norm_says(n in 2usize..12, stretch in 0.5f64..2.0) {
            let r = n as f64 * 0.1;
            let vertices = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z]
                .map(|v| v * r * DVec3::new(1.0, 1.0, stretch)).to_vec();
            let faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
            let mesh = Mesh::from_polygons(Path::new("o"), vertices, faces.iter().map(|f| f.to_vec())).unwrap();
            prop_assert!(mesh.check_closed(Path::new("o")).is_ok());
            let inside = |p: &DVec3| p.x.abs() + p.y.abs() + p.z.abs() / stretch;
            let particles = mesh.sample(0.1);
            prop_assert!(particles.iter().all(|p| inside(p) < r + 1e-9));
            let volume = 4.0 / 3.0 * r.powi(3) * stretch;
            // A layer of half a spacing around the surface may fall either way.
            let area = 8.0 * 3f64.sqrt() / 2.0 * r * r * stretch.max(1.0);
            prop_assert!((particles.len() as f64 * 1e-3 - volume).abs() < 0.05 * area + 0.01);
        }
    }
}
