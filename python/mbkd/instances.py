"""Trees with many moving instances of other trees."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Sequence

import numpy as np
from numpy.typing import ArrayLike

from . import _mbkd
from ._arrays import contiguous, floats, per_query, whole_numbers
from ._traced import EVERYTHING, Hits, Progress, Traced, masks_of
from .rays import RayTree


@dataclass(frozen=True, eq=False)
class InstanceHits(Hits):
    """Hits of rays as in `Hits`, with the path of instances of each hit.

    Attributes
    ----------
    path : int64 (m, 4)
        The instance in the outermost tree, then the instance in the tree placed there, and so on. -1 after the last one,
        and everywhere if nothing is hit.
    """

    path: np.ndarray

    def _arrays(self) -> tuple:
        return super()._arrays(), contiguous(self.path, np.int64)

    @property
    def instance(self) -> np.ndarray:
        """The instance in the outermost tree, int64 (m,); -1 if nothing is hit."""
        return self.path[:, 0]


class InstanceTree(Traced[InstanceHits]):
    """A tree of moving instances of other trees. The placed trees are shared, not copied.

    For the next frame refit the placed trees, and make a new tree of instances. A placed tree stays as it is in this one, since
    a refit copies what is in use.

    An instance places one of `trees` by a matrix, or by scale, rotation and translation, applied in this order. Either is
    given once, or at K keys spaced evenly over the shutter [0, 1]. The entries of matrices are interpolated linearly between
    keys, and so are translations and scales. Rotations turn at constant speed, the shorter way.

    Parameters
    ----------
    trees : sequence of RayTree or InstanceTree
        The trees that instances place. Trees of instances can be nested, up to four levels.
    which : (n,) of integers
        The index of the tree that each instance places.
    matrices : (n, 4, 4), (n, 3, 4), or one of these after a first axis of K keys
        The map from the space of the placed tree to the space of this one, for column vectors: translations are in the last
        column.
    translations : (n, 3) or (K, n, 3), optional
    rotations : (n, 4) or (K, n, 4), optional
        Unit quaternions x, y, z, w, as ``scipy.spatial.transform.Rotation.as_quat`` gives them.
    scales : (n,), (n, 3) or (K, n, 3), optional
        These three replace `matrices`. The defaults are 0, no rotation, and 1. Scales of 0 along all axes at all keys hide an
        instance (as do matrices of zeros beside the translation): it keeps its index, and nothing of it is found.
    masks : (n,) of 32 bits, optional
        A query sees an instance if their masks share a bit, and in it the meshes whose masks share a bit. No query sees an
        instance with the mask 0.
    active : (n, 2), optional
        The interval in which each instance exists: begin <= t < end (an end of 1 includes 1).
    workers : int
        Threads for the build; -1 for all processors.
    progress : callable, optional
        Called with the finished fraction from time to time. An exception ends the build, as Ctrl-C does.

    Raises
    ------
    ValueError
        If transforms are singular (a scale of 0 at some keys or along some axes only), not finite, or distort too much;
        quaternions do not have length 1; arrays have wrong shapes or different lengths; `which` has an index of no tree; or
        trees are nested in more than four levels.

    Examples
    --------
    >>> import numpy as np
    >>> from mbkd import InstanceTree, RayTree
    >>> triangle = RayTree(np.float32([[-1, -1, 0], [1, -1, 0], [0, 1, 0]]), [[0, 1, 2]])
    >>> tree = InstanceTree([triangle], [0, 0], translations=[[[0, 0, 0], [9, 0, 0]], [[0, 0, 1], [9, 0, 2]]])
    >>> hits = tree.closest_hits([[0, 0, 5], [9, 0, 5]], [0, 0, -1], time=0.5)
    >>> hits.t, hits.instance
    (array([4.5, 4. ], dtype=float32), array([0, 1]))
    """

    _tree: _mbkd.Instances
    _hits = InstanceHits

    def __init__(
        self,
        trees: Sequence[RayTree | InstanceTree],
        which: ArrayLike,
        matrices: ArrayLike | None = None,
        *,
        translations: ArrayLike | None = None,
        rotations: ArrayLike | None = None,
        scales: ArrayLike | None = None,
        masks: ArrayLike | None = None,
        active: ArrayLike | None = None,
        workers: int = 1,
        progress: Progress | None = None,
    ) -> None:
        if isinstance(trees, (RayTree, InstanceTree)):
            raise TypeError("trees must be a sequence of trees, not one of them")
        for tree in trees:
            if not isinstance(tree, (RayTree, InstanceTree)):
                raise TypeError(f"trees must be RayTree or InstanceTree, not {type(tree).__name__}")
        which = np.atleast_1d(whole_numbers(which, "which"))
        n = len(which)
        poses = (translations, rotations, scales)
        if matrices is None:
            transforms = _poses(n, *poses)
        elif any(part is not None for part in poses):
            raise ValueError("give either matrices or translations, rotations and scales")
        else:
            transforms = _matrices(n, matrices)
        masks = masks_of(np.full(n, EVERYTHING) if masks is None else masks, n, "masks")
        active = np.tile(np.array([0, 1], np.float32), (n, 1)) if active is None else floats(active, "active")
        if active.shape != (n, 2) or which.ndim != 1:
            raise ValueError(f"{n} instances and active intervals {active.shape}")
        self._tree = _mbkd.Instances(
            [tree._tree for tree in trees],
            contiguous(which, np.int64),
            transforms,
            masks,
            contiguous(active, np.float32),
            workers,
            progress,
        )

    def __len__(self) -> int:
        return self._tree.n

    def __reduce__(self) -> tuple:
        raise TypeError("a tree of instances can not be pickled; pickle the trees that it places, and build it again")

    def __repr__(self) -> str:
        return f"<InstanceTree of {len(self)} instances, {self.nbytes / 1e6:.1f} MB>"

    def closest_point(
        self,
        points: ArrayLike,
        *,
        time: ArrayLike = 0.0,
        max_distance: ArrayLike = np.inf,
        mask: int = EVERYTHING,
        workers: int = 1,
        progress: Progress | None = None,
    ) -> tuple[np.ndarray, np.ndarray, InstanceHits]:
        """The nearest point of any instance to each point.

        The answers of `closest_points`, with the distance by itself. Options are as there.

        Returns
        -------
        closest : float64 (n, 3)
        distance : float32 (n,)
        near : InstanceHits
            The path, mesh, triangle, u and v of each point; its t is the distance. NaN, ``inf`` and -1 if nothing is near
            enough. Ties go to the lowest (path, mesh, triangle).

        Examples
        --------
        >>> import numpy as np
        >>> from mbkd import InstanceTree, RayTree
        >>> triangle = RayTree(np.float32([[-1, -1, 0], [1, -1, 0], [0, 1, 0]]), [[0, 1, 2]])
        >>> tree = InstanceTree([triangle], [0, 0], translations=[[[0, 0, 0], [9, 0, 0]], [[0, 0, 1], [9, 0, 2]]])
        >>> closest, distance, near = tree.closest_point([[9, 0, 5]], time=0.5)
        >>> closest, distance, near.instance
        (array([[9., 0., 1.]]), array([4.], dtype=float32), array([1]))
        """
        closest, near = self.closest_points(
            points, time=time, max_distance=max_distance, mask=mask, workers=workers, progress=progress
        )
        return closest, near.t, near

    def matrices(self, path: ArrayLike, *, time: ArrayLike = 0.0) -> np.ndarray:
        """The matrices of paths (m, levels), as in hits, at times: float64 (m, 4, 4).

        Each maps from the space of the tree at the end of the path to the space of this tree. NaN for invalid paths.
        """
        paths = contiguous(whole_numbers(path, "paths"), np.int64)
        if paths.ndim != 2:
            raise ValueError(f"paths must have the shape (m, levels), not {paths.shape}")
        times = per_query(time, (len(paths),), "time")
        whole = np.tile(np.eye(4), (len(paths), 1, 1))
        whole[:, :3] = self._tree.matrices(paths, times).reshape(-1, 3, 4)
        return whole


def _matrices(n: int, matrices: ArrayLike) -> np.ndarray:
    """Twelve numbers for each key and instance."""
    array = floats(matrices, "matrices").astype(np.float64, copy=False)
    array = array[None] if array.ndim == 3 else array
    if array.ndim != 4 or array.shape[1] != n or array.shape[2:] not in ((3, 4), (4, 4)):
        raise ValueError(f"matrices must have the shape ({n}, 4, 4), ({n}, 3, 4) or (K, ...), not {array.shape}")
    if array.shape[2] == 4 and not (array[:, :, 3] == (0, 0, 0, 1)).all():
        raise ValueError("matrices must be affine, with a last row 0, 0, 0, 1: translations are in the last column")
    return contiguous(array[:, :, :3]).reshape(len(array), n, 12)


def _poses(n: int, translations, rotations, scales) -> np.ndarray:
    """Ten numbers for each key and instance."""
    scales = None if scales is None else floats(scales, "scales")
    if scales is not None and scales.ndim < 2:
        scales = np.repeat(scales.reshape(-1, 1), 3, axis=1)
    parts = []
    for values, name, default in (
        (translations, "translations", [0, 0, 0]),
        (rotations, "rotations", [0, 0, 0, 1]),
        (scales, "scales", [1, 1, 1]),
    ):
        array = np.tile(np.array(default, np.float64), (1, n, 1)) if values is None else floats(values, name)
        array = array[None] if array.ndim == 2 else array
        if array.ndim != 3 or array.shape[1:] != (n, len(default)):
            raise ValueError(f"{name} must have the shape ({n}, {len(default)}) or (K, {n}, {len(default)}), not {array.shape}")
        parts.append(array.astype(np.float64, copy=False))
    keys = max(len(part) for part in parts)
    if any(len(part) not in (1, keys) for part in parts):
        raise ValueError(f"translations, rotations and scales at {[len(part) for part in parts]} keys")
    parts = [np.broadcast_to(part, (keys, *part.shape[1:])) for part in parts]
    return contiguous(np.concatenate(parts, axis=2))
