"""Progress of a command: a bar, plain lines, or a function of one's own."""

from __future__ import annotations

import json
import sys
import warnings
from typing import Any, Callable, Dict, Optional, Union

from .errors import GicWarning

Event = Dict[str, Any]
Progress = Union[bool, Callable[[Event], Any]]


def listener(progress: Progress) -> Callable[[str], None]:
    """What receives a command's events as JSON: warnings become warnings, all else goes to ``progress``."""
    if callable(progress):
        receive: Callable[[Event], Any] = progress
    else:
        receive = _Bar() if progress else lambda event: None

    def receive_text(text: str) -> None:
        event = json.loads(text)
        if event["event"] == "warning":
            warnings.warn(f"{event['stage']}: {event['text']}", GicWarning, stacklevel=3)
        receive(event)

    return receive_text


class _Bar:
    """A bar of tqdm for each stage's phase, where tqdm is installed; lines on stderr where it is not."""

    def __init__(self) -> None:
        self._bar: Optional[Any] = None
        self._phase: Optional[str] = None
        try:
            from tqdm.auto import tqdm
        except ImportError:
            tqdm = None
        self._tqdm = tqdm

    def __call__(self, event: Event) -> None:
        kind = event["event"]
        if kind == "step":
            self._step(event)
        elif kind in ("stage_started", "stage_done", "failed"):
            self._close()
        if kind == "stage_done":
            self._line(f"{event['stage']}: done in {event['seconds']:.1f} s")

    def _step(self, event: Event) -> None:
        if self._tqdm is None:
            return
        phase = event["phase"] or event["stage"]
        if self._bar is None or phase != self._phase:
            self._close()
            self._phase = phase
            self._bar = self._tqdm(desc=phase, total=event["of"], leave=False)
        self._bar.update(max(0, event["step"] - self._bar.n))
        self._bar.set_postfix({name: f"{value:.4g}" for name, value in event["values"].items()}, refresh=False)

    def _close(self) -> None:
        if self._bar is not None:
            self._bar.close()
            self._bar = None

    def _line(self, text: str) -> None:
        if self._tqdm is None:
            print(text, file=sys.stderr)
        else:
            self._tqdm.write(text, file=sys.stderr)
