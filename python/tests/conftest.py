"""What the tests share: the bundled scene, the installed program, a small world."""

import subprocess
import sysconfig
from pathlib import Path

import gic
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
DEMO = ROOT / "crates/gic/demo"
PROGRAM = Path(sysconfig.get_path("scripts")) / "gic"
FLOOR = {"shape": "half_space", "normal": [0.1, 1.0, 0.05], "contact": "sticky"}
ELASTIC = {"model": "elastic", "youngs_modulus_pa": 2e5, "poisson_ratio": 0.3}


def program(*words, **options):
    """Runs the command `gic` of the wheel."""
    return subprocess.run([PROGRAM, *map(str, words)], capture_output=True, text=True, **options)


def small_body(**changes):
    """A spinning block of 210 particles of different volumes, a little above the floor."""
    positions = gic.block((0.07, 0.06, 0.05), 0.01, (-0.005, 0.021, -0.005))
    n = np.arange(len(positions))
    positions += 1e-3 * np.stack([np.sin(1.3 * n), np.sin(2.7 * n), np.sin(4.1 * n)], axis=1)
    body = gic.Body(ELASTIC, positions, 1e-6, volume_factors=1 + 0.3 * np.sin(1.9 * n), velocity_m_s=(0.4, -3.0, 0.2),
                    angular_velocity_rad_s=(1.0, -2.0, 3.0))
    return body.replace(**changes)


def small_simulator(precision="f64", **options):
    """That body, which hits the floor in its first frame of 50 substeps."""
    usual = {"frame_rate_hz": 100.0, "least_substeps_per_frame": 50, "precision": precision}
    return gic.Simulator(small_body(), [FLOOR], 0.02, **{**usual, **options})


@pytest.fixture
def simulator():
    return small_simulator()
