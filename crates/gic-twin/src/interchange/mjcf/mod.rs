//! MJCF: a deformable body (`flex`) whose vertices follow the nodes of a grid of cells.

mod impact;
mod lattice;
mod obstacle;

use std::fmt::Write as _;
use std::path::Path;

use gic_geometry::TetMesh;
use gic_mpm::Material;

use super::body::TETRAHEDRON_EDGE;
use super::{ExportBody, elastic_solid, is_elastic};
use crate::atomic;
use crate::error::Result;
use crate::twin::Twin;
use impact::{impact_compression, impact_energy_pa, impact_factor};
use lattice::{Lattice, Node};
use obstacle::geom;

/// Least side of a cell over the cube root of the body's volume. Budget: a second of a hard body in ten minutes.
const LEAST_CELL_SHARE: f64 = 0.15;
/// Side of a cell over the depth of the impact. Fitted on: cat, bunny, a ball, a box and elastic_0 of 20 to 100 kPa.
const CELL_DEPTH_SHARE: f64 = 0.75;
/// Cells that the fastest wave passes in a time step: steps are implicit and take energy from what moves fast. Fitted
/// on: cat, bunny, a ball and a box of 20 and 100 kPa; with half of it soft bodies spring 11 % of the drop higher.
const COURANT_NUMBER: f64 = 0.125;
/// Time constant of contact over the time step: what is shorter than the step MuJoCo replaces by the stiffest contact
/// that the step resolves, and which does not throw back. Derived: any share below 1.
const CONTACT_STEPS: f64 = 0.5;
/// Radius of the vertices in contact, over the particles' spacing.
const CONTACT_RADIUS: f64 = 0.1;
/// Time constant of the throw's filter over the time step. Derived: what is left after a step is below rounding.
const THROW_SHARE: f64 = 0.05;
/// Joints of a node, by name and direction.
const AXES: [(&str, &str); 3] = [("x", "1 0 0"), ("y", "0 1 0"), ("z", "0 0 1")];

/// Writes the twin as a MuJoCo model (4.0 and later) in SI units: tetrahedra in a grid of trilinear cells with
/// corotated elasticity, the body's mass, gravity, the obstacles that rest, and a throw that gives the initial velocity
/// in the first step. The keyframe `start` has this velocity, and the throw behind it.
///
/// # Errors
/// Matter that is no elastic solid, unless `approximate` and it has elastic moduli; particles that cannot be meshed; an
/// unwritable file.
pub fn write_mjcf(path: &Path, body: &ExportBody, approximate: bool) -> Result<()> {
    let twin = body.twin();
    let [young, poisson] = elastic_solid(twin, "MJCF", approximate)?;
    let mesh = body.tetrahedra()?;
    let compression = impact_compression(impact_energy_pa(body), [young, poisson]);
    let factor = impact_factor(compression, [young, poisson]);
    // MuJoCo's law turns cells inside out that are much smaller than the depth of the impact.
    let cell = (CELL_DEPTH_SHARE * compression).max(LEAST_CELL_SHARE) * body.volume_m3().cbrt();
    // A cell holds whole tetrahedra.
    let cell = cell.max(TETRAHEDRON_EDGE * body.particle_spacing_m());
    let timestep = COURANT_NUMBER * cell / twin.material.wave_speed_m_s(twin.density_kg_m3);
    let lattice = Lattice::around(&mesh, cell, body.mass_kg());
    let mut text = format!(
        "<mujoco model=\"twin\">\n  <!-- gic {}: {} of E = {young:.6e} Pa, nu = {poisson:.6}, {} kg/m^3, {:.6} kg, \
         metres.{}\n       MuJoCo's elasticity is linear in the stretch and softer than the twin's when compressed: E is \
         {factor:.4} times the twin's,\n       so that both store the energy of the first impact at the same \
         compression. -->\n",
        crate::VERSION,
        twin.material.model(),
        twin.density_kg_m3,
        body.mass_kg(),
        if !is_elastic(&twin.material) { " EXPORTED AS ELASTIC: MuJoCo knows nothing of its plasticity." } else { "" },
    );
    let _ = write!(
        text,
        "  <compiler angle=\"radian\"/>\n  <option timestep=\"{timestep:.4e}\" gravity=\"{}\" integrator=\"discrete\" \
         solver=\"CG\" tolerance=\"1e-6\"/>\n  <worldbody>\n",
        triple(twin.gravity_m_s2)
    );
    for (index, obstacle) in twin.colliders.iter().enumerate() {
        text += &geom(index, obstacle, CONTACT_STEPS * timestep);
    }
    text += &bodies(&lattice);
    text += "  </worldbody>\n  <deformable>\n";
    text += &flex(&mesh, &lattice, CONTACT_RADIUS * body.particle_spacing_m());
    let _ = write!(
        text,
        "      <elasticity young=\"{:.8e}\" poisson=\"{poisson:.6}\" damping=\"{}\"/>\n      \
         <contact selfcollide=\"none\" condim=\"3\"/>\n    </flex>\n  </deformable>\n",
        factor * young,
        damping_s(twin)
    );
    text += &throw(body, &lattice, timestep);
    text += "</mujoco>\n";
    atomic::write(path, text.as_bytes())
}

/// A body for each node that moves, which slides along the axes.
fn bodies(lattice: &Lattice) -> String {
    let mut text = String::new();
    for Node { name, position, mass_kg, .. } in lattice.moving() {
        // Nothing turns a node, but MuJoCo wants a moment of inertia.
        let inertia = 1e-4 * mass_kg;
        let joint = |(axis, along)| format!("<joint name=\"{name}_{axis}\" type=\"slide\" axis=\"{along}\"/>");
        let _ = writeln!(
            text,
            "    <body name=\"{name}\" pos=\"{}\"><inertial pos=\"0 0 0\" mass=\"{mass_kg:.9}\" \
             diaginertia=\"{inertia:.3e} {inertia:.3e} {inertia:.3e}\"/>{}</body>",
            triple(position.to_array()),
            AXES.map(joint).concat()
        );
    }
    text
}

/// The start of the flex: the mesh, whose vertices follow the nodes of the cells around them. Places of nodes are as
/// they are, not rounded: MuJoCo refuses axes of the grid that are a ten-millionth off the right angle.
fn flex(mesh: &TetMesh, lattice: &Lattice, radius: f64) -> String {
    let [nx, ny, nz] = lattice.cells;
    let from_carrier = |node: &Node| node.position - lattice.nodes[node.carrier].position;
    format!(
        "    <flex name=\"twin\" dim=\"3\" dof=\"trilinear\" cellcount=\"{nx} {ny} {nz}\" radius=\"{radius:.4e}\" \
         rgba=\"0.8 0.58 0.42 1\"\n      node=\"{}\"\n      nodecoord=\"{}\"\n      body=\"{}\"\n      vertex=\"{}\"\n      \
         element=\"{}\">\n",
        joined(lattice.nodes.iter().map(|node| lattice.nodes[node.carrier].name.clone())),
        joined(lattice.nodes.iter().map(|node| triple(from_carrier(node).to_array()))),
        joined(std::iter::repeat_n("world".to_owned(), mesh.vertices.len())),
        joined(mesh.vertices.iter().map(|p| format!("{:.7} {:.7} {:.7}", p.x, p.y, p.z))),
        joined(mesh.tetrahedra.iter().flatten().map(ToString::to_string)),
    )
}

/// What gives the initial velocity, since MuJoCo starts every file at rest: a motor that pulls every node in proportion
/// to its momentum. Its control is held at 1, which its filter follows within the first step, and then the filter's
/// state takes away what the motor pulls: an impulse of the momentum. In the keyframe that is past.
fn throw(body: &ExportBody, lattice: &Lattice, timestep: f64) -> String {
    let velocity_at = body.velocity_field();
    let (mut coefficients, mut speeds) = (String::new(), Vec::new());
    for Node { name, position, mass_kg, .. } in lattice.moving() {
        let velocity = velocity_at(*position).to_array();
        for ((axis, _), v) in AXES.into_iter().zip(velocity) {
            let _ = writeln!(coefficients, "      <joint joint=\"{name}_{axis}\" coef=\"{:.8e}\"/>", mass_kg * v);
        }
        speeds.push(triple(velocity));
    }
    let force = 1.0 / timestep;
    format!(
        "  <!-- MuJoCo starts every file at rest: for one step this motor pulls every node by its mass times its \
         velocity over the step. -->\n  <tendon>\n    <fixed name=\"throw\">\n{coefficients}    </fixed>\n  </tendon>\n  \
         <actuator>\n    <general name=\"throw\" tendon=\"throw\" ctrllimited=\"true\" ctrlrange=\"1 1.0001\" \
         dyntype=\"filterexact\" dynprm=\"{:.4e}\"\n      gaintype=\"fixed\" gainprm=\"{:.8e}\" biastype=\"affine\" \
         biasprm=\"{force:.8e} 0 0\"/>\n  </actuator>\n  <keyframe>\n    <key name=\"start\" act=\"1\" \
         qvel=\"{}\"/>\n  </keyframe>\n",
        THROW_SHARE * timestep,
        -force,
        speeds.join(" ")
    )
}

/// Damping [s] of the stiffness: the retardation time of a viscoelastic solid, of which MuJoCo's law is that of small
/// strains.
fn damping_s(twin: &Twin) -> f64 {
    if let Material::Viscoelastic { retardation_time_s, .. } = twin.material { retardation_time_s } else { 0.0 }
}

fn joined(words: impl Iterator<Item = String>) -> String {
    words.collect::<Vec<_>>().join(" ")
}

fn triple(v: [f64; 3]) -> String {
    format!("{} {} {}", v[0], v[1], v[2])
}
