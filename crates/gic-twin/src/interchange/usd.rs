//! OpenUSD as text: the tetrahedra as a deformable body with its material, its surface as a mesh, both moving as
//! predicted.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use gic_geometry::TetMesh;
use glam::DVec3;

use super::elastic_solid;
use crate::atomic;
use crate::error::Result;
use crate::twin::Twin;

/// Positions of the mesh's vertices over time.
#[derive(Clone, Debug, Default)]
pub struct MotionSamples {
    /// Frames per second.
    pub frame_rate_hz: f64,
    /// Positions [m] in every frame, shape [frames][vertices].
    pub frames: Vec<Vec<DVec3>>,
}

/// Writes a stage in metres and kilograms: `/World/Twin` with the deformable body `Volume` (a `TetMesh`, with the Omni
/// Physics deformable schemas), its `Surface`, and the physics material `/World/Matter`. The law's own parameters are
/// custom attributes `gic:...`, so that laws without a USD schema are not lost.
///
/// # Errors
/// Matter that is no elastic solid, an unwritable file.
pub fn write_usd(path: &Path, mesh: &TetMesh, twin: &Twin, motion: &MotionSamples) -> Result<()> {
    let [young, poisson] = elastic_solid(twin, "USD")?;
    let gravity = DVec3::from(twin.gravity_m_s2);
    let direction = gravity.normalize_or(DVec3::NEG_Y);
    let up_axis = if direction.z.abs() > direction.y.abs() { "Z" } else { "Y" };
    let rate = if motion.frame_rate_hz > 0.0 { motion.frame_rate_hz } else { twin.frame_rate_hz };
    let last = motion.frames.len().saturating_sub(1);
    let mut text = format!(
        "#usda 1.0\n(\n    defaultPrim = \"World\"\n    metersPerUnit = 1\n    kilogramsPerUnit = 1\n    \
         upAxis = \"{up_axis}\"\n    startTimeCode = 0\n    endTimeCode = {last}\n    \
         timeCodesPerSecond = {rate}\n    framesPerSecond = {rate}\n    \
         doc = \"A twin by gic {}\"\n)\n\ndef Xform \"World\"\n{{\n",
        crate::VERSION
    );
    let _ = write!(
        text,
        "    def PhysicsScene \"Physics\"\n    {{\n        vector3f physics:gravityDirection = {}\n        \
         float physics:gravityMagnitude = {}\n    }}\n\n",
        triple(direction),
        gravity.length()
    );
    let _ = write!(
        text,
        "    def Material \"Matter\" (\n        \
         prepend apiSchemas = [\"OmniPhysicsBaseMaterialAPI\", \"OmniPhysicsDeformableMaterialAPI\"]\n    )\n    \
         {{\n        float omniphysics:density = {}\n        float omniphysics:youngsModulus = {young}\n        \
         float omniphysics:poissonsRatio = {poisson}\n        custom string gic:model = \"{}\"\n",
        twin.density_kg_m3,
        twin.material.model()
    );
    for (name, value) in twin.material.parameter_names().iter().zip(twin.material.parameters()) {
        let _ = writeln!(text, "        custom double gic:{name} = {value}");
    }
    text += "    }\n\n    def Xform \"Twin\"\n    {\n";
    volume(&mut text, mesh, twin, motion);
    surface(&mut text, mesh, motion);
    text += "    }\n}\n";
    atomic::write(path, text.as_bytes())
}

fn volume(text: &mut String, mesh: &TetMesh, twin: &Twin, motion: &MotionSamples) {
    let faces = mesh.boundary();
    let _ = write!(
        text,
        "        def TetMesh \"Volume\" (\n            \
         prepend apiSchemas = [\"MaterialBindingAPI\", \"PhysicsCollisionAPI\", \
         \"OmniPhysicsDeformableBodyAPI\", \"OmniPhysicsVolumeDeformableSimAPI\"]\n        )\n        {{\n            \
         rel material:binding:physics = </World/Matter>\n            uniform token purpose = \"guide\"\n            \
         float omniphysics:mass = {}\n            point3f[] omniphysics:restShapePoints = {}\n            \
         int4[] omniphysics:restTetVtxIndices = {}\n",
        mesh.volume() * twin.density_kg_m3,
        points(mesh.vertices.iter()),
        list(mesh.tetrahedra.iter().map(|t| format!("({}, {}, {}, {})", t[0], t[1], t[2], t[3]))),
    );
    let _ = write!(
        text,
        "            int4[] tetVertexIndices = {}\n            int3[] surfaceFaceVertexIndices = {}\n",
        list(mesh.tetrahedra.iter().map(|t| format!("({}, {}, {}, {})", t[0], t[1], t[2], t[3]))),
        list(faces.iter().map(|f| format!("({}, {}, {})", f[0], f[1], f[2]))),
    );
    let all: Vec<u32> = (0..mesh.vertices.len() as u32).collect();
    moving_points(text, &mesh.vertices, &all, motion);
    *text += "        }\n\n";
}

fn surface(text: &mut String, mesh: &TetMesh, motion: &MotionSamples) {
    let faces = mesh.boundary();
    // Numbers among the vertices of the surface only.
    let mut numbers: BTreeMap<u32, u32> = faces.iter().flatten().map(|&v| (v, 0)).collect();
    numbers.values_mut().zip(0..).for_each(|(number, i)| *number = i);
    let _ = write!(
        text,
        "        def Mesh \"Surface\"\n        {{\n            uniform token subdivisionScheme = \"none\"\n            \
         color3f[] primvars:displayColor = [(0.8, 0.58, 0.42)]\n            int[] faceVertexCounts = {}\n            \
         int[] faceVertexIndices = {}\n",
        list(faces.iter().map(|_| "3".to_owned())),
        list(faces.iter().flatten().map(|v| numbers[v].to_string())),
    );
    let used: Vec<u32> = numbers.keys().copied().collect();
    moving_points(text, &mesh.vertices, &used, motion);
    *text += "        }\n";
}

/// The points at rest, in every frame, and their bounds.
fn moving_points(text: &mut String, rest: &[DVec3], used: &[u32], motion: &MotionSamples) {
    let of = |all: &[DVec3]| used.iter().map(|&i| all[i as usize]).collect::<Vec<_>>();
    let _ = writeln!(text, "            point3f[] points = {}", points(of(rest).iter()));
    if motion.frames.is_empty() {
        let _ = writeln!(text, "            float3[] extent = {}", extent(&of(rest)));
        return;
    }
    for (name, value) in [("point3f[] points", true), ("float3[] extent", false)] {
        let _ = writeln!(text, "            {name}.timeSamples = {{");
        for (frame, all) in motion.frames.iter().enumerate() {
            let now = of(all);
            let _ =
                writeln!(text, "                {frame}: {},", if value { points(now.iter()) } else { extent(&now) });
        }
        *text += "            }\n";
    }
}

fn extent(all: &[DVec3]) -> String {
    let low = all.iter().fold(DVec3::INFINITY, |low, &p| low.min(p));
    let high = all.iter().fold(DVec3::NEG_INFINITY, |high, &p| high.max(p));
    points([low, high].iter())
}

fn points<'a>(all: impl Iterator<Item = &'a DVec3>) -> String {
    list(all.map(|p| triple(*p)))
}

fn triple(p: DVec3) -> String {
    // f32 is what USD keeps; its shortest form is exact.
    let [x, y, z] = p.as_vec3().to_array();
    format!("({x}, {y}, {z})")
}

fn list(items: impl Iterator<Item = String>) -> String {
    format!("[{}]", items.collect::<Vec<_>>().join(", "))
}
