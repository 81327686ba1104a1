"""Arguments as arrays that the engine takes, and what is wrong with them."""

from __future__ import annotations

from typing import Any, List, Optional, Sequence, Tuple, Union

import numpy as np

from .errors import UsageError

Size = Union[int, str]


def checked(name: str, value: Any, shape: Sequence[Size], dtype: Any = np.float64) -> np.ndarray:
    """``value`` as a contiguous array of finite real numbers; a letter in ``shape`` stands for any size.

    Raises UsageError, which names the argument, for another shape, numbers that are not real, and NaN or infinities.
    """
    array = _real(name, value)
    fits = array.ndim == len(shape) and all(
        isinstance(wanted, str) or found == wanted for found, wanted in zip(array.shape, shape)
    )
    if not fits:
        wanted = ", ".join(str(size) for size in shape) + ("," if len(shape) == 1 else "")
        raise UsageError(f"{name} must have shape ({wanted}), found {array.shape}")
    array = np.ascontiguousarray(array, dtype=dtype).reshape(array.shape)
    if not np.isfinite(array).all():
        place = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        index = f"[{', '.join(map(str, place))}]" if place else ""
        raise UsageError(f"{name}{index} is {array[place]}; it must be finite")
    return array


def _real(name: str, value: Any) -> np.ndarray:
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise UsageError(f"{name} is no array: {error}") from None
    if array.dtype.kind not in "fiu":
        raise UsageError(f"{name} must hold real numbers, not {array.dtype}")
    return array


def number(name: str, value: Any) -> float:
    """``value`` as a finite number; arrays of one number are numbers."""
    array = _real(name, value)
    if array.size != 1:
        raise UsageError(f"{name} must be one number, found an array of shape {array.shape}")
    return float(checked(name, array.reshape(()), ()))


def vector(name: str, value: Any) -> Tuple[float, float, float]:
    """``value`` as three finite numbers."""
    x, y, z = checked(name, value, (3,)).tolist()
    return x, y, z


def optional(name: str, value: Any, shape: Sequence[Size]) -> Optional[np.ndarray]:
    """As ``checked``, where there is a value."""
    return None if value is None else checked(name, value, shape)


def frame_numbers(frames: Union[int, Sequence[int]]) -> Tuple[int, Optional[List[int]]]:
    """How many frames an argument asks to simulate, and which of them to keep; None for all."""
    numbers = np.asarray(frames)
    if numbers.dtype.kind not in "iu" or numbers.ndim > 1 or numbers.size == 0:
        raise UsageError("frames must be a count or a sequence of frame numbers")
    if numbers.ndim == 0 and numbers >= 1:
        return int(numbers), None
    if numbers.ndim == 1 and numbers[0] >= 0 and (np.diff(numbers) > 0).all():
        return int(numbers[-1]) + 1, [int(frame) for frame in numbers]
    raise UsageError("frames must be a count of at least 1, or ascend from 0 or more")
