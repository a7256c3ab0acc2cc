"""Queries that trees of meshes and trees of instances share: rays and nearest points."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Callable, Generic, Tuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from . import _mbkd
from ._arrays import contiguous, corners_of, floats, per_query, places, whole, whole_numbers

Progress = Callable[[float], object]
EVERYTHING = 0xFFFF_FFFF

# Of the rays that tell inside from outside: along no edge of what people model.
ASIDE = np.float32([0.3171, 0.5923, 0.7407])

# Origins, directions, times, t_min and t_max; one of the last three may be for all rays.
Rays = Tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]

H = TypeVar("H", bound="Hits")


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
        Barycentric coordinates: the weights of the triangle's second and third corner. The first corner has 1 - u - v. On a
        sphere, x and y of the unit normal. NaN if nothing is hit.
    time : float32 (n,), or (1,) for all
        The times of the rays. (0 of hits that were not made by a query.)
    """

    t: np.ndarray
    mesh: np.ndarray
    triangle: np.ndarray
    u: np.ndarray
    v: np.ndarray
    time: np.ndarray = field(default_factory=lambda: np.zeros(1, np.float32), init=False, repr=False)

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self: H, rows: ArrayLike | slice) -> H:
        """Some of the hits: a mask, indices, or a slice."""
        at = rows if isinstance(rows, slice) or np.ndim(rows) else [rows]
        some = type(self)(*(getattr(self, column.name)[at] for column in fields(self) if column.init))
        return some._at(self.time if len(self.time) == 1 else self.time[at])

    def _at(self: H, time: np.ndarray) -> H:
        """These hits, as those of rays with these times."""
        object.__setattr__(self, "time", time)
        return self

    def _arrays(self) -> tuple:
        """What the compiled part takes."""
        kinds = (("t", np.float32), ("mesh", np.int32), ("triangle", np.int64), ("u", np.float32), ("v", np.float32))
        return tuple(contiguous(getattr(self, name), kind) for name, kind in kinds)


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
        origins : (n, 3) or (3,)
            The origins of rays, or one for all. float64 origins are not rounded.
        directions : (n, 3) or (3,)
            Directions of any length except zero, or one for all; t is in units of that length. float64 directions are rounded to
            float32, which moves a ray aside by up to 6e-8 of the distance from its origin. A ray whose direction is zero or not
            finite hits nothing.
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
        return self._hits(*self._tree.closest_hits(rays, mask_of(mask), workers, progress))._at(rays[2])

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
        return index, self._hits(*hits)._at(rays[2] if len(rays[2]) == 1 else rays[2][index])

    def intersects_any(
        self,
        ray_origins: ArrayLike,
        ray_directions: ArrayLike,
        *,
        time: ArrayLike = 0.0,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = np.inf,
        mask: int = EVERYTHING,
        workers: int = 1,
        progress: Progress | None = None,
    ) -> np.ndarray:
        """Whether each ray hits anything, bool (n,). Options as for `closest_hits`."""
        rays = rays_of(ray_origins, ray_directions, time, t_min, t_max)
        return self._tree.any_hits(rays, mask_of(mask), workers, progress)

    def surface(
        self, origins: ArrayLike, directions: ArrayLike, hits: H, *, time: ArrayLike | None = None, workers: int = 1
    ) -> tuple[np.ndarray, np.ndarray]:
        """The points of the surface that rays hit, and the normals there.

        Parameters
        ----------
        origins, directions
            The rays, as for `closest_hits`.
        hits : Hits, or InstanceHits of a tree of instances
            What each of the rays hit. (Those of `all_hits` belong to the rays ``origins[index]``.)
        time : float or (n,), optional
            The times of the rays. Default: ``hits.time``, those at which they were traced.
        workers : int
            Threads; -1 for all processors.

        Returns
        -------
        points : float64 (n, 3)
            The points of triangles with the weights of the hits, which are nearer to the surface than ``origin + t *
            direction``.
        normals : float32 (n, 3)
            Unit normals. Seen from their side, the corners of a triangle are in counter-clockwise order; those of spheres
            point outwards. NaN where nothing is hit, and for triangles without area.
        """
        return self._of_hits(self._tree.surfaces, origins, directions, hits, time, workers)

    def points_at(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        hits: H,
        at: ArrayLike,
        *,
        time: ArrayLike | None = None,
        workers: int = 1,
    ) -> np.ndarray:
        """Where the points that rays hit are at another time, for motion vectors: float64 (n, 3).

        A point of a triangle keeps its weights, a point of a sphere its direction from the center. NaN where nothing is hit.

        Parameters
        ----------
        origins, directions, hits, time, workers
            As for `surface`.
        at : float or (n,)
            The other time, or one for each hit, in [0, 1].

        Examples
        --------
        >>> import numpy as np
        >>> from mbkd import RayTree
        >>> open = np.float32([[-1, -1, 0], [1, -1, 0], [0, 1, 0]])
        >>> tree = RayTree(np.stack([open, open + np.float32([3, 0, 0])]), [[0, 1, 2]])
        >>> ray = [[1.5, 0, 9]], [0, 0, -1]
        >>> hits = tree.closest_hits(*ray, time=0.5)
        >>> tree.points_at(*ray, hits, 1.0) - tree.points_at(*ray, hits, 0.0)
        array([[3., 0., 0.]])
        """
        times = per_query(at, (len(hits),), "at")
        return self._of_hits(self._tree.points_at, origins, directions, hits, time, times, workers)

    def secondary_origins(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        hits: H,
        outgoing: ArrayLike,
        *,
        time: ArrayLike | None = None,
        workers: int = 1,
    ) -> np.ndarray:
        """Origins of rays that leave from the points that rays hit, float64 (n, 3): of shadow rays, reflections and the like.

        Each is moved off the surface, to the side that the ray leaves to, by no more than what the intersection rounds, so
        that the ray does not hit the same triangle or sphere again at once. NaN where nothing is hit: select the rays that hit
        something before.

        Parameters
        ----------
        origins, directions, hits, time, workers
            As for `surface`.
        outgoing : (n, 3) or (3,)
            The directions of the rays that leave.

        Examples
        --------
        >>> import numpy as np
        >>> from mbkd import RayTree
        >>> tree = RayTree(np.float32([[-1, -1, 0.1], [1, -1, 0.1], [0, 1, 0.1]]), [[0, 1, 2]])
        >>> origins, directions, up = np.float64([[0.1, 0.2, 9], [7, 7, 9]]), np.float32([[0, 0, -1]] * 2), [0, 0, 1]
        >>> hits = tree.closest_hits(origins, directions)
        >>> some = hits.triangle >= 0
        >>> leave = tree.secondary_origins(origins[some], directions[some], hits[some], up)
        >>> tree.intersects_any(leave, up)
        array([False])
        """
        to = floats(outgoing, "outgoing")
        try:
            to = contiguous(np.broadcast_to(to, (len(hits), 3)), np.float32)
        except ValueError:
            raise ValueError(f"outgoing has the shape {to.shape}, but there are {len(hits)} hits") from None
        return self._of_hits(self._tree.secondary_origins, origins, directions, hits, time, to, workers)

    def _of_hits(
        self,
        query: Callable,
        origins: ArrayLike,
        directions: ArrayLike,
        hits: H,
        time: ArrayLike | None,
        *arguments,
    ) -> np.ndarray | tuple[np.ndarray, np.ndarray]:
        if not isinstance(hits, self._hits):
            raise TypeError(f"hits must be {self._hits.__name__}, not {type(hits).__name__}")
        time = hits.time if time is None else time
        return query(rays_of(origins, directions, time, 0.0, np.inf), hits._arrays(), *arguments)

    def contains_points(
        self,
        points: ArrayLike,
        *,
        time: ArrayLike = 0.0,
        mask: int = EVERYTHING,
        workers: int = 1,
        progress: Progress | None = None,
    ) -> np.ndarray:
        """Whether points are inside of closed meshes or spheres, bool (n,), as ``trimesh.ray.contains_points``.

        That is where a ray from the point meets a surface from behind first. So meshes must be closed, with corners in
        counter-clockwise order as seen from outside, and must not overlap: tell those that do apart by `mask`. A point on the
        surface is on either side, by rounding. Options are as for `closest_points`.

        Examples
        --------
        >>> from mbkd import RayTree
        >>> ball = RayTree.from_meshes([], spheres=([[[0, 0, 0]], [[0, 0, 4]]], 1.0))       # moves along z
        >>> ball.contains_points([[0, 0, 0.5], [0, 0, 2.5]], time=0.5)
        array([False,  True])
        """
        where, _ = places(points, "points")
        hits = self.closest_hits(where, ASIDE, time=time, mask=mask, workers=workers, progress=progress)
        _, normals = self.surface(where, ASIDE, hits, workers=workers)
        return normals @ ASIDE > 0

    def closest_points(
        self,
        points: ArrayLike,
        *,
        time: ArrayLike = 0.0,
        max_distance: ArrayLike = np.inf,
        mask: int = EVERYTHING,
        workers: int = 1,
        progress: Progress | None = None,
    ) -> tuple[np.ndarray, H]:
        """Find the nearest point of the surface to each point, from outside or inside (`contains_points`).

        Distances are measured in the coordinates of this tree, also to what instances place under any matrix.

        Parameters
        ----------
        points : (n, 3)
        time : float or (n,)
            The time of each query, in [0, 1].
        max_distance : float or (n,)
            Points farther away are not found.
        mask, workers, progress
            As for `closest_hits`.

        Returns
        -------
        closest : float64 (n, 3)
            The nearest points; NaN if nothing is near enough.
        near : Hits, or InstanceHits of a tree of instances
            What they lie on: mesh, triangle, u and v (and path). t is the distance. Ties go to the lowest path of instances, and
            then to the lowest (mesh, triangle).

        Examples
        --------
        >>> import numpy as np
        >>> from mbkd import RayTree
        >>> corners, faces = np.float32([[-1, -1, 0], [1, -1, 0], [0, 1, 0]]), [[0, 1, 2]]
        >>> tree = RayTree.from_meshes([(corners, faces), (corners + np.float32([0, 0, 4]), faces)])
        >>> closest, near = tree.closest_points([[0, 0, 1], [0, 0, 3.5]])
        >>> near.mesh, near.triangle, near.t
        (array([0, 1], dtype=int32), array([0, 0]), array([1. , 0.5], dtype=float32))
        """
        queries, shape = places(points, "points")
        times, most = per_query(time, shape, "time"), per_query(max_distance, shape, "max_distance")
        if not (most >= 0).all():
            raise ValueError("max_distance must not be negative or NaN")
        wide = contiguous(queries, np.float64)
        closest, near = self._tree.closest_points((wide, times, most), mask_of(mask), workers, progress)
        return closest, self._hits(*near)._at(times)


def mask_of(mask: int) -> int:
    """A mask of 32 bits."""
    return whole(mask, "a mask", 0, EVERYTHING)


def masks_of(masks: ArrayLike, count: int, name: str) -> np.ndarray:
    """Masks of 32 bits, (n,)."""
    array = whole_numbers(masks, name)
    if array.shape != (count,):
        raise ValueError(f"{name} must have the shape ({count},), not {array.shape}")
    if array.size and (array.min() < 0 or array.max() > EVERYTHING):
        raise ValueError(f"{name} must have 32 bits")
    return contiguous(array, np.uint32)


def ends(origins: ArrayLike, directions: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Origins in float64 and directions in float32, both (n, 3); one of either may be given for all."""
    begin, to = floats(origins, "origins"), floats(directions, "directions")
    for array, name in ((begin, "origins"), (to, "directions")):
        if array.ndim not in (1, 2) or array.shape[-1] != 3:
            cure = f": pass {name}.reshape(-1, 3)" if array.ndim > 2 and array.shape[-1] == 3 else ""
            raise ValueError(f"{name} must have the shape (n, 3), not {array.shape}{cure}")
    begin, to = np.atleast_2d(begin, to)
    try:
        begin, to = np.broadcast_arrays(begin, to)
    except ValueError:
        raise ValueError(f"{len(begin)} origins and {len(to)} directions of rays") from None
    return contiguous(begin, np.float64), contiguous(to, np.float32)


def rays_of(origins: ArrayLike, directions: ArrayLike, time: ArrayLike, t_min: ArrayLike, t_max: ArrayLike) -> Rays:
    """Rays as the compiled part takes them."""
    begin, to = ends(origins, directions)
    if not np.isfinite(begin).all():
        raise ValueError("origins must be finite; check for nan or inf values")
    shape = begin.shape[:1]
    return begin, to, per_query(time, shape, "time"), per_query(t_min, shape, "t_min"), per_query(t_max, shape, "t_max")
