"""Ray queries and nearest points on triangle meshes and spheres that move."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import NamedTuple, Sequence

import numpy as np
from numpy.typing import ArrayLike

from . import _mbkd
from ._arrays import contiguous, floats, interval, keys_of, per_query, whole_numbers
from ._traced import EVERYTHING, Hits, Progress, Rays, Traced, mask_of, masks_of, rays_of


# Centers and radii at no keys, and neither active intervals nor masks.
NO_SPHERES: tuple = ([], [], None, None)

WHOLE = (0.0, 1.0)


@dataclass(frozen=True)
class Refit:
    """The result of a refit: the quality of the tree, and the work done.

    Attributes
    ----------
    cost : float
        The expected cost of a ray, relative to that when the tree was built: rays of this frame take about so many times as
        long as those of the frame that was built. If a frame's rays take R seconds and a build B seconds, a new tree pays
        within the frame where ``(cost - 1) * R > B``. A caller that measures both may add up ``cost - 1`` over the frames and
        build again when the sum times R exceeds B. It may be 1 although a new tree would be faster: where the pose of the
        frame makes any tree cheaper than the pose that was built. So build now and then where everything bends.
    is_worn : bool
        Whether `cost` is above 1.5, where a new tree pays if the rays of a frame take twice as long as a build.
    nodes, leaves : int
        Nodes, and leaf blocks of up to sixteen triangles, that were written again.
    kept, skipped : int
        Nodes and leaf blocks that were visited and did not change, and those that were not visited.
    """

    cost: float
    is_worn: bool
    nodes: int
    leaves: int
    kept: int
    skipped: int


class _Options(NamedTuple):
    """How a mesh is seen and stored."""

    active: Sequence[float] = WHOLE
    mask: int = EVERYTHING
    keep_keys: bool = False
    precise: bool = False


class RayTree(Traced[Hits]):
    """A tree of triangle meshes with vertices that may move, for ray queries and nearest points at any time.

    `RayTree.from_meshes` makes a tree of several meshes and of spheres.

    Parameters
    ----------
    vertices : (V, 3) or (K, V, 3)
        Positions, or positions at K keys spaced evenly over the shutter [0, 1]. Vertices move linearly between keys.
        float32 positions are kept bit for bit; float64 positions are rounded to float32 relative to the middle of the
        scene, unless `precision` says otherwise.
    faces : (F, 3) of integers
        The vertex indices of each triangle.
    active : (begin, end), optional
        The interval in which the mesh exists.
    keep_keys : bool
        Keep all keys. Otherwise those on straight lines between others are dropped, and the mesh of a later frame that needs
        more of them cannot take its place (`refit`). Each key beyond the second takes memory and time.
    precision : {'float32', 'float64'}
        'float64': positions are kept in float64 and decide every answer, for small parts that are far from each other. Takes
        24 bytes per vertex and key and 12 per triangle more, and up to 1.4 times the time of rays.
    workers : int
        Threads for the build; -1 for all processors.
    progress : callable, optional
        Called with the finished fraction from time to time. An exception ends the build, as Ctrl-C does.

    Raises
    ------
    ValueError
        If positions are not finite or beyond 1e30, faces have indices of no vertex, or arrays have wrong shapes.
    TypeError
        If an argument is not an array of numbers.

    Examples
    --------
    >>> import numpy as np
    >>> from mbkd import RayTree
    >>> open = np.float32([[-1, -1, 0], [1, -1, 0], [0, 1, 0]])
    >>> tree = RayTree(np.stack([open, open + np.float32([0, 0, 1])]), [[0, 1, 2]])
    >>> tree.closest_hits([[0, 0, 5], [0, 0, 5]], [0, 0, -1], time=[0, 0.5]).t
    array([5. , 4.5], dtype=float32)
    """

    _tree: _mbkd.Rays
    _hits = Hits
    # Of each mesh in the last build or refit; none in a tree that was loaded.
    _options: list[_Options]

    def __init__(
        self,
        vertices: ArrayLike,
        faces: ArrayLike,
        *,
        active: Sequence[float] = WHOLE,
        keep_keys: bool = False,
        precision: str = "float32",
        workers: int = 1,
        progress: Progress | None = None,
    ) -> None:
        self._options = _options(1, [active], None, keep_keys, precision)
        self._tree = _mbkd.Rays([_mesh(vertices, faces, self._options[0])], NO_SPHERES, workers, progress)

    @classmethod
    def from_meshes(
        cls,
        meshes: Sequence[tuple[ArrayLike, ArrayLike]],
        *,
        active: Sequence[Sequence[float]] | None = None,
        masks: Sequence[int] | None = None,
        spheres: tuple[ArrayLike, ArrayLike] | None = None,
        spheres_active: ArrayLike | None = None,
        spheres_masks: ArrayLike | None = None,
        keep_keys: bool | Sequence[bool] = False,
        precision: str = "float32",
        workers: int = 1,
        progress: Progress | None = None,
    ) -> RayTree:
        """Build a tree of several meshes, and of spheres, whose centers and radii may move.

        Parameters
        ----------
        meshes : sequence of pairs (vertices, faces)
            Each as for `RayTree`. May be empty.
        active : sequence of (begin, end), optional
            The interval in which each mesh exists.
        masks : sequence of int, optional
            32 bits for each mesh: a query sees the mesh if their masks share a bit. No query sees a mesh with the mask 0.
        spheres : (centers, radii), optional
            Centers (n, 3), or (K, n, 3) at K keys spaced evenly over the shutter; radii (n,), (K, n), or one number. Both are
            used in float64. A hit on a sphere has the number of meshes as its `mesh`, the index of the sphere as its
            `triangle`, and the x and y of the unit normal as `u` and `v`.
        spheres_active : (n, 2), optional
            The interval in which each sphere exists.
        spheres_masks : (n,) of 32 bits, optional
            As `masks`. Default: every query with a mask that is not 0 sees the spheres.
        keep_keys : bool or sequence of bool
            As for `RayTree`, for all meshes or for each.
        precision, workers, progress
            As for `RayTree`.

        Examples
        --------
        >>> from mbkd import RayTree
        >>> centers = [[[0, 0, 0]], [[0, 0, 4]]]                        # one sphere at two keys
        >>> tree = RayTree.from_meshes([], spheres=(centers, [[1], [2]]))
        >>> tree.closest_hits([0, 0, 10], [0, 0, -1], time=0.5).t       # the center is at 2 and the radius 1.5
        array([6.5], dtype=float32)
        """
        options = _options(len(meshes), active, masks, keep_keys, precision)
        balls = _spheres_or_none(spheres, spheres_active, spheres_masks)
        tree = _mbkd.Rays(_meshes(meshes, options), NO_SPHERES if balls is None else balls, workers, progress)
        return cls._of(tree, options)

    def refit(
        self, vertices: ArrayLike, faces: ArrayLike, *, active: Sequence[float] | None = None, workers: int = 1
    ) -> Refit:
        """Move the mesh to other positions, as those of the next frame, in a part of the time of a new build.

        Answers are then those of a new tree, bit for bit. The structure of the tree stays as it is, so rays may take longer:
        `Refit.cost` tells. For trees of several meshes, and of spheres, there is `refit_meshes`.

        A query in progress in another thread goes on in the tree as it was, and so do trees of instances, which keep the tree
        that they were made of: the refit copies it where it is in use. Calls that begin during a refit wait for it. To trace
        one frame while the next one is prepared, refit a `copy`.

        Parameters
        ----------
        vertices : (V, 3) or (K, V, 3)
            Positions. They must need as many keys as the tree has, after those on straight lines between others are dropped
            (with `keep_keys` none are). What stands still always fits.
        faces : (F, 3) of integers
            The triangles that the tree was built of.
        active : (begin, end), optional
            The interval in which the mesh exists now. Default: as in the last build or refit.
        workers : int
            Threads; -1 for all processors.

        Returns
        -------
        Refit
            The relative cost of rays, and the work done.

        Raises
        ------
        RefitError
            If this tree has no place for the mesh: it has other triangles, needs other keys, or exists at times that were left
            out; or if the tree was loaded or unpickled. Build a new tree then. RefitError is a ValueError.
        ValueError
            If no tree can be built of the mesh either. After either error the tree is unchanged.

        Examples
        --------
        >>> import numpy as np
        >>> from mbkd import RayTree
        >>> corners, faces = np.float32([[-1, -1, 0], [1, -1, 0], [0, 1, 0]]), [[0, 1, 2]]
        >>> tree = RayTree(corners, faces)
        >>> tree.refit(corners + np.float32([0, 0, 2]), faces).is_worn
        False
        >>> tree.closest_hits([0, 0, 5], [0, 0, -1]).t
        array([3.], dtype=float32)
        """
        return self.refit_meshes([(vertices, faces)], active=None if active is None else [active], workers=workers)

    def refit_meshes(
        self,
        meshes: Sequence[tuple[ArrayLike, ArrayLike]],
        *,
        moved: ArrayLike | None = None,
        active: Sequence[Sequence[float]] | None = None,
        masks: Sequence[int] | None = None,
        spheres: tuple[ArrayLike, ArrayLike] | None = None,
        spheres_active: ArrayLike | None = None,
        spheres_masks: ArrayLike | None = None,
        workers: int = 1,
    ) -> Refit:
        """`refit` of a tree of several meshes, and of spheres.

        Parameters
        ----------
        meshes : sequence of pairs (vertices, faces)
            All meshes of the tree, in the same order.
        moved : sequence of int, optional
            The indices of the meshes that differ from the last build or refit, in anything; this is not checked. From the
            second refit of a tree on, the others are skipped where the tree does not mix them with these. Default: all.
        active, masks : optional
            As for `from_meshes`, but the default is as in the last build or refit.
        spheres : (centers, radii), optional
            As for `from_meshes`: as many as before, with any number of keys. Default: they stay where they are.
        spheres_active, spheres_masks : optional
            As for `from_meshes`; with `spheres` only.
        workers : int
            Threads; -1 for all processors.

        Raises
        ------
        RefitError, ValueError
            As for `refit`; ValueError if `moved` has an index of no mesh.

        Examples
        --------
        >>> import numpy as np
        >>> from mbkd import RayTree
        >>> corners, faces = np.float32([[-1, -1, 0], [1, -1, 0], [0, 1, 0]]), [[0, 1, 2]]
        >>> tree = RayTree.from_meshes([(corners, faces), (corners + np.float32([0, 0, 1]), faces)])
        >>> refit = tree.refit_meshes([(corners, faces), (corners + np.float32([0, 0, 2]), faces)], moved=[1])
        >>> tree.closest_hits([0, 0, 5], [0, 0, -1]).t
        array([3.], dtype=float32)
        """
        last = self._options if len(self._options) == len(meshes) else [_Options()] * len(meshes)
        options = [option._replace(active=now) for option, now in zip(last, _each(active, last, 0, "active intervals"))]
        options = [option._replace(mask=now) for option, now in zip(options, _each(masks, last, 1, "masks"))]
        balls = _spheres_or_none(spheres, spheres_active, spheres_masks)
        which = None if moved is None else whole_numbers(moved, "moved").reshape(-1).tolist()
        if which and min(which) < 0:
            raise ValueError(f"moved must have indices of meshes, not {min(which)}")
        done = self._tree.refit(_meshes(meshes, options), balls, which, workers)
        self._options = options
        cost, is_worn, counts = done
        return Refit(cost, is_worn, *counts)

    def copy(self) -> RayTree:
        """A tree with the same contents that is refitted by itself.

        The two share memory until one of them is refitted, which then copies what both had.
        """
        return self._of(self._tree.copy(), self._options)

    __copy__ = copy

    def __deepcopy__(self, memo: dict) -> RayTree:
        return self.copy()

    def save(self, path: str | os.PathLike) -> None:
        """Write the tree to a file. `RayTree.load` reads it, in Python and in Rust, on any machine."""
        self._tree.save(os.fspath(path))

    @classmethod
    def load(cls, path: str | os.PathLike, *, workers: int = 1) -> RayTree:
        """Read a tree from a file, on so many threads (-1 for all processors).

        The tree gives the same answers as the saved one. Reading takes a small part of the time of a build. A loaded tree
        cannot be refitted.

        Raises
        ------
        OSError
            If the file cannot be read.
        ValueError
            If the file is damaged or invalid, has another version, or is not a tree of triangles.
        """
        return cls._of(_mbkd.Rays.load(os.fspath(path), workers), [])

    @classmethod
    def _of(cls, compiled: _mbkd.Rays, options: list[_Options]) -> RayTree:
        tree = cls.__new__(cls)
        tree._tree, tree._options = compiled, options
        return tree

    def __reduce__(self) -> tuple:
        return _restored, (self._tree.to_bytes(),)

    def __repr__(self) -> str:
        return f"<RayTree, {self.nbytes / 1e6:.1f} MB>"

    def intersects_first(
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
        """The first triangle that each ray hits, int64 (n,); -1 if there is none. Options as for `closest_hits`."""
        return self.closest_hits(
            ray_origins,
            ray_directions,
            time=time,
            t_min=t_min,
            t_max=t_max,
            mask=mask,
            workers=workers,
            progress=progress,
        ).triangle

    def intersects_id(
        self,
        ray_origins: ArrayLike,
        ray_directions: ArrayLike,
        multiple_hits: bool = True,
        return_locations: bool = False,
        *,
        time: ArrayLike = 0.0,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = np.inf,
        mask: int = EVERYTHING,
        workers: int = 1,
        progress: Progress | None = None,
    ) -> tuple[np.ndarray, ...]:
        """The triangles and rays of all hits (or of the first hit of each ray), and on request their positions.

        Returns ``index_tri, index_ray`` and ``locations``, one row for each hit, as `intersects_location` gives them. Options as
        for `closest_hits`.
        """
        rays = rays_of(ray_origins, ray_directions, time, t_min, t_max)
        index_ray, hits = self._found(rays, multiple_hits, mask, workers, progress)
        if return_locations:
            return hits.triangle, index_ray, self._locations(rays, index_ray, hits, workers)
        return hits.triangle, index_ray

    def intersects_location(
        self,
        ray_origins: ArrayLike,
        ray_directions: ArrayLike,
        multiple_hits: bool = True,
        *,
        time: ArrayLike = 0.0,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = np.inf,
        mask: int = EVERYTHING,
        workers: int = 1,
        progress: Progress | None = None,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The positions of hits.

        Returns
        -------
        locations : float64 (hits, 3)
            The points of the surface, as `points_at` gives them at the times of the rays.
        index_ray : int64 (hits,)
        index_tri : int64 (hits,)
            One row for each hit: all hits, sorted by ray and along each ray; or the first hit of each ray that hits
            anything. Options as for `closest_hits`.
        """
        rays = rays_of(ray_origins, ray_directions, time, t_min, t_max)
        index_ray, hits = self._found(rays, multiple_hits, mask, workers, progress)
        return self._locations(rays, index_ray, hits, workers), index_ray, hits.triangle

    def _found(
        self, rays: Rays, all_of_them: bool, mask: int, workers: int, progress: Progress | None
    ) -> tuple[np.ndarray, Hits]:
        """All hits, or the first one of each ray that hits anything, with the indices of their rays."""
        if all_of_them:
            index_ray, columns = self._tree.all_hits(rays, mask_of(mask), workers, progress)
            return index_ray, Hits(*columns)
        hits = Hits(*self._tree.closest_hits(rays, mask_of(mask), workers, progress))
        index = np.flatnonzero(hits.triangle >= 0)
        return index, hits[index]

    def _locations(self, rays: Rays, index: np.ndarray, hits: Hits, workers: int) -> np.ndarray:
        """The points that these of the rays hit."""
        origins, directions, *others = rays
        time, t_min, t_max = (part if len(part) == 1 else part[index] for part in others)
        of_hits = (origins.take(index, axis=0), directions.take(index, axis=0), time, t_min, t_max)
        return self._tree.points_at(of_hits, hits._arrays(), time, workers)

    def closest_point(
        self,
        points: ArrayLike,
        *,
        time: ArrayLike = 0.0,
        max_distance: ArrayLike = np.inf,
        mask: int = EVERYTHING,
        workers: int = 1,
        progress: Progress | None = None,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The nearest point of the surface to each point, as ``trimesh.proximity.closest_point``.

        In a tree of several meshes `closest_points` tells which one each triangle is of. Options are as there.

        Returns
        -------
        closest : float64 (n, 3)
        distance : float32 (n,)
        triangle_id : int64 (n,)
            NaN, ``inf`` and -1 if nothing is near enough.
        """
        closest, near = self.closest_points(
            points, time=time, max_distance=max_distance, mask=mask, workers=workers, progress=progress
        )
        return closest, near.t, near.triangle

    def triangles(self, mesh: ArrayLike, triangle: ArrayLike, *, time: ArrayLike = 0.0) -> np.ndarray:
        """The corners of triangles at times, float64 (n, 3, 3), exactly as rays meet them; NaN if there is no such triangle."""
        triangle = contiguous(whole_numbers(triangle, "triangle"), np.int64).reshape(-1)
        # Numbers that the smaller type does not have are those of no mesh either.
        mesh = np.clip(whole_numbers(mesh, "mesh"), -1, 2**31 - 1).astype(np.int32)
        mesh = contiguous(np.broadcast_to(mesh, triangle.shape))
        return self._tree.triangles(mesh, triangle, per_query(time, triangle.shape, "time"))

    def normals(self, mesh: ArrayLike, triangle: ArrayLike, *, time: ArrayLike = 0.0) -> np.ndarray:
        """Unit normals of triangles at times, float64 (n, 3); NaN for triangles without area."""
        a, b, c = np.moveaxis(self.triangles(mesh, triangle, time=time), 1, 0)
        normals = np.cross(b - a, c - a)
        with np.errstate(invalid="ignore"):
            return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _restored(bytes_of_file: bytes) -> RayTree:
    """Restores a pickled tree."""
    return RayTree._of(_mbkd.Rays.from_bytes(bytes_of_file), [])


def _spheres(spheres: tuple[ArrayLike, ArrayLike], active: ArrayLike | None, masks: ArrayLike | None) -> tuple:
    if not isinstance(spheres, (tuple, list)) or len(spheres) != 2:
        raise TypeError(f"spheres must be a pair (centers, radii), not {type(spheres).__name__}")
    centers, radii = floats(spheres[0], "centers").astype(np.float64), floats(spheres[1], "radii").astype(np.float64)
    if centers.ndim not in (2, 3) or centers.shape[-1] != 3 or centers.ndim == 3 and not len(centers):
        raise ValueError(f"centers must have the shape (n, 3) or (K, n, 3), not {centers.shape}")
    # Centers that stay where they are have as many keys as radii that change.
    keys = max(len(array) if array.ndim == most else 1 for array, most in ((centers, 3), (radii, 2)))
    count = centers.shape[-2]
    try:
        centers, radii = np.broadcast_to(centers, (keys, count, 3)), np.broadcast_to(radii, (keys, count))
    except ValueError:
        raise ValueError(f"radii of the shape {radii.shape} for centers of the shape {centers.shape}") from None
    if active is not None:
        active = floats(active, "spheres_active").astype(np.float32)
        if active.shape != (count, 2):
            raise ValueError(f"spheres_active must have the shape ({count}, 2), not {active.shape}")
        active = contiguous(active)
    if masks is not None:
        masks = masks_of(masks, count, "spheres_masks")
    return [contiguous(c) for c in centers], [contiguous(r) for r in radii], active, masks


def _spheres_or_none(
    spheres: tuple[ArrayLike, ArrayLike] | None, active: ArrayLike | None, masks: ArrayLike | None
) -> tuple | None:
    if spheres is None and (active is not None or masks is not None):
        raise ValueError(f"spheres_{'masks' if active is None else 'active'} without spheres")
    return None if spheres is None else _spheres(spheres, active, masks)


def _options(
    count: int,
    active: Sequence[Sequence[float]] | None,
    masks: Sequence[int] | None,
    keep_keys: bool | Sequence[bool],
    precision: str,
) -> list[_Options]:
    """The options of each mesh."""
    if precision not in ("float32", "float64"):
        raise ValueError(f"precision must be 'float32' or 'float64', not {precision!r:.60}")
    last = [_Options(precise=precision == "float64")] * count
    keep = [keep_keys] * count if isinstance(keep_keys, (bool, np.bool_)) else keep_keys
    parts = [
        _each(values, last, field, name)
        for field, (values, name) in enumerate(((active, "active intervals"), (masks, "masks"), (keep, "elements of keep_keys")))
    ]
    return [of._replace(active=a, mask=mask, keep_keys=bool(k)) for of, a, mask, k in zip(last, *parts)]


def _each(values: Sequence | None, last: list[_Options], field: int, name: str) -> list:
    """A value for each mesh; those of the last time if none are given."""
    if values is None:
        return [options[field] for options in last]
    if len(values) != len(last):
        raise ValueError(f"{len(last)} meshes and {len(values)} {name}")
    return list(values)


def _meshes(meshes: Sequence[tuple[ArrayLike, ArrayLike]], options: list[_Options]) -> list[tuple]:
    for i, mesh in enumerate(meshes):
        if not isinstance(mesh, (tuple, list)) or len(mesh) != 2:
            raise TypeError(f"mesh {i} must be a pair (vertices, faces), not {type(mesh).__name__}")
    return [_mesh(*mesh, option) for mesh, option in zip(meshes, options)]


def _mesh(vertices: ArrayLike, faces: ArrayLike, options: _Options) -> tuple:
    corners = whole_numbers(faces, "faces")
    if corners.size == 0:
        corners = np.empty((0, 3), np.uint32)
    if corners.ndim != 2 or corners.shape[1] != 3:
        raise ValueError(f"faces must have the shape (F, 3), not {corners.shape}")
    if corners.dtype != np.uint32 and len(corners):
        if corners.min() < 0 or corners.max() > 0xFFFF_FFFF:
            raise ValueError("faces must be indices of vertices: at least 0 and less than 2^32")
    corners = contiguous(corners, np.uint32)
    keys = keys_of(vertices, None, "vertices")
    if options.precise:
        keys = [contiguous(key, np.float64) for key in keys]
    return keys, corners, interval(options.active), mask_of(options.mask), options.keep_keys, options.precise
