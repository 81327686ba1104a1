//! glTF 2.0 in its binary form: the surface (or the particles) with colours, moving.

use std::path::Path;

use glam::DVec3;
use serde_json::{Value, json};

use super::{ExportBody, Paint, UpAxis, linear_colors, stays_together};
use crate::atomic;
use crate::error::{Result, TwinError};
use crate::json;

const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const POINTS: u32 = 0;
const TRIANGLES: u32 = 4;

/// Writes a body that stays together as its surface, another one as points; colours at the vertices, and the motion as
/// one morph target a frame, weighted one after the other. The body is turned to y up, as glTF has it.
///
/// # Errors
/// Particles that cannot be meshed, a number that is not finite, an unwritable file.
pub fn write_glb(path: &Path, body: &ExportBody, paint: Option<&Paint>) -> Result<()> {
    let is_surface = stays_together(&body.twin().material);
    let (rest, normals, triangles) = if is_surface {
        let mesh = body.surface()?;
        (mesh.vertices, mesh.normals, mesh.triangles)
    } else {
        (body.particles().to_vec(), Vec::new(), Vec::new())
    };
    let colors = paint.map(|paint| linear_colors(paint, &rest));
    let turn = |v: DVec3| if body.up() == UpAxis::Z { DVec3::new(v.x, v.z, -v.y) } else { v };
    let mut file = Chunks::default();
    let shown: Vec<DVec3> = rest.iter().map(|p| turn(*p)).collect();
    let mut attributes = json!({ "POSITION": file.vectors(&shown, true) });
    if is_surface {
        let normals: Vec<DVec3> = normals.iter().map(|n| turn(*n).normalize_or(DVec3::Y)).collect();
        attributes["NORMAL"] = file.vectors(&normals, false).into();
    }
    if let Some(colors) = colors {
        attributes["COLOR_0"] = file.vectors(&colors, false).into();
    }
    let mut primitive = json!({
        "attributes": attributes, "material": 0, "mode": if is_surface { TRIANGLES } else { POINTS }
    });
    if is_surface {
        primitive["indices"] = file.indices(&triangles).into();
    }
    let mut mesh = json!({ "name": "twin", "primitives": [] });
    let mut document = json!({
        "asset": { "version": "2.0", "generator": format!("gic {}", crate::VERSION) },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "name": "twin", "mesh": 0 }],
        "materials": [{
            "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 0.9 }, "doubleSided": true
        }],
        "extras": {
            "mass_kg": body.mass_kg(),
            "density_kg_m3": body.twin().density_kg_m3,
            "material": json::value(&body.twin().material).map_err(|e| TwinError::write(path)(e.into()))?,
        },
    });
    let frames = if is_surface { body.carried(&rest) } else { body.motion().frames.clone() };
    if frames.len() > 1 {
        let moved = |frame: &Vec<DVec3>| {
            let offsets: Vec<DVec3> = frame.iter().zip(&rest).map(|(p, q)| turn(*p - *q)).collect();
            json!({ "POSITION": file.vectors(&offsets, true) })
        };
        primitive["targets"] = frames.iter().map(moved).collect();
        mesh["weights"] = vec![0.0; frames.len()].into();
        let rate = body.motion().frame_rate_hz;
        let times: Vec<f32> = (0..frames.len()).map(|i| (i as f64 / rate) as f32).collect();
        let weights: Vec<f32> =
            (0..frames.len() * frames.len()).map(|i| f32::from(i % (frames.len() + 1) == 0)).collect();
        let (input, output) = (file.numbers(&times, true), file.numbers(&weights, false));
        document["animations"] = json!([{
            "name": "simulation",
            "channels": [{ "sampler": 0, "target": { "node": 0, "path": "weights" } }],
            "samplers": [{ "input": input, "output": output, "interpolation": "LINEAR" }],
        }]);
    }
    mesh["primitives"] = json!([primitive]);
    document["meshes"] = json!([mesh]);
    atomic::write(path, &file.finish(document).map_err(|e| TwinError::write(path)(e.into()))?)
}

/// The binary part, and what describes it.
#[derive(Default)]
struct Chunks {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Chunks {
    /// Number of a new accessor of `count` elements on `values`.
    fn add(&mut self, values: impl Iterator<Item = [u8; 4]>, target: Option<u32>, mut accessor: Value) -> usize {
        let start = self.bytes.len();
        self.bytes.extend(values.flatten());
        let mut view = json!({ "buffer": 0, "byteOffset": start, "byteLength": self.bytes.len() - start });
        if let Some(target) = target {
            view["target"] = target.into();
        }
        accessor["bufferView"] = self.views.len().into();
        self.views.push(view);
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// Vectors, with their bounds where wanted.
    fn vectors(&mut self, values: &[DVec3], bounded: bool) -> usize {
        let mut accessor = json!({ "componentType": FLOAT, "count": values.len(), "type": "VEC3" });
        if bounded {
            let low = values.iter().fold(DVec3::INFINITY, |low, p| low.min(*p)).as_vec3();
            let high = values.iter().fold(DVec3::NEG_INFINITY, |high, p| high.max(*p)).as_vec3();
            accessor["min"] = low.to_array().to_vec().into();
            accessor["max"] = high.to_array().to_vec().into();
        }
        let numbers = values.iter().flat_map(|v| v.as_vec3().to_array().map(f32::to_le_bytes));
        self.add(numbers, Some(ARRAY_BUFFER), accessor)
    }

    fn numbers(&mut self, values: &[f32], bounded: bool) -> usize {
        let mut accessor = json!({ "componentType": FLOAT, "count": values.len(), "type": "SCALAR" });
        if let (true, Some(first), Some(last)) = (bounded, values.first(), values.last()) {
            accessor["min"] = vec![*first].into();
            accessor["max"] = vec![*last].into();
        }
        self.add(values.iter().map(|v| v.to_le_bytes()), None, accessor)
    }

    fn indices(&mut self, triangles: &[[u32; 3]]) -> usize {
        let accessor = json!({ "componentType": UNSIGNED_INT, "count": 3 * triangles.len(), "type": "SCALAR" });
        self.add(triangles.iter().flatten().map(|i| i.to_le_bytes()), Some(ELEMENT_ARRAY_BUFFER), accessor)
    }

    /// The bytes of the file: a header, the document, the binary part; each padded to four bytes.
    fn finish(mut self, mut document: Value) -> std::result::Result<Vec<u8>, json::Unwritable> {
        document["buffers"] = json!([{ "byteLength": self.bytes.len() }]);
        document["bufferViews"] = self.views.into();
        document["accessors"] = self.accessors.into();
        let mut text = json::text(&document)?.into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let length = 12 + 8 + text.len() + 8 + self.bytes.len();
        let mut bytes = Vec::with_capacity(length);
        bytes.extend(b"glTF");
        for number in [2, length as u32, text.len() as u32] {
            bytes.extend(number.to_le_bytes());
        }
        bytes.extend(b"JSON");
        bytes.extend(text);
        bytes.extend((self.bytes.len() as u32).to_le_bytes());
        bytes.extend(b"BIN\0");
        bytes.extend(self.bytes);
        Ok(bytes)
    }
}
