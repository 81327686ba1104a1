//! Files for other tools: OBJ, STL, PLY and MSH. Each is written beside its place and then renamed.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::{Particles, TetMesh, TriangleMesh};

/// A file could not be written.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: {source}", path.display())]
pub struct ExportError {
    /// The file.
    pub path: PathBuf,
    /// What the system said.
    pub source: io::Error,
}

/// Writes a surface as Wavefront OBJ: positions [m], normals, triangles.
pub fn write_obj(path: &Path, mesh: &TriangleMesh) -> Result<(), ExportError> {
    write_file(path, |out| {
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
pub fn write_stl(path: &Path, mesh: &TriangleMesh) -> Result<(), ExportError> {
    write_file(path, |out| {
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
pub fn write_mesh_ply(path: &Path, mesh: &TriangleMesh) -> Result<(), ExportError> {
    write_file(path, |out| {
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

/// Writes particles as binary PLY: x, y, z [m], density, volume [m^3], doubt (0 to 1), surface (0 or 1).
pub fn write_particles_ply(path: &Path, particles: &Particles) -> Result<(), ExportError> {
    write_file(path, |out| {
        write!(
            out,
            "ply\nformat binary_little_endian 1.0\ncomment gic continuum, metres\nelement vertex {}\n\
             property float x\nproperty float y\nproperty float z\nproperty float density\nproperty float volume\n\
             property float doubt\nproperty uchar surface\nend_header\n",
            particles.positions.len()
        )?;
        for i in 0..particles.positions.len() {
            write_f32(out, &particles.positions[i].as_vec3().to_array())?;
            write_f32(
                out,
                &[particles.densities[i], particles.volume as f32 * particles.volume_factors[i], particles.doubts[i]],
            )?;
            out.write_all(&[u8::from(particles.surface[i])])?;
        }
        Ok(())
    })
}

/// Writes tetrahedra as Gmsh MSH 2.2 in ASCII, which Gmsh, meshio and most FEM tools read; positions [m], one volume with tag 1.
pub fn write_msh(path: &Path, mesh: &TetMesh) -> Result<(), ExportError> {
    write_file(path, |out| {
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

/// Writes to a temporary file in the same folder and renames it: a reader never sees half a file.
fn write_file(path: &Path, content: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> Result<(), ExportError> {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(format!(".{}.part", std::process::id()));
    let temporary = path.with_file_name(name);
    let written = (|| {
        let mut out = BufWriter::new(File::create(&temporary)?);
        content(&mut out)?;
        out.into_inner().map_err(|e| e.into_error())?.sync_all()?;
        std::fs::rename(&temporary, path)
    })();
    written.map_err(|source| {
        // The error that matters is the first; the leftover may not even exist.
        let _ = std::fs::remove_file(&temporary);
        ExportError { path: path.to_owned(), source }
    })
}
