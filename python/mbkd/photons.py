"""Density estimates over photons with time stamps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Callable

import numpy as np
from numpy.typing import ArrayLike

from . import _mbkd
from ._arrays import box_lengths, contiguous, floats, per_query, places, whole

Progress = Callable[[float], object]


@dataclass(frozen=True, eq=False)
class Gathered:
    """Density estimates, one row for each query.

    Attributes
    ----------
    density : float32 (n,) or (n, 3)
        Flux per area (per volume with `volume`) and time (the shutter has length 1), in as many channels as the photons have.
    radius : float32 (n,)
        The radius of the disc or ball of each estimate.
    count : int64 (n,)
        The number of photons in each estimate.
    """

    density: np.ndarray
    radius: np.ndarray
    count: np.ndarray


class PhotonMap:
    """Photons on surfaces, for density estimates at a time (Cammarano and Jensen, 2002).

    Parameters
    ----------
    positions : (n, 3)
        The positions at which photons arrived. All numbers are converted to float32.
    normals : (n, 3)
        Unit normals of the surface at these positions.
    flux : (n,) or (n, 3)
        The flux of each photon: energy over the whole shutter.
    times : (n,)
        The time at which each photon arrived, in [0, 1].
    window, neighbors
        The expected half width of the time window and the expected number of photons of queries. The tree is optimized for
        these; answers do not depend on them.
    boxsize : float or (3,), optional
        Periodic box [0, L), as that of `PointTree`. Distances are to the nearest image; photons and queries may lie in any
        period, photons within sixteen of each other.
    workers : int
        Threads for the build; -1 for all processors.
    progress : callable, optional
        Called with the finished fraction from time to time. An exception ends the build, as Ctrl-C does.
    """

    def __init__(
        self,
        positions: ArrayLike,
        normals: ArrayLike,
        flux: ArrayLike,
        times: ArrayLike,
        *,
        window: float = 0.05,
        neighbors: int = 50,
        boxsize: ArrayLike | None = None,
        workers: int = 1,
        progress: Progress | None = None,
    ) -> None:
        where, facing = _rows(positions, "positions"), _rows(normals, "normals")
        light = floats(flux, "flux").astype(np.float32, copy=False)
        self._gray = light.ndim == 1
        if self._gray:
            light = np.repeat(light[:, None], 3, axis=1)
        if light.ndim != 2 or light.shape[1] != 3:
            raise ValueError(f"flux must have the shape (n,) or (n, 3), not {light.shape}")
        when = contiguous(floats(times, "times"), np.float32)
        if when.ndim != 1:
            raise ValueError(f"times must have the shape (n,), not {when.shape}")
        typical = whole(neighbors, "neighbors", 1, 2**32 - 1)
        box = box_lengths(boxsize).tolist()
        self._map = _mbkd.Photons(where, facing, contiguous(light), when, window, typical, box, workers, progress)

    def __len__(self) -> int:
        return self._map.n

    @property
    def nbytes(self) -> int:
        """Memory of the map in bytes."""
        return self._map.nbytes

    def __repr__(self) -> str:
        return f"<PhotonMap of {len(self)} photons, {self.nbytes / 1e6:.1f} MB>"

    def gather(
        self,
        positions: ArrayLike,
        normals: ArrayLike,
        time: ArrayLike = 0.0,
        *,
        k: int | None = None,
        radius: float = np.inf,
        window: float = np.inf,
        cosine: float | None = None,
        thickness: float | None = None,
        volume: bool = False,
        kernels: tuple[str, str] = ("box", "box"),
        workers: int = 1,
        progress: Progress | None = None,
    ) -> Gathered:
        """Estimate the density of light at positions (n, 3) with unit normals (n, 3) or (3,), each at its time.

        Parameters
        ----------
        k, radius
            Use the k nearest photons, those within a radius, or both. At least one must be given.
        window : float
            Half width of the time window: a photon with the time stamp s counts if abs(s - time) <= window.
        cosine, thickness : float, optional
            Use only photons whose normal has at least this cosine with that of the query, and only photons in a disc of this
            half thickness.
        volume : bool
            Estimate flux per volume, as in smoke, instead of per area.
        kernels : (str, str)
            Weights by distance in space and in time: 'box', 'cone', 'epanechnikov' or 'gaussian'.

        Raises
        ------
        ValueError
            If an argument is out of range, or neither k nor radius is given.
        """
        where = _rows(positions, "positions")
        facing = np.broadcast_to(floats(normals, "normals"), where.shape)
        density, reach, count = self._map.gather(
            where,
            contiguous(facing, np.float32),
            per_query(time, (len(where),), "time"),
            None if k is None else whole(k, "k", 1, 2**32),
            radius,
            window,
            cosine,
            thickness,
            bool(volume),
            list(kernels),
            workers,
            progress,
        )
        return Gathered(density[:, 0].copy() if self._gray else density, reach, count)


def _rows(values: ArrayLike, name: str) -> np.ndarray:
    return contiguous(places(values, name)[0], np.float32)
