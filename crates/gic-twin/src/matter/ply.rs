//! PLY files: particles or a mesh in, particles out.

use std::io::{BufReader, ErrorKind};
use std::path::Path;

use gic_files::{FileError, PlyLayout, PlyProperty, write_ply};
use glam::DVec3;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{Property, PropertyAccess, PropertyAccessResult};

use super::Mesh;
use crate::error::{Result, TwinError};

/// The vertices of a PLY file, in its order.
pub struct PlyParticles {
    /// Positions [m], shape [n].
    pub positions: Vec<DVec3>,
    /// The property `density`, shape [n]; NaN where the file has none.
    pub densities: Vec<f32>,
    /// The property `surface`, shape [n]; NaN where the file has none.
    pub surface: Vec<f32>,
    /// The property `doubt`, shape [n]; NaN where the file has none.
    pub doubts: Vec<f32>,
    /// The property `volume_factor`, shape [n]; NaN where the file has none.
    pub volume_factors: Vec<f64>,
    /// The properties `vx`, `vy`, `vz` [m/s], shape [n]; NaN where the file has none.
    pub velocities: Vec<DVec3>,
    /// The property `von_mises_pa`, shape [n]; NaN where the file has none.
    pub von_mises_pa: Vec<f32>,
}

/// What a PLY file holds.
pub enum PlyContent {
    /// Vertices without faces.
    Particles(PlyParticles),
    /// Vertices with faces.
    Mesh(Mesh),
}

/// One row of a PLY file, of which only these properties matter here.
struct Row {
    position: DVec3,
    density: f32,
    surface: f32,
    doubt: f32,
    volume_factor: f64,
    velocity: DVec3,
    von_mises_pa: f32,
    corners: Vec<u32>,
}

impl PropertyAccess for Row {
    fn new() -> Self {
        Self {
            position: DVec3::NAN,
            density: f32::NAN,
            surface: f32::NAN,
            doubt: f32::NAN,
            volume_factor: f64::NAN,
            velocity: DVec3::NAN,
            von_mises_pa: f32::NAN,
            corners: Vec::new(),
        }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let number = |property: &Property| match property {
            Property::Double(v) => *v,
            other => other.to_f32_lossy().map_or(f64::NAN, f64::from),
        };
        match name {
            "x" => self.position.x = number(&property),
            "y" => self.position.y = number(&property),
            "z" => self.position.z = number(&property),
            "vx" => self.velocity.x = number(&property),
            "vy" => self.velocity.y = number(&property),
            "vz" => self.velocity.z = number(&property),
            "density" => self.density = number(&property) as f32,
            "surface" => self.surface = number(&property) as f32,
            "doubt" => self.doubt = number(&property) as f32,
            "volume_factor" => self.volume_factor = number(&property),
            "von_mises_pa" => self.von_mises_pa = number(&property) as f32,
            "vertex_indices" | "vertex_index" => {
                // A negative index stays an empty face, which the mesh check then refuses.
                self.corners = property.to_u32_list().unwrap_or_default();
            }
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}

/// Reads a PLY file, ASCII or binary; properties other than those of [`PlyParticles`] and faces are skipped.
pub fn read_ply(path: &Path) -> Result<PlyContent> {
    let content = |problem: String, hint: &str| {
        TwinError::File(FileError::Content {
            path: path.to_owned(),
            problem,
            hint: (!hint.is_empty()).then(|| hint.to_owned()),
        })
    };
    let file = gic_files::input::open(path).map_err(TwinError::read(path))?;
    let mut reader = Reader::new(BufReader::new(file));
    let parser = Parser::<Row>::new();
    let header = parser
        .read_header(&mut reader)
        .map_err(|e| content(format!("is not a PLY file, or its header is damaged ({e})"), "write the file again"))?;
    let vertices = header.elements.get("vertex");
    let axes = ["x", "y", "z"];
    let Some(vertices) = vertices.filter(|v| axes.iter().all(|axis| v.properties.contains_key(*axis))) else {
        return Err(content("has no `vertex` element with x, y and z".into(), "particles are PLY vertices"));
    };
    let promised = vertices.count;
    if promised == 0 {
        return Err(content("holds no particles".into(), "the continuum needs at least one"));
    }
    let mut payload = parser.read_payload(&mut reader, &header).map_err(|e| match e.kind() {
        ErrorKind::UnexpectedEof => content(
            format!("is truncated: its header promises {promised} vertices, but the file ends before the last row"),
            "copy or write the file again",
        ),
        _ => {
            let cause = e.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
            content(format!("is damaged: {cause}"), "write the file again")
        }
    })?;
    let rows = payload.swap_remove("vertex").unwrap_or_default();
    let positions: Vec<DVec3> = rows.iter().map(|row| row.position).collect();
    if let Some((i, p)) = positions.iter().enumerate().find(|(_, p)| !p.is_finite()) {
        return Err(content(
            format!("vertex {i} has the position ({}, {}, {}), which is not finite", p.x, p.y, p.z),
            "remove or repair it; vertices are counted from 0",
        ));
    }
    let faces = payload.swap_remove("face").unwrap_or_default();
    if faces.is_empty() {
        let densities = rows.iter().map(|row| row.density).collect();
        let surface = rows.iter().map(|row| row.surface).collect();
        let doubts = rows.iter().map(|row| row.doubt).collect();
        let volume_factors = rows.iter().map(|row| row.volume_factor).collect();
        let velocities = rows.iter().map(|row| row.velocity).collect();
        let von_mises_pa = rows.iter().map(|row| row.von_mises_pa).collect();
        let particles =
            PlyParticles { positions, densities, surface, doubts, volume_factors, velocities, von_mises_pa };
        return Ok(PlyContent::Particles(particles));
    }
    let polygons = faces.into_iter().map(|row| row.corners);
    Mesh::from_polygons(path, positions, polygons).map(PlyContent::Mesh)
}

/// Reads the particles of a PLY file without faces.
pub fn read_particles(path: &Path) -> Result<PlyParticles> {
    match read_ply(path)? {
        PlyContent::Particles(particles) => Ok(particles),
        PlyContent::Mesh(_) => Err(TwinError::File(FileError::Content {
            path: path.to_owned(),
            problem: "holds a mesh where particles are expected".into(),
            hint: None,
        })),
    }
}

/// Writes rows of numbers as the vertices of a PLY file.
pub fn write_particles<const COLUMNS: usize>(
    path: &Path,
    names: [&str; COLUMNS],
    rows: impl ExactSizeIterator<Item = [f32; COLUMNS]>,
) -> Result<()> {
    let layout = PlyLayout { comment: None, properties: &names.map(PlyProperty::Float), triangles: None };
    Ok(write_ply(path, &layout, rows)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn particles_come_back_in_number_and_order() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.ply");
        let rows: Vec<[f32; 4]> = (0..1000).map(|i| [i as f32, 0.5 * i as f32, -1.0, 7.0]).collect();
        write_particles(&path, ["x", "y", "z", "extra"], rows.iter().copied()).unwrap();
        let PlyContent::Particles(read) = read_ply(&path).unwrap() else { panic!("no faces were written") };
        assert_eq!(read.positions.len(), rows.len());
        for (r, p) in rows.iter().zip(read.positions) {
            assert_eq!([r[0], r[1], r[2]].map(f64::from), p.to_array());
        }
    }

    #[test]
    fn doubles_keep_their_precision() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.ply");
        let header = "ply\nformat ascii 1.0\nelement vertex 1\n\
                      property double x\nproperty double y\nproperty int z\nend_header\n";
        std::fs::write(&path, format!("{header}0.123456789012345 2.5 -3\n")).unwrap();
        let PlyContent::Particles(read) = read_ply(&path).unwrap() else { panic!("no faces were written") };
        assert_eq!(read.positions, [DVec3::new(0.123456789012345, 2.5, -3.0)]);
        assert!(read.densities[0].is_nan());
    }
}
