"""Loads files that `gic export` wrote with the readers other tools use, and checks them.

    pip install trimesh meshio
    python3 scripts/check_exports.py surface.obj surface.stl surface.ply particles.ply body.msh

Fails if a surface is not watertight or is turned inside out, or if a tetrahedron has no volume.
"""

import sys

import meshio
import numpy
import trimesh


def check_surface(path, mesh):
    assert mesh.is_watertight, f"{path}: not watertight"
    assert mesh.is_winding_consistent, f"{path}: winding is not consistent"
    assert mesh.volume > 0, f"{path}: inside out"
    print(f"{path}: {len(mesh.vertices)} vertices, {len(mesh.faces)} triangles, volume {mesh.volume:.6g} m^3")


def check_tetrahedra(path):
    mesh = meshio.read(path)
    corners = mesh.points[mesh.cells_dict["tetra"]]
    a, b, c, d = corners.transpose(1, 0, 2)
    volumes = numpy.einsum("ij,ij->i", numpy.cross(b - a, c - a), d - a) / 6
    assert (volumes > 0).all(), f"{path}: a tetrahedron has no volume or is inside out"
    print(f"{path}: {len(mesh.points)} nodes, {len(volumes)} tetrahedra, volume {volumes.sum():.6g} m^3")


def main(paths):
    for path in paths:
        if path.endswith(".msh"):
            check_tetrahedra(path)
            continue
        loaded = trimesh.load(path)
        if isinstance(loaded, trimesh.PointCloud):
            assert numpy.isfinite(loaded.vertices).all(), f"{path}: a position is not finite"
            print(f"{path}: {len(loaded.vertices)} particles")
        else:
            check_surface(path, loaded)


if __name__ == "__main__":
    main(sys.argv[1:])
