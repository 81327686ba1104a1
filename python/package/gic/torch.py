"""The simulator and the rasteriser as functions of torch: ``loss.backward()`` goes through them."""

from __future__ import annotations

from typing import Any, List, Mapping, Optional, Tuple

import torch

from . import splat
from ._differentiable import attribute_gradients, named, picture, pictures_of, replaced, rollout_gradients
from .simulator import Frames, Simulator

__all__ = ["render", "rollout"]


def rollout(
    simulator: Simulator, frames: Frames, *inputs: Mapping[str, torch.Tensor]
) -> Tuple[torch.Tensor, torch.Tensor]:
    """Positions [m] and velocities [m/s] of the frames, float64, shape [f, n, 3] each.

    frames: as in ``Simulator.rollout``.
    inputs: one mapping for each of the first bodies, of tensors by the name of a field or material parameter:
        ``{"youngs_modulus_pa": e, "velocity_m_s": v}``. All of them get gradients; derivatives of derivatives do not
        exist.
    """
    keys, tensors = named(inputs)
    return _Rollout.apply(simulator, frames, keys, *(torch.as_tensor(tensor) for tensor in tensors))


def render(
    camera: splat.Camera,
    positions_m: torch.Tensor,
    opacities: torch.Tensor,
    scales_m: torch.Tensor,
    rotations: Optional[torch.Tensor] = None,
    sh: Optional[torch.Tensor] = None,
    **settings: Any,
) -> Tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Colour [height, width, 3], alpha [height, width] and depth [m, height, width] of Gaussians, float32; attributes
    and settings as in ``gic.splat``. Without ``sh`` the colour is zero."""
    return _Picture.apply(camera, settings, positions_m, opacities, scales_m, rotations, sh)


def _arrays(tensors: Any) -> List[Any]:
    return [None if tensor is None else tensor.detach().cpu().numpy() for tensor in tensors]


def _like(gradients: Any, tensors: Any) -> List[Optional[torch.Tensor]]:
    """Gradients with the types and devices of their tensors."""
    return [None if tensor is None or gradient is None else torch.as_tensor(gradient).to(tensor)
            for gradient, tensor in zip(gradients, tensors)]


class _Rollout(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, simulator: Simulator, frames: Frames, keys: Any, *tensors: torch.Tensor) -> Any:
        arrays = _arrays(tensors)
        changed = replaced(simulator, keys, arrays)
        if any(ctx.needs_input_grad):
            ctx.recording = changed.record(frames)
            ctx.keys, ctx.arrays = keys, arrays
            ctx.save_for_backward(*tensors)
            found = ctx.recording.rollout
        else:
            found = changed.rollout(frames)
        return torch.from_numpy(found.positions_m), torch.from_numpy(found.velocities_m_s)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, positions: torch.Tensor, velocities: torch.Tensor) -> Any:
        bars = _arrays((positions, velocities))
        gradients = rollout_gradients(ctx.recording, ctx.keys, ctx.arrays, *bars)
        return (None, None, None, *_like(gradients, ctx.saved_tensors))


class _Picture(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, camera: splat.Camera, settings: Any, *tensors: Optional[torch.Tensor]) -> Any:
        ctx.arrays = _arrays(tensors)
        ctx.picture = picture(camera, ctx.arrays, settings)
        ctx.save_for_backward(*tensors)
        return tuple(torch.from_numpy(array) for array in pictures_of(ctx.picture))

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, *bars: torch.Tensor) -> Any:
        gradients = attribute_gradients(ctx.picture, ctx.arrays, _arrays(bars))
        return (None, None, *_like(gradients, ctx.saved_tensors))
