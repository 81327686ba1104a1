"""Every example runs and gives what it promises."""

import importlib
import sys
from pathlib import Path

import pytest
from conftest import DEMO

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


@pytest.fixture
def example(monkeypatch):
    """Imports an example by name, as if it were started in its folder."""
    monkeypatch.syspath_prepend(str(EXAMPLES))
    names = [path.stem for path in EXAMPLES.glob("*.py")]
    yield importlib.import_module
    for name in names:
        sys.modules.pop(name, None)


def test_video_to_twin(example, tmp_path, capsys):
    run = example("video_to_twin").main(DEMO, tmp_path / "twin", cameras=[0, 4, 6], fit_frames=4, steps=30,
                                        no_appearance=True, progress=False)
    assert run.twin.model == "elastic" and "on the Moon" in capsys.readouterr().out


def test_fit_modulus_torch(example):
    pytest.importorskip("torch", reason="torch is not installed")
    assert example("fit_modulus_torch").main() == pytest.approx(5e4, rel=0.05)


def test_fit_modulus_scipy(example):
    modulus, ratio = example("fit_modulus_scipy").main()
    assert modulus == pytest.approx(5e4, rel=1e-3) and ratio == pytest.approx(0.3, abs=1e-3)


def test_plan_throw(example):
    assert example("plan_throw").main() < 0.01


def test_posterior(example):
    sampled, expected = example("posterior").main()
    for one, other in zip(sampled, expected):
        assert 0.6 < one / other < 1.6


def test_compare_mpm(example):
    pytest.importorskip("taichi", reason="taichi is not installed")
    theirs, ours = example("compare_mpm").main(frames=10)
    assert abs(theirs - ours).max() < 5e-3


def test_notebook(tmp_path, monkeypatch):
    import nbformat
    from nbclient import NotebookClient

    monkeypatch.setenv("GIC_DEMO", str(DEMO))
    monkeypatch.setenv("GIC_OUT", str(tmp_path))
    notebook = nbformat.read(EXAMPLES / "twin.ipynb", as_version=4)
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    html = " ".join(output["data"].get("text/html", "") for output in outputs if "data" in output)
    assert "elastic twin" in html and "largest_von_mises_pa" in html
    assert "youngs_modulus_pa" in str(outputs[-1]["data"])
