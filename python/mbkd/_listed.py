"""The neighbour lists of all points of a tree: a part of `PointTree`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Sequence

import numpy as np
from numpy.typing import ArrayLike

from . import _mbkd
from ._arrays import interval, numbers, per_query, whole
from .lists import Encounters, NeighborLists

if TYPE_CHECKING:
    from .points import PointTree


class Listed:
    """A tree of points with neighbour lists."""

    _tree: _mbkd.Points

    def neighbor_lists(
        self,
        r: ArrayLike,
        *,
        time: float = 0.0,
        among: PointTree | None = None,
        r_among: ArrayLike | None = None,
        larger: bool = False,
        summed: bool = False,
        pairs_once: bool = False,
        distances: bool = False,
        displacements: bool = False,
        sorted: bool = False,
        rows: str = "points",
        max_neighbors: int | None = None,
        workers: int = 1,
    ) -> NeighborLists:
        """Find all neighbours of every point within a radius.

        One traversal of the tree serves many points. This is several times faster than `query_ball_point` for all points.
        Of points in float64, differences are computed in float64; squared distances and displacements are rounded to float32.

        Parameters
        ----------
        r : float or (n,)
            One radius, or one for each point.
        time : float
            The time of all lists, in [0, 1].
        larger : bool
            Two points are neighbours if they are within the larger of their radii. Otherwise each point lists the points
            within its own radius.
        summed : bool
            Two points are neighbours if they are within the sum of their radii: spheres that touch.
        among : PointTree, optional
            List the points of another tree instead, all of them.
        r_among : float or (m,), optional
            The radii of the points of `among`, for `larger` and `summed`: one, or one for each.
        pairs_once : bool
            List each pair only at the point with the lower index.
        distances, displacements : bool
            Also return distances, and the vectors from points to neighbours.
        sorted : bool
            Sort each list by index; otherwise lists have no particular order.
        rows : {'points', 'tree'}
            'points': list i belongs to point i, and is empty if the point does not exist at the time. 'tree': lists stay
            in the order of their computation, without those of points that do not exist, and `NeighborLists.points` has
            the point of each list. This saves a copy of all lists.
        max_neighbors : int, optional
            A list with more neighbours raises a ValueError, before memory runs out where points clump. Default: no limit.
        workers : int
            Threads; -1 for all processors.
        """
        if rows not in ("points", "tree"):
            raise ValueError(f"rows must be 'points' or 'tree', not {rows!r}")
        radii, r_among = self._radii(r, among, r_among, larger, summed)
        by_id = rows == "points"
        offsets, ids, points, far, ways = _mbkd.neighbor_lists(
            self._tree,
            time,
            radii,
            larger,
            summed,
            None if among is None else among._tree,
            r_among,
            pairs_once,
            distances,
            displacements,
            sorted,
            by_id,
            most_of(max_neighbors),
            workers,
        )
        return NeighborLists(offsets, ids, points, far if distances else None, ways if displacements else None)

    def _radii(
        self, r: ArrayLike, among: PointTree | None, r_among: ArrayLike | None, larger: bool, summed: bool
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """One radius, or one for each point; and one for each of the others, if they have their own."""
        if among is not None:
            same_kind(among, "among")
        if larger and summed:
            raise ValueError("two points are neighbours within the larger of their radii or within the sum, not both")
        radii = _radii_of(r, self._tree.n, "r", each=summed or r_among is not None)
        if r_among is None:
            return radii, None
        if among is None or not (larger or summed):
            raise ValueError("r_among has the radii of the points of `among`, for `larger` or `summed`")
        return radii, _radii_of(r_among, among._tree.n, "r_among", each=True)

    def neighbor_lists_with_skin(
        self,
        r: ArrayLike,
        skin: float,
        *,
        time: float = 0.0,
        until: float = 1.0,
        among: PointTree | None = None,
        r_among: ArrayLike | None = None,
        larger: bool = False,
        summed: bool = False,
        pairs_once: bool = False,
        distances: bool = False,
        displacements: bool = False,
        sorted: bool = False,
        max_neighbors: int | None = None,
        workers: int = 1,
    ) -> NeighborLists:
        """Neighbour lists with the radius r + skin, and the time until which they contain every pair within r.

        With one radius for each point, the skin is added to that of each pair. Every pair within r is in the lists from `time`
        until just before `NeighborLists.valid_until`. That time follows from the exact motion of the points, not from a bound
        on speeds. It is at most `until`, and at most the time of the next key. In a periodic box, distances are to the nearest
        image. Other options are as for `neighbor_lists`.
        """
        radii, r_among = self._radii(r, among, r_among, larger, summed)
        (offsets, ids, _, far, ways), valid_until = _mbkd.neighbor_lists_with_skin(
            self._tree,
            time,
            radii,
            larger,
            summed,
            skin,
            until,
            None if among is None else among._tree,
            r_among,
            pairs_once,
            distances,
            displacements,
            sorted,
            most_of(max_neighbors),
            workers,
        )
        return NeighborLists(
            offsets, ids, None, far if distances else None, ways if displacements else None, valid_until
        )

    def neighbor_lists_swept(
        self,
        r: ArrayLike,
        between: Sequence[float] = (0.0, 1.0),
        *,
        among: PointTree | None = None,
        r_among: ArrayLike | None = None,
        larger: bool = False,
        summed: bool = False,
        pairs_once: bool = False,
        max_neighbors: int | None = None,
        workers: int = 1,
    ) -> Encounters:
        """Find all points that come within a radius of each point at any time of an interval, and the times.

        This is decided in float64, for exact linear motion between the positions at the keys, in float32 or float64.
        `r`, `among`, `r_among`, `larger`, `summed`, `pairs_once` and `max_neighbors` are as for `neighbor_lists`: with
        `summed`, these are the contacts of spheres that move; with `among` and `r_among`, those with another set, as walls that
        move. In a periodic box points are as far apart as their nearest images; a pair comes up once, whatever images it meets
        in.
        """
        radii, r_among = self._radii(r, among, r_among, larger, summed)
        offsets, ids, columns = _mbkd.neighbor_lists_swept(
            self._tree,
            interval(between),
            radii,
            larger,
            summed,
            None if among is None else among._tree,
            r_among,
            pairs_once,
            most_of(max_neighbors),
            workers,
        )
        return Encounters(offsets, ids, *columns)


def same_kind(tree: object, name: str) -> None:
    """Refuses other kinds of trees, those of scipy for example."""
    if not isinstance(tree, Listed):
        raise TypeError(f"{name} must be a PointTree, not {type(tree).__name__}")


def _radii_of(r: ArrayLike, count: int, name: str, each: bool) -> np.ndarray:
    """One radius, or one for each of so many points; the latter if it must be."""
    radii = numbers(r, name)
    if radii.ndim and radii.shape != (count,):
        raise ValueError(f"{name} must be one radius or have the shape ({count},), not {radii.shape}")
    return per_query(np.full(count, radii) if each and not radii.ndim else radii, (count,), name)


def most_of(max_neighbors: int | None) -> int | None:
    """The greatest length of a list."""
    return None if max_neighbors is None else whole(max_neighbors, "max_neighbors", 0, 2**32)
