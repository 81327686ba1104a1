//! PLY files: vertices of named numbers and, for meshes, triangles; binary, little-endian.

use std::io::{self, BufWriter, Write};
use std::path::Path;

use crate::finite::require_finite_numbers;
use crate::{FileError, write_with};

/// A property of the vertices by its name, and how its numbers are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlyProperty<'a> {
    /// As four bytes.
    Float(&'a str),
    /// As one byte, for whole numbers from 0 to 255.
    Byte(&'a str),
}

impl PlyProperty<'_> {
    fn name(&self) -> &str {
        let (Self::Float(name) | Self::Byte(name)) = self;
        name
    }
}

/// What a PLY file is to hold.
#[derive(Clone, Copy, Debug)]
pub struct PlyLayout<'a> {
    /// A line for readers, such as the unit.
    pub comment: Option<&'a str>,
    /// The numbers of a vertex in their order, p of them.
    pub properties: &'a [PlyProperty<'a>],
    /// Corners of each triangle, shape [t, 3]; no faces at all where there is no mesh.
    pub triangles: Option<&'a [[u32; 3]]>,
}

/// Writes a PLY file; each vertex has as many numbers as there are properties, shape [n, p].
///
/// # Errors
/// A number that is not finite, and what the system says; then the file is as it was.
pub fn write_ply<V: AsRef<[f32]>>(
    path: &Path,
    layout: &PlyLayout,
    vertices: impl ExactSizeIterator<Item = V>,
) -> Result<(), FileError> {
    write_with(path, |out| {
        write_header(out, layout, vertices.len())?;
        for (index, vertex) in vertices.enumerate() {
            write_vertex(out, layout.properties, index, vertex.as_ref())?;
        }
        for triangle in layout.triangles.unwrap_or_default() {
            out.write_all(&[3])?;
            triangle.iter().try_for_each(|corner| out.write_all(&corner.to_le_bytes()))?;
        }
        Ok(())
    })
}

fn write_header(out: &mut impl Write, layout: &PlyLayout, vertices: usize) -> io::Result<()> {
    write!(out, "ply\nformat binary_little_endian 1.0\n")?;
    if let Some(comment) = layout.comment {
        writeln!(out, "comment {comment}")?;
    }
    writeln!(out, "element vertex {vertices}")?;
    for property in layout.properties {
        match property {
            PlyProperty::Float(name) => writeln!(out, "property float {name}")?,
            PlyProperty::Byte(name) => writeln!(out, "property uchar {name}")?,
        }
    }
    if let Some(triangles) = layout.triangles {
        write!(out, "element face {}\nproperty list uchar int vertex_indices\n", triangles.len())?;
    }
    writeln!(out, "end_header")
}

fn write_vertex<W: Write>(
    out: &mut BufWriter<W>,
    properties: &[PlyProperty],
    index: usize,
    numbers: &[f32],
) -> io::Result<()> {
    assert_eq!(numbers.len(), properties.len(), "one number per property");
    require_finite_numbers(numbers, |i| format!("{} of vertex {index}", properties[i].name()))?;
    properties.iter().zip(numbers).try_for_each(|(property, number)| match property {
        PlyProperty::Float(_) => out.write_all(&number.to_le_bytes()),
        PlyProperty::Byte(_) => out.write_all(&[*number as u8]),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_those_of_the_format() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        let properties = [PlyProperty::Float("x"), PlyProperty::Byte("surface")];
        let layout = PlyLayout { comment: Some("metres"), properties: &properties, triangles: Some(&[[0, 1, 258]]) };
        write_ply(&path, &layout, [[0.5, 1.0], [-2.0, 200.0]].into_iter()).unwrap();
        let mut expected =
            b"ply\nformat binary_little_endian 1.0\ncomment metres\nelement vertex 2\nproperty float x\n\
            property uchar surface\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
                .to_vec();
        expected.extend([0, 0, 0, 0x3f, 1, 0, 0, 0, 0xc0, 200]);
        expected.extend([3, 0, 0, 0, 0, 1, 0, 0, 0, 2, 1, 0, 0]);
        assert_eq!(std::fs::read(&path).unwrap(), expected);
    }

    #[test]
    fn a_vertex_that_is_nowhere_is_not_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        let layout = PlyLayout { comment: None, properties: &[PlyProperty::Float("x")], triangles: None };
        let failed = write_ply(&path, &layout, [[0.5], [f32::NAN]].into_iter()).unwrap_err();
        let FileError::Write { source, .. } = failed else { panic!("{failed}") };
        assert!(source.to_string().contains("`x of vertex 1` is NaN") && !path.exists(), "{source}");
    }

    #[test]
    fn points_have_no_faces() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        let layout = PlyLayout { comment: None, properties: &[PlyProperty::Float("x")], triangles: None };
        write_ply(&path, &layout, [[0.5]].into_iter()).unwrap();
        let header = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nend_header\n";
        assert_eq!(std::fs::read(&path).unwrap(), [&header[..], &[0, 0, 0, 0x3f]].concat());
    }
}
