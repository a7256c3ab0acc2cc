"""Neighbour queries and ray tracing over geometry that moves while a shutter is open.

The shutter is the time range [0, 1]. Positions are given at one or more *keys*, spaced evenly over it, and are linear in
between. Every query carries its own time.

- `PointTree`: k nearest, radius, pairs, counts, closest approach and neighbour lists among points, with the names, shapes
  and conventions of ``scipy.spatial.cKDTree``.
- `RayTree`: rays and closest points on triangle meshes, with names as in trimesh.
- `InstanceTree`: trees of meshes with many moving instances.
- `PhotonMap`: density estimates over photons with time stamps.

Answers equal those of brute force, bit for bit, for any number of threads.
"""

from ._mbkd import RefitError, certified_duration
from .instances import InstanceHits, InstanceTree
from .lists import Encounters, NeighborLists
from .photons import Gathered, PhotonMap
from .points import PointTree
from .rays import Hits, RayTree, Refit

__all__ = [
    "Encounters",
    "Gathered",
    "Hits",
    "InstanceHits",
    "InstanceTree",
    "NeighborLists",
    "PhotonMap",
    "PointTree",
    "RayTree",
    "Refit",
    "RefitError",
    "certified_duration",
]
__version__ = "0.1.0"
