//! Gaussians as PLY files in the 3DGS convention, which the usual splat viewers open.
//!
//! One element `vertex` with float properties `x y z nx ny nz f_dc_0..2 f_rest_0..m opacity scale_0..2 rot_0..3`:
//! normals are zero, `f_rest` has all coefficients of one channel before the next channel's, `opacity` is a logit,
//! `scale` the natural logarithm of a standard deviation [m], `rot` a quaternion (w, x, y, z). Isotropic Gaussians are
//! written with three equal scales and no rotation, and recognised by the equal scales when read.

use std::io::{BufReader, ErrorKind};
use std::path::{Path, PathBuf};

use gic_files::{FileError, PlyLayout, PlyProperty};
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{DefaultElement, Header, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType};
use thiserror::Error;

use crate::{Gaussians, GaussiansError, Shape, sigmoid};

/// How near to 0 and 1 an opacity can be written: the logit of 0 and 1 is infinite.
const OPACITY_MARGIN: f32 = 1e-7;
/// The smallest standard deviation [m] that is written: the logarithm of 0 is infinite.
const SCALE_MIN: f32 = 1e-12;

/// Gaussians from a file, and what of the file is not in them.
#[derive(Clone, Debug, PartialEq)]
pub struct Imported {
    /// The Gaussians; valid in the sense of [`Gaussians::validate`].
    pub gaussians: Gaussians,
    /// What was left out, a sentence each; empty if nothing was.
    pub dropped: Vec<String>,
}

/// Why a PLY file could not be read or written.
#[derive(Debug, Error)]
pub enum PlyError {
    /// A file that cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// It ends early.
    #[error("{}: the file is truncated ({detail}); copy or export it again", path.display())]
    Truncated {
        /// Which file.
        path: PathBuf,
        /// Where.
        detail: String,
    },
    /// It is not a PLY file, or a damaged one.
    #[error("{}: not a readable PLY file ({detail}); export it again", path.display())]
    Malformed {
        /// Which file.
        path: PathBuf,
        /// What is wrong.
        detail: String,
    },
    /// It holds something else than Gaussians.
    #[error("{}: not Gaussians in the 3DGS convention: {detail}", path.display())]
    NotGaussians {
        /// Which file.
        path: PathBuf,
        /// What is missing.
        detail: String,
    },
    /// A Gaussian that cannot be drawn.
    #[error(
        "{}: `{field}` of vertex {index} is {value}, which is no usable number; remove that vertex or write the file \
         again",
        path.display()
    )]
    Unusable {
        /// Which file.
        path: PathBuf,
        /// Its number, from 0.
        index: usize,
        /// The property, or the kind of it.
        field: &'static str,
        /// Its value.
        value: f32,
    },
    /// The Gaussians to be written are not valid.
    #[error("{}: not written: {source}", path.display())]
    Invalid {
        /// Which file.
        path: PathBuf,
        /// What is wrong with them.
        source: GaussiansError,
    },
}

/// Coefficients per channel beyond the constant one, of degree 3.
const MAX_REST: usize = 15;
const POSITION: usize = 0;
const OPACITY: usize = 3;
const SCALE: usize = 4;
const ROTATION: usize = 7;
const CONSTANT: usize = 11;
const REST: usize = 14;
const NORMAL: usize = REST + 3 * MAX_REST;
const COLUMNS: usize = NORMAL + 3;

/// One vertex as the file has it.
#[derive(Clone, Debug)]
struct Row {
    values: [f32; COLUMNS],
}

/// Where a property goes in [`Row::values`]; `None` if it is not part of the convention.
fn column(name: &str) -> Option<usize> {
    let numbered = |prefix: &str, first: usize, count: usize| {
        let index: usize = name.strip_prefix(prefix)?.parse().ok()?;
        (index < count).then_some(first + index)
    };
    match name {
        "x" => Some(POSITION),
        "y" => Some(POSITION + 1),
        "z" => Some(POSITION + 2),
        "nx" => Some(NORMAL),
        "ny" => Some(NORMAL + 1),
        "nz" => Some(NORMAL + 2),
        "opacity" => Some(OPACITY),
        _ => numbered("scale_", SCALE, 3)
            .or_else(|| numbered("rot_", ROTATION, 4))
            .or_else(|| numbered("f_dc_", CONSTANT, 3))
            .or_else(|| numbered("f_rest_", REST, 3 * MAX_REST)),
    }
}

impl PropertyAccess for Row {
    fn new() -> Row {
        Row { values: [0.0; COLUMNS] }
    }

    fn set_float(&mut self, name: &str, value: f32) -> PropertyAccessResult {
        let Some(c) = column(name) else { return PropertyAccessResult::Ignored };
        self.values[c] = value;
        PropertyAccessResult::Set
    }

    fn set_double(&mut self, name: &str, value: f64) -> PropertyAccessResult {
        self.set_float(name, value as f32)
    }
}

/// Reads Gaussians.
///
/// Properties and elements outside the convention are left out; the result says so.
///
/// # Errors
/// A [`PlyError`] that names the file, when it cannot be read, is truncated or damaged, holds no Gaussians, or one with
/// a value that is not finite.
pub fn read_ply(path: &Path) -> Result<Imported, PlyError> {
    let file = gic_files::input::open(path).map_err(FileError::read(path))?;
    read(BufReader::new(file), path)
}

/// Reads Gaussians from anywhere; `path` is for messages.
fn read(source: impl std::io::BufRead, path: &Path) -> Result<Imported, PlyError> {
    let damaged = |error: ply_rs_bw::parser::ParseError| match error.kind() {
        ErrorKind::UnexpectedEof => PlyError::Truncated { path: path.into(), detail: error.to_string() },
        _ => PlyError::Malformed { path: path.into(), detail: error.to_string() },
    };
    let mut reader = Reader::new(source);
    let parser = Parser::<Row>::new();
    let header = parser.read_header(&mut reader).map_err(damaged)?;
    let rest = check_header(&header, path)?;
    let (mut rows, mut dropped) = (Vec::new(), Vec::new());
    for (name, element) in &header.elements {
        if name == "vertex" {
            rows = parser.read_payload_for_element(&mut reader, element, &header).map_err(damaged)?;
            let others: Vec<&str> =
                element.properties.keys().map(String::as_str).filter(|p| column(p).is_none()).collect();
            if !others.is_empty() {
                dropped.push(format!("properties outside the convention: {}", others.join(", ")));
            }
        } else {
            let skip = Parser::<DefaultElement>::new();
            skip.read_payload_for_element(&mut reader, element, &header).map_err(damaged)?;
            if element.count > 0 {
                dropped.push(format!("{} elements `{name}`", element.count));
            }
        }
    }
    if rows.iter().any(|r| r.values[NORMAL..].iter().any(|&v| v != 0.0)) {
        dropped.push("normals".to_owned());
    }
    if let Some((index, (field, value))) = rows.iter().enumerate().find_map(|(i, row)| Some((i, unusable(row)?))) {
        return Err(PlyError::Unusable { path: path.into(), index, field, value });
    }
    Ok(Imported { gaussians: from_rows(&rows, rest), dropped })
}

/// Makes sure that the convention's properties are there; returns the coefficients per channel beyond the constant one.
fn check_header(header: &Header, path: &Path) -> Result<usize, PlyError> {
    let wrong = |detail: String| PlyError::NotGaussians { path: path.into(), detail };
    let vertex = header.elements.get("vertex").ok_or_else(|| wrong("there is no element `vertex`".to_owned()))?;
    let needed = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2"];
    let missing: Vec<&str> = needed
        .into_iter()
        .chain(["rot_0", "rot_1", "rot_2", "rot_3"])
        .filter(|name| !vertex.properties.contains_key(*name))
        .collect();
    if !missing.is_empty() {
        return Err(wrong(format!("the vertices lack {}", missing.join(", "))));
    }
    for (name, property) in &vertex.properties {
        let number = matches!(property.data_type, PropertyType::Scalar(ScalarType::Float | ScalarType::Double));
        if column(name).is_some() && !number {
            return Err(wrong(format!("`{name}` is neither float nor double")));
        }
    }
    let rest = vertex.properties.keys().filter(|name| name.starts_with("f_rest_")).count();
    let complete = (0..rest).all(|i| vertex.properties.contains_key(&format!("f_rest_{i}")));
    match rest {
        0 | 9 | 24 | 45 if complete => Ok(rest / 3),
        _ => Err(wrong(format!(
            "{rest} properties f_rest_*; 0, 9, 24 or 45 belong to spherical harmonics of degree 0 to 3, \
             export it with one of these"
        ))),
    }
}

/// The kind of property and the value that make a Gaussian unusable: not finite, in the file or as it is meant, or a
/// rotation that is none.
fn unusable(row: &Row) -> Option<(&'static str, f32)> {
    let rotation: f32 = row.values[ROTATION..ROTATION + 4].iter().map(|v| v * v).sum();
    let values = row.values.iter().enumerate().map(|(column, &value)| (kind(column), value));
    let scales = row.values[SCALE..SCALE + 3].iter().map(|&scale| ("scale_*", scale, scale.exp()));
    let mut wrong = values.map(|(field, value)| (field, value, value)).chain(scales);
    let not_finite = wrong.find(|(_, _, meant)| !meant.is_finite()).map(|(field, value, _)| (field, value));
    not_finite.or_else(|| (!(rotation > 0.0 && rotation.is_finite())).then_some(("rot_*", rotation)))
}

/// What a column of [`Row::values`] holds.
fn kind(column: usize) -> &'static str {
    match column {
        ..OPACITY => "x, y, z",
        OPACITY..SCALE => "opacity",
        SCALE..ROTATION => "scale_*",
        ROTATION..CONSTANT => "rot_*",
        CONSTANT..REST => "f_dc_*",
        REST..NORMAL => "f_rest_*",
        NORMAL.. => "nx, ny, nz",
    }
}

fn from_rows(rows: &[Row], rest: usize) -> Gaussians {
    let three = |row: &Row, at: usize| -> [f32; 3] { std::array::from_fn(|k| row.values[at + k]) };
    let scales: Vec<[f32; 3]> = rows.iter().map(|r| three(r, SCALE).map(f32::exp)).collect();
    let isotropic = rows.iter().map(|r| three(r, SCALE)).all(|[a, b, c]| a == b && b == c);
    let shape = if isotropic {
        Shape::Isotropic { scales: scales.iter().map(|s| s[0]).collect() }
    } else {
        let rotations = rows.iter().map(|r| std::array::from_fn(|k| r.values[ROTATION + k])).collect();
        Shape::Anisotropic { scales, rotations }
    };
    let mut sh = Vec::with_capacity(rows.len() * (rest + 1));
    for row in rows {
        sh.push(three(row, CONSTANT));
        sh.extend((0..rest).map(|k| -> [f32; 3] { std::array::from_fn(|c| row.values[REST + c * rest + k]) }));
    }
    Gaussians {
        positions: rows.iter().map(|r| three(r, POSITION)).collect(),
        opacities: rows.iter().map(|r| sigmoid(r.values[OPACITY])).collect(),
        shape,
        sh_degree: (1..=3).find(|d| (d + 1) * (d + 1) == rest + 1).unwrap_or(0),
        sh,
    }
}

/// Writes Gaussians, binary little-endian.
///
/// Returns what the file does not hold exactly, a sentence each: opacities of 0 and 1 and scales of 0 have no finite
/// logit or logarithm and are moved by a hair; Gaussians without colour become grey.
///
/// # Errors
/// A [`PlyError`] that names the file, when the Gaussians are not valid or the file cannot be written.
pub fn write_ply(path: &Path, gaussians: &Gaussians) -> Result<Vec<String>, PlyError> {
    gaussians.validate().map_err(|source| PlyError::Invalid { path: path.into(), source })?;
    let coefficients = if gaussians.sh.is_empty() { 0 } else { gaussians.sh_per_gaussian() };
    let names = names(coefficients.saturating_sub(1));
    let properties: Vec<PlyProperty> = names.iter().map(|name| PlyProperty::Float(name)).collect();
    let layout = PlyLayout { comment: None, properties: &properties, triangles: None };
    gic_files::write_ply(path, &layout, (0..gaussians.len()).map(|i| numbers(gaussians, i, coefficients)))?;
    Ok(changes(gaussians))
}

/// What [`write_ply`] cannot write as it is.
fn changes(gaussians: &Gaussians) -> Vec<String> {
    let mut changes = Vec::new();
    let mut say = |count: usize, what: String| {
        if count > 0 {
            changes.push(format!("{count} {what}"));
        }
    };
    let extreme = gaussians.opacities.iter().filter(|&&o| o != clamp_opacity(o)).count();
    say(extreme, format!("opacities nearer than {OPACITY_MARGIN} to 0 or 1 were moved to that distance"));
    let flat = match &gaussians.shape {
        Shape::Isotropic { scales } => scales.iter().filter(|&&s| s < SCALE_MIN).count(),
        Shape::Anisotropic { scales, .. } => scales.as_flattened().iter().filter(|&&s| s < SCALE_MIN).count(),
    };
    say(flat, format!("scales below {SCALE_MIN} m were raised to it"));
    say(if gaussians.sh.is_empty() { gaussians.len() } else { 0 }, "Gaussians without colour are grey".to_owned());
    changes
}

fn clamp_opacity(opacity: f32) -> f32 {
    opacity.clamp(OPACITY_MARGIN, 1.0 - OPACITY_MARGIN)
}

/// The properties in the file's order, with `rest` coefficients per channel beyond the constant one.
fn names(rest: usize) -> Vec<String> {
    let first = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"].map(String::from);
    let last = ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"].map(String::from);
    first.into_iter().chain((0..3 * rest).map(|k| format!("f_rest_{k}"))).chain(last).collect()
}

/// A Gaussian's numbers in that order.
fn numbers(gaussians: &Gaussians, i: usize, coefficients: usize) -> Vec<f32> {
    let sh = &gaussians.sh[i * coefficients..(i + 1) * coefficients];
    let mut numbers = gaussians.positions[i].to_vec();
    // No normals.
    numbers.extend([0.0; 3]);
    numbers.extend(sh.first().unwrap_or(&[0.0; 3]));
    for channel in 0..3 {
        numbers.extend(sh.iter().skip(1).map(|coefficient| coefficient[channel]));
    }
    let opacity = clamp_opacity(gaussians.opacities[i]);
    numbers.push((opacity / (1.0 - opacity)).ln());
    let (scales, rotation) = match &gaussians.shape {
        Shape::Isotropic { scales } => ([scales[i]; 3], [1.0, 0.0, 0.0, 0.0]),
        Shape::Anisotropic { scales, rotations } => (scales[i], rotations[i]),
    };
    numbers.extend(scales.map(|s| s.max(SCALE_MIN).ln()));
    numbers.extend(rotation);
    numbers
}
