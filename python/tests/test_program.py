"""The wheel holds the program, and simulations from Python are its own, to the bit."""

import json
import re
import subprocess
import sys

import gic
import numpy as np
import pytest
from conftest import ROOT, program

BOX = ROOT / "examples/elastic.json"
SAND = ROOT / "examples/sand.json"
WALL = {"shape": "sphere", "centre_m": [0.05, 0.02, 0.0], "radius_m": 0.05, "contact": "slip", "friction": 0.1}


def particles(path):
    """The columns of a binary PLY of floats."""
    head, _, body = path.read_bytes().partition(b"end_header\n")
    names = re.findall(rb"property float (\w+)", head)
    rows = np.frombuffer(body, "<f4").reshape(-1, len(names))
    return {name.decode(): rows[:, index] for index, name in enumerate(names)}


def assert_same(rollout, folder):
    """Every frame of a rollout is what the program has written into a folder."""
    assert len(rollout.frames) == len(list(folder.glob("particles_*.ply")))
    for index in rollout.frames:
        written = particles(folder / f"particles_{index:04}.ply")
        computed = {
            **dict(zip("xyz", rollout.positions_m[index].astype(np.float32).T)),
            **dict(zip(("vx", "vy", "vz"), rollout.velocities_m_s[index].astype(np.float32).T)),
            "von_mises_pa": rollout.von_mises_pa[index],
            "J": rollout.volume_ratios[index],
        }
        assert computed.keys() == written.keys()
        for name, column in computed.items():
            assert column.tobytes() == written[name].tobytes(), f"{name} of frame {index}"


def test_a_twin_simulates_as_the_program_does(tmp_path):
    done = program("simulate", BOX, "-o", tmp_path, "--frames", 5)
    assert done.returncode == 0, done.stderr
    assert_same(gic.Twin(BOX).simulate(5), tmp_path)


def test_other_laws_obstacles_and_company_are_the_programs_own(tmp_path):
    colliders = tmp_path / "wall.json"
    colliders.write_text(json.dumps([WALL]))
    out = tmp_path / "out"
    done = program("simulate", BOX, "-o", out, "--frames", 4, "--material", "plasticine",
                   "--set", "yield_stress_pa=2e3", "--set", "gravity_m_s2=0,-3,1", "--colliders", colliders,
                   "--with", f"{SAND}@0,0.6,0")
    assert done.returncode == 0, done.stderr
    changed = {"yield_stress_pa": 2e3, "gravity_m_s2": [0, -3, 1]}
    arguments = {"set": changed, "material": "plasticine", "colliders": [WALL], "with_": [(SAND, (0.0, 0.6, 0.0))]}
    assert_same(gic.Twin(BOX).simulate(4, **arguments), out)
    assert len(gic.Twin(BOX).simulator(**arguments).bodies) == 2


def test_the_program_ends_with_its_own_codes(tmp_path):
    assert program("--version").stdout.strip() == f"gic {gic.__version__}"
    assert program("simulate").returncode == 2
    failed = program("simulate", tmp_path / "none.json", "-o", tmp_path)
    assert failed.returncode == 1 and "hint: check the path" in failed.stderr
    module = subprocess.run([sys.executable, "-m", "gic", "--version"], capture_output=True, text=True)
    assert module.stdout.strip() == f"gic {gic.__version__}"


def test_help_is_a_result():
    assert "--fit-frames" in gic.command("run", help=True)
    with pytest.raises(gic.UsageError, match="unrecognized subcommand"):
        gic.command("runn")


def test_importing_takes_less_than_a_fifth_of_a_second():
    code = "import time; start = time.perf_counter(); import gic; print(time.perf_counter() - start)"
    runs = [subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout for _ in range(5)]
    assert min(map(float, runs)) < 0.2


def test_large_packages_are_imported_when_they_are_used():
    large = ["numpy", "torch", "jax", "pandas", "tqdm"]
    code = f"import sys, gic; print([name for name in {large} if name in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"


def test_a_twin_is_read_with_all_that_it_says(tmp_path):
    twin = gic.Twin(BOX)
    assert twin.model == "elastic" and twin.parameters.keys() == {"youngs_modulus_pa", "poisson_ratio"}
    assert twin.to_dict()["schema"] == "gic.twin/1" and twin.intervals == {} and twin.verdicts == {}
    content = {**twin.to_dict(), "intervals_95": {"youngs_modulus_pa": [1e5, 4e5]},
               "identifiable": {"youngs_modulus_pa": True, "poisson_ratio": False}}
    file = tmp_path / "twin.json"
    file.write_text(json.dumps(content))
    identified = gic.Twin(file)
    assert identified.intervals == {"youngs_modulus_pa": (1e5, 4e5)}
    rows = {row["parameter"]: row for row in identified.table()}
    assert rows["youngs_modulus_pa"]["high_95"] == 4e5 and rows["poisson_ratio"]["identifiable"] is False
    assert "<td>1e+05</td>" in identified._repr_html_()


def test_what_is_wrong_with_a_twin_has_a_name(tmp_path):
    with pytest.raises(gic.TwinError, match="cannot read"):
        gic.Twin(tmp_path / "none.json")
    with pytest.raises(gic.TwinError, match="youngs_modulus_pax.*did you mean"):
        gic.Twin(BOX).simulate(2, set={"youngs_modulus_pax": 1e5})
    with pytest.raises(gic.TwinError, match="colliders.*shape"):
        gic.Twin(BOX).simulate(2, colliders=[{"shape": "cone", "contact": "slip"}])
    with pytest.raises(gic.SimulationError, match="budget"):
        gic.Twin(BOX).simulate(10**9)
