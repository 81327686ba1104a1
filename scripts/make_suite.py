#!/usr/bin/env python3
"""Makes the scenes of the paper's tables, each from its name, in batches.

    python3 scripts/make_suite.py --generator FOLDER --python VENV/bin/python -o SUITE [NAME ...] [--at-most N]

FOLDER holds the generator (`bench_sim.py`, `bench_render.py`); its README says how the virtual environment is made.
Without names: the 45 scenes elastic_0 .. 9, newtonian_0 .. 9, non_newtonian_0 .. 9, plasticine_0 .. 9, sand_0 .. 4, one
of each law after the other, so that every batch has all laws. `named` stands for the nine with names of their own.

A scene is made in SUITE/.making and moved to SUITE/NAME once it is whole: what was stopped is made again, what is there
stays. A scene that fails is named at the end, and the others are made. One scene takes 80 s on a core. Needs Python 3.9
and nothing else itself.
"""

import argparse
import glob
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

LAWS = {"elastic": 10, "newtonian": 10, "non_newtonian": 10, "plasticine": 10, "sand": 5}
NAMED = ["torus", "bird", "playdoh", "cat", "trophy", "droplet", "letter", "cream", "toothpaste"]


def paper_names():
    return [f"{law}_{i}" for i in range(max(LAWS.values())) for law, count in LAWS.items() if i < count]


def environment():
    """The renderer needs a newer LLVM than the oldest that may lie beside it."""
    found = glob.glob("/usr/lib/*/libLLVM.so.19*")
    return {**({"DRJIT_LIBLLVM_PATH": found[0]} if found else {}), **os.environ}


def make(name, options):
    """Makes one scene; returns whether it is there."""
    place, making = options.out / name, options.out / ".making"
    shutil.rmtree(making / name, ignore_errors=True)
    making.mkdir(parents=True, exist_ok=True)
    steps = [
        ["bench_sim.py", "scene", name, "--out", str(making), "--threads", str(options.threads)],
        ["bench_render.py", str(making / name), "--size", str(options.size)],
    ]
    with open(making / f"{name}.txt", "w", encoding="utf-8") as log:
        for script, *words in steps:
            command = [options.python, str(options.generator / script), *words]
            if subprocess.run(command, stdout=log, stderr=log, env=environment(), check=False).returncode != 0:
                return False
    (making / name).rename(place)
    return True


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--generator", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--python", required=True, help="the interpreter that has the generator's packages")
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="SUITE")
    parser.add_argument("--at-most", type=int, metavar="N", help="make so many now, the others another day")
    parser.add_argument("--size", type=int, default=400, help="width and height of the pictures [pixels]")
    parser.add_argument("--threads", type=int, default=1, help="of the simulation")
    options = parser.parse_args()
    for script in ["bench_sim.py", "bench_render.py"]:
        if not (options.generator / script).is_file():
            parser.error(f"{options.generator / script} is missing; --generator is the folder that holds it")
    names = [other for name in options.names for other in (NAMED if name == "named" else [name])] or paper_names()
    options.out, options.generator = options.out.resolve(), options.generator.resolve()
    wanted = [name for name in names if not (options.out / name / "all_data.json").is_file()]
    print(f"{len(names) - len(wanted)} of {len(names)} scenes are there", flush=True)
    failed = []
    for name in wanted[:options.at_most]:
        start = time.time()
        made = make(name, options)
        failed += [] if made else [name]
        log = options.out / ".making" / f"{name}.txt"
        print(f"{name}: {time.time() - start:.0f} s" if made else f"{name}: FAILED, see {log}", flush=True)
    if failed:
        sys.exit(f"make_suite: failed: {', '.join(failed)}; the same command makes them again")


if __name__ == "__main__":
    main()
