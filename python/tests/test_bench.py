"""Tasks on Ray and Dask: each ends with its own status, and one that is killed starts again."""

import io
import json
import sys
from pathlib import Path

import pytest

from gic import bench

# In the place of `gic --threads N bench --task NAME OUT`: the task "killed" is killed the first time.
PROGRAM = """#!/bin/sh
echo "$5 $2" >> "$6/begun"
echo working >&2
if [ "$5" = killed ] && [ ! -f "$6/once" ]; then touch "$6/once"; kill -9 $$; fi
[ "$5" != failing ]
"""

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the stand-in for the program is a shell script")


@pytest.fixture
def order(tmp_path: Path) -> dict:
    program = tmp_path / "gic"
    program.write_text(PROGRAM)
    program.chmod(0o755)
    tasks = ["killed", "failing", "whole"]
    for name in tasks:
        (tmp_path / name).mkdir()
    return {"program": str(program), "out": str(tmp_path), "tasks": tasks, "threads": 1, "memory_gb": 0.1}


def begun(order: dict) -> list:
    return sorted((Path(order["out"]) / "begun").read_text().split("\n")[:-1])


def test_a_task_tells_its_status_and_that_it_was_killed(order):
    assert bench._task(order, "whole")() == 0
    assert bench._task(order, "failing")() == 1
    with pytest.raises(RuntimeError, match="killed by signal 9"):
        bench._task(order, "killed")()
    assert (Path(order["out"]) / "killed" / "messages.txt").read_text() == "working\n"


@pytest.mark.parametrize("engine", ["ray", "dask"])
def test_a_killed_task_starts_again(order, engine, monkeypatch):
    pytest.importorskip("dask.distributed" if engine == "dask" else engine)
    monkeypatch.setattr(sys, "stdin", io.StringIO(json.dumps({**order, "engine": engine, "jobs": 2})))
    assert bench.main() == 0
    assert begun(order) == ["failing 1", "killed 1", "killed 1", "whole 1"]


def test_an_engine_that_is_missing_is_named(order, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "ray", None)
    monkeypatch.setattr(sys, "stdin", io.StringIO(json.dumps({**order, "engine": "ray"})))
    assert bench.main() == 1
    assert "pip install ray" in capsys.readouterr().err
