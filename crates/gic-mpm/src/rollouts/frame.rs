//! What a simulation reports at the end of a frame.

use gic_simd::Scalar;
use glam::DVec3;

use crate::Material;
use crate::colliders::grid_frame::GridFrame;
use crate::laws::law::Law;
use crate::laws::with_law;
use crate::math::mat3::Mat3;
use crate::substep::grid_update::Impulse;
use crate::substep::prepared_world::{PreparedBody, PreparedWorld};
use crate::substep::state::{State, map_particles};

/// Mean force [N] and torque [N m] on an obstacle over a frame, the torque about the obstacle's origin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContactForce {
    /// Mean force [N].
    pub force_n: DVec3,
    /// Mean torque [N m].
    pub torque_n_m: DVec3,
}

/// What is known at the end of a frame; particles in input order, one body after the other.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Number of the frame; 0 is the initial state.
    pub index: usize,
    /// Positions [m], shape [n].
    pub positions: Vec<DVec3>,
    /// Velocities [m/s], shape [n].
    pub velocities: Vec<DVec3>,
    /// Von Mises (Cauchy) stress [Pa], shape [n].
    pub von_mises_pa: Vec<f32>,
    /// Volume ratio J, shape [n]: of the elastic deformation for plastic materials.
    pub jacobian: Vec<f32>,
    /// Mean force on each obstacle during the frame, shape [colliders]; zero for frame 0.
    pub contacts: Vec<ContactForce>,
    /// Substeps that the frame took; 0 for frame 0.
    pub substeps: usize,
}

/// How the particles are deformed and loaded; matrices by rows.
#[derive(Clone, Debug, PartialEq)]
pub struct Deformation {
    /// Deformation gradients F, shape [n, 3, 3]: of the elastic deformation for plastic materials, `J^(1/3) I` for
    /// Newtonian fluids, which keep their volume ratio alone.
    pub gradients: Vec<[[f64; 3]; 3]>,
    /// Cauchy stress [Pa], shape [n, 3, 3].
    pub cauchy_stress_pa: Vec<[[f64; 3]; 3]>,
}

/// What is reported at the end of a frame of `frame_seconds`: impulses on the obstacles and substeps are those of the
/// frame, none for frame 0.
pub(super) fn report<R: Scalar>(
    world: &PreparedWorld,
    parallel: bool,
    frame_seconds: f64,
    index: usize,
    state: &State<R>,
    advanced: Option<(&[Impulse], usize)>,
) -> Frame {
    let (mut von_mises_pa, mut jacobian) = (Vec::with_capacity(state.len()), Vec::with_capacity(state.len()));
    for body in &world.bodies {
        let of = |p: usize| stress_of(world, body, &in_f64(&state.affine[p]), &in_f64(&state.deformation[p]));
        for (stress, j) in map_particles(parallel, body.range.clone(), of) {
            von_mises_pa.push(stress);
            jacobian.push(j);
        }
    }
    let contacts = match advanced {
        None => vec![ContactForce::default(); world.colliders.len()],
        Some((impulses, _)) => impulses.iter().map(|i| mean_force(&world.frame, i, frame_seconds)).collect(),
    };
    Frame {
        index,
        positions: map_particles(parallel, 0..state.len(), |p| world.frame.point_in_world(state.position_of(p))),
        velocities: map_particles(parallel, 0..state.len(), |p| world.frame.vector_in_world(state.velocity_of(p))),
        von_mises_pa,
        jacobian,
        contacts,
        substeps: advanced.map_or(0, |(_, substeps)| substeps),
    }
}

/// The deformation and the stress of all particles of a state.
pub(super) fn deformation<R: Scalar>(world: &PreparedWorld, state: &State<R>) -> Deformation {
    let (mut gradients, mut cauchy_stress_pa) = (Vec::with_capacity(state.len()), Vec::with_capacity(state.len()));
    for body in &world.bodies {
        for p in body.range.clone() {
            let (c, f) = (in_f64(&state.affine[p]), in_f64(&state.deformation[p]));
            let j = volume_ratio(body, &f);
            gradients.push(match body.material {
                Material::Newtonian { .. } => Mat3::identity() * j.cbrt(),
                _ => world.frame.tensor_in_world(f),
            });
            let stress = kirchhoff_stress(world, body, &c, &f) * (1.0 / j);
            cauchy_stress_pa.push(world.frame.tensor_in_world(stress));
        }
    }
    Deformation { gradients: rows(&gradients), cauchy_stress_pa: rows(&cauchy_stress_pa) }
}

fn rows(matrices: &[Mat3<f64>]) -> Vec<[[f64; 3]; 3]> {
    matrices.iter().map(|m| [0, 1, 2].map(|i| [0, 1, 2].map(|j| m.at(i, j)))).collect()
}

fn mean_force(frame: &GridFrame, impulse: &Impulse, frame_seconds: f64) -> ContactForce {
    let mean = |impulse: DVec3| frame.vector_in_world(impulse / frame_seconds);
    ContactForce { force_n: mean(impulse.linear), torque_n_m: mean(impulse.angular) }
}

/// Kirchhoff stress [Pa] of a particle.
fn kirchhoff_stress(world: &PreparedWorld, body: &PreparedBody, c: &Mat3<f64>, f: &Mat3<f64>) -> Mat3<f64> {
    // So short that nothing moves [s]: only the law's stress remains.
    let instant = 1e-12;
    let rules = world.rules;
    with_law!(body.material, L => L::<f64>::new(&body.coefficients, rules).update(instant, c, f).tau)
}

/// J of a particle.
fn volume_ratio(body: &PreparedBody, f: &Mat3<f64>) -> f64 {
    match body.material {
        Material::Newtonian { .. } => f.at(0, 0),
        _ => f.det(),
    }
}

/// Von Mises stress [Pa] and J of a particle.
fn stress_of(world: &PreparedWorld, body: &PreparedBody, c: &Mat3<f64>, f: &Mat3<f64>) -> (f32, f32) {
    let tau = kirchhoff_stress(world, body, c, f);
    let j = volume_ratio(body, f);
    let deviator = tau.add_diagonal(-tau.trace() / 3.0);
    let von_mises = (1.5 * deviator.double_dot(&deviator)).sqrt() / j;
    (von_mises as f32, j as f32)
}

fn in_f64<R: Scalar>(m: &Mat3<R>) -> Mat3<f64> {
    Mat3(m.0.map(|x| x.lane(0)))
}
