//! The readable engine: one particle at a time, in f64 (the oracle of all checks) or f32 (the scalar twin of the fast
//! engine).
//!
//! A substep (paper section 4.3, in the order of the published simulator), with node offsets d = x_i - x_p,
//! D = 4 / dx^2, rest volume V, particle mass m (both with the particle's own factor):
//!
//! ```text
//! law:   F', tau = law(dt, C, F)          A = m C - dt V D tau
//! p2g:   m_i = sum w m                    p_i = sum w (m v + A d)
//! grid:  v_i = p_i / m_i + dt g, obstacles
//! g2p:   v' = sum w v_i                   C' = D sum w v_i d^T              x' = x + dt v'
//! ```
//!
//! Backward, the bar of a number is the derivative of the loss with respect to it, and w' the gradient of a weight with
//! respect to x. From the bars of x', v', C', F' to those of x, v, C, F:
//!
//! ```text
//! g2p:   v'_bar += dt x'_bar              v_i_bar = sum w (v'_bar + D C'_bar d)
//!        x_bar = x'_bar + sum w' v_i . (v'_bar + D C'_bar d) - D C'_bar^T v'
//! grid:  p_i_bar = v_i_bar / m_i          m_i_bar = -p_i_bar . p_i / m_i          (v_i_bar through the obstacles)
//! p2g:   A_bar = sum w p_i_bar d^T        v_bar = m sum w p_i_bar
//!        x_bar += sum w' ((m v + A d) . p_i_bar + m m_i_bar) - A^T sum w p_i_bar
//! law:   C_bar, F_bar = law_adjoint(F'_bar, -dt V D A_bar)                        C_bar += m A_bar
//! ```

use gic_simd::{Real, Scalar};

use super::engine::{Bars, Engine, Segment};
use super::grid::{GridBox, Node};
use super::grid_update::Impulse;
use super::prepared_world::{PreparedBody, PreparedWorld};
use super::violation::Violation;
use crate::laws::law::Law;
use crate::laws::with_law;
use crate::math::mat3::Mat3;
use crate::substep::state::State;
use crate::substep::stencil;

/// Margin of the grid around the particles, in cells: rounding of f32 may put a particle into the neighbour of the cell
/// that f64 puts it in. Derived: 2^16 cells from the origin f32 resolves a 128th of a cell.
const ROUNDING_MARGIN_CELLS: f64 = 0.01;

/// The engine; `R` is f64 or f32.
pub(crate) struct ScalarEngine<R>(core::marker::PhantomData<R>);

impl<R> ScalarEngine<R> {
    pub(crate) fn new() -> Self {
        Self(core::marker::PhantomData)
    }
}

impl<R: Scalar> Engine for ScalarEngine<R> {
    type Number = R;
    type Tape = (Vec<State<R>>, Segment);

    fn advance(
        &self,
        world: &PreparedWorld,
        state: &mut State<R>,
        segment: Segment,
        impulses: &mut [Impulse],
    ) -> Result<(), Violation> {
        (0..segment.substeps).try_for_each(|i| Substep::new(world, segment, i, state)?.forward(state, impulses))
    }

    fn record(&self, world: &PreparedWorld, state: &State<R>, segment: Segment) -> Result<Self::Tape, Violation> {
        let mut states = Vec::with_capacity(segment.substeps + 1);
        states.push(state.clone());
        let mut ignored = vec![Impulse::default(); world.colliders.len()];
        for i in 0..segment.substeps {
            let mut next = states[i].clone();
            Substep::new(world, segment, i, &next)?.forward(&mut next, &mut ignored)?;
            states.push(next);
        }
        Ok((states, segment))
    }

    fn reverse(&self, world: &PreparedWorld, (states, segment): Self::Tape, adjoint: &mut State<R>, bars: &mut Bars) {
        for (i, pair) in states.windows(2).enumerate().rev() {
            // The forward pass already went through this state, so its extent is known to be fine.
            if let Ok(substep) = Substep::new(world, segment, i, &pair[0]) {
                substep.backward(&pair[0], &pair[1], adjoint, bars);
            }
        }
    }

    fn is_parallel(&self) -> bool {
        false
    }

    fn tape_bytes(&self, particles: usize, _nodes: usize, substeps: usize) -> usize {
        State::<R>::bytes(particles) * (substeps + 1)
    }
}

/// The 27 nodes around a particle.
struct Stencil<R> {
    base: [usize; 3],
    offset: [R; 3],
    weights: [[R; 3]; 3],
    slopes: [[R; 3]; 3],
}

/// One node of a stencil as its particle sees it.
struct Neighbour<R> {
    index: usize,
    weight: R,
    /// Derivative of the weight with respect to the particle's position, in units of 1 / dx.
    slope: [R; 3],
    /// x_i - x_p, in units of dx.
    d: [R; 3],
}

impl<R: Scalar> Stencil<R> {
    fn neighbours(&self, extent: &GridBox) -> impl Iterator<Item = Neighbour<R>> {
        let (w, s) = (&self.weights, &self.slopes);
        (0..27).map(move |n| {
            let [i, j, k] = [n / 9, n / 3 % 3, n % 3];
            Neighbour {
                index: extent.index(self.base[0] + i, self.base[1] + j, self.base[2] + k),
                weight: w[0][i] * w[1][j] * w[2][k],
                slope: [s[0][i] * w[1][j] * w[2][k], w[0][i] * s[1][j] * w[2][k], w[0][i] * w[1][j] * s[2][k]],
                d: [
                    R::splat(i as f64) - self.offset[0],
                    R::splat(j as f64) - self.offset[1],
                    R::splat(k as f64) - self.offset[2],
                ],
            }
        })
    }
}

/// One substep at one time on one grid.
struct Substep<'a, R> {
    world: &'a PreparedWorld,
    extent: GridBox,
    time: f64,
    dt: f64,
    /// 1 / dx and D dx = 4 / dx (offsets are in units of dx).
    inverse_dx: R,
    apic: R,
}

impl<'a, R: Scalar> Substep<'a, R> {
    fn new(world: &'a PreparedWorld, segment: Segment, index: usize, state: &State<R>) -> Result<Self, Violation> {
        Ok(Self {
            world,
            extent: world.extent(state, 0.0, ROUNDING_MARGIN_CELLS)?,
            time: segment.time(index),
            dt: segment.dt,
            inverse_dx: R::splat(1.0 / world.spacing),
            apic: R::splat(4.0 / world.spacing),
        })
    }

    fn stencil(&self, position: [R; 3]) -> Stencil<R> {
        let mut base = [0; 3];
        let mut offset = [R::zero(); 3];
        for axis in 0..3 {
            let (node, within) = stencil::base_and_offset(position[axis] * self.inverse_dx);
            base[axis] = (node.lane(0) as i32 - self.extent.first[axis]) as usize;
            offset[axis] = within;
        }
        Stencil { base, offset, weights: offset.map(stencil::weights), slopes: offset.map(stencil::slopes) }
    }

    /// The factor from tau to its part of A, times dx because offsets are in units of dx.
    fn stress_factor(&self, body: &PreparedBody) -> R {
        R::splat(-self.dt * body.volume * 4.0 / self.world.spacing)
    }

    /// The factor from C to its part of A, times dx likewise.
    fn inertia_factor(&self, body: &PreparedBody) -> R {
        R::splat(body.mass * self.world.spacing)
    }

    fn forward(&self, state: &mut State<R>, impulses: &mut [Impulse]) -> Result<(), Violation> {
        let mut grid = vec![[R::zero(); 4]; self.extent.nodes()];
        for body in &self.world.bodies {
            with_law!(body.material, L => self.p2g::<L<R>>(body, state, &mut grid));
        }
        self.update_grid(&mut grid, impulses);
        self.g2p(&grid, state)
    }

    /// Law and particle-to-grid transfer of one body; F becomes F'.
    fn p2g<L: Law<R>>(&self, body: &PreparedBody, state: &mut State<R>, grid: &mut [Node<R>]) {
        let law = L::new(&body.coefficients, self.world.rules);
        let dt = R::splat(self.dt);
        for (p, &factor) in body.range.clone().zip(&body.factors) {
            let factor = R::splat(factor);
            let mass = R::splat(body.mass) * factor;
            let updated = law.update(dt, &state.affine[p], &state.deformation[p]);
            state.deformation[p] = updated.f;
            let momentum = state.velocity[p].map(|v| v * mass);
            let affine =
                (state.affine[p] * self.inertia_factor(body)).add_scaled(self.stress_factor(body), &updated.tau);
            let affine = affine * factor;
            for n in self.stencil(state.position[p]).neighbours(&self.extent) {
                let carried = add(momentum, affine.times_vec(n.d));
                let node = &mut grid[n.index];
                for axis in 0..3 {
                    node[axis] += n.weight * carried[axis];
                }
                node[3] += n.weight * mass;
            }
        }
    }

    fn update_grid(&self, grid: &mut [Node<R>], impulses: &mut [Impulse]) {
        let update = self.world.grid_update(self.extent, self.time, self.dt);
        for (x, plane) in grid.chunks_exact_mut(self.extent.plane()).enumerate() {
            update.forward_plane(x, plane, impulses);
        }
    }

    /// Grid-to-particle transfer and motion.
    fn g2p(&self, grid: &[Node<R>], state: &mut State<R>) -> Result<(), Violation> {
        let dt = R::splat(self.dt);
        let limit = (self.world.spacing / self.dt).powi(2);
        for p in 0..state.len() {
            let mut velocity = [R::zero(); 3];
            let mut affine = Mat3::zero();
            for n in self.stencil(state.position[p]).neighbours(&self.extent) {
                let v = weighted_velocity(&grid[n.index], n.weight);
                velocity = add(velocity, v);
                affine += outer(v, n.d);
            }
            state.velocity[p] = velocity;
            state.affine[p] = affine * self.apic;
            for axis in 0..3 {
                state.position[p][axis] += dt * velocity[axis];
            }
            // Phrased so that NaN is too fast.
            let slow_enough = state.velocity_of(p).length_squared() <= limit;
            if !slow_enough {
                return Err(Violation::too_fast(state, p));
            }
        }
        Ok(())
    }

    /// The reverse of [`Self::forward`] from `before` to `after`: `adjoint` goes from that of `after` to that of
    /// `before`.
    fn backward(&self, before: &State<R>, after: &State<R>, adjoint: &mut State<R>, bars: &mut Bars) {
        let mut momenta = vec![[R::zero(); 4]; self.extent.nodes()];
        let mut recomputed = before.clone();
        for body in &self.world.bodies {
            with_law!(body.material, L => self.p2g::<L<R>>(body, &mut recomputed, &mut momenta));
        }
        let mut velocities = momenta.clone();
        self.update_grid(&mut velocities, &mut vec![Impulse::default(); self.world.colliders.len()]);

        let mut grid_bar = vec![[R::zero(); 4]; self.extent.nodes()];
        self.g2p_adjoint(before, after, &velocities, adjoint, &mut grid_bar);

        let update = self.world.grid_update(self.extent, self.time, self.dt);
        let planes = momenta.chunks_exact(self.extent.plane()).zip(grid_bar.chunks_exact_mut(self.extent.plane()));
        for (x, (plane, plane_bar)) in planes.enumerate() {
            update.adjoint_plane(x, plane, plane_bar);
        }
        for index in 0..self.world.bodies.len() {
            let material = self.world.bodies[index].material;
            with_law!(material, L => self.p2g_adjoint::<L<R>>(index, before, &grid_bar, adjoint, bars));
        }
    }

    /// Reads the adjoints of x', v', C'; leaves that of x (as far as it comes from here), and scatters those of the
    /// grid velocities.
    fn g2p_adjoint(
        &self,
        before: &State<R>,
        after: &State<R>,
        velocities: &[Node<R>],
        adjoint: &mut State<R>,
        grid_bar: &mut [Node<R>],
    ) {
        let dt = R::splat(self.dt);
        for p in 0..before.len() {
            let mut position_bar = adjoint.position[p];
            let velocity_bar = add(adjoint.velocity[p], position_bar.map(|x| x * dt));
            let affine_bar = adjoint.affine[p] * self.apic;
            for n in self.stencil(before.position[p]).neighbours(&self.extent) {
                let node_bar = add(velocity_bar, affine_bar.times_vec(n.d));
                let node = &velocities[n.index];
                let along = dot(node_bar, [node[0], node[1], node[2]]) * self.inverse_dx;
                for axis in 0..3 {
                    grid_bar[n.index][axis] += n.weight * node_bar[axis];
                    position_bar[axis] += n.slope[axis] * along;
                }
            }
            // d depends on x too, and sum w v_i is the new velocity.
            let through_d = affine_bar.transpose().times_vec(after.velocity[p]);
            for axis in 0..3 {
                position_bar[axis] -= self.inverse_dx * through_d[axis];
            }
            adjoint.position[p] = position_bar;
        }
    }

    /// Reads the adjoints of the grid's momenta and masses and of F'; completes that of x and leaves those of v, C, F.
    fn p2g_adjoint<L: Law<R>>(
        &self,
        index: usize,
        before: &State<R>,
        grid_bar: &[Node<R>],
        adjoint: &mut State<R>,
        bars: &mut Bars,
    ) {
        let (body, body_bars) = (&self.world.bodies[index], &mut bars.bodies[index]);
        let law = L::new(&body.coefficients, self.world.rules);
        let dt = R::splat(self.dt);
        for (p, &factor) in body.range.clone().zip(&body.factors) {
            let factor = R::splat(factor);
            let mass = R::splat(body.mass) * factor;
            let (stress, inertia) = (self.stress_factor(body) * factor, self.inertia_factor(body) * factor);
            let (velocity, c, f) = (before.velocity[p], &before.affine[p], &before.deformation[p]);
            let tau = law.update(dt, c, f).tau;
            let momentum = velocity.map(|v| v * mass);
            let affine = (*c * inertia).add_scaled(stress, &tau);

            let mut momentum_bar = [R::zero(); 3];
            let mut affine_bar = Mat3::zero();
            let mut mass_bar = R::zero();
            let mut position_bar = [R::zero(); 3];
            for n in self.stencil(before.position[p]).neighbours(&self.extent) {
                let bar = &grid_bar[n.index];
                let weighted = weighted_velocity(bar, n.weight);
                momentum_bar = add(momentum_bar, weighted);
                affine_bar += outer(weighted, n.d);
                mass_bar += n.weight * bar[3];
                let along = dot(add(momentum, affine.times_vec(n.d)), [bar[0], bar[1], bar[2]]) + mass * bar[3];
                position_bar = add(position_bar, n.slope.map(|s| s * along));
            }
            let through_d = affine.transpose().times_vec(momentum_bar);
            for axis in 0..3 {
                adjoint.position[p][axis] += self.inverse_dx * (position_bar[axis] - through_d[axis]);
            }
            adjoint.velocity[p] = momentum_bar.map(|b| b * mass);

            let law_bar = law.update_adjoint(dt, c, f, &adjoint.deformation[p], &(affine_bar * stress));
            adjoint.affine[p] = law_bar.c.add_scaled(inertia, &affine_bar);
            adjoint.deformation[p] = law_bar.f;

            for (sum, bar) in body_bars.coefficients.iter_mut().zip(law_bar.coefficients) {
                *sum += bar.lane(0);
            }
            let through_inertia = R::splat(self.world.spacing) * affine_bar.double_dot(c);
            let by_mass = mass_bar + dot(momentum_bar, velocity) + through_inertia;
            let through_stress = stress * affine_bar.double_dot(&tau);
            body_bars.mass += (factor * by_mass).lane(0);
            body_bars.volume += through_stress.lane(0) / body.volume;
            bars.factors[p] += (R::splat(body.mass) * by_mass + through_stress / factor).lane(0);
        }
    }
}

#[inline(always)]
fn add<R: Real>(a: [R; 3], b: [R; 3]) -> [R; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
fn dot<R: Real>(a: [R; 3], b: [R; 3]) -> R {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn outer<R: Real>(a: [R; 3], b: [R; 3]) -> Mat3<R> {
    Mat3::from_fn(|i, j| a[i] * b[j])
}

#[inline(always)]
fn weighted_velocity<R: Real>(node: &Node<R>, weight: R) -> [R; 3] {
    [node[0] * weight, node[1] * weight, node[2] * weight]
}
