#!/usr/bin/env python3
"""Makes the scene that comes with gic (`crates/gic/demo`): a soft tabby cat without a mirror plane.

    VENV/bin/python scripts/make_demo.py --generator FOLDER -o SCENE

FOLDER holds the generator (`bench_sim.py`, `bench_render.py`); its README says how the virtual environment is made,
whose interpreter runs this script. The cat is .55 m long; grid cells of 30 mm, eight cameras and eleven frames keep
`gic demo` short. Making it takes a minute on two cores, whose sums differ in their last digits from one time to the
next.
"""

import argparse
import os
import shutil
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from make_suite import environment

CELL_M, FRAMES, PICTURE = 0.03, 11, 300
MARGIN = 0.12  # of the pictures' width, that no frame's body enters
YOUNGS_MODULUS_PA, POISSONS_RATIO = 4e4, 0.3
VELOCITY_M_S, FIRST_CONTACT_FRAME = np.array([0.3, -1.6, -0.25]), 3.4
TILT = np.array([1.0, 0.16, 0.35, -0.22])  # a quaternion, w first, not normalised
CAMERA_RINGS = [(27, 30, 3), (42, 90, 3), (64, 0, 2)]  # elevation, first azimuth [degrees], cameras
GROUND_TRUTH_FRAMES = (0, 5, 10)  # the others are large and only the report of a truth needs them

# The cat sits, y is up and x its front [m]: (one end, other end, radius at the one, radius at the other).
LIMBS = [
    ((-0.035, -0.10, 0.0), (0.03, 0.06, 0.0), 0.108, 0.078),  # trunk
    ((0.075, 0.165, 0.01), (0.085, 0.165, 0.01), 0.078, 0.078),  # head
    ((0.135, 0.14, 0.013), (0.15, 0.135, 0.013), 0.042, 0.038),  # muzzle
    ((0.06, 0.22, 0.058), (0.045, 0.285, 0.075), 0.042, 0.03),  # ears, one of them hanging
    ((0.07, 0.21, -0.05), (0.085, 0.255, -0.105), 0.042, 0.032),
    ((0.06, 0.0, 0.06), (0.115, -0.165, 0.06), 0.045, 0.038),  # front legs, one of them raised
    ((0.06, 0.01, -0.06), (0.19, -0.02, -0.095), 0.045, 0.04),
    ((-0.02, -0.175, 0.085), (0.085, -0.185, 0.11), 0.045, 0.04),  # hind legs
    ((-0.02, -0.175, -0.085), (0.09, -0.175, -0.095), 0.045, 0.04),
    ((-0.11, -0.16, 0.0), (-0.21, -0.155, 0.05), 0.045, 0.042),  # tail
    ((-0.21, -0.155, 0.05), (-0.275, -0.08, 0.085), 0.042, 0.04),
    ((-0.275, -0.08, 0.085), (-0.285, 0.02, 0.075), 0.04, 0.038),
]


def is_inside(points):
    """Whether each point [m] of the cat's own frame lies in one of its limbs."""
    found = np.zeros(len(points), bool)
    for start, end, first, last in LIMBS:
        start, along = np.array(start), np.subtract(end, start)
        share = np.clip((points - start) @ along / (along @ along), 0, 1)
        distance = np.linalg.norm(points - (start + share[:, None] * along), axis=1)
        found |= distance < first + share * (last - first)
    return found


def fur(points, _seed):
    """Linear colours of points [m] of the cat's own frame, as the renderer asks for them."""
    x, y, z = points.T
    stripes = np.sin(2 * np.pi * (y + 0.35 * x + 0.008 * np.sin(60 * z)) / 0.055)
    dark = (0.5 + 0.5 * np.tanh(2 * stripes))[:, None]
    colour = (1 - dark) * np.array([0.66, 0.30, 0.075]) + dark * np.array([0.32, 0.115, 0.025])

    def painted(under, share, over):
        share = np.clip(share, 0, 1)[:, None]
        return (1 - share) * under + share * np.array(over)

    def near(place, radius):
        return 1.5 - np.linalg.norm(points - np.array(place), axis=1) / (radius / 1.5)

    white = (0.75, 0.71, 0.64)
    chest = np.minimum((x - 0.025 + 0.25 * (y + 0.05)) / 0.02, (0.06 - np.abs(z)) / 0.02)
    colour = painted(colour, np.where(y < 0.11, chest, 0), white)
    places = [((0.115, -0.175, 0.06), 0.06), ((0.19, -0.02, -0.095), 0.065), ((0.09, -0.185, 0.11), 0.06)]
    places += [((0.095, -0.175, -0.095), 0.06), ((-0.285, 0.03, 0.075), 0.065), ((0.16, 0.13, 0.013), 0.055)]
    for place, radius in places:
        colour = painted(colour, near(place, radius), white)
    for side in (-1, 1):
        colour = painted(colour, near((0.15, 0.195, 0.01 + 0.042 * side), 0.024), (0.05, 0.16, 0.03))
    return painted(colour, near((0.19, 0.145, 0.013), 0.018), (0.62, 0.25, 0.24))


def rotation(quaternion):
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    rows = [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)]]
    rows += [[2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)]]
    return np.array(rows + [[2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


def cat(frame_rate):
    """Particles in the world and in the cat's own frame [m], its rotation, velocity [m/s] and time of contact [s]."""
    spacing = CELL_M / 2
    axis = np.arange(-0.36, 0.36, spacing) + spacing / 2
    lattice = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    body = lattice[is_inside(lattice)]
    turned = rotation(TILT)
    world = body @ turned.T
    contact = FIRST_CONTACT_FRAME / frame_rate
    world -= world.mean(0) + [0.6 * VELOCITY_M_S[0] * contact, 0, 0.6 * VELOCITY_M_S[2] * contact]
    height = -VELOCITY_M_S[1] * contact + 0.5 * 9.8 * contact**2 + CELL_M
    world[:, 1] += height - world[:, 1].min()
    return world, body, turned, VELOCITY_M_S, contact


def rig(target, radius):
    """Poses that look at the target, in OpenGL's axes."""
    poses = []
    for elevation, first, count in CAMERA_RINGS:
        for azimuth in first + 360 / count * np.arange(count):
            up, around = np.deg2rad([elevation, azimuth])
            back = np.array([np.cos(up) * np.cos(around), np.sin(up), np.cos(up) * np.sin(around)])
            right = np.cross([0, 1, 0], back)
            right /= np.linalg.norm(right)
            poses.append(np.column_stack([right, np.cross(back, right), back, target + radius * back]))
    return poses


def simulate(generator, folder):
    import bench_sim

    bench_sim.DX, bench_sim.SPACING = CELL_M, CELL_M / 2
    law = ("elastic", "tabby", {"E": YOUNGS_MODULUS_PA, "nu": POISSONS_RATIO})
    bench_sim.scene_table = lambda: {"demo": law}
    bench_sim.make_object = lambda *_: cat(bench_sim.FPS)
    reference = bench_sim.Reference
    bench_sim.Reference = lambda *words, **settings: reference(*words, dx=CELL_M, **settings)
    simulator = str(generator / "ref" / "mpm_simulator.py")
    options = SimpleNamespace(out=folder, ref=simulator, frames=FRAMES, substeps=bench_sim.SUBSTEPS, threads=2)
    bench_sim.run_scene("demo", options)


def render(folder):
    os.environ.update(environment())
    import bench_render

    bench_render.rig, bench_render.material_colour, bench_render.MARGIN = rig, fur, MARGIN
    bench_render.contact_sheet = lambda *_: None
    options = SimpleNamespace(size=PICTURE, spp=36, shadow_blur=2.5, mesh=False, sheet=None)
    bench_render.render_scene(f"{folder}/demo", options)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--generator", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="SCENE")
    options = parser.parse_args()
    if options.out.exists():
        parser.error(f"{options.out} is there already")
    sys.path.insert(0, str(options.generator.resolve()))
    with tempfile.TemporaryDirectory() as folder:
        simulate(options.generator.resolve(), folder)
        render(folder)
        for path in Path(folder, "demo", "gt").glob("*.npz"):
            if path.stem not in [f"particles_{frame}" for frame in GROUND_TRUTH_FRAMES]:
                path.unlink()
        shutil.move(Path(folder, "demo"), options.out)


if __name__ == "__main__":
    main()
