"""Conversion of arguments to the contiguous arrays that the compiled part takes."""

from __future__ import annotations

import operator
from typing import Sequence

import numpy as np
from numpy.typing import ArrayLike, DTypeLike


def numbers(values: ArrayLike, name: str) -> np.ndarray:
    """An array of numbers of any type, without masked elements."""
    array = _unmasked(values, name)
    if array.dtype.kind not in "fiub":
        cure = f"; convert them by np.asarray({name}, dtype=float)" if array.dtype.kind == "O" else ""
        raise TypeError(f"{name} must be numbers, not {array.dtype}{cure}")
    return array


def whole_numbers(values: ArrayLike, name: str) -> np.ndarray:
    """An array of integers of any type, without masked elements."""
    array = _unmasked(values, name)
    if array.dtype.kind not in "iu" and array.size:
        raise TypeError(f"{name} must be whole numbers, not {array.dtype}")
    return array


def _unmasked(values: ArrayLike, name: str) -> np.ndarray:
    if np.ma.is_masked(values):
        raise ValueError(f"{name} has masked elements; fill them or leave them out")
    try:
        return np.asarray(values)
    except ValueError as error:
        raise ValueError(f"{name} must be an array, with rows of one length: {error}") from None


def floats(values: ArrayLike, name: str) -> np.ndarray:
    """A C-contiguous array of float32 or float64.

    Arrays of this kind are returned as they are; float16 becomes float32, and integers become float64. Masked elements are
    refused, since the library does not support masked arrays.
    """
    array = numbers(values, name)
    if array.dtype != np.float32 and array.dtype != np.float64:
        array = array.astype(np.float32 if array.dtype == np.float16 else np.float64)
    if not array.dtype.isnative:
        array = array.astype(array.dtype.newbyteorder("="))
    return contiguous(array)


def contiguous(array: ArrayLike, dtype: DTypeLike | None = None) -> np.ndarray:
    """A C-contiguous array whose elements lie at multiples of their size. Those of a buffer that is read from anywhere may not."""
    array = np.ascontiguousarray(array, dtype=dtype)
    return array if array.flags.aligned else array.copy()


def places(values: ArrayLike, name: str) -> tuple[np.ndarray, tuple[int, ...]]:
    """Finite positions as rows (m, 3), and their original shape without the last axis."""
    array = floats(values, name)
    if array.ndim == 0 or array.shape[-1] != 3:
        flat = "; give flat ones a third coordinate that is zero" if array.shape[-1:] == (2,) else ""
        raise ValueError(f"{name} must have the shape (..., 3), not {array.shape}{flat}")
    # If the sum is finite, so is every element. Otherwise each element is tested.
    with np.errstate(all="ignore"):
        suspicious = not np.isfinite(array.sum(dtype=np.float64))
    if suspicious and not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite; check for nan or inf values")
    return array.reshape(-1, 3), array.shape[:-1]


def per_query(values: ArrayLike, shape: tuple[int, ...], name: str) -> np.ndarray:
    """One float32 for all queries, or one for each query."""
    array = numbers(values, name)
    with np.errstate(over="ignore"):
        array = array.astype(np.float32, copy=False)
    if array.ndim == 0:
        return contiguous(array)
    try:
        return contiguous(np.broadcast_to(array, shape)).reshape(-1)
    except ValueError:
        raise ValueError(f"{name} has the shape {array.shape}, but there are queries of the shape {shape}") from None


def keys_of(first: ArrayLike, later: ArrayLike | None, name: str) -> list[np.ndarray]:
    """Positions (n, 3) at each key, all of one precision, from (n, 3) or (K, n, 3) and the positions at later keys."""
    array = floats(first, name)
    arrays = [array] if array.ndim == 2 else list(array) if array.ndim == 3 else None
    if arrays is None:
        raise ValueError(f"{name} must have the shape (n, 3) or (K, n, 3), not {array.shape}")
    if later is not None:
        if array.ndim == 3:
            raise ValueError(f"{name} has positions at all keys already; leave out `keys`")
        more = floats(later, "keys")
        if more.ndim not in (2, 3):
            raise ValueError(f"keys must have the shape (n, 3) or (K - 1, n, 3), not {more.shape}")
        arrays += [more] if more.ndim == 2 else list(more)
    for key in arrays:
        if key.shape[1] != 3:
            raise ValueError(f"{name} have {key.shape[1]} coordinates instead of 3; give flat ones a third that is zero")
        if key.shape != arrays[0].shape:
            raise ValueError(f"positions of {len(key)} points at a later key, but of {len(arrays[0])} at the first")
    if not arrays:
        raise ValueError(f"{name} must have at least one key, not the shape {array.shape}")
    kind = np.result_type(*arrays)
    return [contiguous(key, kind) for key in arrays]


def corners_of(bounds: Sequence[Sequence[float]] | None) -> np.ndarray | None:
    """The lowest and the highest corner of a box, (2, 3)."""
    return None if bounds is None else np.asarray(bounds)


def only_euclidean(p: float) -> None:
    """Refuses the other metrics of scipy."""
    if p != 2:
        raise ValueError("distances are Euclidean: p must be 2")


def interval(between: Sequence[float]) -> list[float]:
    """Begin and end of a part of the shutter."""
    try:
        begin, end = between
    except (TypeError, ValueError):
        raise ValueError(f"an interval is (begin, end), not {between!r}") from None
    return [number(begin, "begin"), number(end, "end")]


def number(value: float, name: str) -> float:
    """A single number."""
    try:
        return float(value)
    except (TypeError, ValueError):
        raise TypeError(f"{name} must be one number, not {value!r:.60}") from None


def whole(value: int, name: str, least: int, most: int) -> int:
    """A single integer within bounds."""
    try:
        found = operator.index(value)
    except TypeError:
        raise TypeError(f"{name} must be a whole number, not {value!r:.60}") from None
    if not least <= found <= most:
        raise ValueError(f"{name} must be from {least} to {most}, not {found}")
    return found


def box_lengths(boxsize: ArrayLike | None) -> np.ndarray:
    """The lengths of a periodic box along each axis; 0 where it is not periodic."""
    box = np.zeros(3) if boxsize is None else np.asarray(boxsize, dtype=np.float64)
    if box.shape not in ((), (1,), (3,)):
        raise ValueError(f"boxsize must be one number or have the shape (3,), not {box.shape}")
    # An infinite box repeats nothing, as one of length 0.
    return np.broadcast_to(np.where(np.isposinf(box), 0.0, box), 3)
