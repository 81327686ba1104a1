"""The pipeline from Python: the program's own results, progress, interrupts and errors."""

import json
import signal
import subprocess
import sys
import warnings

import gic
import pytest
from conftest import DEMO, program

#: A run of seconds, far from converged.
FEW = {"cameras": [0, 4, 6], "fit_frames": 4, "steps": 30, "no_appearance": True, "fix": {"poisson_ratio": 0.3},
       "set": {"identify.iterations": 3}}
FEW_WORDS = ["--cameras", "0,4,6", "--fit-frames", "4", "--steps", "30", "--no-appearance",
             "--fix", "poisson_ratio=0.3", "--set", "identify.iterations=3"]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A run, the events that its progress function got, and its warnings."""
    events = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        run = gic.run(DEMO, "elastic", out=tmp_path_factory.mktemp("run") / "twin", progress=events.append, **FEW)
    return run, events, [str(warning.message) for warning in caught if warning.category is gic.GicWarning]


def test_a_run_is_the_programs_own(made, tmp_path):
    run, _, _ = made
    done = program("run", DEMO, "-o", tmp_path / "twin", "--material", "elastic", *FEW_WORDS)
    assert done.returncode == 0, done.stderr
    twins = [json.loads((folder / "twin.json").read_text()) for folder in (run.folder, tmp_path / "twin")]
    for twin in twins:
        twin.pop("seconds")
    assert twins[0] == twins[1]
    files = ["twin.ply", *(f"prediction/particles_{frame:04}.ply" for frame in range(11))]
    for file in files:
        assert (run.folder / file).read_bytes() == (tmp_path / "twin" / file).read_bytes(), file


def test_a_run_has_a_twin_with_intervals(made):
    run, _, _ = made
    assert run.twin.model == "elastic" and run.twin.parameters["poisson_ratio"] == 0.3
    assert {"parameter", "value", "low_95", "high_95", "identifiable"} == run.table()[0].keys()
    assert run.report.read_text(encoding="utf-8").startswith("<!")
    assert "<table>" in run._repr_html_() and run.events[0]["event"] == "started"
    future = run.twin.simulate([3], set={"youngs_modulus_pa": 2e4})
    assert future.positions_m.shape == future.velocities_m_s.shape and future.frames == [3]


def test_progress_tells_every_event_in_order(made):
    run, events, told = made
    stages = [event["stage"] for event in events if event["event"] == "stage_done"]
    assert stages[:5] == ["reconstruct", "fill", "refine", "identify", "simulate"]
    steps = [event["step"] for event in events if event["event"] == "step" and event["stage"] == "reconstruct"]
    assert steps == sorted(steps) and steps[-1] == 30
    assert [event["event"] for event in run.events] == [event["event"] for event in events][:len(run.events)]
    assert any("density is taken as 1000" in text for text in told)


def test_a_run_goes_on_where_it_is(made):
    run, _, _ = made
    events = []
    gic.run(DEMO, "elastic", out=run.folder, progress=events.append, **FEW)
    assert {event["stage"] for event in events if event["event"] == "stage_skipped"} >= {"reconstruct", "identify"}


def test_a_run_is_evaluated_and_exported(made):
    run, _, _ = made
    evaluation = run.evaluate(DEMO / "gt")
    assert evaluation["model"] == "elastic" and evaluation["frames"][0]["observed"]
    assert evaluation["parameters"][0]["truth"] > 0.0
    assert "in " in run.export("obj") and (run.folder / "surface.obj").exists()
    with pytest.raises(gic.UsageError, match="invalid value 'xyz'"):
        run.export("xyz")


def test_a_scene_is_inspected(tmp_path):
    found = gic.inspect(DEMO, sheet=tmp_path / "sheet.png")
    assert found["camera_count"] == 8 and found["frame_count"] == 11 and (tmp_path / "sheet.png").exists()
    assert gic.inspect(DEMO, cameras=[0, 4, 6], threads=1)["camera_count"] == 3


@pytest.mark.parametrize("scene, changes, error, message", [
    ("none", {}, gic.SceneError, "no such file or folder"),
    (DEMO, {"fit_frames": 12}, gic.GicError, "from 2 to 11"),
    (DEMO, {"stepz": 3}, gic.UsageError, "unexpected argument '--stepz'"),
    (DEMO, {"set": {"reconstruct.stepz": 3}}, gic.UsageError, "stepz"),
    (DEMO, {"material": "jelly"}, gic.UsageError, "possible values: auto"),
])
def test_what_is_wrong_with_a_run_has_a_name(tmp_path, scene, changes, error, message):
    arguments = {"material": "elastic", **changes}
    with pytest.raises(error, match=message):
        gic.run(scene, out=tmp_path / "run", progress=False, **arguments)


def test_an_error_of_the_progress_function_stops_the_run(tmp_path):
    def fail(event):
        if event["event"] == "step":
            raise ZeroDivisionError("enough")

    with pytest.raises(ZeroDivisionError, match="enough"):
        gic.run(DEMO, "elastic", out=tmp_path / "run", progress=fail, **{**FEW, "steps": 100_000})


ENDLESS = """
import sys, gic
def tell(event):
    if event["event"] == "step":
        print("step", flush=True)
try:
    gic.run(sys.argv[1], "elastic", out=sys.argv[2], progress=tell, cameras=[0, 4, 6], fit_frames=4, steps=100_000)
except KeyboardInterrupt as error:
    print(type(error).__name__, error)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals of Unix")
def test_ctrl_c_stops_a_run_at_a_safe_point(tmp_path):
    command = [sys.executable, "-c", ENDLESS, str(DEMO), str(tmp_path / "run")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "step\n"
        process.send_signal(signal.SIGINT)
        rest, _ = process.communicate(timeout=60)
    last = [line for line in rest.splitlines() if line != "step"]
    assert last[0].startswith("Interrupted interrupted") and last[1].startswith("hint: run the same command again")


STIFF = """
import gic, sys
sys.path.insert(0, sys.argv[1])
from conftest import small_simulator
simulator = small_simulator(least_substeps_per_frame=2000)
print("starts", flush=True)
try:
    simulator.{call}
except gic.Interrupted as error:
    print(error)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals of Unix")
@pytest.mark.parametrize("call", ["rollout(100_000)", "jacobian(100_000, ['density_kg_m3'])"])
def test_ctrl_c_stops_a_simulation(call, request):
    command = [sys.executable, "-c", STIFF.replace("{call}", call), str(request.path.parent)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "starts\n"
        try:
            process.communicate(timeout=1)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGINT)
        rest, _ = process.communicate(timeout=60)
    assert rest.strip() == "interrupted"
