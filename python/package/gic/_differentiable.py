"""What the wrappers of torch and JAX share: named inputs of a rollout and of a picture, forward and backward."""

from __future__ import annotations

from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from . import splat
from .errors import UsageError
from .simulator import BodyGradient, Recording, Simulator

#: A body's number and the name of one of its fields or material parameters.
Key = Tuple[int, str]

#: The attributes of Gaussians, in the order in which the wrappers take them.
ATTRIBUTES = ("positions_m", "opacities", "scales_m", "rotations", "sh")


def named(inputs: Sequence[Mapping[str, Any]]) -> Tuple[List[Key], List[Any]]:
    """The keys and values of one mapping for each body."""
    pairs = [((body, name), value) for body, mapping in enumerate(inputs) for name, value in mapping.items()]
    if not pairs:
        raise UsageError('nothing to differentiate by: give a mapping such as {"youngs_modulus_pa": ...}')
    return [key for key, _ in pairs], [value for _, value in pairs]


def replaced(simulator: Simulator, keys: Sequence[Key], arrays: Sequence[np.ndarray]) -> Simulator:
    """The simulator with these inputs."""
    changes: List[Dict[str, Any]] = [{} for _ in range(max(body for body, _ in keys) + 1)]
    for (body, name), array in zip(keys, arrays):
        changes[body][name] = array
    return simulator.replace(*changes)


def rollout_gradients(
    recording: Recording, keys: Sequence[Key], arrays: Sequence[np.ndarray], positions: Any, velocities: Any
) -> List[np.ndarray]:
    """Derivatives of the loss with respect to the inputs, in their shapes."""
    bodies: List[BodyGradient] = recording.gradient(positions, velocities)
    return [bodies[body].of(name).reshape(np.shape(array)) for (body, name), array in zip(keys, arrays)]


def picture(camera: splat.Camera, attributes: Sequence[Any], settings: Mapping[str, Any]) -> splat.Picture:
    """The picture of Gaussians with these attributes, with colour, alpha and depth."""
    gaussians = splat.Gaussians(**dict(zip(ATTRIBUTES, attributes)))
    return splat.render(gaussians, camera, **settings)


def pictures_of(picture: splat.Picture) -> Tuple[Any, Any, Any]:
    """Colour, alpha and depth; zeros of colour where there is none."""
    color = picture.color if picture.color is not None else np.zeros((*picture.alpha.shape, 3), np.float32)
    return color, picture.alpha, picture.depth_m


def attribute_gradients(
    picture: splat.Picture, attributes: Sequence[Optional[np.ndarray]], bars: Sequence[np.ndarray]
) -> List[Optional[np.ndarray]]:
    """Derivatives of the loss with respect to the attributes, from those with respect to colour, alpha and depth."""
    color, alpha, depth = bars
    found = picture.backward(color=None if picture.color is None else color, alpha=alpha, depth_m=depth)
    return [None if array is None else getattr(found, name) for name, array in zip(ATTRIBUTES, attributes)]
