"""Loads what `gic export` wrote for other simulators with those simulators themselves, and checks that it works.

    pip install mujoco usd-core meshio numpy
    cargo run --release -p gic-twin --example write_interchange -- FOLDER
    python3 scripts/check_simulators.py FOLDER/beam.xml FOLDER/beam.usda FOLDER/beam.msh FOLDER/beam.npz
    python3 scripts/check_simulators.py --cantilever FOLDER
    gic export RUN --format mjcf -o twin.xml && python3 scripts/check_simulators.py --settle twin.xml

By the file's ending: .xml is loaded and stepped by MuJoCo, .usda opened by OpenUSD, .msh read by meshio, .npz by NumPy.
`--settle` puts an exported twin on a floor below it, lets it fall, and wants it at rest without a warning of MuJoCo's.
`--cantilever` hangs the example's beam by its end and compares its sag with that of gic's simulation and of beam theory.
"""

import json
import sys
import xml.etree.ElementTree as tree

import numpy


def steady(values, share):
    """Whether the last of the values vary by less than a share of the largest."""
    return numpy.ptp(values) <= share * max(abs(values).max(), 1e-12)


def load_mujoco(path, edit=None):
    import mujoco

    root = tree.parse(path).getroot()
    if edit:
        edit(root)
    model = mujoco.MjModel.from_xml_string(tree.tostring(root, encoding="unicode"))
    return mujoco, model, mujoco.MjData(model)


def warnings(data):
    return [(i, w.number) for i, w in enumerate(data.warning) if w.number]


def check_mjcf(path):
    mujoco, model, data = load_mujoco(path)
    for _ in range(50):
        mujoco.mj_step(model, data)
    assert numpy.isfinite(data.qpos).all(), f"{path}: not finite"
    assert not warnings(data), f"{path}: warnings {warnings(data)}"
    mass = model.body_mass.sum()
    print(f"{path}: MuJoCo {mujoco.__version__}: {model.nflexvert} vertices, {model.nflexelem} tetrahedra, {mass:.4f} kg, 50 steps")


def check_usd(path):
    from pxr import Usd, UsdGeom, UsdShade

    stage = Usd.Stage.Open(path)
    body = stage.GetPrimAtPath("/World/Twin/Volume")
    tets = UsdGeom.TetMesh(body)
    surface = UsdGeom.Mesh(stage.GetPrimAtPath("/World/Twin/Surface"))
    assert tets and surface, f"{path}: no meshes"
    corners = numpy.array(tets.GetTetVertexIndicesAttr().Get())
    rest = numpy.array(tets.GetPrim().GetAttribute("omniphysics:restShapePoints").Get())
    a, b, c, d = (rest[corners[:, i]] for i in range(4))
    volumes = numpy.einsum("ij,ij->i", numpy.cross(b - a, c - a), d - a) / 6
    assert (volumes > 0).all(), f"{path}: a tetrahedron is inside out"
    times = tets.GetPointsAttr().GetTimeSamples()
    for t in times:
        assert numpy.isfinite(numpy.array(tets.GetPointsAttr().Get(t))).all(), f"{path}: time {t} is not finite"
    faces = numpy.array(surface.GetFaceVertexIndicesAttr().Get())
    assert faces.max() < len(surface.GetPointsAttr().Get(times[0] if times else 0)), f"{path}: a face out of range"
    material = UsdShade.MaterialBindingAPI(body).GetDirectBinding(materialPurpose="physics").GetMaterial()
    young = material.GetPrim().GetAttribute("omniphysics:youngsModulus").Get()
    density = material.GetPrim().GetAttribute("omniphysics:density").Get()
    mass = body.GetAttribute("omniphysics:mass").Get()
    assert abs(volumes.sum() * density / mass - 1) < 1e-3, f"{path}: mass {mass}"
    print(f"{path}: OpenUSD {Usd.GetVersion()}: {len(corners)} tetrahedra, E = {young:.4g} Pa, {mass:.4f} kg, {len(times)} time samples")


def check_msh(path):
    import meshio

    mesh = meshio.read(path)
    a, b, c, d = mesh.points[mesh.cells_dict["tetra"]].transpose(1, 0, 2)
    volumes = numpy.einsum("ij,ij->i", numpy.cross(b - a, c - a), d - a) / 6
    assert (volumes > 0).all(), f"{path}: a tetrahedron is inside out"
    print(f"{path}: meshio: {len(mesh.points)} nodes, {len(volumes)} tetrahedra, volume {volumes.sum():.6g} m^3")


def check_particles(path):
    arrays = numpy.load(path)
    parameters = json.load(open(path[: -len("npz")] + "particles.json"))
    n = parameters["particles"]
    shapes = {"positions": (n, 3), "velocities": (n, 3), "volumes": (n,), "masses": (n,)}
    for name, shape in shapes.items():
        assert arrays[name].shape == shape and numpy.isfinite(arrays[name]).all(), f"{path}: {name}"
    print(f"{path}: NumPy: {n} particles, {arrays['masses'].sum():.4f} kg, {parameters['material']}")


def settle(path):
    """Lets a twin fall on a floor just below it."""

    def on_a_floor(root):
        world = root.find("worldbody")
        for geom in world.findall("geom"):
            world.remove(geom)
        heights = [float(body.get("pos").split()[1]) for body in world.findall("body")]
        floor = {"name": "floor", "type": "plane", "size": "0 0 1", "pos": f"0 {min(heights) - 0.005} 0"}
        tree.SubElement(world, "geom", {**floor, "zaxis": "0 1 0", "friction": "0.8 0.005 0.0001"})
        if int(mujoco.__version__.split(".")[0]) >= 4:
            # Implicit elasticity: long steps, and motion that dies out.
            root.find("option").set("integrator", "discrete")
            root.find("option").set("timestep", "0.002")

    import mujoco

    _, model, data = load_mujoco(path, on_a_floor)
    heights, speeds = [], []
    while data.time < 3:
        for _ in range(max(1, int(0.05 / model.opt.timestep))):
            mujoco.mj_step(model, data)
        heights.append(data.flexvert_xpos[:, 1].mean())
        speeds.append(numpy.sqrt((model.body_mass[1:, None] * data.qvel.reshape(-1, 3) ** 2).sum() / model.body_mass.sum()))
        if len(speeds) >= 10 and max(speeds[-10:]) < 5e-3:
            break
    assert not warnings(data), f"{path}: warnings {warnings(data)}"
    lowest = data.flexvert_xpos[:, 1].min()
    print(f"{path}: after {data.time:.2f} s on the floor: rms speed {speeds[-1]:.2e} m/s, mean height {heights[-1]:.4f} m, lowest {lowest:.4f} m, no warnings")
    assert numpy.isfinite(data.qpos).all()
    assert speeds[-1] < 5e-3, f"{path}: does not come to rest"


def cantilever(folder):
    """The sag of the beam's end in MuJoCo, in gic and in theory."""
    twin = json.load(open(f"{folder}/beam.json"))
    length, height, _ = twin["continuum"]["size_m"]
    young, poisson = twin["material"]["youngs_modulus_pa"], twin["material"]["poisson_ratio"]
    load = 9.8 * twin["density_kg_m3"] * height**2
    inertia = height**4 / 12
    shear = young / (2 * (1 + poisson)) * height**2 * 5 / 6
    theory = load * length**4 / (8 * young * inertia) + load * length**2 / (2 * shear)

    def clamped(root):
        for body in root.find("worldbody").findall("body"):
            if float(body.get("pos").split()[0]) < 1e-4:
                for joint in body.findall("joint"):
                    body.remove(joint)
        root.remove(root.find("keyframe"))

    mujoco, model, data = load_mujoco(f"{folder}/beam.xml", clamped)
    mujoco.mj_forward(model, data)
    before = data.flexvert_xpos.copy()
    tip = before[:, 0] > length - 1e-3
    sags = []
    for _ in range(400):
        for _ in range(max(1, int(0.005 / model.opt.timestep))):
            mujoco.mj_step(model, data)
        # Motion dies out, so that what is left is the sag at rest.
        data.qvel *= 0.7
        sags.append((before - data.flexvert_xpos)[tip, 1].mean())
        if len(sags) > 40 and steady(numpy.array(sags[-20:]), 1e-3):
            break
    assert not warnings(data), warnings(data)
    # gic's beam swings without damping about its sag at rest: the mean over whole periods.
    y = numpy.loadtxt(f"{folder}/beam_tip.csv", skiprows=1)
    down = y[0] - y
    lows = [i for i in range(1, len(down) - 1) if down[i] < down[i - 1] and down[i] <= down[i + 1]]
    swing = down[lows[0] : lows[-1]].mean()
    print(f"sag of the tip: MuJoCo {1e3 * sags[-1]:.3f} mm, gic {1e3 * swing:.3f} mm, Timoshenko {1e3 * theory:.3f} mm")
    print(f"MuJoCo over gic {sags[-1] / swing:.3f}; gic over theory {swing / theory:.3f}; {len(lows) - 1} periods, {len(sags)} x 5 ms")
    assert abs(sags[-1] / swing - 1) < 0.2


def main(arguments):
    if arguments[:1] == ["--cantilever"]:
        return cantilever(arguments[1])
    if arguments[:1] == ["--settle"]:
        return settle(arguments[1])
    checks = {"xml": check_mjcf, "usda": check_usd, "msh": check_msh, "npz": check_particles}
    for path in arguments:
        checks[path.rsplit(".", 1)[-1]](path)


if __name__ == "__main__":
    main(sys.argv[1:])
