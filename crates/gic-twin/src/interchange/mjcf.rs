//! MJCF: a deformable body (`flexcomp`) whose vertices follow the nodes of a grid of cells.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use gic_mpm::Material;
use glam::{DQuat, DVec3};

use super::{ExportBody, elastic_solid, friction, is_elastic, lame};
use crate::atomic;
use crate::error::Result;
use crate::twin::{Obstacle, ObstacleShape, Twin};

/// Least side of a cell over the cube root of the body's volume. Budget: a second of a hard body in ten minutes.
const LEAST_CELL_SHARE: f64 = 0.15;
/// Side of a cell over the depth of the impact. Fitted on: cat, bunny, a ball and a box of 20 and 100 kPa.
const CELL_DEPTH_SHARE: f64 = 0.9;
/// Cells that the fastest wave passes in a time step: steps are implicit and take energy from what moves fast. Fitted
/// on: cat, bunny, a ball and a box of 20 and 100 kPa; with half of it soft bodies spring 11 % of the drop higher.
const COURANT_NUMBER: f64 = 0.125;
/// Time constant of contact over the time step: what is shorter than the step MuJoCo replaces by the stiffest contact
/// that the step resolves, and which does not throw back. Derived: any share below 1.
const CONTACT_STEPS: f64 = 0.5;
/// Radius of the vertices in contact, over the particles' spacing.
const CONTACT_RADIUS: f64 = 0.1;
/// Compressions, as shares of the length, between which that of an impact is sought.
const COMPRESSED: [f64; 2] = [0.05, 1.0];

/// Writes the twin as a MuJoCo model (4.0 and later) in SI units: tetrahedra in a grid of trilinear cells with
/// corotated elasticity, the body's mass, gravity, the obstacles that rest, and the initial velocity as the numbers
/// `initial_velocity_m_s` and `initial_angular_velocity_rad_s`. MuJoCo starts every file at rest, so a loader that sets
/// these velocities, and those of the keyframe, is written beside it; returns its path. How many nodes the body has is
/// for MuJoCo's compiler to say: the file cannot hold a velocity of each.
///
/// # Errors
/// Matter that is no elastic solid, unless `approximate` and it has elastic moduli; particles that cannot be meshed; an
/// unwritable file.
pub fn write_mjcf(path: &Path, body: &ExportBody, approximate: bool) -> Result<PathBuf> {
    let twin = body.twin();
    let [young, poisson] = elastic_solid(twin, "MJCF", approximate)?;
    let mesh = body.tetrahedra()?;
    let energy = impact_energy_pa(body);
    let compression = impact_compression(energy, [young, poisson]);
    let factor = impact_factor(compression, [young, poisson]);
    // MuJoCo's law turns cells inside out that are much smaller than the depth of the impact.
    let cell = (CELL_DEPTH_SHARE * compression).max(LEAST_CELL_SHARE) * body.volume_m3().cbrt();
    let timestep = COURANT_NUMBER * cell / twin.material.wave_speed_m_s(twin.density_kg_m3);
    let low = mesh.vertices.iter().fold(DVec3::INFINITY, |low, p| low.min(*p));
    let high = mesh.vertices.iter().fold(DVec3::NEG_INFINITY, |high, p| high.max(*p));
    let cells = ((high - low) / cell).round().max(DVec3::ONE);
    let mut text = format!(
        "<mujoco model=\"twin\">\n  <!-- gic {}: {} of E = {young:.6e} Pa, nu = {poisson:.6}, {} kg/m^3, {:.6} kg, \
         metres.{}\n       MuJoCo's elasticity is linear in the stretch and softer than the twin's when compressed: E is \
         {factor:.4} times the twin's,\n       so that both store the energy of the first impact at the same \
         compression.\n       MuJoCo loads every file at rest: {} sets the initial velocity. -->\n",
        crate::VERSION,
        twin.material.model(),
        twin.density_kg_m3,
        body.mass_kg(),
        if !is_elastic(&twin.material) { " EXPORTED AS ELASTIC: MuJoCo knows nothing of its plasticity." } else { "" },
        loader_file(path).file_name().unwrap_or_default().to_string_lossy(),
    );
    let _ = write!(
        text,
        "  <option timestep=\"{timestep:.4e}\" gravity=\"{}\" integrator=\"discrete\" solver=\"CG\" \
         tolerance=\"1e-6\"/>\n  <custom>\n    <numeric name=\"initial_velocity_m_s\" data=\"{}\"/>\n    \
         <numeric name=\"initial_angular_velocity_rad_s\" data=\"{}\"/>\n    \
         <numeric name=\"centre_of_mass_m\" data=\"{}\"/>\n    <numeric name=\"youngs_modulus_pa\" data=\"{young}\"/>\n  \
         </custom>\n  <worldbody>\n",
        triple(twin.gravity_m_s2),
        triple(twin.initial_velocity_m_s),
        triple(twin.initial_angular_velocity_rad_s),
        triple(body.centre_of_mass_m().to_array()),
    );
    for (index, obstacle) in twin.colliders.iter().enumerate() {
        text += &geom(index, obstacle, CONTACT_STEPS * timestep);
    }
    let _ = write!(
        text,
        "    <flexcomp name=\"twin\" type=\"direct\" dim=\"3\" dof=\"trilinear\" cellcount=\"{} {} {}\" \
         mass=\"{:.8}\" radius=\"{:.4e}\" rgba=\"0.8 0.58 0.42 1\"\n      point=\"",
        cells.x,
        cells.y,
        cells.z,
        body.mass_kg(),
        CONTACT_RADIUS * body.particle_spacing_m()
    );
    text += &joined(mesh.vertices.iter().map(|p| format!("{:.7} {:.7} {:.7}", p.x, p.y, p.z)));
    text += "\"\n      element=\"";
    text += &joined(mesh.tetrahedra.iter().flatten().map(ToString::to_string));
    let _ = write!(
        text,
        "\">\n      <elasticity young=\"{:.8e}\" poisson=\"{poisson:.6}\" damping=\"{}\"/>\n      \
         <contact selfcollide=\"none\" condim=\"3\"/>\n    </flexcomp>\n  </worldbody>\n  <keyframe>\n    \
         <key name=\"test\"/>\n  </keyframe>\n</mujoco>\n",
        factor * young,
        damping_s(twin)
    );
    atomic::write(path, text.as_bytes())?;
    write_loader(path)
}

/// Energy per volume [Pa] with which the body meets the first half space that it falls on: kinetic energy at the start
/// and the work of gravity; 0 where it falls on none.
fn impact_energy_pa(body: &ExportBody) -> f64 {
    let twin = body.twin();
    let gravity = DVec3::from(twin.gravity_m_s2);
    let fall = |obstacle: &Obstacle| {
        let ObstacleShape::HalfSpace { point_m, normal } = obstacle.shape else { return None };
        let turn = crate::rotation(obstacle.rotation_deg.unwrap_or_default());
        let normal = turn * DVec3::from(normal).normalize();
        let slope = -normal.dot(gravity.normalize_or_zero());
        let heights = body.particles().iter().map(|p| (*p - DVec3::from(point_m)).dot(normal));
        (slope > 0.0).then(|| heights.fold(f64::INFINITY, f64::min).max(0.0) / slope)
    };
    let drop = twin.colliders.iter().filter_map(fall).fold(f64::INFINITY, f64::min);
    if !drop.is_finite() {
        return 0.0;
    }
    let speed_squared = DVec3::from(twin.initial_velocity_m_s).length_squared() + 2.0 * gravity.length() * drop;
    0.5 * twin.density_kg_m3 * speed_squared
}

/// Energy per volume [Pa] of the neo-Hookean law compressed to the share `s` of its length without widening:
/// `mu (s^2 - 1) / 2 - mu ln s + lambda (ln s)^2 / 2`.
fn stored_pa(s: f64, moduli: [f64; 2]) -> f64 {
    let [mu, lambda] = lame(moduli);
    0.5 * mu * (s * s - 1.0) - mu * s.ln() + 0.5 * lambda * s.ln().powi(2)
}

/// By which share of its length the neo-Hookean law is compressed, without widening, when it stores an energy per
/// volume `w` [Pa].
fn impact_compression(w: f64, moduli: [f64; 2]) -> f64 {
    let [mut low, mut high] = COMPRESSED;
    // The stored energy falls from the most compressed to the uncompressed.
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        *(if stored_pa(middle, moduli) > w { &mut low } else { &mut high }) = middle;
    }
    1.0 - low
}

/// By how much the modulus of a law that is linear in the stretch is raised so that it stores at a compression by the
/// share `e` of the length what the neo-Hookean law does: `(lambda + 2 mu) e^2 / 2` against [`stored_pa`].
fn impact_factor(e: f64, moduli: [f64; 2]) -> f64 {
    let [mu, lambda] = lame(moduli);
    let linear = 0.5 * (lambda + 2.0 * mu) * e * e;
    // Where hardly anything is compressed, both laws are the same.
    if e < 1e-6 { 1.0 } else { (stored_pa(1.0 - e, moduli) / linear).max(1.0) }
}

/// Damping [s] of the stiffness: the retardation time of a viscoelastic solid, of which MuJoCo's law is that of small
/// strains.
fn damping_s(twin: &Twin) -> f64 {
    if let Material::Viscoelastic { retardation_time_s, .. } = twin.material { retardation_time_s } else { 0.0 }
}

fn loader_file(path: &Path) -> PathBuf {
    path.with_extension("mujoco.py")
}

fn write_loader(path: &Path) -> Result<PathBuf> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let text = format!(
        r#""""Loads {name} with the twin's initial velocity, which MuJoCo does not take from it: pip install mujoco

Without an argument it opens the viewer. With the name of an .mjb file it writes the model there, which MuJoCo's other
programs load: its keyframe `test` starts with the velocity.
"""

import pathlib
import sys

import mujoco
import numpy as np


def load(path=pathlib.Path(__file__).with_name({name:?})):
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    velocity, spin, centre = (model.numeric(key).data for key in (
        "initial_velocity_m_s", "initial_angular_velocity_rad_s", "centre_of_mass_m"))
    at = model.body_pos[model.dof_bodyid] - centre
    data.qvel[:] = ((velocity + np.cross(spin, at)) * model.jnt_axis[model.dof_jntid]).sum(axis=1)
    # Where a reset to the keyframe goes.
    model.key_qvel[:] = data.qvel
    mujoco.mj_forward(model, data)
    return model, data


if __name__ == "__main__":
    if sys.argv[1:]:
        mujoco.mj_saveModel(load()[0], sys.argv[1])
    else:
        import mujoco.viewer

        mujoco.viewer.launch(*load())
"#
    );
    let loader = loader_file(path);
    atomic::write(&loader, text.as_bytes())?;
    Ok(loader)
}

fn joined(words: impl Iterator<Item = String>) -> String {
    words.collect::<Vec<_>>().join(" ")
}

fn triple(v: [f64; 3]) -> String {
    format!("{} {} {}", v[0], v[1], v[2])
}

/// An obstacle as a geom with the time constant of its contact [s]; one that moves as a comment.
fn geom(index: usize, obstacle: &Obstacle, contact_s: f64) -> String {
    let label = obstacle.label(index);
    if obstacle.moves() {
        return format!("    <!-- {label} moves and is left out -->\n");
    }
    let turn = crate::rotation(obstacle.rotation_deg.unwrap_or_default());
    let friction = friction(obstacle);
    // MuJoCo's cylinders and capsules stand along z, the twin's along y.
    let along_z = turn * DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2);
    let quaternion = |q: DQuat| format!("{} {} {} {}", q.w, q.x, q.y, q.z);
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
    // MuJoCo's default contact gives way for 20 ms and takes energy; the obstacle's values stand before the body's.
    format!(
        "    <geom name=\"obstacle{index}\" {shape} friction=\"{friction} 0.005 0.0001\" solref=\"{contact_s:.4e} 1\" \
         priority=\"1\"/>\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_modulus_is_raised_for_a_hard_impact_and_not_for_a_soft_one() {
        let factor = |w: f64, moduli: [f64; 2]| impact_factor(impact_compression(w, moduli), moduli);
        assert_eq!(factor(0.0, [4e4, 0.3]), 1.0);
        assert!((factor(1.0, [4e6, 0.3]) - 1.0).abs() < 1e-2);
        let raised = factor(5600.0, [4.04e4, 0.322]);
        assert!(raised > 1.3 && raised < 1.45, "{raised}");
        // Without Poisson's ratio both energies are written down for one compression, to half the length.
        let mu = 0.5e4;
        let w = mu * (-0.375 + 2f64.ln());
        assert!((impact_compression(w, [1e4, 0.0]) - 0.5).abs() < 1e-9);
        assert!((factor(w, [1e4, 0.0]) - w / (mu * 0.25)).abs() < 1e-6);
    }
}
