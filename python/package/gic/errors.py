"""What can go wrong, by kind. Every message is the program's own; ``hint`` is the way out, where one is known."""

from __future__ import annotations

from typing import Optional

__all__ = [
    "GicError", "GicWarning", "Interrupted", "RunError", "SceneError", "SimulationError", "SplatError", "TwinError",
    "UsageError",
]


class _Explained(BaseException):
    """An exception with a hint."""

    hint: Optional[str]

    def __init__(self, message: str = "", hint: Optional[str] = None) -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint

    def __str__(self) -> str:
        return f"{self.message}\nhint: {self.hint}" if self.hint else self.message


class GicError(_Explained, Exception):
    """The base of all errors of gic."""


class UsageError(GicError, ValueError):
    """An argument that makes no sense: wrong shape, type, name or place."""


class SceneError(GicError):
    """A scene that cannot be read."""


class RunError(GicError):
    """A run folder or a stage of the pipeline: unreadable, damaged, failed."""


class TwinError(GicError):
    """A twin or its matter: unreadable, damaged, not valid."""


class SimulationError(GicError):
    """A world that cannot be simulated, or a simulation that failed."""


class SplatError(GicError):
    """Gaussians that cannot be drawn, read or written."""


class Interrupted(_Explained, KeyboardInterrupt):
    """The user pressed Ctrl-C; what was finished is kept. As every ``KeyboardInterrupt``, it is no ``Exception``."""


class GicWarning(UserWarning):
    """Something that may spoil a result."""
