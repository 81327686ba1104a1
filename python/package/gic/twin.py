"""Physical digital twins."""

from __future__ import annotations

import html
import json
from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple, Union

from . import _gic
from ._arrays import vector
from .simulator import Body, Frames, Rollout, Simulator, _plain

__all__ = ["Twin"]

PathLike = Union[str, Path]


class Twin:
    """A twin: matter, its law, and its surroundings at time 0.

    path: ``twin.json`` or a run folder, which stands for the twin in it. Raises TwinError where it is not valid,
    RunError where the run is damaged.
    """

    def __init__(self, path: PathLike) -> None:
        text, file = _gic.read_twin(str(path))
        self._content: Dict[str, Any] = json.loads(text)
        self.path = Path(file)

    def __repr__(self) -> str:
        parameters = ", ".join(f"{name}={value:.4g}" for name, value in self.parameters.items())
        return f"Twin({self.model}: {parameters})"

    @property
    def model(self) -> str:
        """The law: elastic, viscoelastic, plasticine, sand, newtonian or non-newtonian."""
        return self._content["material"]["model"]

    @property
    def parameters(self) -> Dict[str, float]:
        """The material's parameters by name, in SI units."""
        return {key: value for key, value in self._content["material"].items() if key != "model"}

    @property
    def intervals(self) -> Dict[str, Tuple[float, float]]:
        """The 95 % interval of each identified number; empty where the twin was not identified."""
        return {key: (low, high) for key, (low, high) in self._content.get("intervals_95", {}).items()}

    @property
    def verdicts(self) -> Dict[str, bool]:
        """Whether the video determines each identified number."""
        return dict(self._content.get("identifiable", {}))

    def to_dict(self) -> Dict[str, Any]:
        """All of ``twin.json``, defaults included."""
        return json.loads(json.dumps(self._content))

    def table(self) -> List[Dict[str, Any]]:
        """One row for each parameter, for ``pandas.DataFrame``: value, interval, verdict; None where not known."""
        rows = []
        for name, value in self.parameters.items():
            low, high = self.intervals.get(name, (None, None))
            rows.append({"parameter": name, "value": value, "low_95": low, "high_95": high,
                         "identifiable": self.verdicts.get(name)})
        return rows

    def _repr_html_(self) -> str:
        cells = ["".join(f"<td>{html.escape(_short(cell))}</td>" for cell in row.values()) for row in self.table()]
        head = "".join(f"<th>{title}</th>" for title in ("parameter", "value", "from", "to (95 %)", "identifiable"))
        rows = "".join(f"<tr>{row}</tr>" for row in cells)
        return f"<table><caption>{html.escape(self.model)} twin</caption><tr>{head}</tr>{rows}</table>"

    def simulator(
        self,
        *,
        set: Optional[Mapping[str, Any]] = None,
        material: Optional[str] = None,
        colliders: Sequence[Mapping[str, Any]] = (),
        with_: Sequence[Tuple[Union[PathLike, Twin], Sequence[float]]] = (),
        **options: Any,
    ) -> Simulator:
        """The twin's world as a simulator.

        set: other values by their keys in ``twin.json``: ``{"youngs_modulus_pa": 2e5, "gravity_m_s2": [0, 0, 0]}``.
        material: another law; parameters that both have stay, further ones come with ``set``.
        colliders: further obstacles, in the form of ``twin.json``.
        with_: further twins in the same world, each with a shift [m].
        options: keyword arguments of ``Simulator``.

        The simulation is that of ``gic simulate``, to the bit. Raises TwinError, UsageError.
        """
        return self._world(set or {}, material, colliders, with_, options)[0]

    def simulate(
        self,
        frames: Optional[Frames] = None,
        *,
        set: Optional[Mapping[str, Any]] = None,
        material: Optional[str] = None,
        colliders: Sequence[Mapping[str, Any]] = (),
        with_: Sequence[Tuple[Union[PathLike, Twin], Sequence[float]]] = (),
        deformation: bool = True,
        **options: Any,
    ) -> Rollout:
        """Simulates the twin; ``frames`` as in ``Simulator.rollout``, by default as many as the twin says. The other
        arguments are those of ``simulator``."""
        simulator, usual = self._world(set or {}, material, colliders, with_, options)
        return simulator.rollout(usual if frames is None else frames, deformation=deformation)

    def _world(
        self,
        set: Mapping[str, Any],
        material: Optional[str],
        colliders: Sequence[Mapping[str, Any]],
        with_: Sequence[Tuple[Union[PathLike, Twin], Sequence[float]]],
        options: Mapping[str, Any],
    ) -> Tuple[Simulator, int]:
        """The simulator, and how many frames the twin says."""
        settings = [f"material.model={material}"] if material else []
        settings += [f"{key}={_text(value)}" for key, value in set.items()]
        obstacles = json.dumps([dict(collider) for collider in colliders], default=_plain)
        companions = [(str(twin.path if isinstance(twin, Twin) else twin), vector("with_", shift))
                      for twin, shift in with_]
        world = _gic.twin_world(str(self.path), settings, obstacles, companions)
        frames = world.pop("frames")
        world["bodies"] = [Body._of(body) for body in world["bodies"]]
        world["colliders"] = json.loads(world["colliders"])
        given = {key: value for key, value in world.items() if value is not None}
        return Simulator(**{**given, **options}), frames


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, default=_plain)


def _short(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
