//! Meshes as files for other tools: OBJ, STL, PLY and MSH.

use std::io::{self, Write};
use std::path::Path;

use gic_files::{WriteError, write_with};

use crate::{TetMesh, TriangleMesh};

/// Writes a surface as Wavefront OBJ: positions [m], normals, triangles.
pub fn write_obj(path: &Path, mesh: &TriangleMesh) -> Result<(), WriteError> {
    write_with(path, |out| {
        writeln!(out, "# gic surface, metres")?;
        for p in &mesh.vertices {
            writeln!(out, "v {} {} {}", p.x as f32, p.y as f32, p.z as f32)?;
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
pub fn write_stl(path: &Path, mesh: &TriangleMesh) -> Result<(), WriteError> {
    write_with(path, |out| {
        let mut header = [0u8; 80];
        header[..19].copy_from_slice(b"gic surface, metres");
        out.write_all(&header)?;
        out.write_all(&(mesh.triangles.len() as u32).to_le_bytes())?;
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|i| mesh.vertices[i as usize]);
            let normal = (b - a).cross(c - a).normalize_or_zero();
            for v in [normal, a, b, c] {
                write_f32(out, &v.as_vec3().to_array())?;
            }
            out.write_all(&[0, 0])?;
        }
        Ok(())
    })
}

/// Writes a surface as binary PLY: x, y, z [m], nx, ny, nz, faces.
pub fn write_mesh_ply(path: &Path, mesh: &TriangleMesh) -> Result<(), WriteError> {
    write_with(path, |out| {
        write!(
            out,
            "ply\nformat binary_little_endian 1.0\ncomment gic surface, metres\nelement vertex {}\n\
             property float x\nproperty float y\nproperty float z\nproperty float nx\nproperty float ny\nproperty float nz\n\
             element face {}\nproperty list uchar int vertex_indices\nend_header\n",
            mesh.vertices.len(),
            mesh.triangles.len()
        )?;
        for (p, n) in mesh.vertices.iter().zip(&mesh.normals) {
            write_f32(out, &p.as_vec3().to_array())?;
            write_f32(out, &n.as_vec3().to_array())?;
        }
        for t in &mesh.triangles {
            out.write_all(&[3])?;
            for i in t {
                out.write_all(&i.to_le_bytes())?;
            }
        }
        Ok(())
    })
}

/// Writes tetrahedra as Gmsh MSH 2.2 in ASCII, which Gmsh, meshio and most FEM tools read; positions [m], one volume with tag 1.
pub fn write_msh(path: &Path, mesh: &TetMesh) -> Result<(), WriteError> {
    write_with(path, |out| {
        writeln!(out, "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n1\n3 1 \"body\"\n$EndPhysicalNames")?;
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

fn write_f32(out: &mut impl Write, values: &[f32]) -> io::Result<()> {
    values.iter().try_for_each(|v| out.write_all(&v.to_le_bytes()))
}
