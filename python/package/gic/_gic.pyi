"""The native half. Arrays must be contiguous, of the stated type and shape; the Python half sees to that."""

from os import PathLike
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple, Union

import numpy as np
from numpy.typing import NDArray

Path = Union[str, PathLike[str]]
Vector = Tuple[float, float, float]

__version__: str

def cli(words: Sequence[str]) -> int: ...
def call(words: Sequence[str], on_event: Optional[Callable[[str], Any]] = None) -> str: ...
def read_twin(path: Path) -> Tuple[str, str]: ...
def twin_world(
    path: Path, settings: Sequence[str], colliders: str, companions: Sequence[Tuple[Path, Vector]]
) -> Dict[str, Any]: ...

class Body:
    def __init__(
        self,
        material: str,
        positions: NDArray[np.float64],
        density: float,
        particle_volume: float,
        volume_factors: Optional[NDArray[np.float64]],
        velocity: Vector,
        angular_velocity: Vector,
        own_velocities: Optional[NDArray[np.float64]],
    ) -> None: ...
    @property
    def material(self) -> str: ...
    @property
    def positions(self) -> NDArray[np.float64]: ...
    @property
    def density(self) -> float: ...
    @property
    def particle_volume(self) -> float: ...
    @property
    def volume_factors(self) -> Optional[NDArray[np.float64]]: ...
    @property
    def velocity(self) -> Vector: ...
    @property
    def angular_velocity(self) -> Vector: ...

class World:
    def __init__(
        self,
        bodies: Sequence[Body],
        colliders: str,
        grid_spacing: float,
        gravity: Vector,
        frame_rate: float,
        stepping: Tuple[Optional[int], float],
        precision: str,
        gradient_memory_bytes: int,
        parallel: bool,
    ) -> None: ...
    def rollout(self, frames: int, kept: Optional[Sequence[int]], deformation: bool) -> Dict[str, Any]: ...
    def record(self, frames: int, kept: Optional[Sequence[int]]) -> Tuple[Recording, Dict[str, Any]]: ...
    def jacobian(
        self, frames: Sequence[int], unknowns: Sequence[Tuple[str, int, int]]
    ) -> Tuple[NDArray[np.float64], NDArray[np.float64]]: ...

class Recording:
    def gradient(
        self, positions: Dict[int, NDArray[np.float64]], velocities: Dict[int, NDArray[np.float64]]
    ) -> List[Dict[str, Any]]: ...

class Rendered:
    def pictures(self) -> Dict[str, Any]: ...
    def backward(
        self,
        color: Optional[NDArray[np.float32]],
        alpha: Optional[NDArray[np.float32]],
        depth: Optional[NDArray[np.float32]],
    ) -> Dict[str, Any]: ...

def render(
    attributes: Tuple[Any, ...],
    camera: Tuple[Any, ...],
    background: Sequence[float],
    channels: str,
    dilation: float,
    compensate: bool,
    near: float,
    max_sh_degree: int,
) -> Rendered: ...
def read_ply(path: Path) -> Tuple[Dict[str, Any], List[str]]: ...
def write_ply(path: Path, attributes: Tuple[Any, ...]) -> List[str]: ...
