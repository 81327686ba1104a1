"""Differentiable Gaussian splatting on the CPU: colour, alpha and depth in one pass, and 3DGS files."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, List, Optional, Sequence, Tuple, Union

import numpy as np

from . import _gic
from ._arrays import checked, number, vector
from .errors import GicWarning, UsageError

__all__ = ["Camera", "GaussianGradients", "Gaussians", "Picture", "read_ply", "render", "write_ply"]

#: Coefficients of spherical harmonics of degree 0 to 3.
_SH_COUNTS = (1, 4, 9, 16)


@dataclass(frozen=True)
class Gaussians:
    """n Gaussians in the world frame, as float32.

    positions_m: centres [m], shape [n, 3].
    opacities: opacity at the centre, in [0, 1], shape [n].
    scales_m: standard deviations [m], shape [n]; or [n, 3] along the axes of ``rotations``.
    rotations: quaternions (w, x, y, z), world from local, shape [n, 4]; None for balls.
    sh: spherical-harmonics coefficients, RGB, shape [n, k, 3] with k = 1, 4, 9 or 16; colour = 0.5 + sum. None where
        no colour is drawn.

    Raises UsageError where an array has another shape or is not finite.
    """

    positions_m: np.ndarray
    opacities: np.ndarray
    scales_m: np.ndarray
    rotations: Optional[np.ndarray] = None
    sh: Optional[np.ndarray] = None

    def __post_init__(self) -> None:
        positions = checked("positions_m", self.positions_m, ("n", 3), np.float32)
        n = len(positions)
        shapes = {
            "opacities": (n,),
            "scales_m": (n,) if self.rotations is None else (n, 3),
            "rotations": (n, 4),
            "sh": (n, "k", 3),
        }
        arrays = {"positions_m": positions}
        for name, shape in shapes.items():
            value = getattr(self, name)
            if value is not None or name in ("opacities", "scales_m"):
                arrays[name] = checked(name, value, shape, np.float32)
        if "sh" in arrays and arrays["sh"].shape[1] not in _SH_COUNTS:
            raise UsageError(f"sh has {arrays['sh'].shape[1]} coefficients; there must be 1, 4, 9 or 16")
        for name, array in arrays.items():
            object.__setattr__(self, name, array)

    def __len__(self) -> int:
        return len(self.positions_m)

    def _attributes(self) -> Tuple[Any, ...]:
        return (self.positions_m, self.opacities, self.scales_m, self.rotations, self.sh)


@dataclass(frozen=True)
class Camera:
    """A pinhole camera: x right, y down, z forward; the centre of the pixel in column i, row j is (i + 0.5, j + 0.5).

    width, height: of the picture [pixels]. focal_px, principal_px: (fx, fy) and (cx, cy) [pixels].
    world_from_camera: rotation and centre [m] as a matrix of shape [3, 4] or [4, 4].
    """

    width: int
    height: int
    focal_px: Sequence[float]
    principal_px: Sequence[float]
    world_from_camera: np.ndarray

    def __post_init__(self) -> None:
        pose = checked("world_from_camera", self.world_from_camera, ("rows", 4))
        rotation = pose[:3, :3]
        if len(pose) not in (3, 4) or not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-4):
            raise UsageError("world_from_camera must hold a rotation and a centre, shape (3, 4) or (4, 4)")
        if self.width < 1 or self.height < 1:
            raise UsageError(f"a picture of {self.width}x{self.height} pixels has none")
        object.__setattr__(self, "world_from_camera", pose)

    @classmethod
    def looking_at(
        cls,
        eye_m: Sequence[float],
        target_m: Sequence[float],
        up: Sequence[float] = (0.0, 1.0, 0.0),
        *,
        width: int = 400,
        height: int = 400,
        focal_px: Optional[float] = None,
    ) -> Camera:
        """A camera at ``eye_m`` that has ``target_m`` in the middle of its picture; the focal length is the width by
        default."""
        eye = np.asarray(vector("eye_m", eye_m))
        forward = np.asarray(vector("target_m", target_m)) - eye
        right = np.cross(forward, vector("up", up))
        if not np.linalg.norm(right) > 0.0:
            raise UsageError("up must not lie along the view")
        axes = np.stack([axis / np.linalg.norm(axis) for axis in (right, np.cross(forward, right), forward)], axis=1)
        focal = float(width) if focal_px is None else number("focal_px", focal_px)
        pose = np.hstack([axes, eye[:, None]])
        return cls(width, height, (focal, focal), (width / 2, height / 2), pose)

    def _numbers(self) -> Tuple[Any, ...]:
        focal = checked("focal_px", self.focal_px, (2,)).tolist()
        principal = checked("principal_px", self.principal_px, (2,)).tolist()
        pose = self.world_from_camera
        return (self.width, self.height, focal, principal, pose[:3, :3].tolist(), pose[:3, 3].tolist())


@dataclass(frozen=True)
class GaussianGradients:
    """Derivatives of a loss with respect to the attributes of Gaussians, in their shapes; ``screen`` is the norm of
    that with respect to the projected centre [per pixel], shape [n], which densification looks at."""

    positions_m: np.ndarray
    opacities: np.ndarray
    scales_m: np.ndarray
    rotations: Optional[np.ndarray]
    sh: Optional[np.ndarray]
    screen: np.ndarray


@dataclass(frozen=True)
class Picture:
    """What a camera sees of Gaussians, float32.

    color: over the background, shape [height, width, 3]; None where there are no coefficients.
    alpha: accumulated alpha, shape [height, width].
    depth_m: sum of transmittance, alpha and depth (not divided by alpha) [m], shape [height, width]; None where not
        asked for.
    rejected: Gaussians left out for attributes that cannot be drawn.
    """

    alpha: np.ndarray
    rejected: int
    color: Optional[np.ndarray] = None
    depth_m: Optional[np.ndarray] = None
    _native: Any = field(default=None, repr=False, compare=False)

    def backward(self, color: Any = None, alpha: Any = None, depth_m: Any = None) -> GaussianGradients:
        """Derivatives of a loss with respect to the Gaussians; the arguments are its derivatives with respect to the
        pictures, in their shapes, None where it does not depend on one."""
        size = self.alpha.shape
        shapes = {"color": (*size, 3), "alpha": size, "depth_m": size}
        given = {"color": color, "alpha": alpha, "depth_m": depth_m}
        arrays = [None if value is None else checked(name, value, shapes[name], np.float32)
                  for name, value in given.items()]
        return GaussianGradients(**self._native.backward(*arrays))


def render(
    gaussians: Gaussians,
    camera: Camera,
    *,
    background: Sequence[float] = (0.0, 0.0, 0.0),
    depth: bool = True,
    dilation_px2: float = 0.3,
    compensate: bool = False,
    near_m: float = 0.01,
    max_sh_degree: int = 3,
) -> Picture:
    """Draws Gaussians front to back, as 3DGS does.

    background: colour in [0, 1]. depth: whether to draw it. dilation_px2: low-pass filter, added to the diagonal of
    every projected covariance. compensate: keeps each Gaussian's total under that filter. near_m: what is nearer to the
    camera plane is not drawn. max_sh_degree: higher coefficients are left out.

    Raises UsageError and SplatError for Gaussians that cannot be drawn.
    """
    channels = ("color_" if gaussians.sh is not None else "") + ("alpha_depth" if depth else "alpha")
    native = _gic.render(gaussians._attributes(), camera._numbers(), list(vector("background", background)), channels,
                         number("dilation_px2", dilation_px2), compensate, number("near_m", near_m), max_sh_degree)
    return Picture(**native.pictures(), _native=native)


def read_ply(path: Union[str, Path]) -> Gaussians:
    """Gaussians of a PLY file in the 3DGS convention. Warns of what is left out; raises SplatError."""
    attributes, dropped = _gic.read_ply(str(path))
    _warn(dropped)
    return Gaussians(**attributes)


def write_ply(path: Union[str, Path], gaussians: Gaussians) -> None:
    """Writes such a file, which the usual viewers open. Warns of what does not fit it; raises SplatError."""
    _warn(_gic.write_ply(str(path), gaussians._attributes()))


def _warn(sentences: List[str]) -> None:
    for sentence in sentences:
        warnings.warn(sentence, GicWarning, stacklevel=3)
