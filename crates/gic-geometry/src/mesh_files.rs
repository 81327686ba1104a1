//! Meshes as files for other tools: OBJ, STL, PLY and MSH.

use std::io::Write;
use std::path::Path;

use gic_files::{FileError, PlyLayout, PlyProperty, write_ply, write_with};
use glam::DVec3;

use crate::tetrahedra::TetMesh;
use crate::triangle_mesh::TriangleMesh;

/// What a file of a mesh says beside the mesh.
#[derive(Clone, Copy, Debug, Default)]
pub struct MeshNotes<'a> {
    /// A line for readers, such as unit and mass.
    pub comment: &'a str,
    /// RGB of each vertex, in [0, 1], shape [n, 3]; nothing of it is written where there is none.
    pub colors: Option<&'a [[f32; 3]]>,
}

/// Writes a surface as Wavefront OBJ: positions [m] with colours, normals, triangles.
///
/// # Errors
/// What the system says.
pub fn write_obj(path: &Path, mesh: &TriangleMesh, notes: &MeshNotes) -> Result<(), FileError> {
    write_with(path, |out| {
        writeln!(out, "# gic surface, metres {}", notes.comment)?;
        for (i, p) in mesh.vertices.iter().enumerate() {
            write!(out, "v {} {} {}", p.x as f32, p.y as f32, p.z as f32)?;
            if let Some([r, g, b]) = notes.colors.map(|colors| colors[i]) {
                write!(out, " {r:.4} {g:.4} {b:.4}")?;
            }
            writeln!(out)?;
        }
        for n in &mesh.normals {
            writeln!(out, "vn {:.5} {:.5} {:.5}", n.x, n.y, n.z)?;
        }
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|i| i + 1);
            writeln!(out, "f {a}//{a} {b}//{b} {c}//{c}")?;
        }
        Ok(())
    })
}

/// Writes a surface as binary STL [m].
///
/// # Errors
/// What the system says.
pub fn write_stl(path: &Path, mesh: &TriangleMesh) -> Result<(), FileError> {
    let single = |v: DVec3| stl_io::Vector::new(v.as_vec3().to_array());
    let facets = mesh.triangles.iter().map(|t| {
        let [a, b, c] = t.map(|i| mesh.vertices[i as usize]);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        stl_io::Triangle { normal: single(normal), vertices: [a, b, c].map(single) }
    });
    write_with(path, |out| stl_io::write_stl(out, facets))
}

/// Writes a surface as binary PLY: x, y, z [m], nx, ny, nz, red, green, blue where there are colours, faces.
///
/// # Errors
/// What the system says.
pub fn write_mesh_ply(path: &Path, mesh: &TriangleMesh, notes: &MeshNotes) -> Result<(), FileError> {
    let mut properties = ["x", "y", "z", "nx", "ny", "nz"].map(PlyProperty::Float).to_vec();
    if notes.colors.is_some() {
        properties.extend(["red", "green", "blue"].map(PlyProperty::Byte));
    }
    let comment = format!("gic surface, metres {}", notes.comment);
    let layout = PlyLayout { comment: Some(&comment), properties: &properties, triangles: Some(&mesh.triangles) };
    let vertices = mesh.vertices.iter().zip(&mesh.normals).enumerate().map(|(i, (p, n))| {
        let mut row: Vec<f32> = [p.x, p.y, p.z, n.x, n.y, n.z].map(|v| v as f32).to_vec();
        row.extend(notes.colors.into_iter().flat_map(|colors| colors[i]).map(|v| (255.0 * v.clamp(0.0, 1.0)).round()));
        row
    });
    write_ply(path, &layout, vertices)
}

/// Writes tetrahedra as Gmsh MSH 2.2 in ASCII, which Gmsh, meshio and most FEM tools read; positions [m], one volume
/// with tag 1.
///
/// # Errors
/// What the system says.
pub fn write_msh(path: &Path, mesh: &TetMesh, comment: &str) -> Result<(), FileError> {
    write_with(path, |out| {
        writeln!(out, "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Comments\ngic body, metres {comment}\n$EndComments")?;
        writeln!(out, "$PhysicalNames\n1\n3 1 \"body\"\n$EndPhysicalNames")?;
        writeln!(out, "$Nodes\n{}", mesh.vertices.len())?;
        for (i, p) in mesh.vertices.iter().enumerate() {
            writeln!(out, "{} {} {} {}", i + 1, p.x, p.y, p.z)?;
        }
        writeln!(out, "$EndNodes\n$Elements\n{}", mesh.tetrahedra.len())?;
        for (i, t) in mesh.tetrahedra.iter().enumerate() {
            let [a, b, c, d] = t.map(|k| k + 1);
            // Type 4 is a tetrahedron of four nodes; two tags: physical volume 1, geometrical volume 1.
            writeln!(out, "{} 4 2 1 1 {a} {b} {c} {d}", i + 1)?;
        }
        writeln!(out, "$EndElements")
    })
}
