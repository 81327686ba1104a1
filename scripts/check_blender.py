"""Opens files that `gic export` wrote in Blender, without its window, and compares what it shows with gic's simulation.

    pip install bpy numpy
    python3 scripts/check_blender.py RUN/prediction surface.ply surface.obj particles.ply twin.glb twin.usda

(PyPI's bpy wants the Python version that Blender has: pip names it.) The first argument is the folder with gic's
trajectory.json. Wanted of every file: vertices, and where the file has a motion, as many frames; in every frame the
same bounds to 20 mm, in gic's axes.
"""

import json
import pathlib
import sys

import bpy
import numpy

TOLERANCE_M = 0.02
READERS = {
    "ply": lambda path: bpy.ops.wm.ply_import(filepath=path, forward_axis="Y", up_axis="Z"),
    "obj": lambda path: bpy.ops.wm.obj_import(filepath=path, forward_axis="Y", up_axis="Z"),
    "stl": lambda path: bpy.ops.wm.stl_import(filepath=path, forward_axis="Y", up_axis="Z"),
    "glb": lambda path: bpy.ops.import_scene.gltf(filepath=path),
    "usda": lambda path: bpy.ops.wm.usd_import(filepath=path, import_guide=True),
}
# Blender has z up, and turns what says that y is.
TURNED = {"glb", "usda"}


def points_of(kind):
    """Per object of the scene, its points in the world at the current frame, in gic's axes."""
    graph = bpy.context.evaluated_depsgraph_get()
    found = {}
    for item in bpy.context.scene.objects:
        if item.type not in ("MESH", "POINTCLOUD") or item.name.startswith("Obstacle"):
            continue
        shown = item.evaluated_get(graph)
        data = shown.data
        count = len(data.vertices if item.type == "MESH" else data.points)
        points = numpy.empty(3 * count, numpy.float32)
        if item.type == "MESH":
            data.vertices.foreach_get("co", points)
        else:
            data.attributes["position"].data.foreach_get("vector", points)
        matrix = numpy.array(shown.matrix_world)
        points = points.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
        found[item.name] = points[:, [0, 2, 1]] * [1, 1, -1] if kind in TURNED else points
    return found


def check(path, frames, rate):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    kind = path.rsplit(".", 1)[-1]
    READERS[kind](str(pathlib.Path(path).resolve()))
    scene = bpy.context.scene
    # glTF counts its frames by the scene's rate; USD sets the scene's.
    moves = kind in TURNED
    first = points_of(kind)
    assert first, f"{path}: Blender shows nothing"
    worst = dict.fromkeys(first, 0.0)
    for index, frame in enumerate(frames if moves else frames[:1]):
        time = index / rate * scene.render.fps / scene.render.fps_base if kind == "glb" else index
        scene.frame_set(int(time), subframe=time - int(time))
        for name, points in points_of(kind).items():
            low, high = points.min(0), points.max(0)
            apart = max(abs(low - frame["low_m"]).max(), abs(high - frame["high_m"]).max())
            worst[name] = max(worst[name], apart)
            assert apart < TOLERANCE_M, f"{path}: {name}, frame {index}: bounds are {1e3 * apart:.1f} mm from gic's"
    motion = f"{len(frames)} frames" if moves else "still"
    found = [f"{name}: {len(points)} points, {motion}, bounds within {1e3 * worst[name]:.1f} mm" for name, points in first.items()]
    print(f"{path}: Blender {bpy.app.version_string}: " + "; ".join(found))


def main(folder, paths):
    trajectory = json.loads((pathlib.Path(folder) / "trajectory.json").read_text())
    failed = False
    for path in paths:
        try:
            check(path, trajectory["frames"], trajectory["twin"].get("frame_rate_hz", 24.0))
        except AssertionError as error:
            print(f"FAILED: {error}")
            failed = True
    return failed


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2:]))
