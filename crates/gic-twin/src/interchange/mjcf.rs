//! MJCF: a deformable body (`flex` of dimension 3) whose vertices are bodies with three slides each.

use std::fmt::Write as _;
use std::path::Path;

use gic_geometry::TetMesh;
use glam::DVec3;

use super::{elastic_solid, least_height, vertex_masses};
use crate::atomic;
use crate::error::Result;
use crate::twin::{Obstacle, ObstacleShape, Twin};

/// Time step over the time that the fastest wave takes across the flattest tetrahedron: MuJoCo's elastic forces are
/// explicit.
const COURANT_NUMBER: f64 = 0.2;
/// Stiffness-proportional damping, in time steps.
const DAMPING_STEPS: f64 = 1.0;
/// Radius of the vertices in contact, over the least height of a tetrahedron.
const CONTACT_RADIUS_SHARE: f64 = 0.1;

/// Writes the twin as a MuJoCo model in SI units and the twin's own frame: tetrahedra with Young's modulus and
/// Poisson's ratio, masses lumped at the vertices, its velocity as a key frame named `start`, its gravity, and its
/// obstacles as far as they rest.
///
/// # Errors
/// Matter that is no elastic solid, an unwritable file.
pub fn write_mjcf(path: &Path, mesh: &TetMesh, twin: &Twin) -> Result<()> {
    let [young, poisson] = elastic_solid(twin, "MJCF")?;
    let height = least_height(mesh);
    let timestep = COURANT_NUMBER * height / twin.material.wave_speed_m_s(twin.density_kg_m3);
    let [gx, gy, gz] = twin.gravity_m_s2;
    let mut text = format!(
        "<mujoco model=\"twin\">\n  <!-- gic {}: {} of E = {young:.6e} Pa, nu = {poisson:.6}, {} kg/m^3. \
         MuJoCo's law is Saint Venant-Kirchhoff: the same at small strains. -->\n",
        crate::VERSION,
        twin.material.model(),
        twin.density_kg_m3
    );
    let _ = write!(
        text,
        "  <option timestep=\"{timestep:.3e}\" gravity=\"{gx} {gy} {gz}\" solver=\"CG\" tolerance=\"1e-6\"/>\n  \
         <statistic meansize=\"{height:.4e}\"/>\n  <worldbody>\n"
    );
    for (index, obstacle) in twin.colliders.iter().enumerate() {
        text += &geom(index, obstacle);
    }
    for (i, (p, mass)) in mesh.vertices.iter().zip(vertex_masses(mesh, twin.density_kg_m3)).enumerate() {
        // A vertex does not turn, but MuJoCo needs an inertia: that of a ball of this size.
        let inertia = 0.4 * mass * height * height;
        let _ = writeln!(
            text,
            "    <body name=\"v{i}\" pos=\"{:.7} {:.7} {:.7}\">\
             <inertial pos=\"0 0 0\" mass=\"{mass:.6e}\" diaginertia=\"{inertia:.4e} {inertia:.4e} {inertia:.4e}\"/>\
             <joint type=\"slide\" axis=\"1 0 0\"/><joint type=\"slide\" axis=\"0 1 0\"/>\
             <joint type=\"slide\" axis=\"0 0 1\"/></body>",
            p.x, p.y, p.z
        );
    }
    text += "  </worldbody>\n  <deformable>\n    <flex name=\"twin\" dim=\"3\" rgba=\"0.8 0.58 0.42 1\"";
    let _ = write!(text, " radius=\"{:.4e}\" body=\"", CONTACT_RADIUS_SHARE * height);
    text += &joined((0..mesh.vertices.len()).map(|i| format!("v{i}")));
    text += "\" element=\"";
    text += &joined(mesh.tetrahedra.iter().flatten().map(ToString::to_string));
    let _ = write!(
        text,
        "\">\n      <elasticity young=\"{young:.8e}\" poisson=\"{poisson:.6}\" damping=\"{:.3e}\"/>\n      \
         <contact selfcollide=\"none\" condim=\"3\"/>\n    </flex>\n  </deformable>\n",
        DAMPING_STEPS * timestep
    );
    let velocities = joined(mesh.vertices.iter().map(|p| {
        let v = velocity(twin, mesh, *p);
        format!("{} {} {}", v.x, v.y, v.z)
    }));
    let _ = write!(text, "  <keyframe>\n    <key name=\"start\" qvel=\"{velocities}\"/>\n  </keyframe>\n</mujoco>\n");
    atomic::write(path, text.as_bytes())
}

fn joined(words: impl Iterator<Item = String>) -> String {
    words.collect::<Vec<_>>().join(" ")
}

/// Velocity of a point of the twin at the start [m/s].
fn velocity(twin: &Twin, mesh: &TetMesh, p: DVec3) -> DVec3 {
    let spin = DVec3::from(twin.initial_angular_velocity_rad_s);
    let linear = DVec3::from(twin.initial_velocity_m_s);
    if spin == DVec3::ZERO {
        return linear;
    }
    let masses = vertex_masses(mesh, 1.0);
    let centre = mesh.vertices.iter().zip(&masses).map(|(p, m)| *p * *m).sum::<DVec3>() / masses.iter().sum::<f64>();
    linear + spin.cross(p - centre)
}

/// An obstacle as a geom; one that moves as a comment.
fn geom(index: usize, obstacle: &Obstacle) -> String {
    let label = obstacle.label(index);
    if !obstacle.keyframes.is_empty() || obstacle.velocity_m_s.is_some() || obstacle.angular_velocity_rad_s.is_some() {
        return format!("    <!-- {label} moves and is left out -->\n");
    }
    let turn = crate::rotation(obstacle.rotation_deg.unwrap_or_default());
    let friction =
        obstacle.friction.unwrap_or(if obstacle.contact == crate::twin::ContactKind::Sticky { 1.0 } else { 0.0 });
    let triple = |v: [f64; 3]| format!("{} {} {}", v[0], v[1], v[2]);
    // MuJoCo's cylinders and capsules stand along z, the twin's along y.
    let along_z = turn * glam::DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2);
    let quaternion = |q: glam::DQuat| format!("{} {} {} {}", q.w, q.x, q.y, q.z);
    let shape = match obstacle.shape {
        ObstacleShape::HalfSpace { point_m, normal } => {
            let normal = turn * DVec3::from(normal).normalize();
            format!("type=\"plane\" size=\"0 0 1\" pos=\"{}\" zaxis=\"{}\"", triple(point_m), triple(normal.to_array()))
        }
        ObstacleShape::Sphere { centre_m, radius_m } => {
            format!("type=\"sphere\" size=\"{radius_m}\" pos=\"{}\"", triple(centre_m))
        }
        ObstacleShape::Box { centre_m, size_m } => format!(
            "type=\"box\" size=\"{}\" pos=\"{}\" quat=\"{}\"",
            triple(size_m.map(|s| 0.5 * s)),
            triple(centre_m),
            quaternion(turn)
        ),
        ObstacleShape::Cylinder { centre_m, radius_m, height_m } => format!(
            "type=\"cylinder\" size=\"{radius_m} {}\" pos=\"{}\" quat=\"{}\"",
            0.5 * height_m,
            triple(centre_m),
            quaternion(along_z)
        ),
        ObstacleShape::Capsule { centre_m, radius_m, height_m } => format!(
            "type=\"capsule\" size=\"{radius_m} {}\" pos=\"{}\" quat=\"{}\"",
            0.5 * height_m,
            triple(centre_m),
            quaternion(along_z)
        ),
    };
    format!("    <geom name=\"obstacle{index}\" {shape} friction=\"{friction} 0.005 0.0001\"/>\n")
}
