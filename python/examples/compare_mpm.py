"""Taichi's published 3D MLS-MPM example (`taichi.examples.simulation.mpm3d`) and the same scene in gic, with times.

A cube of a fluid without viscosity, 8,192 particles, falls inside a box. gic's law stiffens in compression, where
Taichi's is linear in J; near J = 1 they are the same.
"""

import os
import time

import gic
import numpy as np


def walls(low, high):
    """Six planes without friction, which matter may leave."""
    inward = [(axis, sign) for axis in range(3) for sign in (1.0, -1.0)]
    planes = []
    for axis, sign in inward:
        normal = [0.0, 0.0, 0.0]
        normal[axis] = sign
        planes.append({"shape": "half_space", "point_m": [low if sign > 0 else high] * 3, "normal": normal,
                       "contact": "separating"})
    return planes


def main(frames=20):
    # On the CPU, as gic.
    os.environ["TI_ARCH"] = "x64"
    import taichi as ti
    from taichi.examples.simulation import mpm3d

    mpm3d.init()
    start = mpm3d.F_x.to_numpy().astype(np.float64)
    mpm3d.substep()
    mpm3d.init()
    mpm3d.F_x.from_numpy(start.astype(np.float32))
    begin = time.perf_counter()
    for _ in range(frames * mpm3d.steps):
        mpm3d.substep()
    ti.sync()
    taichi_s = time.perf_counter() - begin
    theirs = mpm3d.F_x.to_numpy().mean(axis=0)

    # d/dJ (J - J^-6) = 7 at J = 1.
    fluid = {"model": "newtonian", "viscosity_pa_s": 0.0, "bulk_modulus_pa": mpm3d.E / 7}
    body = gic.Body(fluid, start, (mpm3d.dx / 2) ** 3, mpm3d.p_rho)
    box = walls((mpm3d.bound - 1) * mpm3d.dx, 1 - (mpm3d.bound - 1) * mpm3d.dx)
    # Its substeps, however stiff the fluid is.
    simulator = gic.Simulator(body, box, mpm3d.dx, frame_rate_hz=1 / (mpm3d.steps * mpm3d.dt),
                              least_substeps_per_frame=mpm3d.steps, courant=0.999)
    begin = time.perf_counter()
    ours = simulator.rollout([frames]).positions_m[0].mean(axis=0)
    gic_s = time.perf_counter() - begin
    print(f"{frames * mpm3d.steps} substeps of {len(start)} particles: Taichi {taichi_s:.2f} s, gic {gic_s:.2f} s")
    print(f"centre of mass: Taichi {theirs.round(4)}, gic {ours.round(4)} m")
    return theirs, ours


if __name__ == "__main__":
    main()
