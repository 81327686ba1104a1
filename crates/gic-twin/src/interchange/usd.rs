//! OpenUSD as text: one body as tetrahedra for Isaac's finite elements and as points for Newton's material points, its
//! surface, the floor, and the motion of all.

use std::fmt::Write as _;
use std::path::Path;

use gic_geometry::{TetMesh, TriangleMesh};
use gic_mpm::Material;
use glam::{DQuat, DVec3};

use super::usd_text::{list, moving_points, points, quaternion, triple};
use super::{ExportBody, Paint, UpAxis, friction, linear_colors, stays_together};
use crate::atomic;
use crate::error::Result;
use crate::twin::{Obstacle, ObstacleShape};

/// A stress that nothing reaches, for what does not yield, in Young's moduli. Derived: a strain that nothing survives;
/// Newton computes with f32, and larger stresses end in NaN where matter is soft.
const NEVER_STRAIN: f64 = 1e3;
/// Steps that Newton takes in a frame: it steps implicitly, and damps what moves within a step. Budget: four minutes
/// for the cat's fall on one core, 12 % off; with 16 steps 18 %.
const NEWTON_STEPS_PER_FRAME: f64 = 64.0;
/// Sides of the square that shows a half space, over the body's.
const FLOOR_SIDES: f64 = 10.0;

/// What of a body is seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UsdLook {
    /// Its surface, where it stays together; tetrahedra belong to it.
    Surface,
    /// Its particles.
    Particles,
}

/// Writes a stage in metres and kilograms. `/World/Twin/Particles` are points with masses and velocities
/// (`NewtonPointsDeformableSimAPI`) that its implicit material point method simulates with every law;
/// of what stays together, `/World/Twin/Volume` are tetrahedra with the Omni Physics deformable schemas, which Isaac
/// simulates, and `/World/Twin/Surface` is its look. All enclose the same volume, have the same mass, and move as
/// simulated. `/World/Obstacles` holds the obstacles that rest. The law's own parameters are custom attributes
/// `gic:...` of the material.
///
/// # Errors
/// Particles that cannot be meshed, an unwritable file.
pub fn write_usd(path: &Path, body: &ExportBody, paint: Option<&Paint>, look: UsdLook) -> Result<()> {
    let twin = body.twin();
    let gravity = DVec3::from(twin.gravity_m_s2);
    let mut text = header(body);
    let _ = write!(
        text,
        "    def PhysicsScene \"Physics\" (\n        prepend apiSchemas = [\"NewtonMPMSceneAPI\"]\n    )\n    {{\n        \
         vector3f physics:gravityDirection = {}\n        float physics:gravityMagnitude = {}\n        \
         uniform int newton:timeStepsPerSecond = {}\n        uniform float newton:mpm:voxelSize = {}\n        \
         uniform float newton:mpm:airDrag = 0\n    }}\n\n",
        triple(gravity.normalize_or(-body.up().direction())),
        gravity.length(),
        (NEWTON_STEPS_PER_FRAME * twin.frame_rate_hz).ceil(),
        body.world().grid_spacing_m
    );
    material(&mut text, body);
    obstacles(&mut text, body);
    // One deformable body: Newton takes its points as what is simulated, and its meshes as what is seen.
    let _ = write!(
        text,
        "    def Xform \"Twin\" (\n        prepend apiSchemas = [\"PhysicsDeformableBodyAPI\"]\n    )\n    {{\n        \
         rel physics:simulationOwner = </World/Physics>\n        float physics:mass = {}\n",
        body.mass_kg()
    );
    let has_surface = look == UsdLook::Surface && stays_together(&twin.material);
    // One look: where there is a surface, the points are there for simulators.
    particles(&mut text, body, paint, if has_surface { "guide" } else { "default" });
    if has_surface {
        volume(&mut text, body, &body.tetrahedra()?);
        surface(&mut text, body, &body.surface()?, paint);
    }
    text += "    }\n}\n";
    atomic::write(path, text.as_bytes())
}

/// The stage's metadata, up to the inside of `/World`.
fn header(body: &ExportBody) -> String {
    let twin = body.twin();
    let up_axis = if body.up() == UpAxis::Z { "Z" } else { "Y" };
    let motion = body.motion();
    let rate = if motion.frame_rate_hz > 0.0 { motion.frame_rate_hz } else { twin.frame_rate_hz };
    let last = motion.frames.len().saturating_sub(1);
    format!(
        "#usda 1.0\n(\n    defaultPrim = \"World\"\n    metersPerUnit = 1\n    kilogramsPerUnit = 1\n    \
         upAxis = \"{up_axis}\"\n    startTimeCode = 0\n    endTimeCode = {last}\n    \
         timeCodesPerSecond = {rate}\n    framesPerSecond = {rate}\n    \
         doc = \"A twin by gic {}: {} kg of {}\"\n)\n\ndef Xform \"World\"\n{{\n",
        crate::VERSION,
        body.mass_kg(),
        twin.material.model()
    )
}

/// Newton's material point parameters of a law. Its deviatoric stress is measured by |s| / sqrt(2), which it bounds by
/// the yield stress and the friction times the pressure.
fn newton_parameters(material: &Material) -> Vec<(&'static str, f64)> {
    let young = match *material {
        // Only the bulk modulus E / (3 (1 - 2 nu)) is felt where shear yields at once.
        Material::Newtonian { bulk_modulus_pa, .. } => 1.2 * bulk_modulus_pa,
        _ => material.elastic_moduli().map_or(0.0, |[young, _]| young),
    };
    let never_pa = NEVER_STRAIN * young;
    let never = [("yieldPressure", never_pa), ("tensileYieldRatio", 1.0)];
    let mut parameters = Vec::new();
    if let Some([young, poisson]) = material.elastic_moduli() {
        parameters.extend([("youngsModulus", young), ("poissonsRatio", poisson)]);
    }
    if let Material::Viscoelastic { youngs_modulus_pa, retardation_time_s, .. } = *material {
        parameters.push(("elasticDamping", retardation_time_s * youngs_modulus_pa));
    }
    match *material {
        Material::Elastic { .. } | Material::Viscoelastic { .. } => {
            parameters.extend(never);
            parameters.extend([("internalFriction", 0.0), ("yieldStress", never_pa)]);
        }
        // gic's bound is on |s|.
        Material::Plasticine { yield_stress_pa, .. } => {
            parameters.extend(never);
            parameters.extend([("internalFriction", 0.0), ("yieldStress", yield_stress_pa / 2f64.sqrt())]);
        }
        // |s| <= 3 alpha p with the cone's slope alpha = sqrt(2/3) 2 sin(angle) / (3 - sin(angle)).
        Material::Sand { friction_angle_deg, .. } => {
            let sin = friction_angle_deg.to_radians().sin();
            let friction = 3f64.sqrt() * 2.0 * sin / (3.0 - sin);
            parameters.extend([("yieldPressure", never_pa), ("tensileYieldRatio", 0.0)]);
            parameters.extend([("internalFriction", friction), ("yieldStress", 0.0)]);
        }
        Material::Newtonian { viscosity_pa_s, .. } => {
            parameters.extend([("youngsModulus", young), ("poissonsRatio", 0.3)]);
            // Newton's fluids end in NaN where they bear tension: these tear.
            parameters.extend([("yieldPressure", never_pa), ("tensileYieldRatio", 0.0)]);
            parameters.extend([("internalFriction", 0.0), ("yieldStress", 0.0), ("viscosity", viscosity_pa_s)]);
        }
        // gic's bound on |s| is sqrt(2/3) of the yield stress.
        Material::NonNewtonian { yield_stress_pa, plastic_viscosity_pa_s, .. } => {
            parameters.extend(never);
            parameters.extend([("internalFriction", 0.0), ("yieldStress", yield_stress_pa / 3f64.sqrt())]);
            parameters.push(("viscosity", plastic_viscosity_pa_s));
        }
    }
    parameters
}

fn material(text: &mut String, body: &ExportBody) {
    let twin = body.twin();
    let _ = write!(
        text,
        "    def Material \"Matter\" (\n        prepend apiSchemas = [\"PhysicsMaterialAPI\", \
         \"NewtonMPMMaterialAPI\", \"OmniPhysicsBaseMaterialAPI\", \"OmniPhysicsDeformableMaterialAPI\"]\n    )\n    \
         {{\n        float physics:density = {0}\n        float omniphysics:density = {0}\n",
        twin.density_kg_m3
    );
    for (name, value) in newton_parameters(&twin.material) {
        let _ = writeln!(text, "        float newton:mpm:{name} = {value}");
    }
    if let Some([young, poisson]) = twin.material.elastic_moduli() {
        let _ = write!(
            text,
            "        float omniphysics:youngsModulus = {young}\n        float omniphysics:poissonsRatio = {poisson}\n"
        );
    }
    let _ = writeln!(text, "        custom string gic:model = \"{}\"", twin.material.model());
    for (name, value) in twin.material.parameter_names().iter().zip(twin.material.parameters()) {
        let _ = writeln!(text, "        custom double gic:{name} = {value}");
    }
    *text += "    }\n\n";
}

/// The obstacles that rest, each with its friction.
fn obstacles(text: &mut String, body: &ExportBody) {
    *text += "    def Scope \"Obstacles\"\n    {\n";
    let side = FLOOR_SIDES * body.volume_m3().cbrt();
    for (index, obstacle) in body.twin().colliders.iter().enumerate() {
        if obstacle.moves() {
            let _ = writeln!(text, "        # {} moves and is left out", obstacle.label(index));
            continue;
        }
        let friction = friction(obstacle);
        let (kind, attributes, place, turn) = shape(obstacle, side);
        let _ = write!(
            text,
            "        def Material \"Friction{index}\" (\n            \
             prepend apiSchemas = [\"PhysicsMaterialAPI\"]\n        )\n        {{\n            \
             float physics:staticFriction = {friction}\n            float physics:dynamicFriction = {friction}\n        \
             }}\n\n        def {kind} \"Obstacle{index}\" (\n            \
             prepend apiSchemas = [\"PhysicsCollisionAPI\", \"MaterialBindingAPI\"]\n        )\n        {{\n            \
             rel material:binding:physics = </World/Obstacles/Friction{index}>\n{attributes}            \
             double3 xformOp:translate = ({}, {}, {})\n            quatd xformOp:orient = {}\n            \
             uniform token[] xformOpOrder = [{}]\n        }}\n",
            place.x,
            place.y,
            place.z,
            quaternion(turn),
            if kind == "Cube" {
                "\"xformOp:translate\", \"xformOp:orient\", \"xformOp:scale\""
            } else {
                "\"xformOp:translate\", \"xformOp:orient\""
            }
        );
    }
    *text += "    }\n\n";
}

/// Kind of prim, its attributes, place [m] and rotation; half spaces are shown as squares with sides of `side` [m].
fn shape(obstacle: &Obstacle, side: f64) -> (&'static str, String, DVec3, DQuat) {
    let turn = crate::rotation(obstacle.rotation_deg.unwrap_or_default());
    let line = |attribute: String| format!("            {attribute}\n");
    let round = |radius: f64, height: f64| {
        line("uniform token axis = \"Y\"".into())
            + &line(format!("double radius = {radius}"))
            + &line(format!("double height = {height}"))
    };
    match obstacle.shape {
        ObstacleShape::HalfSpace { point_m, normal } => {
            let to = turn * DVec3::from(normal).normalize();
            let attributes = line("uniform token axis = \"Z\"".into())
                + &line(format!("double width = {side}"))
                + &line(format!("double length = {side}"));
            ("Plane", attributes, point_m.into(), DQuat::from_rotation_arc(DVec3::Z, to))
        }
        ObstacleShape::Sphere { centre_m, radius_m } => {
            ("Sphere", line(format!("double radius = {radius_m}")), centre_m.into(), turn)
        }
        ObstacleShape::Box { centre_m, size_m: [x, y, z] } => {
            let attributes = line("double size = 1".into()) + &line(format!("double3 xformOp:scale = ({x}, {y}, {z})"));
            ("Cube", attributes, centre_m.into(), turn)
        }
        ObstacleShape::Cylinder { centre_m, radius_m, height_m } => {
            ("Cylinder", round(radius_m, height_m), centre_m.into(), turn)
        }
        ObstacleShape::Capsule { centre_m, radius_m, height_m } => {
            ("Capsule", round(radius_m, height_m), centre_m.into(), turn)
        }
    }
}

fn particles(text: &mut String, body: &ExportBody, paint: Option<&Paint>, purpose: &str) {
    let velocities: Vec<DVec3> = body.particles().iter().copied().map(body.velocity_field()).collect();
    // All alike, a share of the body each: with unequal ones Newton's steps end in NaN where the lightest touch first.
    let count = body.particles().len();
    let mass = body.mass_kg() / count as f64;
    let width = (mass / body.twin().density_kg_m3).cbrt();
    let _ = write!(
        text,
        "        def Points \"Particles\" (\n            prepend apiSchemas = [\"MaterialBindingAPI\", \
         \"NewtonPointsDeformableSimAPI\"]\n        )\n        {{\n            \
         rel material:binding:physics = </World/Matter>\n            uniform token purpose = \"{purpose}\"\n            \
         float[] physics:masses = {}\n            vector3f[] velocities = {}\n            \
         float[] widths = {}\n",
        list(std::iter::repeat_n((mass as f32).to_string(), count)),
        points(&velocities),
        list(std::iter::repeat_n((width as f32).to_string(), count)),
    );
    colors(text, body.particles(), paint);
    moving_points(text, body.particles(), &body.motion().frames);
    *text += "        }\n";
}

fn volume(text: &mut String, body: &ExportBody, mesh: &TetMesh) {
    let faces = mesh.boundary();
    let tetrahedra = list(mesh.tetrahedra.iter().map(|t| format!("({}, {}, {}, {})", t[0], t[1], t[2], t[3])));
    let velocities: Vec<DVec3> = mesh.vertices.iter().copied().map(body.velocity_field()).collect();
    let _ = write!(
        text,
        "\n        def TetMesh \"Volume\" (\n            prepend apiSchemas = [\"MaterialBindingAPI\", \
         \"PhysicsCollisionAPI\", \"OmniPhysicsDeformableBodyAPI\", \"OmniPhysicsVolumeDeformableSimAPI\"]\n        \
         )\n        {{\n            rel material:binding:physics = </World/Matter>\n            \
         uniform token purpose = \"guide\"\n            float omniphysics:mass = {}\n            \
         point3f[] omniphysics:restShapePoints = {}\n            int4[] omniphysics:restTetVtxIndices = {tetrahedra}\n            \
         int4[] tetVertexIndices = {tetrahedra}\n            int3[] surfaceFaceVertexIndices = {}\n            \
         vector3f[] velocities = {}\n",
        body.mass_kg(),
        points(&mesh.vertices),
        list(faces.iter().map(|f| format!("({}, {}, {})", f[0], f[1], f[2]))),
        points(&velocities),
    );
    moving_points(text, &mesh.vertices, &body.carried(&mesh.vertices));
    *text += "        }\n";
}

fn surface(text: &mut String, body: &ExportBody, mesh: &TriangleMesh, paint: Option<&Paint>) {
    let _ = write!(
        text,
        "\n        def Mesh \"Surface\"\n        {{\n            uniform token subdivisionScheme = \"none\"\n            \
         int[] faceVertexCounts = {}\n            int[] faceVertexIndices = {}\n",
        list(mesh.triangles.iter().map(|_| "3".to_owned())),
        list(mesh.triangles.iter().flatten().map(ToString::to_string)),
    );
    colors(text, &mesh.vertices, paint);
    moving_points(text, &mesh.vertices, &body.carried(&mesh.vertices));
    *text += "        }\n";
}

/// Colours of points [m], linear as USD wants them.
fn colors(text: &mut String, at: &[DVec3], paint: Option<&Paint>) {
    let Some(paint) = paint else {
        *text += "            color3f[] primvars:displayColor = [(0.6, 0.3, 0.15)]\n";
        return;
    };
    let _ = write!(
        text,
        "            color3f[] primvars:displayColor = {} (\n                interpolation = \"vertex\"\n            )\n",
        points(&linear_colors(paint, at))
    );
}
