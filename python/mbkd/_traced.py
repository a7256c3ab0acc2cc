"""What trees of meshes and trees of instances are asked: rays and nearest points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Callable, Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from . import _mbkd
from ._arrays import floats, per_query, places, whole

Progress = Callable[[float], object]
EVERYTHING = 0xFFFF_FFFF


@dataclass(frozen=True, eq=False)
class Hits:
    """What rays hit, one row for each ray (or for each hit of all hits).

    Attributes
    ----------
    t : float32
        Distance in units of the direction; ``inf`` where nothing is hit.
    mesh : int32
        The mesh, by its place among those that the tree was built of; -1 where nothing is hit.
    triangle : int64
        The triangle within its mesh; -1 where nothing is hit.
    u, v : float32
        Barycentric weights of the triangle's second and third corner; the first has 1 - u - v.
    """

    t: np.ndarray
    mesh: np.ndarray
    triangle: np.ndarray
    u: np.ndarray
    v: np.ndarray

    def __len__(self) -> int:
        return len(self.t)


H = TypeVar("H", bound=Hits)


class Traced(Generic[H]):
    """A tree that is asked for hits of rays."""

    _tree: _mbkd.Rays | _mbkd.Instances
    _hits: type[H]

    @property
    def nbytes(self) -> int:
        """Bytes that the tree and its triangles take; a tree that is placed several times counts once."""
        return self._tree.nbytes

    def statistics(self) -> str:
        """What the build made, as text."""
        return self._tree.statistics()

    def closest_hits(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        *,
        time: ArrayLike = 0.0,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = np.inf,
        mask: int = EVERYTHING,
        workers: int = 1,
        progress: Progress | None = None,
    ) -> H:
        """The nearest hit of each ray; of several at the same t that on the lowest (mesh, triangle), and before that
        of the lowest path of instances.

        Parameters
        ----------
        origins : (n, 3)
            Where rays begin; float64 keeps what it has.
        directions : (n, 3) or (3,)
            Of any length but zero; t counts in that length. A ray whose direction is zero or not finite hits nothing.
        time : float or (n,)
            When each ray looks, in [0, 1].
        t_min, t_max : float or (n,)
            Hits count from t_min to t_max, both included; none do where the first is above the second or one is NaN.
        mask : int
            Sees the meshes, and the instances, whose mask shares a bit.
        workers : int
            Threads; -1 for all processors.
        progress : callable, optional
            Called with the finished fraction now and then.
        """
        rays = rays_of(origins, directions, time, t_min, t_max)
        return self._hits(*self._tree.closest_hits(rays, mask_of(mask), workers, progress))

    def all_hits(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        *,
        time: ArrayLike = 0.0,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = np.inf,
        mask: int = EVERYTHING,
        workers: int = 1,
        progress: Progress | None = None,
    ) -> tuple[np.ndarray, H]:
        """All hits of all rays: the index of the ray of each (int64), and the hits, by ray and along each ray."""
        rays = rays_of(origins, directions, time, t_min, t_max)
        index, hits = self._tree.all_hits(rays, mask_of(mask), workers, progress)
        return index, self._hits(*hits)

    def intersects_any(self, ray_origins: ArrayLike, ray_directions: ArrayLike, **options) -> np.ndarray:
        """Whether each ray hits anything, bool (n,). Options as of `closest_hits`."""
        return _with(self._tree.any_hits, ray_origins, ray_directions, **options)

    def _nearest(
        self,
        points: ArrayLike,
        *,
        time: ArrayLike = 0.0,
        max_distance: ArrayLike = np.inf,
        mask: int = EVERYTHING,
        workers: int = 1,
        progress: Progress | None = None,
    ) -> tuple[np.ndarray, H]:
        """The nearest points, float64 (n, 3), and what they lie on; t is their distance."""
        queries, shape = places(points, "points")
        times, most = per_query(time, shape, "time"), per_query(max_distance, shape, "max_distance")
        if not (most >= 0).all():
            raise ValueError("max_distance must not be negative or NaN")
        wide = np.ascontiguousarray(queries, dtype=np.float64)
        closest, near = self._tree.closest_points((wide, times, most), mask_of(mask), workers, progress)
        return closest, self._hits(*near)


def _with(query, origins, directions, *, time=0.0, t_min=0.0, t_max=np.inf, mask=EVERYTHING, workers=1, progress=None):
    return query(rays_of(origins, directions, time, t_min, t_max), mask_of(mask), workers, progress)


def mask_of(mask: int) -> int:
    """A mask of 32 bits."""
    return whole(mask, "a mask", 0, EVERYTHING)


def ends(origins: ArrayLike, directions: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Origins in float64 and directions in float32, both (n, 3)."""
    begin, to = floats(origins, "origins"), floats(directions, "directions")
    for array, name in ((begin, "origins"), (to, "directions")):
        if array.ndim not in (1, 2) or array.shape[-1] != 3:
            raise ValueError(f"{name} must have the shape (n, 3), not {array.shape}")
    begin = np.atleast_2d(begin)
    try:
        to = np.broadcast_to(to, begin.shape)
    except ValueError:
        raise ValueError(f"{len(begin)} origins and {len(to)} directions of rays") from None
    return np.ascontiguousarray(begin, dtype=np.float64), np.ascontiguousarray(to, dtype=np.float32)


def rays_of(origins: ArrayLike, directions: ArrayLike, time, t_min, t_max) -> tuple[np.ndarray, ...]:
    begin, to = ends(origins, directions)
    if not np.isfinite(begin).all():
        raise ValueError("origins must be finite; check for nan or inf values")
    numbers = [per_query(v, (len(begin),), n) for v, n in ((time, "time"), (t_min, "t_min"), (t_max, "t_max"))]
    return (begin, to, *numbers)
