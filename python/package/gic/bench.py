"""The tasks of a suite on Ray or Dask. ``gic bench SUITE -o OUT --on ray`` starts this module with an order on stdin::

    {"engine": "ray", "program": "/usr/bin/gic", "out": "/shared/out", "tasks": ["elastic_0"], "threads": 2,
     "memory_gb": 1.0, "jobs": null, "address": null}

A task is the command ``gic bench --task NAME OUT``; what it found lies in OUT, which all machines see by the same path.
The workers need the program and nothing of this package. A task that is killed, or whose worker is, is started again:
it goes on where it stopped.
"""

from __future__ import annotations

import json
import sys
from typing import Any, Callable, Dict, List

__all__ = ["main", "on_dask", "on_ray"]

# How often a task is started that is killed each time.
ATTEMPTS = 3


def _task(order: Dict[str, Any], name: str) -> Callable[[], int]:
    """A function that runs one task and returns its exit status; raises where the task was killed.

    It holds all that it needs, so that a worker can run it without this package.
    """
    program, out, threads = order["program"], order["out"], order["threads"]

    def run() -> int:
        import ctypes
        import os
        import signal
        import subprocess

        def end_with_the_worker() -> None:
            # Linux: a task whose worker is killed must not go on and keep its folder locked.
            if hasattr(signal, "SIGKILL") and os.path.exists("/proc/self"):
                ctypes.CDLL(None).prctl(1, signal.SIGKILL)

        command = [program, "--threads", str(threads), "bench", "--task", name, out]
        with open(os.path.join(out, name, "messages.txt"), "wb") as messages:
            status = subprocess.run(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=messages, check=False,
                preexec_fn=end_with_the_worker).returncode
        if status < 0:
            raise RuntimeError(f"{name} was killed by signal {-status}")
        return status

    return run


def on_ray(order: Dict[str, Any]) -> List[str]:
    """Runs the tasks of an order on Ray and returns the names of those that were killed each time."""
    import ray

    ray.init(address=order.get("address"), ignore_reinit_error=True, log_to_driver=False, include_dashboard=False)
    needs = {"num_cpus": order["threads"], "memory": int(1e9 * order["memory_gb"])}
    retries = {"max_retries": ATTEMPTS - 1, "retry_exceptions": True}
    waiting, running, killed = list(order["tasks"]), {}, []
    while waiting or running:
        while waiting and len(running) < (order.get("jobs") or len(order["tasks"])):
            name = waiting.pop(0)
            running[ray.remote(**needs, **retries)(_task(order, name)).remote()] = name
        for reference in ray.wait(list(running))[0]:
            name = running.pop(reference)
            try:
                _say(name, ray.get(reference))
            except ray.exceptions.RayError as error:
                killed.append(name)
                print(f"{name}: {error}", file=sys.stderr)
    return killed


def on_dask(order: Dict[str, Any]) -> List[str]:
    """Runs the tasks of an order on Dask and returns the names of those that were killed each time."""
    from dask.distributed import Client, LocalCluster, as_completed

    if order.get("address"):
        client = Client(order["address"])
    else:
        import os

        workers = max(1, (os.cpu_count() or 1) // order["threads"])
        client = Client(LocalCluster(n_workers=order.get("jobs") or workers, threads_per_worker=1, dashboard_address=None))
    waiting, names, killed = list(order["tasks"]), {}, []

    def submit() -> Any:
        name = waiting.pop(0)
        future = client.submit(_task(order, name), retries=ATTEMPTS - 1, pure=False)
        names[future] = name
        return future

    with client:
        running = as_completed([submit() for _ in range(min(order.get("jobs") or len(waiting), len(waiting)))])
        for future in running:
            if future.status == "finished":
                _say(names[future], future.result())
            else:
                killed.append(names[future])
                print(f"{names[future]}: {future.exception()}", file=sys.stderr)
            if waiting:
                running.add(submit())
    return killed


def _say(name: str, status: int) -> None:
    print(f"{name} {'done' if status == 0 else 'FAILED'}", file=sys.stderr)


def main() -> int:
    """Carries out the order on stdin. A task that fails has a record that says why, and is no failure of the engine."""
    order = json.load(sys.stdin)
    engines = {"ray": on_ray, "dask": on_dask}
    try:
        killed = engines[order["engine"]](order)
    except ImportError as error:
        install = {"ray": "ray", "dask": "'dask[distributed]'"}[order["engine"]]
        print(f"error: {error}; pip install {install} into {sys.executable}", file=sys.stderr)
        return 1
    return 1 if killed else 0


if __name__ == "__main__":
    sys.exit(main())
