"""Neighbour lists in compressed sparse rows."""

from __future__ import annotations

import operator
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class NeighborLists:
    """Lists in compressed sparse rows: list ``i`` is ``ids[offsets[i]:offsets[i + 1]]``, or ``lists[i]``.

    Attributes
    ----------
    offsets : int64 (m + 1,)
        The begin of each list in `ids`, and the end of the last one.
    ids : int32 (total,)
        The neighbours, list after list.
    points : int32 (m,) or None
        The point that each list belongs to; None if list i belongs to point (or query) i.
    distances : float32 (total,) or None
        The distance of each neighbour, if requested.
    displacements : float32 (total, 3) or None
        The vector from the point to each neighbour (to its nearest image in a periodic box), if requested.
    valid_until : float or None
        For lists with a skin: the time until which they contain every pair within the radius.
    """

    offsets: np.ndarray
    ids: np.ndarray
    points: np.ndarray | None = None
    distances: np.ndarray | None = None
    displacements: np.ndarray | None = None
    valid_until: float | None = None

    def __len__(self) -> int:
        return len(self.offsets) - 1

    def __getitem__(self, row: int) -> np.ndarray:
        """The ids of one list (a view)."""
        return _row(self, row)

    @property
    def counts(self) -> np.ndarray:
        """The number of neighbours in each list, int64 (m,)."""
        return np.diff(self.offsets)

    def pairs(self) -> np.ndarray:
        """Rows (point, neighbour) of all lists, intp (total, 2)."""
        return _pairs(self, np.arange(len(self), dtype=np.intp) if self.points is None else self.points)

    def to_objects(self) -> np.ndarray:
        """An array of Python lists (m,), as in scipy: convenient for few lists, slow and large for many."""
        rows = np.empty(len(self), dtype=object)
        rows[:] = [self[row].tolist() for row in range(len(self))]
        return rows

    def __repr__(self) -> str:
        return f"<NeighborLists: {len(self.ids)} neighbours in {len(self)} lists>"


@dataclass(frozen=True, eq=False)
class Encounters:
    """The points that come within a radius of each other during an interval. List i belongs to point i and is sorted by id.

    Attributes
    ----------
    offsets : int64 (n + 1,)
        The begin of each list in `ids`, and the end of the last one.
    ids : int32 (total,)
        The neighbours, list after list.
    enter, leave : float32 (total,)
        The first and the last time within the radius.
    closest : float32 (total,)
        The time at which the two points are nearest.
    distances : float32 (total,)
        Their distance at that time.
    """

    offsets: np.ndarray
    ids: np.ndarray
    enter: np.ndarray
    leave: np.ndarray
    closest: np.ndarray
    distances: np.ndarray

    def __len__(self) -> int:
        return len(self.offsets) - 1

    def __getitem__(self, row: int) -> np.ndarray:
        """The ids of one list (a view)."""
        return _row(self, row)

    @property
    def counts(self) -> np.ndarray:
        """The number of encounters in each list, int64 (n,)."""
        return np.diff(self.offsets)

    def pairs(self) -> np.ndarray:
        """Rows (point, neighbour) of all encounters, intp (total, 2), in the order of `enter` and the other columns."""
        return _pairs(self, np.arange(len(self), dtype=np.intp))

    def __repr__(self) -> str:
        return f"<Encounters: {len(self.ids)} in {len(self)} lists>"


def _pairs(lists: NeighborLists | Encounters, points: np.ndarray) -> np.ndarray:
    """Rows (point, neighbour), given the point of each list."""
    pairs = np.empty((len(lists.ids), 2), dtype=np.intp)
    pairs[:, 0] = np.repeat(points, lists.counts)
    pairs[:, 1] = lists.ids
    return pairs


def _row(lists: NeighborLists | Encounters, row: int) -> np.ndarray:
    at, count = operator.index(row), len(lists)
    if not -count <= at < count:
        raise IndexError(f"there is no list {at}: there are {count}")
    at %= count
    return lists.ids[lists.offsets[at] : lists.offsets[at + 1]]
