#!/usr/bin/env python3
"""Runs a small suite on every engine that is installed, kills a task in the middle, and compares the results.

    apt-get install slurmctld slurmd munge slurm-client
    python3 -m venv VENV && VENV/bin/pip install ray 'dask[distributed]' ./python
    python3 scripts/check_engines.py --gic target/release/gic --python VENV/bin/python [--only slurm] [--keep FOLDER]

The suite is the bundled scene with two seeds, cut to seconds. On each engine one task is killed while it works, by its
process, and on Ray and Dask once more with its worker. The command is given again where the engine itself starts no
task twice. Then results.json, .csv and .md must be the bytes of a run on this machine that nothing disturbed. An engine
that is missing is skipped, visibly; with none there, nothing runs. Needs Linux and Python 3.9.
"""

import argparse
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SCENE = ROOT / "crates" / "gic" / "demo"
SHORT = ["--steps", "300", "--fit-frames", "7", "--cameras", "0,1,2,3,4,6", "--no-appearance"]
RESULTS = ["results.json", "results.csv", "results.md"]
# The engine "slurm" waits for its job, so that it can be compared.
ENGINES = {"slurm": ["--on", "slurm", "--wait"], "ray": ["--on", "ray"], "dask": ["--on", "dask"]}


def command(options, out, engine=()):
    return [options.gic, "-q", "--threads", "1", "bench", str(options.suite), "-o", str(out), "--repeat", "2",
            *engine, "--", *SHORT]


def missing(engine, options):
    """Why an engine cannot be used here; None where it can."""
    if engine == "slurm":
        programs = [name for name in ["munged", "slurmctld", "slurmd", "sbatch"] if not shutil.which(name)]
        if programs:
            return f"{', '.join(programs)} not installed"
        return None if os.geteuid() == 0 else "only root starts Slurm's daemons"
    module = "dask.distributed" if engine == "dask" else engine
    for name in [module, "gic.bench"]:
        found = subprocess.run([options.python, "-c", f"import {name}"], capture_output=True, check=False)
        if found.returncode != 0:
            return f"{options.python} has no {name}"
    return None


def processes():
    """Numbers, parents and command lines of all processes."""
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            words = (folder / "cmdline").read_bytes().decode().split("\0")
            parent = int((folder / "stat").read_text().rsplit(")", 1)[1].split()[1])
        except (OSError, ValueError):
            continue
        yield int(folder.name), parent, words


def kill_a_task(out, with_worker, running, timeout_s=600):
    """Waits until a task of `out` has reconstructed its scene, and kills it, or the worker that started it."""
    end = time.monotonic() + timeout_s
    while time.monotonic() < end and running.poll() is None:
        for number, parent, words in processes():
            if "--task" not in words or str(out) not in words:
                continue
            name = words[words.index("--task") + 1]
            if (out / name / "stamps" / "reconstruct.json").is_file() and not (out / name / "result.json").is_file():
                os.kill(parent if with_worker else number, signal.SIGKILL)
                return name
        time.sleep(0.1)
    raise SystemExit(f"check_engines: no task of {out} was there to be killed")


def results(out):
    return {name: (out / name).read_bytes() for name in RESULTS}


def check(engine, with_worker, options, wanted):
    out = options.folder / f"{engine}{'_worker' if with_worker else ''}"
    environment = dict(os.environ)
    if engine == "slurm":
        environment["SLURM_CONF"] = str(options.folder / "daemons" / "slurm.conf")
    flags = ENGINES[engine] + (["--python", options.python] if engine != "slurm" else [])
    with open(options.folder / f"{out.name}.txt", "w", encoding="utf-8") as log:
        first = subprocess.Popen(command(options, out, flags), stdout=log, stderr=log, env=environment)
        killed = kill_a_task(out, with_worker, first)
        first.wait()
        finished = [record.stat().st_mtime_ns for record in sorted(out.glob("*/*/result.json"))]
        if engine == "slurm":
            if (out / killed / "result.json").is_file():
                raise SystemExit(f"check_engines: {killed} was killed and has a result")
            subprocess.run(command(options, out, flags), stdout=log, stderr=log, env=environment, check=True)
        kept = [record.stat().st_mtime_ns for record in sorted(out.glob("*/*/result.json"))]
    if not set(finished) <= set(kept):
        raise SystemExit(f"check_engines: {engine} ran a finished task again")
    found = results(out)
    for name in RESULTS:
        if found[name] != wanted[name]:
            raise SystemExit(f"check_engines: {out / name} differs from the one of this machine")
    print(f"{engine}: {killed} {'and its worker were' if with_worker else 'was'} killed; all results are the same bytes")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--gic", default=str(ROOT / "target" / "release" / "gic"))
    parser.add_argument("--python", default=sys.executable, help="the Python that has ray, dask and gic")
    parser.add_argument("--only", choices=ENGINES, help="this engine only")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="work there and leave it")
    options = parser.parse_args()
    engines = [options.only] if options.only else list(ENGINES)
    reasons = {engine: missing(engine, options) for engine in engines}
    for engine, reason in reasons.items():
        if reason:
            print(f"{engine}: SKIPPED, {reason}")
    engines = [engine for engine in engines if not reasons[engine]]
    if not engines:
        return
    options.gic = str(Path(options.gic).resolve())
    with tempfile.TemporaryDirectory() as folder:
        options.folder = (options.keep or Path(folder)).resolve()
        options.suite = options.folder / "suite"
        options.suite.mkdir(parents=True, exist_ok=True)
        if not (options.suite / "cat").exists():
            (options.suite / "cat").symlink_to(SCENE)
        out = options.folder / "local"
        subprocess.run(command(options, out), stdout=subprocess.DEVNULL, check=True)
        wanted = results(out)
        slurm = [str(ROOT / "scripts" / "slurm_local.sh"), "start", str(options.folder / "daemons")]
        for engine in engines:
            if engine == "slurm":
                subprocess.run(slurm, stdout=subprocess.DEVNULL, check=True)
            try:
                check(engine, False, options, wanted)
                if engine != "slurm":
                    check(engine, True, options, wanted)
            finally:
                if engine == "slurm":
                    subprocess.run([slurm[0], "stop", slurm[2]], check=True)


if __name__ == "__main__":
    main()
