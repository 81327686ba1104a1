"""Steps what `gic export` wrote for other simulators in those, and compares fall and material with gic's own.

    pip install mujoco numpy                                # twin.xml
    pip install newton newton-usd-schemas usd-core          # particles.usda or twin.usda
    pip install torch genesis-world                         # twin.npz, through its twin.genesis.py
    python3 scripts/check_simulators.py RUN/prediction twin.xml particles.usda twin.genesis.py

The first argument is the folder with gic's trajectory.json. Prints mass, the parameters that the program holds after it
has loaded the file, in gic's conventions, and how far the centre of mass is from gic's over all frames, in shares of
the drop, vertically and in all; `--json FILE` also writes it. Mass and parameters must be gic's to 1 permille, and the
fall within 10 % (Newton: 12 %) vertically; else the exit code is 1. Another material than elastic is no elastic body in MuJoCo:
compare it in the others. `--newton-steps N` takes N steps a frame in Newton instead of those of the file.

    cargo run --release -p gic-twin --example write_interchange -- FOLDER
    python3 scripts/check_simulators.py --cantilever FOLDER

hangs the example's beam by its end and compares its sag in MuJoCo with that of gic's simulation and of beam theory.
"""

import importlib.util
import json
import math
import pathlib
import sys
import xml.etree.ElementTree as tree

import numpy

# Share of the drop that the centre of mass may be off vertically. Newton's steps are implicit and of first order: the 64
# a frame that the file asks for lose that much of a bounce.
TOLERANCE = 0.1
NEWTON_TOLERANCE = 0.12
# Shares of a parameter that a program may be off.
PARAMETER_TOLERANCE = 1e-3
FAILURES = []


class Reference:
    def __init__(self, folder):
        trajectory = json.loads((pathlib.Path(folder) / "trajectory.json").read_text())
        frames, self.twin = trajectory["frames"], trajectory["twin"]
        self.material, self.lowest = self.twin["material"], frames[0]["low_m"]
        self.times = numpy.array([frame["time_s"] for frame in frames])
        self.centres = numpy.array([frame["centre_of_mass_m"] for frame in frames])
        self.mass = numpy.linalg.norm(frames[0]["momentum_kg_m_s"]) / numpy.linalg.norm(frames[0]["velocity_m_s"])
        # Down is where it falls in the first frame.
        self.down = int(abs(self.centres[1] - self.centres[0]).argmax())
        heights = self.centres[:, self.down]
        self.drop = heights[0] - heights.min()

    def compare_material(self, path, held):
        """`held` are all parameters of the law and the density, as the program has them, in gic's conventions."""
        wanted = {key: value for key, value in self.material.items() if key != "model"}
        wanted["density_kg_m3"] = self.twin["density_kg_m3"]
        for key in sorted(wanted.keys() | held.keys()):
            theirs, ours = held.get(key), wanted.get(key)
            if theirs is None or ours is None or not abs(theirs - ours) <= PARAMETER_TOLERANCE * abs(ours):
                FAILURES.append(f"{path}: {key} is {theirs}, gic has {ours}")
        print(f"{path}: " + ", ".join(f"{key} {value:.6g}" for key, value in held.items()))

    def compare(self, path, centres, mass, tolerance=TOLERANCE):
        if not abs(mass / self.mass - 1) < 1e-3:
            FAILURES.append(f"{path}: {mass} kg, gic has {self.mass}")
        error = numpy.array(centres) - self.centres
        vertical = abs(error[:, self.down]).max() / self.drop
        whole = numpy.linalg.norm(error, axis=1).max() / self.drop
        rising = numpy.diff(self.centres[:, self.down]) > 0
        impact = rising.argmax() if rising.any() else len(error) - 1
        apex, ours = (numpy.array(all)[impact:, self.down].max() for all in (centres, self.centres))
        if not vertical < tolerance:
            FAILURES.append(f"{path}: the centre of mass is off by {100 * vertical:.1f} % of the drop")
        return {"mass_kg": mass, "vertical": vertical, "all": whole, "apex_m": apex, "gic_apex_m": ours}


def loader(path):
    spec = importlib.util.spec_from_file_location("loader", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def impact_factor(reference, young, poisson):
    """By how much the export raises the modulus for MuJoCo's law, which is linear in the stretch (decision 54)."""
    twin = reference.twin
    gravity, velocity = numpy.array(twin["gravity_m_s2"]), numpy.array(twin["initial_velocity_m_s"])
    floor = next(c for c in twin["colliders"] if c["shape"] == "half_space")
    gap = max(0.0, (reference.lowest[reference.down] - floor["point_m"][reference.down]))
    energy = 0.5 * twin["density_kg_m3"] * (velocity @ velocity + 2 * numpy.linalg.norm(gravity) * gap)
    mu, lame = young / (2 * (1 + poisson)), young * poisson / ((1 + poisson) * (1 - 2 * poisson))
    stored = lambda s: 0.5 * mu * (s * s - 1) - mu * math.log(s) + 0.5 * lame * math.log(s) ** 2
    low, high = 0.05, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stored(middle) > energy else (low, middle)
    return max(1.0, stored(low) / (0.5 * (lame + 2 * mu) * (1 - low) ** 2))


def check_mujoco(path, reference):
    import mujoco

    model = mujoco.MjModel.from_xml_path(path)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    flex = mujoco.MjSpec.from_file(path).flexes[0]
    young, poisson = reference.material["youngs_modulus_pa"], reference.material["poisson_ratio"]
    held = {"youngs_modulus_pa": flex.young / impact_factor(reference, young, poisson), "poisson_ratio": flex.poisson}
    if flex.damping:
        held["retardation_time_s"] = flex.damping
    # MuJoCo keeps masses alone; they must be those of the volume that the reference has, too.
    held["density_kg_m3"] = reference.twin["density_kg_m3"] * model.body_mass.sum() / reference.mass
    reference.compare_material(path, held)
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
    return f"MuJoCo {mujoco.__version__}", reference.compare(path, centres, model.body_mass.sum())


def newton_material(model, law):
    """The material of Newton's particles in gic's conventions; all particles must have the same."""

    def the(values):
        assert numpy.ptp(values) <= 1e-5 * abs(values).max(), "particles differ"
        return float(values.astype(float).mean())

    mpm = {name: the(getattr(model.mpm, name).numpy()) for name in [
        "young_modulus", "poisson_ratio", "damping", "friction", "yield_pressure", "tensile_yield_ratio", "yield_stress",
        "viscosity", "hardening", "dilatancy"]}
    young, poisson = mpm["young_modulus"], mpm["poisson_ratio"]
    bulk, shear = young / (3 * (1 - 2 * poisson)), young / (2 * (1 + poisson))
    # What a law does not have must be out of reach, or absent.
    never = ["yield_pressure"] + ["yield_stress"] * (law in ["elastic", "viscoelastic"])
    zero = ["hardening", "dilatancy"] + ["friction"] * (law != "sand") + ["yield_stress"] * (law in ["sand", "newtonian"])
    zero += ["viscosity"] * ("newtonian" not in law) + ["damping"] * (law != "viscoelastic")
    for name in never + zero:
        assert mpm[name] > 100 * young if name in never else mpm[name] == 0, f"{law}: {name} is {mpm[name]}"
    assert mpm["tensile_yield_ratio"] == (law not in ["sand", "newtonian"]), f"{law}: tension"
    # Newton bounds |s| / sqrt(2) by yield stress and friction times pressure, gic |s|.
    elastic = {"youngs_modulus_pa": young, "poisson_ratio": poisson}
    sine = 3 * mpm["friction"] / (2 * math.sqrt(3) + mpm["friction"])
    held = {
        "elastic": lambda: elastic,
        "viscoelastic": lambda: elastic | {"retardation_time_s": mpm["damping"]},
        "plasticine": lambda: elastic | {"yield_stress_pa": math.sqrt(2) * mpm["yield_stress"]},
        "sand": lambda: elastic | {"friction_angle_deg": math.degrees(math.asin(sine))},
        "newtonian": lambda: {"viscosity_pa_s": mpm["viscosity"], "bulk_modulus_pa": bulk},
        "non-newtonian": lambda: {
            "shear_modulus_pa": shear, "bulk_modulus_pa": bulk, "yield_stress_pa": math.sqrt(3) * mpm["yield_stress"],
            "plastic_viscosity_pa_s": mpm["viscosity"]},
    }[law]()
    masses, radii = model.particle_mass.numpy().astype(float), model.particle_radius.numpy().astype(float)
    return held | {"density_kg_m3": masses.sum() / (8 * radii**3).sum()}


def check_newton(path, reference, steps):
    import newton
    from newton.solvers import SolverImplicitMPM
    from pxr import Usd, UsdGeom

    builder = newton.ModelBuilder()
    SolverImplicitMPM.register_custom_attributes(builder)
    stage = Usd.Stage.Open(path)
    loaded = builder.add_usd(stage, load_visual_shapes=False)
    assert builder.shape_count > 0, f"{path}: no floor"
    config = SolverImplicitMPM.Config.create_from_usd(stage.GetPrimAtPath(loaded["particle_scene_path"]))
    model = builder.finalize()
    reference.compare_material(path, newton_material(model, reference.material["model"]))
    steps = steps or round(reference.times[1] / loaded["physics_dt"])
    solver, now, then = SolverImplicitMPM(model, config=config), model.state(), model.state()
    masses = model.particle_mass.numpy()[:, None].astype(float)
    # Newton turns stages to z up.
    back = (lambda p: p) if UsdGeom.GetStageUpAxis(stage) == "Z" else (lambda p: numpy.array([p[0], p[2], -p[1]]))
    centre = lambda: back((now.particle_q.numpy() * masses).sum(0) / masses.sum())
    centres = [centre()]
    for step in numpy.diff(reference.times):
        for _ in range(steps):
            solver.step(now, then, None, None, step / steps)
            now, then = then, now
        centres.append(centre())
    compared = reference.compare(path, centres, masses.sum(), NEWTON_TOLERANCE)
    return f"Newton {newton.__version__}, {steps} steps a frame", compared


def genesis_material(material, substep_s, wanted):
    """A Genesis material in gic's conventions, from the numbers that its laws compute with."""
    mu, lame = material.mu, material.lam
    elastic = {"youngs_modulus_pa": mu * (3 * lame + 2 * mu) / (lame + mu), "poisson_ratio": lame / (2 * (lame + mu))}
    slope = getattr(material, "alpha", 0.0)
    sine = 3 * slope / (2 * math.sqrt(2 / 3) + slope)
    held = {
        "elastic": lambda: elastic,
        "plasticine": lambda: elastic | {"yield_stress_pa": material.von_mises_yield_stress},
        "sand": lambda: elastic | {"friction_angle_deg": math.degrees(math.asin(sine))},
        # Its stress is 2 mu times the strain of one substep, gic's the viscosity times the strain rate.
        "newtonian": lambda: {"viscosity_pa_s": 2 * mu * substep_s, "bulk_modulus_pa": (lame + 2 / 3 * mu) / 7},
    }[wanted["model"]]()
    if wanted["model"] == "newtonian" and lame == 0:
        # Where mu alone resists compression more than the twin, the program's fluid is stiffer.
        held["bulk_modulus_pa"] = min(held["bulk_modulus_pa"], wanted["bulk_modulus_pa"])
    return held | {"density_kg_m3": material.rho}


def check_genesis(path, reference):
    import genesis

    genesis.init(backend=genesis.cpu, logging_level="error")
    scene, body, steps = loader(path).load()
    reference.compare_material(path, genesis_material(body.material, scene.sim.substep_dt, reference.material))
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
    # Its nodes at one end do not move.
    held = [body for body in root.iter("body") if body.get("name").startswith("node_0_")]
    names = {joint.get("name") for body in held for joint in body.iter("joint")}
    for body in held:
        for joint in body.findall("joint"):
            body.remove(joint)
    tendon = next(root.iter("fixed"))
    for joint in [joint for joint in tendon if joint.get("joint") in names]:
        tendon.remove(joint)
    root.remove(root.find("keyframe"))
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
        cantilever(arguments[1])
        return False
    output = None
    steps = 0
    for flag in ["--json", "--newton-steps"]:
        if flag in arguments:
            at = arguments.index(flag)
            value, arguments = arguments[at + 1], arguments[:at] + arguments[at + 2 :]
            output, steps = (value, steps) if flag == "--json" else (output, int(value))
    reference, results = Reference(arguments[0]), {}
    for path in arguments[1:]:
        newton = lambda path, reference: check_newton(path, reference, steps)
        checks = {"xml": check_mujoco, "usda": newton, "genesis.py": check_genesis}
        check = next((check for ending, check in checks.items() if path.endswith("." + ending)), None)
        assert check, f"{path}: give a .xml, .usda or .genesis.py"
        program, result = check(path, reference)
        results[program] = result
        print(
            f"{path}: {program}: {result['mass_kg']:.4f} kg; centre of mass within {100 * result['vertical']:.1f} % of "
            f"the drop vertically, {100 * result['all']:.1f} % in all; highest after the impact {result['apex_m']:.4f} m, "
            f"gic {result['gic_apex_m']:.4f} m"
        )
    for failure in FAILURES:
        print(f"FAILED: {failure}")
    if output:
        pathlib.Path(output).write_text(json.dumps(results, indent=1, default=float) + "\n")
    return bool(FAILURES)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
