"""Queries that trees of meshes and trees of instances share: rays and nearest points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Callable, Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from . import _mbkd
from ._arrays import contiguous, corners_of, floats, per_query, places, whole

Progress = Callable[[float], object]
EVERYTHING = 0xFFFF_FFFF


@dataclass(frozen=True, eq=False)
class Hits:
    """Hits of rays, one row for each ray (or one for each hit, for queries of all hits).

    Attributes
    ----------
    t : float32
        Distance in units of the direction; ``inf`` if nothing is hit.
    mesh : int32
        The index of the mesh among the meshes of the tree; -1 if nothing is hit.
    triangle : int64
        The index of the triangle in its mesh; -1 if nothing is hit.
    u, v : float32
        Barycentric coordinates: the weights of the triangle's second and third corner. The first corner has 1 - u - v.
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
    """A tree with ray queries."""

    _tree: _mbkd.Rays | _mbkd.Instances
    _hits: type[H]

    @property
    def nbytes(self) -> int:
        """Memory of the tree and its triangles in bytes. A tree that is placed several times counts once."""
        return self._tree.nbytes

    @property
    def bounds(self) -> np.ndarray | None:
        """A box around everything over the shutter, float64 (2, 3), slightly enlarged for rounding; None if there is nothing."""
        return corners_of(self._tree.bounds)

    def statistics(self) -> str:
        """Statistics of the tree, as text."""
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
        """Find the nearest hit of each ray.

        Ties at the same t go to the lowest path of instances, and then to the lowest (mesh, triangle).

        Parameters
        ----------
        origins : (n, 3)
            The origins of rays. float64 origins are not rounded.
        directions : (n, 3) or (3,)
            Directions of any length except zero; t is in units of that length. A ray whose direction is zero or not finite
            hits nothing.
        time : float or (n,)
            The time of each ray, in [0, 1].
        t_min, t_max : float or (n,)
            Hits count from t_min to t_max, inclusive. If t_min is greater than t_max, or one of them is NaN, there are none.
        mask : int
            The query sees the meshes, and the instances, whose masks share a bit with this one.
        workers : int
            Threads; -1 for all processors.
        progress : callable, optional
            Called with the finished fraction from time to time.
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
        """Find all hits of all rays: the ray index of each hit (int64), and the hits, sorted by ray and along each ray."""
        rays = rays_of(origins, directions, time, t_min, t_max)
        index, hits = self._tree.all_hits(rays, mask_of(mask), workers, progress)
        return index, self._hits(*hits)

    def intersects_any(self, ray_origins: ArrayLike, ray_directions: ArrayLike, **options) -> np.ndarray:
        """Whether each ray hits anything, bool (n,). Options as for `closest_hits`."""
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
        """The nearest points, float64 (n, 3), and the triangles they lie on; t is their distance."""
        queries, shape = places(points, "points")
        times, most = per_query(time, shape, "time"), per_query(max_distance, shape, "max_distance")
        if not (most >= 0).all():
            raise ValueError("max_distance must not be negative or NaN")
        wide = contiguous(queries, np.float64)
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
    return contiguous(begin, np.float64), contiguous(to, np.float32)


def rays_of(origins: ArrayLike, directions: ArrayLike, time, t_min, t_max) -> tuple[np.ndarray, ...]:
    begin, to = ends(origins, directions)
    if not np.isfinite(begin).all():
        raise ValueError("origins must be finite; check for nan or inf values")
    numbers = [per_query(v, (len(begin),), n) for v, n in ((time, "time"), (t_min, "t_min"), (t_max, "t_max"))]
    return (begin, to, *numbers)
