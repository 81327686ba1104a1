"""The scene in Warp, differentiated by its tape; every substep keeps its state for that. Warp's CPU kernels run on one
thread."""

import numpy as np
import warp as wp

from .scene import Scene

wp.config.quiet = True


@wp.func
def weight(within: float, node: int) -> float:
    w = 0.75 - (within - 1.0) * (within - 1.0)
    if node == 0:
        w = 0.5 * (1.5 - within) * (1.5 - within)
    if node == 2:
        w = 0.5 * (within - 0.5) * (within - 0.5)
    return w


@wp.kernel
def p2g(
    x: wp.array(dtype=wp.vec3), v: wp.array(dtype=wp.vec3), C: wp.array(dtype=wp.mat33), F: wp.array(dtype=wp.mat33),
    modulus: wp.array(dtype=float), mu_share: float, lam_share: float, dt: float, spacing: float, volume: float,
    density: float, F_new: wp.array(dtype=wp.mat33), momentum: wp.array3d(dtype=wp.vec3),
    masses: wp.array3d(dtype=float),
):
    p = wp.tid()
    here = x[p] / spacing
    bx, by, bz = int(here[0] - 0.5), int(here[1] - 0.5), int(here[2] - 0.5)
    within = wp.vec3(here[0] - float(bx), here[1] - float(by), here[2] - float(bz))
    one = wp.identity(n=3, dtype=float)
    deformed = (one + dt * C[p]) * F[p]
    F_new[p] = deformed
    mu, lam = modulus[0] * mu_share, modulus[0] * lam_share
    tau = mu * (deformed * wp.transpose(deformed) - one) + lam * wp.log(wp.determinant(deformed)) * one
    mass = density * volume
    affine = mass * C[p] - (dt * volume * 4.0 / (spacing * spacing)) * tau
    for i in range(3):
        for j in range(3):
            for k in range(3):
                offset = wp.vec3(float(i) - within[0], float(j) - within[1], float(k) - within[2]) * spacing
                w = weight(within[0], i) * weight(within[1], j) * weight(within[2], k)
                wp.atomic_add(momentum, bx + i, by + j, bz + k, w * (mass * v[p] + affine * offset))
                wp.atomic_add(masses, bx + i, by + j, bz + k, w * mass)


@wp.kernel
def update_grid(
    momentum: wp.array3d(dtype=wp.vec3), masses: wp.array3d(dtype=float), floor: int, fall: float,
    velocity: wp.array3d(dtype=wp.vec3),
):
    i, j, k = wp.tid()
    if masses[i, j, k] > 0.0 and j > floor:
        velocity[i, j, k] = momentum[i, j, k] / masses[i, j, k] + wp.vec3(0.0, fall, 0.0)
    else:
        velocity[i, j, k] = wp.vec3(0.0, 0.0, 0.0)


@wp.kernel
def g2p(
    x: wp.array(dtype=wp.vec3), velocity: wp.array3d(dtype=wp.vec3), dt: float, spacing: float,
    x_new: wp.array(dtype=wp.vec3), v_new: wp.array(dtype=wp.vec3), C_new: wp.array(dtype=wp.mat33),
):
    p = wp.tid()
    here = x[p] / spacing
    bx, by, bz = int(here[0] - 0.5), int(here[1] - 0.5), int(here[2] - 0.5)
    within = wp.vec3(here[0] - float(bx), here[1] - float(by), here[2] - float(bz))
    v = wp.vec3(0.0, 0.0, 0.0)
    C = wp.mat33(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for i in range(3):
        for j in range(3):
            for k in range(3):
                offset = wp.vec3(float(i) - within[0], float(j) - within[1], float(k) - within[2]) * spacing
                w = weight(within[0], i) * weight(within[1], j) * weight(within[2], k)
                weighted = w * velocity[bx + i, by + j, bz + k]
                v = v + weighted
                C = C + (4.0 / (spacing * spacing)) * wp.outer(weighted, offset)
    v_new[p] = v
    C_new[p] = C
    x_new[p] = x[p] + dt * v


@wp.kernel
def add_heights(x: wp.array(dtype=wp.vec3), share: float, height: wp.array(dtype=float)):
    p = wp.tid()
    wp.atomic_add(height, 0, x[p][1] * share)


class Warp:
    """Mean height at the end [m], and its derivative with respect to Young's modulus."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.count = scene, scene.side**3
        slots, nodes = scene.substeps + 1, (scene.nodes,) * 3
        with wp.ScopedDevice("cpu"):
            self.x, self.v = ([wp.zeros(self.count, dtype=wp.vec3, requires_grad=True) for _ in range(slots)]
                              for _ in range(2))
            self.C, self.F = ([wp.zeros(self.count, dtype=wp.mat33, requires_grad=True) for _ in range(slots)]
                              for _ in range(2))
            self.momentum, self.velocity = ([wp.zeros(nodes, dtype=wp.vec3, requires_grad=True) for _ in range(slots)]
                                            for _ in range(2))
            self.masses = [wp.zeros(nodes, dtype=float, requires_grad=True) for _ in range(slots)]
            self.modulus = wp.array([scene.youngs_modulus_pa], dtype=float, requires_grad=True)
            self.height = wp.zeros(1, dtype=float, requires_grad=True)
        self.start = scene.positions.astype(np.float32)

    def forward(self) -> float:
        """Two slots in turn: nothing is kept."""
        self._begin()
        for substep in range(self.scene.substeps):
            self._substep(substep % 2, 1 - substep % 2, 0)
        return self._mean_height(self.scene.substeps % 2)

    def gradient(self) -> float:
        self._begin()
        tape = wp.Tape()
        with tape:
            for substep in range(self.scene.substeps):
                self._substep(substep, substep + 1, substep)
            self._mean_height(self.scene.substeps)
        tape.backward(self.height)
        found = float(self.modulus.grad.numpy()[0])
        tape.zero()
        return found

    def _begin(self) -> None:
        self.height.zero_()
        self.x[0].assign(self.start)
        self.v[0].fill_(wp.vec3(0.0, self.scene.speed, 0.0))
        self.C[0].zero_()
        self.F[0].fill_(wp.mat33(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0))

    def _substep(self, now: int, then: int, grid: int) -> None:
        s = self.scene
        self.momentum[grid].zero_()
        self.masses[grid].zero_()
        wp.launch(p2g, self.count, device="cpu", inputs=[
            self.x[now], self.v[now], self.C[now], self.F[now], self.modulus, *s.lame, s.dt, s.spacing, s.volume,
            s.density], outputs=[self.F[then], self.momentum[grid], self.masses[grid]])
        wp.launch(update_grid, (s.nodes,) * 3, device="cpu", inputs=[
            self.momentum[grid], self.masses[grid], s.floor, s.dt * s.gravity], outputs=[self.velocity[grid]])
        wp.launch(g2p, self.count, device="cpu", inputs=[self.x[now], self.velocity[grid], s.dt, s.spacing],
                  outputs=[self.x[then], self.v[then], self.C[then]])

    def _mean_height(self, slot: int) -> float:
        wp.launch(add_heights, self.count, device="cpu", inputs=[self.x[slot], 1.0 / self.count], outputs=[self.height])
        return float(self.height.numpy()[0])
