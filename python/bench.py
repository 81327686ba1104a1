#!/usr/bin/env python3
"""gic against Taichi and Warp on this CPU: the same scene forward and with gradients, one thread each.

    python bench.py                    a table
    python bench.py --json FILE.json   puts the figures into a section of docs/results, too

Needs ``taichi`` and ``warp-lang``. All three simulate in turn, several times; times are those of the processor, and
ratios are medians over the turns. Results have to agree before anything is measured.
"""

import os
import sys

# Before anything starts threads.
os.environ["RAYON_NUM_THREADS"] = "1"

import json
import platform
import statistics
import subprocess
import time
from pathlib import Path

from comparison.scene import Gic, Scene

TURNS = 5
NAMES = ("gic", "Taichi", "Warp")


def simulators(scene):
    from comparison.taichi_mpm import Taichi
    from comparison.warp_mpm import Warp

    return dict(zip(NAMES, (Gic(scene), Taichi(scene, threads=1), Warp(scene))))


def require_agreement(found, what, tolerance):
    """All results are gic's; the first calls also compile."""
    for name, value in found.items():
        if not abs(value - found["gic"]) <= tolerance * abs(found["gic"]):
            sys.exit(f"bench: {what} of {name} is {value:.6e}, of gic {found['gic']:.6e}")


def processor_seconds(work):
    start = time.process_time()
    work()
    return time.process_time() - start


def measure(all_, work, count):
    """Million particle-substeps a second of each turn, by name."""
    speeds = {name: [] for name in all_}
    for _ in range(TURNS):
        for name, simulator in all_.items():
            speeds[name].append(count / 1e6 / processor_seconds(getattr(simulator, work)))
    return speeds


def rows(scene, all_):
    count = scene.side**3 * scene.substeps
    for work, title in (("forward", "forward"), ("gradient", "with gradients")):
        speeds = measure(all_, work, count)
        ratios = [statistics.median(a / b for a, b in zip(speeds["gic"], speeds[name])) for name in NAMES[1:]]
        yield [title, *(f"{statistics.median(speeds[name]):.2f}" for name in NAMES), *(f"**{r:.1f}**" for r in ratios)]


def update(file, table):
    """Puts the figures into the section that the file holds; its text stays."""
    import taichi
    import warp

    section = json.loads(file.read_text(encoding="utf-8"))
    versions = f"Taichi {'.'.join(map(str, taichi.__version__))}, Warp {warp.__version__}"
    section.update(commit=commit(), machine=f"one core, {processor()}, {versions}",
                   columns=["what", *NAMES, "gic / Taichi", "gic / Warp"], rows=table)
    file.write_text(json.dumps(section, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def commit():
    here = Path(__file__).resolve().parent
    command = ["git", "rev-parse", "--short", "HEAD"]
    return subprocess.run(command, cwd=here, capture_output=True, text=True).stdout.strip()


def processor():
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    name = next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), platform.machine())
    level = "AVX-512" if any("avx512f" in line for line in lines) else "AVX2"
    return f"{name} ({level})"


def main(arguments):
    scene = Scene()
    all_ = simulators(scene)
    require_agreement({name: one.forward() for name, one in all_.items()}, "the height", 1e-4)
    require_agreement({name: one.gradient() for name, one in all_.items()}, "the derivative", 1e-2)
    table = list(rows(scene, all_))
    print(f"{'':<16}" + "".join(f"{title:>14}" for title in (*NAMES, "gic / Taichi", "gic / Warp")))
    for title, *cells in table:
        print(f"{title:<16}" + "".join(f"{cell:>14}" for cell in cells))
    if arguments[:1] == ["--json"]:
        update(Path(arguments[1]), table)


if __name__ == "__main__":
    main(sys.argv[1:])
