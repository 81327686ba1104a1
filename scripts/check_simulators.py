"""Steps what `gic export` wrote for other simulators in those simulators, and compares the fall with gic's own.

    pip install mujoco numpy                                # twin.xml, through its twin.mujoco.py
    pip install newton newton-usd-schemas usd-core          # particles.usda or twin.usda
    pip install torch genesis-world                         # twin.npz, through its twin.genesis.py
    python3 scripts/check_simulators.py RUN/prediction twin.mujoco.py particles.usda twin.genesis.py

The first argument is the folder with gic's trajectory.json. Prints mass, and how far the centre of mass is from gic's
over all frames, in shares of the drop, vertically and in all; `--json FILE` also writes it. The file of MuJoCo's must
stay within 10 % vertically. Another material than elastic is no elastic body in MuJoCo: compare it in the others.

    cargo run --release -p gic-twin --example write_interchange -- FOLDER
    python3 scripts/check_simulators.py --cantilever FOLDER

hangs the example's beam by its end and compares its sag in MuJoCo with that of gic's simulation and of beam theory.
"""

import importlib.util
import json
import pathlib
import sys
import xml.etree.ElementTree as tree

import numpy

# Steps of Newton's implicit solver in a frame: it damps what happens within a step.
NEWTON_STEPS = 16


class Reference:
    def __init__(self, folder):
        frames = json.loads((pathlib.Path(folder) / "trajectory.json").read_text())["frames"]
        self.times = numpy.array([frame["time_s"] for frame in frames])
        self.centres = numpy.array([frame["centre_of_mass_m"] for frame in frames])
        self.mass = numpy.linalg.norm(frames[0]["momentum_kg_m_s"]) / numpy.linalg.norm(frames[0]["velocity_m_s"])
        # Down is where it falls in the first frame.
        self.down = int(abs(self.centres[1] - self.centres[0]).argmax())
        heights = self.centres[:, self.down]
        self.drop = heights[0] - heights.min()

    def compare(self, path, centres, mass):
        assert abs(mass / self.mass - 1) < 1e-3, f"{path}: {mass} kg, gic has {self.mass}"
        error = numpy.array(centres) - self.centres
        vertical = abs(error[:, self.down]).max() / self.drop
        whole = numpy.linalg.norm(error, axis=1).max() / self.drop
        rising = numpy.diff(self.centres[:, self.down]) > 0
        impact = rising.argmax() if rising.any() else len(error) - 1
        apex, ours = (numpy.array(all)[impact:, self.down].max() for all in (centres, self.centres))
        return {"mass_kg": mass, "vertical": vertical, "all": whole, "apex_m": apex, "gic_apex_m": ours}


def loader(path):
    spec = importlib.util.spec_from_file_location("loader", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def check_mujoco(path, reference):
    import mujoco

    model, data = loader(path).load()
    masses = model.body_mass[1:, None]
    centre = lambda: (data.xpos[1:] * masses).sum(0) / masses.sum()
    centres, before = [], (0.0, centre())
    for time in reference.times:
        while data.time < time - 1e-9:
            before = (data.time, centre())
            mujoco.mj_step(model, data)
        # Positions are those of the step's start until the next one.
        mujoco.mj_kinematics(model, data)
        now = centre()
        share = (time - before[0]) / (data.time - before[0]) if data.time > before[0] else 1.0
        centres.append(before[1] + share * (now - before[1]))
    assert not any(w.number for w in data.warning), f"{path}: MuJoCo warns"
    result = reference.compare(path, centres, model.body_mass.sum())
    assert result["vertical"] < 0.1, f"{path}: {result}"
    return f"MuJoCo {mujoco.__version__}", result


def check_newton(path, reference):
    import newton
    from newton.solvers import SolverImplicitMPM
    from pxr import Usd, UsdGeom

    builder = newton.ModelBuilder()
    SolverImplicitMPM.register_custom_attributes(builder)
    stage = Usd.Stage.Open(path)
    scene = builder.add_usd(stage, load_visual_shapes=False)["particle_scene_path"]
    assert builder.shape_count > 0, f"{path}: no floor"
    config = SolverImplicitMPM.Config.create_from_usd(stage.GetPrimAtPath(scene))
    config.air_drag = 0.0
    model = builder.finalize()
    solver, now, then = SolverImplicitMPM(model, config=config), model.state(), model.state()
    masses = model.particle_mass.numpy()[:, None].astype(float)
    # Newton turns stages to z up.
    back = (lambda p: p) if UsdGeom.GetStageUpAxis(stage) == "Z" else (lambda p: numpy.array([p[0], p[2], -p[1]]))
    centre = lambda: back((now.particle_q.numpy() * masses).sum(0) / masses.sum())
    centres = [centre()]
    for step in numpy.diff(reference.times):
        for _ in range(NEWTON_STEPS):
            solver.step(now, then, None, None, step / NEWTON_STEPS)
            now, then = then, now
        centres.append(centre())
    return f"Newton {newton.__version__}", reference.compare(path, centres, masses.sum())


def check_genesis(path, reference):
    import genesis

    genesis.init(backend=genesis.cpu, logging_level="error")
    scene, body, steps = loader(path).load()
    masses = numpy.load(path.replace(".genesis.py", ".npz"))["masses"].astype(float)[:, None]
    centre = lambda: (body.get_particles_pos().cpu().numpy().reshape(-1, 3) * masses).sum(0) / masses.sum()
    centres = [centre()]
    for _ in reference.times[1:]:
        for _ in range(steps):
            scene.step()
        centres.append(centre())
    mass = float(numpy.asarray(body.get_mass()).sum())
    return f"Genesis {genesis.__version__}", reference.compare(path, centres, mass)


def cantilever(folder):
    """The sag of the beam's end in MuJoCo, in gic and in theory."""
    import mujoco

    twin = json.load(open(f"{folder}/beam.json"))
    length, height, _ = twin["continuum"]["size_m"]
    young, poisson = twin["material"]["youngs_modulus_pa"], twin["material"]["poisson_ratio"]
    load = 9.8 * twin["density_kg_m3"] * height**2
    inertia = height**4 / 12
    shear = young / (2 * (1 + poisson)) * height**2 * 5 / 6
    theory = load * length**4 / (8 * young * inertia) + load * length**2 / (2 * shear)

    root = tree.parse(f"{folder}/beam.xml").getroot()
    body = next(root.iter("flexcomp"))
    cells = [int(n) for n in body.get("cellcount").split()]
    tree.SubElement(body, "pin", gridrange=f"0 0 0 0 {cells[1]} {cells[2]}")
    model = mujoco.MjModel.from_xml_string(tree.tostring(root, encoding="unicode"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    before = data.flexvert_xpos.copy()
    tip = before[:, 0] > length - 2e-3
    sags = []
    while len(sags) < 40 or numpy.ptp(sags[-20:]) > 1e-3 * max(sags):
        for _ in range(max(1, int(0.005 / model.opt.timestep))):
            mujoco.mj_step(model, data)
        # Motion dies out, so that what is left is the sag at rest.
        data.qvel *= 0.7
        sags.append((before - data.flexvert_xpos)[tip, 1].mean())
    # gic's beam swings without damping about its sag at rest: the mean over whole periods.
    y = numpy.loadtxt(f"{folder}/beam_tip.csv", skiprows=1)
    down = y[0] - y
    lows = [i for i in range(1, len(down) - 1) if down[i] < down[i - 1] and down[i] <= down[i + 1]]
    swing = down[lows[0] : lows[-1]].mean()
    print(f"sag of the tip: MuJoCo {1e3 * sags[-1]:.3f} mm, gic {1e3 * swing:.3f} mm, Timoshenko {1e3 * theory:.3f} mm")
    assert abs(sags[-1] / swing - 1) < 0.3


def main(arguments):
    if arguments[:1] == ["--cantilever"]:
        return cantilever(arguments[1])
    output = None
    if "--json" in arguments:
        at = arguments.index("--json")
        output, arguments = arguments[at + 1], arguments[:at] + arguments[at + 2 :]
    reference, results = Reference(arguments[0]), {}
    for path in arguments[1:]:
        checks = {"mujoco.py": check_mujoco, "usda": check_newton, "genesis.py": check_genesis}
        check = next((check for ending, check in checks.items() if path.endswith("." + ending)), None)
        assert check, f"{path}: give a .mujoco.py, .usda or .genesis.py"
        program, result = check(path, reference)
        results[program] = result
        print(
            f"{path}: {program}: {result['mass_kg']:.4f} kg; centre of mass within {100 * result['vertical']:.1f} % of "
            f"the drop vertically, {100 * result['all']:.1f} % in all; highest after the impact {result['apex_m']:.4f} m, "
            f"gic {result['gic_apex_m']:.4f} m"
        )
    if output:
        pathlib.Path(output).write_text(json.dumps(results, indent=1, default=float) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
