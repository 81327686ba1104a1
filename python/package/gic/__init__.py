"""gic: from videos of a moving object to a physical digital twin, and a differentiable simulator.

>>> import gic
>>> run = gic.run("scene", material="elastic", out="out/twin")
>>> run.twin.simulate(frames=48, set={"gravity_m_s2": [0, -1.62, 0]}).positions_m

``gic.Simulator`` is the simulator alone, ``gic.splat`` the differentiable rasteriser; ``gic.torch`` and ``gic.jax``
put both into a loss. Units are SI, arrays are NumPy's.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from ._gic import __version__

if TYPE_CHECKING:
    from . import errors, splat
    from .errors import (
        GicError, GicWarning, Interrupted, RunError, SceneError, SimulationError, SplatError, TwinError, UsageError,
    )
    from .pipeline import Run, command, evaluate, export, inspect, run
    from .simulator import Body, BodyGradient, Jacobian, Recording, Rollout, Simulator, block
    from .twin import Twin

# What is imported when it is first used, and from where.
_LAZY = {
    **dict.fromkeys(
        ["GicError", "GicWarning", "Interrupted", "RunError", "SceneError", "SimulationError", "SplatError",
         "TwinError", "UsageError"], "errors"),
    **dict.fromkeys(["Run", "command", "evaluate", "export", "inspect", "run"], "pipeline"),
    **dict.fromkeys(["Body", "BodyGradient", "Jacobian", "Recording", "Rollout", "Simulator", "block"], "simulator"),
    "Twin": "twin",
}
_MODULES = ["bench", "errors", "jax", "pipeline", "simulator", "splat", "torch", "twin"]

__all__ = [*_LAZY, "__version__", "errors", "splat"]


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        value = getattr(importlib.import_module(f".{_LAZY[name]}", __name__), name)
    elif name in _MODULES:
        value = importlib.import_module(f".{name}", __name__)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_LAZY, *_MODULES})
