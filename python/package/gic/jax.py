"""The simulator and the rasteriser as functions of JAX: ``jax.grad`` goes through them, also under ``jax.jit``.

They run on the CPU through ``jax.pure_callback``; the backward pass simulates once more. Results have JAX's usual
precision: set ``jax_enable_x64`` for float64.
"""

from __future__ import annotations

from functools import partial
from typing import Any, List, Mapping, Optional, Tuple, Union

import jax
import jax.numpy as jnp
import numpy as np

from . import splat
from ._arrays import frame_numbers
from ._differentiable import ATTRIBUTES, attribute_gradients, named, picture, pictures_of, replaced, rollout_gradients
from .simulator import Frames, Simulator

__all__ = ["render", "rollout"]


def rollout(simulator: Simulator, frames: Frames, *inputs: Mapping[str, Any]) -> Tuple[jax.Array, jax.Array]:
    """Positions [m] and velocities [m/s] of the frames, shape [f, n, 3] each.

    frames: as in ``Simulator.rollout``.
    inputs: one mapping for each of the first bodies, of arrays by the name of a field or material parameter:
        ``{"youngs_modulus_pa": e, "velocity_m_s": v}``.
    """
    keys, arrays = named(inputs)
    call = _RolloutCall(simulator, frames, keys)
    return _called(call, tuple(jnp.asarray(array, dtype=float) for array in arrays))


def render(
    camera: splat.Camera,
    positions_m: Any,
    opacities: Any,
    scales_m: Any,
    rotations: Any = None,
    sh: Any = None,
    **settings: Any,
) -> Tuple[jax.Array, jax.Array, jax.Array]:
    """Colour [height, width, 3], alpha [height, width] and depth [m, height, width] of Gaussians, float32; attributes
    and settings as in ``gic.splat``. Without ``sh`` the colour is zero."""
    attributes = (positions_m, opacities, scales_m, rotations, sh)
    given = [name for name, value in zip(ATTRIBUTES, attributes) if value is not None]
    arrays = tuple(jnp.asarray(value, dtype=jnp.float32) for value in attributes if value is not None)
    return _called(_PictureCall(camera, settings, given), arrays)


def _callback(function: Any, shapes: Any, *arguments: Any) -> Any:
    return jax.pure_callback(function, shapes, *arguments, vmap_method="sequential")


def _shapes_of(arrays: Any) -> Any:
    return tuple(jax.ShapeDtypeStruct(array.shape, array.dtype) for array in arrays)


def _like(gradients: Any, arrays: Any) -> Tuple[np.ndarray, ...]:
    return tuple(np.asarray(gradient, dtype=array.dtype) for gradient, array in zip(gradients, arrays))


class _RolloutCall:
    """What of a rollout is no array."""

    def __init__(self, simulator: Simulator, frames: Frames, keys: Any) -> None:
        self.simulator, self.frames, self.keys = simulator, frames, keys
        # As JAX rounds it: float32, or float64 where that is enabled.
        number = jnp.zeros((), dtype=float).dtype
        count, kept = frame_numbers(frames)
        shape = (count if kept is None else len(kept), simulator.particles, 3)
        self.shapes = (jax.ShapeDtypeStruct(shape, number),) * 2

    def forward(self, *arrays: Any) -> Any:
        found = replaced(self.simulator, self.keys, _numpy(arrays)).rollout(self.frames)
        return _like((found.positions_m, found.velocities_m_s), self.shapes)

    def backward(self, arrays: Any, bars: Any) -> Any:
        arrays = _numpy(arrays)
        recording = replaced(self.simulator, self.keys, arrays).record(self.frames)
        return _like(rollout_gradients(recording, self.keys, arrays, *_numpy(bars)), arrays)


class _PictureCall:
    """What of a picture is no array."""

    def __init__(self, camera: splat.Camera, settings: Any, given: List[str]) -> None:
        self.camera, self.settings, self.given = camera, settings, given
        size = (camera.height, camera.width)
        self.shapes = tuple(jax.ShapeDtypeStruct(shape, jnp.float32) for shape in ((*size, 3), size, size))

    def _attributes(self, arrays: Any) -> List[Optional[np.ndarray]]:
        by_name = dict(zip(self.given, _numpy(arrays)))
        return [by_name.get(name) for name in ATTRIBUTES]

    def forward(self, *arrays: Any) -> Any:
        return pictures_of(picture(self.camera, self._attributes(arrays), self.settings))

    def backward(self, arrays: Any, bars: Any) -> Any:
        attributes = self._attributes(arrays)
        found = picture(self.camera, attributes, self.settings)
        gradients = attribute_gradients(found, attributes, _numpy(bars))
        return _like([gradient for gradient in gradients if gradient is not None], arrays)


@partial(jax.custom_vjp, nondiff_argnums=(0,))
def _called(call: Union[_RolloutCall, _PictureCall], arrays: Any) -> Any:
    return _callback(call.forward, call.shapes, *arrays)


def _called_forward(call: Union[_RolloutCall, _PictureCall], arrays: Any) -> Any:
    return _called(call, arrays), arrays


def _called_backward(call: Union[_RolloutCall, _PictureCall], arrays: Any, bars: Any) -> Any:
    return (_callback(call.backward, _shapes_of(arrays), arrays, bars),)


_called.defvjp(_called_forward, _called_backward)


def _numpy(arrays: Any) -> List[np.ndarray]:
    return [np.asarray(array) for array in arrays]
