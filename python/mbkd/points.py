"""Neighbours among points that move."""

from __future__ import annotations

import os
from typing import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from . import _mbkd
from ._arrays import floats, interval, keys_of, number, only_euclidean, per_query, places
from .lists import Encounters, NeighborLists

Progress = Callable[[float], object]


class PointTree:
    """A tree of points that may move, and may exist for a while only.

    Names, shapes and conventions are those of ``scipy.spatial.cKDTree``; every query has a ``time`` besides.

    Parameters
    ----------
    points : (n, 3) or (K, n, 3)
        Positions, or positions at K keys that are spaced evenly over the shutter [0, 1]. Between keys points move
        linearly. float32 is kept bit for bit; float64 too, unless `round_to_f32`, at about twice the memory and up to
        twice the time; of neighbour lists there are plain ones only. Whole numbers become float64. C-contiguous arrays are read in place.
    keys : (n, 3) or (K - 1, n, 3), optional
        Positions at the later keys, where `points` are those when the shutter opens.
    lifetimes : (n, 2), optional
        When each point exists: begin <= t < end (an end of 1 includes 1).
    boxsize : float or (3,), optional
        Periodic box [0, L) as in scipy; 0 for axes that are not periodic. Points count at their nearest image. Points
        that stand still must lie in the box, those that move may leave it by up to four periods.
    structure : {'automatic', 'linear', 'slabs:N', 'mbkd'}
        How moving points are organized. Answers do not depend on it.
    max_references : float
        Most references per point where points are divided among parts of the tree.
    round_to_f32 : bool
        Rounds float64 positions to float32 relative to the middle of the set: smaller, faster, and with all
        neighbour lists.
    workers : int
        Threads for the build; -1 for all processors.
    progress : callable, optional
        Called with the finished fraction now and then. An exception ends the build, as Ctrl-C does.

    Attributes
    ----------
    n, m : int
        Number of points, and of coordinates (3).
    data : ndarray
        The positions at the first key, as they were given; None in a tree that was loaded. The tree does not look at them
        any more.
    boxsize : (3,) ndarray or None
    nbytes : int
        Memory of the tree.

    Raises
    ------
    ValueError
        Positions that are not finite or beyond 1e18, lifetimes that are no intervals of [0, 1], arrays of different
        length, points outside of the box, parameters out of range.
    TypeError
        What is no array of numbers.

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

    def __init__(
        self,
        points: ArrayLike,
        keys: ArrayLike | None = None,
        lifetimes: ArrayLike | None = None,
        *,
        boxsize: ArrayLike | None = None,
        structure: str = "automatic",
        max_references: float = 8.0,
        round_to_f32: bool = False,
        workers: int = 1,
        progress: Progress | None = None,
    ) -> None:
        arrays = keys_of(points, keys, "points")
        if lifetimes is not None:
            lifetimes = np.ascontiguousarray(floats(lifetimes, "lifetimes"), dtype=np.float32)
            if lifetimes.ndim != 2 or lifetimes.shape[1] != 2:
                raise ValueError(f"lifetimes must have the shape (n, 2), not {lifetimes.shape}")
            if len(lifetimes) != len(arrays[0]):
                raise ValueError(f"{len(lifetimes)} lifetimes of {len(arrays[0])} points")
        box = np.zeros(3) if boxsize is None else np.asarray(boxsize, dtype=np.float64)
        if box.shape not in ((), (1,), (3,)):
            raise ValueError(f"boxsize must be one number or have the shape (3,), not {box.shape}")
        box = np.broadcast_to(box, 3)
        if boxsize is not None and len(arrays) == 1 and len(arrays[0]):
            outside = (box > 0) & ((arrays[0].min(axis=0) < 0) | (arrays[0].max(axis=0) >= box))
            if outside.any():
                raise ValueError("points must lie inside of the periodic box: at least 0 and less than boxsize")
        self._tree = _mbkd.Points(
            arrays, lifetimes, box.tolist(), structure, max_references, round_to_f32, workers, progress
        )
        self.data = arrays[0]
        self.boxsize = None if boxsize is None else box.copy()

    def save(self, path: str | os.PathLike) -> None:
        """Writes the tree to a file, which `PointTree.load` reads, here or in Rust, on any machine.

        The file holds neither `data` nor `boxsize`: a tree with a periodic box is refused with a ValueError; pickle it
        instead.
        """
        if self.boxsize is not None:
            raise ValueError("a file can not hold the periodic box of a tree; pickle the tree instead")
        self._tree.save(os.fspath(path))

    @classmethod
    def load(cls, path: str | os.PathLike) -> PointTree:
        """Reads a tree from a file.

        It answers every query as the tree did that was saved; its `data` is None.

        Raises
        ------
        OSError
            If the file can not be read.
        ValueError
            If it is damaged, of another version, no tree of points, made to mislead, or has ids that are no indices.
        """
        return cls._of(_mbkd.Points.load(os.fspath(path)), None, None)

    @classmethod
    def _of(cls, compiled: _mbkd.Points, data: np.ndarray | None, boxsize: np.ndarray | None) -> PointTree:
        tree = cls.__new__(cls)
        tree._tree, tree.data, tree.boxsize = compiled, data, boxsize
        return tree

    def __reduce__(self) -> tuple:
        return _restored, (*self._tree.to_bytes(), self.data, self.boxsize)

    @property
    def n(self) -> int:
        """Number of points."""
        return self._tree.n

    def __len__(self) -> int:
        return self._tree.n

    @property
    def nbytes(self) -> int:
        """Bytes that the tree takes."""
        return self._tree.nbytes

    def statistics(self) -> str:
        """What the tree consists of, and why, as text."""
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
        """The k nearest points.

        Parameters
        ----------
        x : (..., 3)
            Query positions. Beyond 1e18 nothing is found.
        k : int or sequence of int
            How many, or which: [1, 3] gives the nearest and the third nearest.
        eps : float
            Answers may be farther than the exact ones by a factor of up to 1 + eps.
        p : float
            2; there are no other metrics.
        distance_upper_bound : float
            Only points nearer than this.
        workers : int
            Threads; -1 for all processors.
        time : float or array that broadcasts to x without its last axis
            When each query looks, in [0, 1].
        progress : callable, optional
            Called with the finished fraction now and then. An exception ends the query.

        Returns
        -------
        d, i : float64 and intp (..., k), or (...) for k = 1
            Distances, nearest first, and indices; ties in the order of indices. Missing neighbours have the distance
            ``inf`` and the index ``n``. Distances are those of float32 arithmetic where positions are float32; of
            float64 positions they are rounded to float32 at the end.
        """
        only_euclidean(p)
        queries, shape = places(x, "x")
        times = per_query(time, shape, "time")
        wanted = np.asarray(k)
        single = wanted.ndim == 0
        wanted = wanted.reshape(-1)
        # No whole numbers are those that are too large for numpy, too.
        if wanted.dtype.kind not in "iub" or wanted.size == 0 or wanted.min() < 1:
            raise ValueError("k must be an integer of at least 1, or a sequence of them")
        most = int(wanted.max())
        eps, bound = number(eps, "eps"), number(distance_upper_bound, "distance_upper_bound")
        if not eps >= 0:
            raise ValueError("eps must not be negative or NaN")
        if not bound >= 0:
            raise ValueError("distance_upper_bound must not be negative or NaN")
        # More than there are would only take memory.
        found = max(min(most, self.n), 1)
        d, i = self._tree.query(queries, times, found, eps, bound, workers, progress)
        if not single:
            shape += wanted.shape
            there = wanted <= found
            column = np.where(there, wanted, 1).astype(np.intp) - 1
            d, i = d[:, column], i[:, column]
            d[:, ~there], i[:, ~there] = np.inf, self.n
            return d.reshape(shape), i.reshape(shape)
        if most > found:
            d = np.pad(d, ((0, 0), (0, most - found)), constant_values=np.inf)
            i = np.pad(i, ((0, 0), (0, most - found)), constant_values=self.n)
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
        progress: Progress | None = None,
    ):
        """All points within a radius: squared distance at most r * r, in float32.

        Parameters
        ----------
        x : (..., 3)
            Query positions.
        r : float or array that broadcasts to x without its last axis
            The radius, or one for each query.
        p, eps : float
            2 and anything: other metrics are not there, and answers are always exact.
        return_sorted : bool, optional
            Sort lists by index. As in scipy, None sorts unless there is a single query.
        return_length : bool
            Numbers of points only.
        time : float or array that broadcasts to x without its last axis
        output_type : {'csr', 'object'}
            'object' gives lists as scipy does: convenient for few queries, slow and large for many.

        Returns
        -------
        NeighborLists
            List i is that of query i (queries in C order).
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
        lists = NeighborLists(*self._tree.within(queries, radii, times, is_sorted, workers, progress))
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
        """All pairs of points within a radius of each other, each once with i < j.

        Returns
        -------
        intp (pairs, 2)
            Sorted by i, then j.
        set of tuples
            With ``output_type='set'``, as scipy has it by default.
        """
        only_euclidean(p)
        if output_type not in ("ndarray", "set"):
            raise ValueError(f"output_type must be 'ndarray' or 'set', not {output_type!r}")
        if self.boxsize is None or self.data.dtype == np.float32:
            pairs = self.neighbor_lists(r, time=time, pairs_once=True, sorted=True, workers=workers).pairs()
        else:
            # Lists of periodic boxes are made of float32 positions; queries one by one are exact.
            positions = self.positions(time)
            exist = np.flatnonzero(~np.isnan(positions[:, 0]))
            lists = self.query_ball_point(positions[exist], r, workers=workers, return_sorted=True, time=time)
            pairs = NeighborLists(lists.offsets, lists.ids, points=exist).pairs()
            pairs = pairs[pairs[:, 0] < pairs[:, 1]]
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
        """How many pairs, one point of each tree, are within a radius (or each of several) of each other.

        As in scipy a tree and itself have n pairs of a point with itself, and the others twice.

        Returns
        -------
        int, or int64 array of the shape of `r`
        """
        only_euclidean(p)
        if not isinstance(other, PointTree):
            raise TypeError(f"other must be a PointTree, not {type(other).__name__}")
        radii = np.asarray(r, dtype=np.float64)
        counts = self._tree.count_pairs(other._tree, radii.reshape(-1).tolist(), time, workers, progress)
        return np.asarray(counts, dtype=np.int64).reshape(radii.shape) if radii.ndim else counts[0]

    def positions(self, time: float = 0.0) -> np.ndarray:
        """Where all points are at a time, float64 (n, 3), as queries see them; NaN for those that do not exist then."""
        return self._tree.positions(time)

    def closest_approach(
        self,
        start: ArrayLike,
        end: ArrayLike,
        between: Sequence[float] = (0.0, 1.0),
        workers: int = 1,
        *,
        progress: Progress | None = None,
    ) -> tuple:
        """The points that come nearest to queries that move themselves, and when.

        Parameters
        ----------
        start, end : (..., 3)
            Where each query is at the begin and at the end of `between`; straight in between.
        between : (begin, end)
            The part of the shutter that is looked at.

        Returns
        -------
        d, i, t : float64, intp, float64 (...)
            The least distance, the point, and the first time at which it is that near; ``inf``, ``n`` and NaN where
            no point exists.
        """
        (first, shape), (last, other) = places(start, "start"), places(end, "end")
        if shape != other:
            raise ValueError(f"start has the shape {shape + (3,)}, end {other + (3,)}")
        wide = [np.ascontiguousarray(array, dtype=np.float64) for array in (first, last)]
        answers = self._tree.closest_approach(*wide, interval(between), workers, progress)
        if not shape:
            return tuple(answer[0].item() for answer in answers)
        return tuple(answer.reshape(shape) for answer in answers)

    def neighbor_lists(
        self,
        r: ArrayLike,
        *,
        time: float = 0.0,
        among: PointTree | None = None,
        larger: bool = False,
        pairs_once: bool = False,
        distances: bool = False,
        displacements: bool = False,
        sorted: bool = False,
        rows: str = "points",
        workers: int = 1,
    ) -> NeighborLists:
        """For every point all others within a radius, as particle methods want them.

        One walk through the tree for many points: several times faster than `query_ball_point` of all points. Points in
        float64 search one by one, without `larger` and `displacements`; these need float32 (or `round_to_f32`).

        Parameters
        ----------
        r : float or (n,)
            The radius, or one for each point: point i lists what is within its own, or what is within the larger of
            both with `larger`.
        among : PointTree, optional
            Lists the points of another tree instead, all of them.
        pairs_once : bool
            Each pair in the list of the lower index only.
        distances, displacements : bool
            Also gives distances, and the ways from points to neighbours.
        sorted : bool
            Sorts each list by index; otherwise there is no particular order.
        rows : {'points', 'tree'}
            List i is that of point i, empty where it does not exist at the time. 'tree' leaves lists in the order in
            which they are made, without those of points that do not exist; `NeighborLists.points` then names their
            points. It saves a copy of all lists.
        """
        if rows not in ("points", "tree"):
            raise ValueError(f"rows must be 'points' or 'tree', not {rows!r}")
        radii = np.asarray(r)
        if radii.ndim and radii.shape != (self.n,):
            raise ValueError(f"r must be one radius or have the shape ({self.n},), not {radii.shape}")
        by_id = rows == "points"
        offsets, ids, points, far, ways = _mbkd.neighbor_lists(
            self._tree,
            time,
            per_query(radii, (self.n,), "r"),
            larger,
            None if among is None else among._tree,
            pairs_once,
            distances,
            displacements,
            sorted,
            by_id,
            workers,
        )
        return NeighborLists(offsets, ids, points, far if distances else None, ways if displacements else None)

    def neighbor_lists_with_skin(
        self, r: float, skin: float, *, time: float = 0.0, until: float = 1.0, workers: int = 1
    ) -> NeighborLists:
        """Lists with a radius of r + skin, and until when they miss no pair within r.

        From `time` to before `NeighborLists.valid_until` every pair within r is in the lists. That is exact for the motion
        of the points, not a bound on speeds. Looks ahead to `until`, but not beyond the next key.
        """
        made, valid_until = _mbkd.neighbor_lists_with_skin(self._tree, time, r, skin, until, workers)
        return NeighborLists(made[0], made[1], valid_until=valid_until)

    def neighbor_lists_swept(
        self, r: float, between: Sequence[float] = (0.0, 1.0), *, workers: int = 1
    ) -> Encounters:
        """For every point all others that come within a radius at any time of an interval, and when.

        Decided in float64 for exact linear motion between the float32 positions at the keys.
        """
        offsets, ids, columns = _mbkd.neighbor_lists_swept(self._tree, interval(between), r, workers)
        return Encounters(offsets, ids, *columns)


def _restored(bytes_of_file: bytes, periods: tuple | None, data: np.ndarray | None, boxsize: np.ndarray | None) -> PointTree:
    """What pickle calls."""
    return PointTree._of(_mbkd.Points.from_bytes(bytes_of_file, periods), data, boxsize)
