//! The grid update: from the nodes' momenta to their velocities, forward and backward.
//!
//! Where the mass m of a node exceeds the gate, v = p / m + dt g, then each obstacle that contains the node acts in
//! turn; elsewhere v = 0.

use gic_simd::Scalar;
use glam::{DVec3, IVec3};

use super::grid::{GridBox, Node};
use crate::colliders::collider::{PosedCollider, Touch};

/// Momentum [N s] and angular momentum [N m s] given to an obstacle, the latter about the obstacle's origin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Impulse {
    pub(crate) linear: DVec3,
    pub(crate) angular: DVec3,
}

impl core::ops::AddAssign for Impulse {
    fn add_assign(&mut self, other: Self) {
        self.linear += other.linear;
        self.angular += other.angular;
    }
}

/// What the velocity update of one substep needs.
pub(crate) struct GridUpdate<'a> {
    pub(crate) extent: GridBox,
    /// Grid spacing [m].
    pub(crate) spacing: f64,
    /// Length of the substep [s].
    pub(crate) dt: f64,
    /// Gravity [m/s^2].
    pub(crate) gravity: DVec3,
    /// The unit of the nodes' masses [kg].
    pub(crate) mass_unit: f64,
    /// Nodes with less mass than this [mass units] stay at rest.
    pub(crate) mass_gate: f64,
    /// The obstacles where they are at the start of the substep.
    pub(crate) colliders: Vec<PosedCollider<'a>>,
}

impl GridUpdate<'_> {
    fn node_position(&self, x: usize, y: usize, z: usize) -> DVec3 {
        (self.extent.first + IVec3::new(x as i32, y as i32, z as i32)).as_dvec3() * self.spacing
    }

    /// Turns the momenta of plane `x` into velocities, and adds what the obstacles took to `impulses`, one per
    /// obstacle.
    pub(crate) fn forward_plane<R: Scalar>(&self, x: usize, nodes: &mut [Node<R>], impulses: &mut [Impulse]) {
        let gate = R::splat(self.mass_gate);
        let kick = (self.gravity * self.dt).to_array().map(R::splat);
        for (row, y) in nodes.chunks_exact_mut(self.extent.size[2]).zip(0..) {
            let mut clearance = Clearance::unknown();
            for (node, z) in row.iter_mut().zip(0..) {
                let mass = node[3];
                if !gate.lt(mass) {
                    *node = [R::zero(), R::zero(), R::zero(), mass];
                    continue;
                }
                let inverse = R::one() / mass;
                for axis in 0..3 {
                    node[axis] = node[axis] * inverse + kick[axis];
                }
                if clearance.holds(self, [x, y, z]) {
                    continue;
                }
                let before = vector(node);
                let after = self.collide(self.node_position(x, y, z), before, mass.lane(0), impulses);
                if after != before {
                    *node = [R::splat(after.x), R::splat(after.y), R::splat(after.z), mass];
                }
            }
        }
    }

    /// The adjoint of [`Self::forward_plane`]: `nodes` holds momenta and masses; `adjoints` holds the adjoint of the
    /// velocities (its fourth number is ignored) and receives that of momenta and masses.
    pub(crate) fn adjoint_plane<R: Scalar>(&self, x: usize, nodes: &[Node<R>], adjoints: &mut [Node<R>]) {
        let gate = R::splat(self.mass_gate);
        let kick = (self.gravity * self.dt).to_array().map(R::splat);
        let rows = nodes.chunks_exact(self.extent.size[2]).zip(adjoints.chunks_exact_mut(self.extent.size[2]));
        for ((row, row_bar), y) in rows.zip(0..) {
            let mut clearance = Clearance::unknown();
            for ((node, bar), z) in row.iter().zip(row_bar).zip(0..) {
                let mass = node[3];
                if !gate.lt(mass) {
                    *bar = [R::zero(); 4];
                    continue;
                }
                let inverse = R::one() / mass;
                let free = [node[0] * inverse, node[1] * inverse, node[2] * inverse];
                let mut velocity_bar = [bar[0], bar[1], bar[2]];
                if !clearance.holds(self, [x, y, z]) {
                    let before = vector(&[free[0] + kick[0], free[1] + kick[1], free[2] + kick[2], mass]);
                    let after_bar = vector(bar);
                    let before_bar = collide_adjoint(&self.colliders, self.node_position(x, y, z), before, after_bar);
                    if before_bar != after_bar {
                        velocity_bar = before_bar.to_array().map(R::splat);
                    }
                }
                let [px, py, pz] = velocity_bar.map(|v| v * inverse);
                *bar = [px, py, pz, -(px * free[0] + py * free[1] + pz * free[2])];
            }
        }
    }

    /// Velocity of a node of that mass [mass units] after all obstacles.
    fn collide(&self, point: DVec3, velocity: DVec3, mass: f64, impulses: &mut [Impulse]) -> DVec3 {
        let mut velocity = velocity;
        for (posed, impulse) in self.colliders.iter().zip(impulses) {
            if let Some(touch) = posed.touch(point) {
                let after = respond(posed, &touch, velocity);
                let taken = (velocity - after) * (mass * self.mass_unit);
                *impulse += Impulse { linear: taken, angular: (point - posed.pose.position).cross(taken) };
                velocity = after;
            }
        }
        velocity
    }
}

/// How far along a row of nodes no obstacle can be met: the nearest is at least as far away as its distance from a node
/// behind, less the way from there.
struct Clearance {
    /// The nodes of the row before this one are clear, from the last asked for on.
    end: usize,
}

impl Clearance {
    fn unknown() -> Self {
        Self { end: 0 }
    }

    /// Whether the node is out of reach of all obstacles; to be asked in ascending order of z.
    fn holds(&mut self, update: &GridUpdate<'_>, [x, y, z]: [usize; 3]) -> bool {
        if z >= self.end {
            let point = update.node_position(x, y, z);
            let nearest = update.colliders.iter().map(|posed| posed.clearance(point)).fold(f64::INFINITY, f64::min);
            // Casting saturates: no obstacle, no end; within an obstacle, none.
            self.end = z.saturating_add((nearest / update.spacing).ceil() as usize);
        }
        z < self.end
    }
}

fn respond(posed: &PosedCollider<'_>, touch: &Touch, velocity: DVec3) -> DVec3 {
    touch.wall_velocity + posed.collider.contact.respond(velocity - touch.wall_velocity, touch.normal)
}

/// Adjoint of the velocity before the obstacles, from that after.
fn collide_adjoint(colliders: &[PosedCollider<'_>], point: DVec3, velocity: DVec3, after_bar: DVec3) -> DVec3 {
    let Some((posed, rest)) = colliders.split_first() else { return after_bar };
    match posed.touch(point) {
        None => collide_adjoint(rest, point, velocity, after_bar),
        Some(touch) => {
            let middle_bar = collide_adjoint(rest, point, respond(posed, &touch, velocity), after_bar);
            posed.collider.contact.respond_adjoint(velocity - touch.wall_velocity, touch.normal, middle_bar)
        }
    }
}

fn vector<R: Scalar>(node: &Node<R>) -> DVec3 {
    DVec3::new(node[0].lane(0), node[1].lane(0), node[2].lane(0))
}
