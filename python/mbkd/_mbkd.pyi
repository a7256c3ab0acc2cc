"""The compiled part: flat, C-contiguous arrays in and out. Use the classes of `mbkd` instead."""

from typing import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

_Progress = Callable[[float], object] | None
_F32 = NDArray[np.float32]
_F64 = NDArray[np.float64]
_I32 = NDArray[np.int32]
_I64 = NDArray[np.int64]
_Floats = _F32 | _F64
_Hits = tuple[_F32, _I32, _I64, _F32, _F32]
_PlacedHits = tuple[_F32, _I32, _I64, _F32, _F32, _I64]
_Mesh = tuple[Sequence[_Floats], NDArray[np.uint32], Sequence[float], int, bool, bool]
_Spheres = tuple[Sequence[_F64], Sequence[_F64], _F32 | None, NDArray[np.uint32] | None]
_Rays = tuple[_F64, _F32, _F32, _F32, _F32]
_Places = tuple[_F64, _F32, _F32]
_Periods = Sequence[float | None] | None
_Corners = Sequence[Sequence[float]] | None
_Columns = tuple[_I64, _I32, _I32 | None, _F32 | None, _F32 | None]

class Points:
    def __new__(
        cls,
        keys: Sequence[_Floats],
        active: _F32 | None,
        boxsize: Sequence[float],
        structure: str,
        max_references: float,
        precision: str,
        workers: int,
        progress: _Progress,
    ) -> Points: ...
    def rebuild(
        self,
        keys: Sequence[_Floats],
        active: _F32 | None,
        structure: str,
        max_references: float,
        precision: str,
        workers: int,
    ) -> bool: ...
    def take_order(self) -> _I64: ...
    def copy(self) -> Points: ...
    def save(self, path: str) -> None: ...
    @staticmethod
    def load(path: str, workers: int) -> Points: ...
    def to_bytes(self) -> tuple[bytes, _Periods]: ...
    @staticmethod
    def from_bytes(bytes: bytes, periods: _Periods) -> Points: ...
    @property
    def n(self) -> int: ...
    @property
    def nbytes(self) -> int: ...
    @property
    def bounds(self) -> _Corners: ...
    def statistics(self) -> str: ...
    def query(
        self,
        points: _Floats,
        times: _F32,
        k: int,
        eps: float,
        bound: float,
        workers: int,
        progress: _Progress,
    ) -> tuple[_F64, _I64, int]: ...
    def within(
        self,
        points: _Floats,
        radii: _F32,
        times: _F32,
        sorted: bool,
        max_neighbors: int | None,
        workers: int,
        progress: _Progress,
    ) -> tuple[_I64, _I32]: ...
    def count(self, points: _Floats, radii: _F32, times: _F32, workers: int, progress: _Progress) -> _I64: ...
    def count_pairs(
        self, other: Points, radii: Sequence[float], time: float, workers: int, progress: _Progress
    ) -> list[int]: ...
    def positions(self, time: float) -> _F64: ...
    def closest_approach(
        self, start: _F64, end: _F64, between: Sequence[float], workers: int, progress: _Progress
    ) -> tuple[_F64, _I64, _F64]: ...

class RefitError(ValueError):
    """A tree cannot be refitted to these meshes: build a new one. The tree is unchanged, and answers as before."""

class Rays:
    def __new__(
        cls, of_meshes: Sequence[_Mesh], of_spheres: _Spheres, workers: int, progress: _Progress
    ) -> Rays: ...
    def refit(
        self, to_meshes: Sequence[_Mesh], to_spheres: _Spheres | None, moved: Sequence[int] | None, workers: int
    ) -> tuple[float, bool, Sequence[int]]: ...
    def copy(self) -> Rays: ...
    def save(self, path: str) -> None: ...
    @staticmethod
    def load(path: str, workers: int) -> Rays: ...
    def to_bytes(self) -> bytes: ...
    @staticmethod
    def from_bytes(bytes: bytes) -> Rays: ...
    @property
    def nbytes(self) -> int: ...
    @property
    def bounds(self) -> _Corners: ...
    def statistics(self) -> str: ...
    def closest_hits(self, rays: _Rays, mask: int, workers: int, progress: _Progress) -> _Hits: ...
    def any_hits(self, rays: _Rays, mask: int, workers: int, progress: _Progress) -> NDArray[np.bool_]: ...
    def all_hits(self, rays: _Rays, mask: int, workers: int, progress: _Progress) -> tuple[_I64, _Hits]: ...
    def closest_points(
        self, points: _Places, mask: int, workers: int, progress: _Progress
    ) -> tuple[_F64, _Hits]: ...
    def surfaces(self, rays: _Rays, hits: _Hits, workers: int) -> tuple[_F64, _F32]: ...
    def points_at(self, rays: _Rays, hits: _Hits, times: _F32, workers: int) -> _F64: ...
    def secondary_origins(self, rays: _Rays, hits: _Hits, directions: _F32, workers: int) -> _F64: ...
    def triangles(self, mesh: _I32, triangle: _I64, times: _F32) -> _F64: ...

class Instances:
    def __new__(
        cls,
        trees: Sequence[Rays | Instances],
        which: _I64,
        transforms: _F64,
        masks: NDArray[np.uint32],
        active: _F32,
        workers: int,
        progress: _Progress,
    ) -> Instances: ...
    @property
    def n(self) -> int: ...
    @property
    def nbytes(self) -> int: ...
    @property
    def bounds(self) -> _Corners: ...
    def statistics(self) -> str: ...
    def closest_hits(self, rays: _Rays, mask: int, workers: int, progress: _Progress) -> _PlacedHits: ...
    def any_hits(self, rays: _Rays, mask: int, workers: int, progress: _Progress) -> NDArray[np.bool_]: ...
    def all_hits(self, rays: _Rays, mask: int, workers: int, progress: _Progress) -> tuple[_I64, _PlacedHits]: ...
    def closest_points(
        self, points: _Places, mask: int, workers: int, progress: _Progress
    ) -> tuple[_F64, _PlacedHits]: ...
    def surfaces(self, rays: _Rays, hits: tuple[_Hits, _I64], workers: int) -> tuple[_F64, _F32]: ...
    def points_at(self, rays: _Rays, hits: tuple[_Hits, _I64], times: _F32, workers: int) -> _F64: ...
    def secondary_origins(self, rays: _Rays, hits: tuple[_Hits, _I64], directions: _F32, workers: int) -> _F64: ...
    def matrices(self, paths: _I64, times: _F32) -> _F64: ...

class Photons:
    def __new__(
        cls,
        positions: _F32,
        normals: _F32,
        flux: _F32,
        times: _F32,
        window: float,
        neighbors: int,
        boxsize: Sequence[float],
        workers: int,
        progress: _Progress,
    ) -> Photons: ...
    @property
    def n(self) -> int: ...
    @property
    def nbytes(self) -> int: ...
    def gather(
        self,
        positions: _F32,
        normals: _F32,
        times: _F32,
        k: int | None,
        radius: float,
        window: float,
        cosine: float | None,
        thickness: float | None,
        volume: bool,
        kernels: Sequence[str],
        workers: int,
        progress: _Progress,
    ) -> tuple[_F32, _F32, _I64]: ...

def neighbor_lists(
    points: Points,
    time: float,
    radii: _F32,
    larger: bool,
    summed: bool,
    among: Points | None,
    radii_among: _F32 | None,
    pairs_once: bool,
    distances: bool,
    displacements: bool,
    sorted: bool,
    by_id: bool,
    max_neighbors: int | None,
    workers: int,
) -> _Columns: ...
def neighbor_lists_with_skin(
    points: Points,
    time: float,
    radii: _F32,
    larger: bool,
    summed: bool,
    skin: float,
    until: float,
    among: Points | None,
    radii_among: _F32 | None,
    pairs_once: bool,
    distances: bool,
    displacements: bool,
    sorted: bool,
    max_neighbors: int | None,
    workers: int,
) -> tuple[_Columns, float]: ...
def neighbor_lists_swept(
    points: Points,
    between: Sequence[float],
    radii: _F32,
    larger: bool,
    summed: bool,
    among: Points | None,
    radii_among: _F32 | None,
    pairs_once: bool,
    max_neighbors: int | None,
    workers: int,
) -> tuple[_I64, _I32, Sequence[_F32]]: ...
def certified_duration(radius: float, skin: float, speed: float) -> float:
    """How long lists with a skin hold every pair within `radius`, if no point is ever faster than `speed`.

    Infinite if nothing moves; 0 for arguments that are negative or NaN.
    """
