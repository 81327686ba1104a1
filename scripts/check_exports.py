"""Loads files that `gic export` wrote with the readers other tools use, and compares them with gic's own simulation.

    pip install trimesh meshio usd-core pygltflib numpy
    python3 scripts/check_exports.py RUN/prediction surface.obj surface.stl surface.ply particles.ply tetrahedra.msh \
        twin.glb twin.usda gaussians.usda gaussian-sequence/

The first argument is the folder with gic's trajectory.json. Wanted of every file: gic's mass to 1 permille (density
times volume, or the masses it states); closed surfaces; in every frame the same bounds to 20 mm; colours where any.
"""

import json
import pathlib
import sys

import numpy

TOLERANCE_M = 0.02


class Reference:
    def __init__(self, folder):
        content = json.loads((pathlib.Path(folder) / "trajectory.json").read_text())
        self.frames = content["frames"]
        self.density = content["twin"]["density_kg_m3"]
        first = self.frames[0]
        self.mass = numpy.linalg.norm(first["momentum_kg_m_s"]) / numpy.linalg.norm(first["velocity_m_s"])
        self.worst = 0.0

    def check_mass(self, path, mass):
        assert abs(mass / self.mass - 1) < 1e-3, f"{path}: {mass} kg, gic has {self.mass}"

    def check_bounds(self, path, index, points):
        """The bounds of what is drawn, against those of the particles."""
        frame = self.frames[index]
        assert numpy.isfinite(points).all(), f"{path}: frame {index} is not finite"
        apart = max(abs(points.min(0) - frame["low_m"]).max(), abs(points.max(0) - frame["high_m"]).max())
        assert apart < TOLERANCE_M, f"{path}: frame {index}: bounds are {1e3 * apart:.1f} mm from gic's"
        return apart


def tetrahedron_volumes(points, corners):
    a, b, c, d = points[corners].transpose(1, 0, 2)
    return numpy.einsum("ij,ij->i", numpy.cross(b - a, c - a), d - a) / 6


def check_surface(path, reference):
    import trimesh

    mesh = trimesh.load(path, process=path.endswith(".stl"))
    if isinstance(mesh, trimesh.PointCloud):
        reference.check_bounds(path, 0, mesh.vertices)
        masses = mesh.metadata["_ply_raw"]["vertex"]["data"]["mass"]
        reference.check_mass(path, masses.astype(float).sum())
        return f"{len(mesh.vertices)} particles, {masses.astype(float).sum():.4f} kg"
    assert mesh.is_watertight and mesh.is_winding_consistent, f"{path}: not closed"
    reference.check_mass(path, reference.density * mesh.volume)
    reference.check_bounds(path, 0, mesh.vertices)
    colors = "" if path.endswith(".stl") else f", {len(numpy.unique(mesh.visual.vertex_colors, axis=0))} colours"
    return f"{len(mesh.faces)} triangles, {reference.density * mesh.volume:.4f} kg{colors}"


def check_msh(path, reference):
    import meshio

    mesh = meshio.read(path)
    volumes = tetrahedron_volumes(mesh.points, mesh.cells_dict["tetra"])
    assert (volumes > 0).all(), f"{path}: a tetrahedron has no volume or is inside out"
    reference.check_mass(path, reference.density * volumes.sum())
    reference.check_bounds(path, 0, mesh.points)
    return f"{len(volumes)} tetrahedra, {reference.density * volumes.sum():.4f} kg"


def check_glb(path, reference):
    import pygltflib

    file = pygltflib.GLTF2().load(path)
    blob = file.binary_blob()

    def vectors(accessor):
        view = file.bufferViews[file.accessors[accessor].bufferView]
        return numpy.frombuffer(blob[view.byteOffset : view.byteOffset + view.byteLength], numpy.float32).reshape(-1, 3)

    primitive = file.meshes[0].primitives[0]
    rest = vectors(primitive.attributes.POSITION)
    reference.check_mass(path, file.extras["mass_kg"])
    assert primitive.attributes.COLOR_0 is None or vectors(primitive.attributes.COLOR_0).std() > 0
    targets = primitive.targets or []
    assert len(targets) == len(reference.frames) and len(file.animations) == 1, f"{path}: no motion"
    moved = [vectors(t["POSITION"] if isinstance(t, dict) else t.POSITION) for t in targets]
    apart = max(reference.check_bounds(path, i, rest + offsets) for i, offsets in enumerate(moved))
    return f"{len(rest)} vertices, {len(targets)} frames, bounds within {1e3 * apart:.1f} mm"


def check_usd(path, reference):
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(path)
    found = []
    splats = stage.GetPrimAtPath("/World/Gaussians")
    if splats:
        attribute = splats.GetAttribute("positions")
        at = {int(t): numpy.array(attribute.Get(t)) for t in attribute.GetTimeSamples()}
        apart = max(reference.check_bounds(path, index, points) for index, points in at.items())
        assert len(attribute.GetTimeSamples()) == len(reference.frames)
        return f"{splats.GetTypeName()}: {len(attribute.Get())} Gaussians, bounds within {1e3 * apart:.1f} mm"
    for name in ("Particles", "Volume", "Surface"):
        prim = stage.GetPrimAtPath(f"/World/Twin/{name}")
        if not prim:
            continue
        attribute = UsdGeom.PointBased(prim).GetPointsAttr()
        assert len(attribute.GetTimeSamples()) == len(reference.frames), f"{path}: {name} does not move"
        at = {int(t): numpy.array(attribute.Get(t)) for t in attribute.GetTimeSamples()}
        apart = max(reference.check_bounds(path, index, points) for index, points in at.items())
        found.append(f"{name} of {len(attribute.Get())} points within {1e3 * apart:.1f} mm")
        if name == "Particles":
            reference.check_mass(path, numpy.array(prim.GetAttribute("physics:masses").Get(), float).sum())
        if name == "Volume":
            corners = numpy.array(prim.GetAttribute("tetVertexIndices").Get())
            volumes = tetrahedron_volumes(numpy.array(attribute.Get(), float), corners)
            assert (volumes > 0).all(), f"{path}: a tetrahedron is inside out"
            reference.check_mass(path, reference.density * volumes.sum())
            reference.check_mass(path, prim.GetAttribute("omniphysics:mass").Get())
    assert found, f"{path}: holds no twin"
    return "; ".join(found)


def check_sequence(path, reference):
    import trimesh

    files = sorted(pathlib.Path(path).glob("frame_*.ply"))
    assert len(files) == len(reference.frames), f"{path}: {len(files)} files"
    apart = max(reference.check_bounds(path, i, trimesh.load(file).vertices) for i, file in enumerate(files))
    return f"{len(files)} frames, bounds within {1e3 * apart:.1f} mm"


def main(folder, paths):
    reference = Reference(folder)
    checks = {"msh": check_msh, "glb": check_glb, "usda": check_usd}
    for path in paths:
        check = check_sequence if pathlib.Path(path).is_dir() else checks.get(path.rsplit(".", 1)[-1], check_surface)
        print(f"{path}: {check(path, reference)}")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
