"""The pipeline: from a folder of videos to a twin. Each function is a command of the program ``gic``; its flags are
keyword arguments (``fit_frames=10`` for ``--fit-frames 10``), as ``gic COMMAND --help`` and ``docs/guide.md`` explain
them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional, Union

from . import _gic
from .progress import Progress, listener
from .twin import PathLike, Twin

__all__ = ["Run", "command", "evaluate", "export", "inspect", "run"]


def command(name: str, *arguments: Any, progress: Progress = False, **flags: Any) -> str:
    """Runs any command of ``gic`` and returns what it prints on stdout.

    flags: ``True`` sets a flag, ``None`` and ``False`` leave it out; a mapping gives one ``--flag KEY=VALUE`` for each
        entry, a sequence of numbers one value with commas, a sequence of texts one flag for each.
    progress: True for a bar, or a function that receives each event as in ``log.jsonl``.

    Long commands release the interpreter's lock. Ctrl-C stops at a safe point with ``Interrupted``, a second one at
    once. Raises the errors of ``gic.errors``, with the program's messages.
    """
    words = ["gic", name, *(str(argument) for argument in arguments)]
    for flag, value in flags.items():
        words += _words(f"--{flag.strip('_').replace('_', '-')}", value)
    return _gic.call(words, listener(progress))


def _words(flag: str, value: Any) -> List[str]:
    if value is None or value is False:
        return []
    if value is True:
        return [flag]
    if isinstance(value, Mapping):
        return [f"{flag}={key}={_value(entry)}" for key, entry in value.items()]
    if isinstance(value, (list, tuple)) and all(isinstance(entry, (str, Path)) for entry in value):
        return [f"{flag}={entry}" for entry in value]
    return [f"{flag}={_value(value)}"]


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (str, Path)):
        return str(value)
    if hasattr(value, "tolist"):
        value = value.tolist()
    return ",".join(_value(entry) for entry in value) if isinstance(value, (list, tuple)) else repr(value)


class Run:
    """The folder of a run. Raises RunError or TwinError where its files are damaged or not there yet."""

    def __init__(self, folder: PathLike) -> None:
        self.folder = Path(folder)

    def __repr__(self) -> str:
        return f"Run({str(self.folder)!r})"

    @property
    def twin(self) -> Twin:
        """The twin."""
        return Twin(self.folder)

    @property
    def report(self) -> Path:
        """The report, a page for a browser."""
        return self.folder / "report.html"

    @property
    def events(self) -> List[Dict[str, Any]]:
        """Every step of the run, from ``log.jsonl``."""
        with open(self.folder / "log.jsonl", encoding="utf-8") as lines:
            return [json.loads(line) for line in lines]

    def table(self) -> List[Dict[str, Any]]:
        """One row for each parameter, for ``pandas.DataFrame``; see ``Twin.table``."""
        return self.twin.table()

    def evaluate(self, truth: PathLike) -> Dict[str, Any]:
        """See ``gic.evaluate``."""
        return evaluate(self, truth)

    def export(self, format: str, out: Optional[PathLike] = None) -> str:
        """See ``gic.export``."""
        return export(self, format, out)

    def _repr_html_(self) -> str:
        return self.twin._repr_html_()


def run(
    scene: PathLike,
    material: Optional[str] = None,
    *,
    out: PathLike,
    progress: Progress = True,
    **flags: Any,
) -> Run:
    """Makes the twin of a scene: ``gic run SCENE --material MATERIAL -o OUT``.

    scene: the folder with videos and cameras. material: elastic, viscoelastic, plasticine, sand,
        newtonian, non-newtonian, or auto.
    out: the run folder; what it holds already is not made again. progress, flags: as in ``command``, for example
    ``fix={"poisson_ratio": 0.3}``, ``fit_frames=10``, ``no_appearance=True``, ``set={"reconstruct.iterations": 500}``.

    Raises SceneError, RunError, UsageError; Interrupted after Ctrl-C: the same call goes on where it stopped.
    """
    command("run", scene, progress=progress, out=out, material=material, **flags)
    return Run(out)


def inspect(scene: PathLike, **flags: Any) -> Dict[str, Any]:
    """What gic reads of a scene: cameras, frames, masks, size, ground, motion, warnings. ``sheet="sheet.png"`` writes a
    contact sheet. Lengths in metres. Raises SceneError."""
    text = command("inspect", scene, json=True, **flags)
    return json.JSONDecoder().raw_decode(text)[0]


def evaluate(run: Union[Run, PathLike], truth: PathLike, **flags: Any) -> Dict[str, Any]:
    """A run against ground truth, in the units of the papers; also in ``eval.json`` of the run. ``parameters`` and
    ``frames`` are lists of rows for ``pandas.DataFrame``."""
    folder = _folder(run)
    command("eval", folder, truth=truth, **flags)
    with open(folder / "eval.json", encoding="utf-8") as file:
        return json.load(file)


def export(run: Union[Run, PathLike], format: str, out: Optional[PathLike] = None, **flags: Any) -> str:
    """Writes the matter of a run for other programs: ply, surface-ply, obj, stl, msh, mjcf, usd, particles. Returns in
    a sentence what was written, and where."""
    return command("export", _folder(run), format=format, out=out, **flags).strip()


def _folder(run: Union[Run, PathLike]) -> Path:
    return run.folder if isinstance(run, Run) else Path(run)
