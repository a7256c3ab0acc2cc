"""Neighbour queries among moving points."""

from __future__ import annotations

import os
from typing import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from . import _mbkd
from ._arrays import (
    box_lengths,
    contiguous,
    corners_of,
    floats,
    interval,
    keys_of,
    number,
    numbers,
    only_euclidean,
    per_query,
    places,
)
from ._listed import Listed, most_of, same_kind
from .lists import NeighborLists

Progress = Callable[[float], object]

# Of a tree that was loaded: structure, max_references and precision.
_USUAL = ("automatic", 8.0, "automatic")


class PointTree(Listed):
    """A tree of points that may move, and that may exist during a part of the shutter only.

    Names, shapes and conventions are those of ``scipy.spatial.cKDTree``. In addition, every query has a ``time``.

    Parameters
    ----------
    points : (n, 3) or (K, n, 3)
        Positions, or positions at K keys spaced evenly over the shutter [0, 1]. Points move linearly between keys.
        Trajectories that are stored point by point, (n, K, 3), have their axes swapped: ``paths.swapaxes(0, 1)``.
        float32 positions are kept bit for bit. So are float64 positions, unless `precision` says otherwise; they take about
        twice the memory and up to twice the time. Integers become float64. C-contiguous arrays are read in place.
    keys : (n, 3) or (K - 1, n, 3), optional
        Positions at the later keys, if `points` has those at the first key.
    active : (n, 2), optional
        When each point exists: begin <= t < end (an end of 1 includes 1).
    boxsize : float or (3,), optional
        Periodic box [0, L) as in scipy; 0 or infinity for axes that are not periodic. Distances are to the nearest image. Static
        points must lie in the box. Moving points may leave it: all of them must be within sixteen periods.
    structure : {'automatic', 'linear', 'time_slices:N', 'kd'}
        The structure of the tree for moving points. Answers do not depend on it.
    max_references : float
        The greatest number of references per point, in structures that store a point more than once.
    precision : {'automatic', 'float32', 'float64'}
        What positions are kept in. 'automatic': what they were given in, but float64 positions that are all float32
        numbers, on both sides of zero, in float32. 'float32': float64 positions are rounded relative to the middle of the
        set; the tree is smaller and faster. 'float64': always float64.
    workers : int
        Threads for the build; -1 for all processors.
    progress : callable, optional
        Called with the finished fraction from time to time. An exception ends the build, as Ctrl-C does.

    Attributes
    ----------
    n, m : int
        Number of points, and of coordinates (3).
    data : ndarray
        The positions at the first key, as they were given; None in a tree that was loaded. The tree does not use them.
    boxsize : (3,) ndarray or None
        The lengths of the periodic box; 0 for axes that are not periodic.
    nbytes : int
        Memory of the tree.

    Raises
    ------
    ValueError
        If positions are not finite or beyond 1e18, active intervals do not lie in [0, 1], arrays differ in length, points
        lie outside the box, or parameters are out of range.
    TypeError
        If an argument is not an array of numbers.

    Examples
    --------
    >>> import numpy as np
    >>> from mbkd import PointTree
    >>> tree = PointTree(np.float32([[0, 0, 0], [-4, 1, 0]]), keys=np.float32([[0, 0, 0], [4, 1, 0]]))
    >>> distance, index = tree.query([[0, 0.9, 0], [0, 0.9, 0]], time=[0, 0.5])
    >>> index
    array([0, 1])
    """

    m = 3
    data: np.ndarray | None
    boxsize: np.ndarray | None
    _tree: _mbkd.Points
    # structure, max_references and precision
    _how: tuple[str, float, str]

    def __init__(
        self,
        points: ArrayLike,
        keys: ArrayLike | None = None,
        active: ArrayLike | None = None,
        *,
        boxsize: ArrayLike | None = None,
        structure: str = "automatic",
        max_references: float = 8.0,
        precision: str = "automatic",
        workers: int = 1,
        progress: Progress | None = None,
    ) -> None:
        arrays = keys_of(points, keys, "points")
        active = _active(active, len(arrays[0]))
        box = box_lengths(boxsize)
        if boxsize is not None:
            _inside(arrays, box)
        self._how = (structure, max_references, precision)
        self._tree = _mbkd.Points(arrays, active, box.tolist(), *self._how, workers, progress)
        self.data = arrays[0]
        self.boxsize = None if boxsize is None else box.copy()

    def rebuild(
        self, points: ArrayLike, keys: ArrayLike | None = None, active: ArrayLike | None = None, *, workers: int = 1
    ) -> bool:
        """Put other positions into the tree, as those of the next step of a simulation.

        Answers are those of a new tree with the same `boxsize`, `structure`, `max_references` and `precision` (the defaults of
        these three in a tree that was loaded from a file). Points that
        stand still during a step, in float32, and as many as before, keep the order of the tree where they have moved a little
        since, which takes less time than a new tree. All others take as long as a new tree.

        A query in progress in another thread goes on in the tree as it was: the tree is copied where it is in use. Calls that
        begin meanwhile may wait.

        Parameters
        ----------
        points, keys, active, workers
            As for `PointTree`.

        Returns
        -------
        bool
            Whether the order was kept.

        Raises
        ------
        ValueError, TypeError
            As for `PointTree`. The tree is then unchanged.

        Examples
        --------
        >>> import numpy as np
        >>> from mbkd import PointTree
        >>> points = np.float32([[0, 0, 0], [4, 0, 0], [8, 0, 0]])
        >>> tree = PointTree(points)
        >>> tree.rebuild(points + np.float32([1, 0, 0]))
        True
        >>> tree.query([5.5, 0, 0])
        (0.5, 1)
        """
        arrays = keys_of(points, keys, "points")
        active = _active(active, len(arrays[0]))
        if self.boxsize is not None:
            _inside(arrays, self.boxsize)
        kept = self._tree.rebuild(arrays, active, *self._how, workers)
        self.data = arrays[0]
        return kept

    def take_order(self) -> np.ndarray:
        """Number the points in the order of the tree, in which points that are close in space are close together.

        A simulation that brings its arrays into this order finds neighbours close in memory, and may `rebuild` this tree from
        them. `data` is brought into this order as well.

        Returns
        -------
        intp (n,)
            The number that each point had so far.

        Examples
        --------
        >>> import numpy as np
        >>> from mbkd import PointTree
        >>> points = np.float32([[9, 9, 9], [0, 0, 0], [8, 8, 8]])
        >>> tree = PointTree(points)
        >>> points = points[tree.take_order()]
        >>> points[tree.query([8.1, 8.1, 8.1])[1]]
        array([8., 8., 8.], dtype=float32)
        """
        order = self._tree.take_order()
        if self.data is not None:
            self.data = self.data[order]
        return order

    def copy(self) -> PointTree:
        """A tree with the same contents that is rebuilt by itself.

        The two share memory until one of them is rebuilt, which then copies what both had.
        """
        return self._of(self._tree.copy(), self.data, self.boxsize, self._how)

    __copy__ = copy

    def __deepcopy__(self, memo: dict) -> PointTree:
        return self.copy()

    def save(self, path: str | os.PathLike) -> None:
        """Write the tree to a file. `PointTree.load` reads it, in Python and in Rust, on any machine.

        The file contains neither `data` nor `boxsize`. So a tree with a periodic box raises a ValueError; pickle it
        instead.
        """
        if self.boxsize is not None:
            raise ValueError("a file can not hold the periodic box of a tree; pickle the tree instead")
        self._tree.save(os.fspath(path))

    @classmethod
    def load(cls, path: str | os.PathLike, *, workers: int = 1) -> PointTree:
        """Read a tree from a file, on so many threads (-1 for all processors).

        The tree gives the same answers as the saved one. Its `data` is None. The file does not have `structure`,
        `max_references` and `precision`, so `rebuild` uses their defaults. (A pickled tree has them.)

        Raises
        ------
        OSError
            If the file cannot be read.
        ValueError
            If the file is damaged or invalid, has another version, is not a tree of points, or has ids that are not
            indices.
        """
        return cls._of(_mbkd.Points.load(os.fspath(path), workers), None, None, _USUAL)

    @classmethod
    def _of(
        cls, compiled: _mbkd.Points, data: np.ndarray | None, boxsize: np.ndarray | None, how: tuple[str, float, str]
    ) -> PointTree:
        tree = cls.__new__(cls)
        tree._tree, tree.data, tree.boxsize, tree._how = compiled, data, boxsize, how
        return tree

    def __reduce__(self) -> tuple:
        return _restored, (*self._tree.to_bytes(), self.data, self.boxsize, self._how)

    @property
    def n(self) -> int:
        """Number of points."""
        return self._tree.n

    def __len__(self) -> int:
        return self._tree.n

    @property
    def nbytes(self) -> int:
        """Memory of the tree in bytes."""
        return self._tree.nbytes

    @property
    def bounds(self) -> np.ndarray | None:
        """A box around all points over the shutter, float64 (2, 3), slightly enlarged for rounding; None if there are none."""
        return corners_of(self._tree.bounds)

    def statistics(self) -> str:
        """The contents of the tree and the reasons for its structure, as text."""
        return self._tree.statistics()

    def __repr__(self) -> str:
        return f"<PointTree of {self.n} points, {self.nbytes / 1e6:.1f} MB>"

    def query(
        self,
        x: ArrayLike,
        k: int | Sequence[int] = 1,
        eps: float = 0.0,
        p: float = 2.0,
        distance_upper_bound: float = np.inf,
        workers: int = 1,
        *,
        time: ArrayLike = 0.0,
        progress: Progress | None = None,
    ) -> tuple:
        """Find the k nearest points.

        Parameters
        ----------
        x : (..., 3)
            Query positions. A position beyond 1e18 finds nothing.
        k : int or sequence of int
            The number of neighbours; or a list of ranks: [1, 3] gives the nearest and the third nearest.
        eps : float
            Answers may be farther away than the exact ones by a factor of up to 1 + eps.
        p : float
            Must be 2; other metrics are not supported.
        distance_upper_bound : float
            Return only points nearer than this.
        workers : int
            Threads; -1 for all processors.
        time : float or array that broadcasts to x without its last axis
            The time of each query, in [0, 1].
        progress : callable, optional
            Called with the finished fraction from time to time. An exception ends the query.

        Returns
        -------
        d, i : float64 and intp (..., k), or (...) for k = 1
            Distances, nearest first, and indices. Ties are in the order of indices. Missing neighbours have the distance
            ``inf`` and the index ``n``. Distances of float32 positions are computed in float32. Distances of float64
            positions are rounded to float32 at the end.
        """
        only_euclidean(p)
        queries, shape = places(x, "x")
        times = per_query(time, shape, "time")
        wanted = np.asarray(k)
        single = wanted.ndim == 0
        wanted = wanted.reshape(-1)
        # Integers that are too large for numpy have another kind, and are refused as well.
        if wanted.dtype.kind not in "iub" or wanted.size == 0 or wanted.min() < 1:
            raise ValueError("k must be an integer of at least 1, or a sequence of them")
        most = int(wanted.max())
        eps, bound = number(eps, "eps"), number(distance_upper_bound, "distance_upper_bound")
        if not eps >= 0:
            raise ValueError("eps must not be negative or NaN")
        if not bound >= 0:
            raise ValueError("distance_upper_bound must not be negative or NaN")
        # With n as the tree had it then: another thread may rebuild it meanwhile.
        d, i, n = self._tree.query(queries, times, most, eps, bound, workers, progress)
        found = d.shape[1]
        if not single:
            shape += wanted.shape
            there = wanted <= found
            column = np.where(there, wanted, 1).astype(np.intp) - 1
            d, i = d[:, column], i[:, column]
            d[:, ~there], i[:, ~there] = np.inf, n
            return d.reshape(shape), i.reshape(shape)
        if most > found:
            d = np.pad(d, ((0, 0), (0, most - found)), constant_values=np.inf)
            i = np.pad(i, ((0, 0), (0, most - found)), constant_values=n)
        if most > 1:
            return d.reshape(*shape, most), i.reshape(*shape, most)
        return (d.reshape(shape), i.reshape(shape)) if shape else (float(d[0, 0]), int(i[0, 0]))

    def query_ball_point(
        self,
        x: ArrayLike,
        r: ArrayLike,
        p: float = 2.0,
        eps: float = 0.0,
        workers: int = 1,
        return_sorted: bool | None = None,
        return_length: bool = False,
        *,
        time: ArrayLike = 0.0,
        output_type: str = "csr",
        max_neighbors: int | None = None,
        progress: Progress | None = None,
    ):
        """Find all points within a radius: squared distance at most r * r, in float32.

        Parameters
        ----------
        x : (..., 3)
            Query positions.
        r : float or array that broadcasts to x without its last axis
            One radius, or one for each query.
        p, eps : float
            `p` must be 2; other metrics are not supported. `eps` is ignored; answers are always exact.
        return_sorted : bool, optional
            Sort each list by index. As in scipy, None sorts unless there is a single query.
        return_length : bool
            Return only the numbers of points.
        time : float or array that broadcasts to x without its last axis
            The time of each query, in [0, 1].
        output_type : {'csr', 'object'}
            'object' gives lists as scipy does: convenient for few queries, slow and large for many.
        max_neighbors : int, optional
            A list with more points raises a ValueError, before memory runs out where points clump. (Lengths have no limit.)
        workers, progress
            As for `query`.

        Returns
        -------
        NeighborLists
            List i belongs to query i (queries in C order).
        int64 (...)
            With `return_length`.
        list, or object array (...) of lists
            With ``output_type='object'``.
        """
        only_euclidean(p)
        if output_type not in ("csr", "object"):
            raise ValueError(f"output_type must be 'csr' or 'object', not {output_type!r}")
        queries, shape = places(x, "x")
        radii, times = per_query(r, shape, "r"), per_query(time, shape, "time")
        if return_length:
            counts = self._tree.count(queries, radii, times, workers, progress)
            return counts.reshape(shape) if shape else int(counts[0])
        is_sorted = bool(shape) if return_sorted is None else bool(return_sorted)
        most = most_of(max_neighbors)
        lists = NeighborLists(*self._tree.within(queries, radii, times, is_sorted, most, workers, progress))
        if output_type == "csr":
            return lists
        return lists.to_objects().reshape(shape) if shape else lists[0].tolist()

    def query_pairs(
        self,
        r: float,
        p: float = 2.0,
        eps: float = 0.0,
        output_type: str = "ndarray",
        *,
        time: float = 0.0,
        workers: int = 1,
    ):
        """Find all pairs of points within a radius of each other, each once with i < j.

        Returns
        -------
        intp (pairs, 2)
            Sorted by i, then j.
        set of tuples
            With ``output_type='set'``, the default of scipy.
        """
        only_euclidean(p)
        if output_type not in ("ndarray", "set"):
            raise ValueError(f"output_type must be 'ndarray' or 'set', not {output_type!r}")
        pairs = self.neighbor_lists(r, time=time, pairs_once=True, sorted=True, workers=workers).pairs()
        return pairs if output_type == "ndarray" else set(map(tuple, pairs.tolist()))

    def count_neighbors(
        self,
        other: PointTree,
        r: ArrayLike,
        p: float = 2.0,
        *,
        time: float = 0.0,
        workers: int = 1,
        progress: Progress | None = None,
    ):
        """Count the pairs, one point of each tree, within a radius of each other; for one radius or several.

        As in scipy, a tree and itself have n pairs of a point with itself, and count each other pair twice.

        Returns
        -------
        int, or int64 array of the shape of `r`
        """
        only_euclidean(p)
        same_kind(other, "other")
        radii = np.asarray(r, dtype=np.float64)
        counts = self._tree.count_pairs(other._tree, radii.reshape(-1).tolist(), time, workers, progress)
        return np.asarray(counts, dtype=np.int64).reshape(radii.shape) if radii.ndim else counts[0]

    def positions(self, time: ArrayLike = 0.0) -> np.ndarray:
        """The positions of all points at a time, float64 (n, 3), as queries use them; NaN for points that do not exist then.

        At several times (...) they have the shape (..., n, 3).
        """
        times = np.asarray(numbers(time, "time"), dtype=np.float64)
        if not times.ndim:
            return self._tree.positions(float(times))
        # One tree for all times, though another thread may rebuild this one.
        tree = self._tree.copy()
        at = [tree.positions(one) for one in times.reshape(-1).tolist()]
        return np.array(at, dtype=np.float64).reshape(*times.shape, tree.n, 3)

    def closest_approach(
        self,
        start: ArrayLike,
        end: ArrayLike,
        between: Sequence[float] = (0.0, 1.0),
        workers: int = 1,
        *,
        progress: Progress | None = None,
    ) -> tuple:
        """Find the points that come nearest to moving query points, and the times.

        Parameters
        ----------
        start, end : (..., 3)
            The position of each query at the begin and at the end of `between`; it moves linearly in between.
        between : (begin, end)
            The part of the shutter that is searched.
        workers, progress
            As for `query`.

        Returns
        -------
        d, i, t : float64, intp, float64 (...)
            The least distance, the point, and the first time at which the point has that distance; ``inf``, ``n`` and NaN
            if no point exists. In a periodic box, distances are to the nearest image, and paths that are longer than sixteen
            periods find nothing.
        """
        (first, shape), (last, other) = places(start, "start"), places(end, "end")
        if shape != other:
            raise ValueError(f"start has the shape {shape + (3,)}, end {other + (3,)}")
        first, last = contiguous(first, np.float64), contiguous(last, np.float64)
        answers = self._tree.closest_approach(first, last, interval(between), workers, progress)
        if not shape:
            return tuple(answer[0].item() for answer in answers)
        return tuple(answer.reshape(shape) for answer in answers)


def _active(active: ArrayLike | None, count: int) -> np.ndarray | None:
    """Active intervals as float32 (n, 2)."""
    if active is None:
        return None
    rows = contiguous(floats(active, "active"), np.float32)
    if rows.ndim != 2 or rows.shape[1] != 2:
        raise ValueError(f"active must have the shape (n, 2), not {rows.shape}")
    if len(rows) != count:
        raise ValueError(f"{len(rows)} active intervals of {count} points")
    return rows


def _inside(keys: list[np.ndarray], box: np.ndarray) -> None:
    """Refuses points that stand still outside of a periodic box."""
    if len(keys) > 1 or not len(keys[0]):
        return
    if ((box > 0) & ((keys[0].min(axis=0) < 0) | (keys[0].max(axis=0) >= box))).any():
        raise ValueError("points must lie inside of the periodic box: at least 0 and less than boxsize")


def _restored(
    bytes_of_file: bytes,
    periods: tuple | None,
    data: np.ndarray | None,
    boxsize: np.ndarray | None,
    how: tuple[str, float, str],
) -> PointTree:
    """Restores a pickled tree."""
    return PointTree._of(_mbkd.Points.from_bytes(bytes_of_file, periods), data, boxsize, how)
