"""The scene in Taichi, differentiated by its automatic differentiation; every substep keeps its state for that."""

import numpy as np
import taichi as ti

from .scene import Scene


@ti.data_oriented
class Taichi:
    """Mean height at the end [m], and its derivative with respect to Young's modulus."""

    def __init__(self, scene: Scene, threads: int) -> None:
        ti.init(arch=ti.cpu, cpu_max_num_threads=threads, default_fp=ti.f32, log_level=ti.ERROR, offline_cache=False)
        self.count, self.substeps, self.nodes = scene.side**3, scene.substeps, scene.nodes
        self.dt, self.spacing, self.floor = scene.dt, scene.spacing, scene.floor
        self.mu_share, self.lam_share = scene.lame
        self.particle_volume, self.particle_mass = scene.volume, scene.density * scene.volume
        self.fall, self.speed = scene.dt * scene.gravity, scene.speed
        slots, n = scene.substeps + 1, (scene.nodes,) * 3
        self.x, self.v = (ti.Vector.field(3, ti.f32, (slots, self.count), needs_grad=True) for _ in range(2))
        self.C, self.F = (ti.Matrix.field(3, 3, ti.f32, (slots, self.count), needs_grad=True) for _ in range(2))
        self.momentum, self.velocity = (ti.Vector.field(3, ti.f32, (slots, *n), needs_grad=True) for _ in range(2))
        self.mass = ti.field(ti.f32, (slots, *n), needs_grad=True)
        self.modulus = ti.field(ti.f32, (), needs_grad=True)
        self.height = ti.field(ti.f32, (), needs_grad=True)
        self.modulus[None] = scene.youngs_modulus_pa
        self.start = scene.positions.astype(np.float32)

    def forward(self) -> float:
        """Two slots in turn: nothing is kept."""
        self._begin()
        for substep in range(self.substeps):
            now, then = substep % 2, 1 - substep % 2
            self._clear(0)
            self._substep(now, then, 0)
        self._mean_height(self.substeps % 2)
        return self.height[None]

    def gradient(self) -> float:
        self._begin()
        ti.ad.clear_all_gradients()
        for substep in range(self.substeps):
            self._clear(substep)
            self._substep(substep, substep + 1, substep)
        self._mean_height(self.substeps)
        self.height.grad[None] = 1.0
        self._mean_height.grad(self.substeps)
        for substep in reversed(range(self.substeps)):
            self._g2p.grad(substep, substep + 1, substep)
            self._grid.grad(substep)
            self._p2g.grad(substep, substep + 1, substep)
        return self.modulus.grad[None]

    def _substep(self, now: int, then: int, grid: int) -> None:
        self._p2g(now, then, grid)
        self._grid(grid)
        self._g2p(now, then, grid)

    def _begin(self) -> None:
        self.height[None] = 0.0
        self._set_start(self.start)

    @ti.kernel
    def _set_start(self, positions: ti.types.ndarray()):
        for p in range(self.count):
            self.x[0, p] = ti.Vector([positions[p, 0], positions[p, 1], positions[p, 2]])
            self.v[0, p] = ti.Vector([0.0, self.speed, 0.0])
            self.C[0, p] = ti.Matrix.zero(ti.f32, 3, 3)
            self.F[0, p] = ti.Matrix.identity(ti.f32, 3)

    @ti.kernel
    def _clear(self, grid: ti.i32):
        for i, j, k in ti.ndrange(*[self.nodes] * 3):
            self.momentum[grid, i, j, k] = ti.Vector([0.0, 0.0, 0.0])
            self.mass[grid, i, j, k] = 0.0

    @ti.func
    def _stencil(self, position):
        base = ti.cast(position / self.spacing - 0.5, ti.i32)
        within = position / self.spacing - ti.cast(base, ti.f32)
        weights = [0.5 * (1.5 - within) ** 2, 0.75 - (within - 1.0) ** 2, 0.5 * (within - 0.5) ** 2]
        return base, within, weights

    @ti.kernel
    def _p2g(self, now: ti.i32, then: ti.i32, grid: ti.i32):
        for p in range(self.count):
            base, within, w = self._stencil(self.x[now, p])
            F = (ti.Matrix.identity(ti.f32, 3) + self.dt * self.C[now, p]) @ self.F[now, p]
            self.F[then, p] = F
            modulus = self.modulus[None]
            mu, lam = modulus * self.mu_share, modulus * self.lam_share
            one = ti.Matrix.identity(ti.f32, 3)
            tau = mu * (F @ F.transpose() - one) + lam * ti.log(F.determinant()) * one
            mass = self.particle_mass
            affine = mass * self.C[now, p] - (self.dt * self.particle_volume * 4 / self.spacing**2) * tau
            for i, j, k in ti.static(ti.ndrange(3, 3, 3)):
                offset = (ti.Vector([i, j, k]).cast(ti.f32) - within) * self.spacing
                weight = w[i][0] * w[j][1] * w[k][2]
                node = base + ti.Vector([i, j, k])
                self.momentum[grid, node[0], node[1], node[2]] += weight * (mass * self.v[now, p] + affine @ offset)
                self.mass[grid, node[0], node[1], node[2]] += weight * mass

    @ti.kernel
    def _grid(self, grid: ti.i32):
        for i, j, k in ti.ndrange(*[self.nodes] * 3):
            v = ti.Vector([0.0, 0.0, 0.0])
            if self.mass[grid, i, j, k] > 0.0 and j > self.floor:
                v = self.momentum[grid, i, j, k] / self.mass[grid, i, j, k]
                v[1] += self.fall
            self.velocity[grid, i, j, k] = v

    @ti.kernel
    def _g2p(self, now: ti.i32, then: ti.i32, grid: ti.i32):
        for p in range(self.count):
            base, within, w = self._stencil(self.x[now, p])
            v, C = ti.Vector.zero(ti.f32, 3), ti.Matrix.zero(ti.f32, 3, 3)
            for i, j, k in ti.static(ti.ndrange(3, 3, 3)):
                offset = (ti.Vector([i, j, k]).cast(ti.f32) - within) * self.spacing
                node = base + ti.Vector([i, j, k])
                weighted = w[i][0] * w[j][1] * w[k][2] * self.velocity[grid, node[0], node[1], node[2]]
                v += weighted
                C += (4 / self.spacing**2) * weighted.outer_product(offset)
            self.v[then, p] = v
            self.C[then, p] = C
            self.x[then, p] = self.x[now, p] + self.dt * v

    @ti.kernel
    def _mean_height(self, slot: ti.i32):
        for p in range(self.count):
            self.height[None] += self.x[slot, p][1] / self.count
