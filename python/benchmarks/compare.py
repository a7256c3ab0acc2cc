"""Measures mbkd against other packages from Python, on one thread; those that are not installed are left out.

    python python/benchmarks/compare.py [points | periodic | lists | rays ...] [--n 1000000] [--repeat 5]

All contestants of a row run in turn in one process. The table has the medians in seconds of processor time, which leaves out what
other programs take on a busy machine, and how many times the time of mbkd they take. Trees are built before queries are timed, and
their builds are rows of their own; packages without trees are compared with build and query together.
"""

import argparse
import os
import time

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS"):
    os.environ[variable] = "1"

import numpy as np  # noqa: E402
from mbkd import PointTree, RayTree  # noqa: E402

NEIGHBORS = 40


def medians(contestants, repeat):
    """The median time of each, called in turn; slow ones less often."""
    times = {name: [] for name in contestants}
    results = {}
    for round_ in range(repeat):
        for name, call in contestants.items():
            if round_ and min(times[name]) > 15:
                continue
            begin = time.process_time()
            results[name] = call()
            times[name].append(time.process_time() - begin)
    return {name: float(np.median(t)) for name, t in times.items()}, results


def row(title, contestants, repeat):
    seconds, results = medians(contestants, repeat)
    ours = seconds["mbkd"]
    others = ", ".join(f"{name} {s:.3f} ({s / ours:.1f} x)" for name, s in seconds.items() if name != "mbkd")
    print(f"{title}: mbkd {ours:.3f}; {others}", flush=True)
    return results


def optional(name):
    try:
        return __import__(name, fromlist=["_"])
    except ImportError:
        print(f"({name} is not installed)")
        return None


def points(n, repeat):
    """Trees and k nearest."""
    spatial, pykdtree = optional("scipy.spatial"), optional("pykdtree.kdtree")
    rng = np.random.default_rng(1)
    for kind in (np.float32, np.float64):
        data, queries = rng.random((n, 3)).astype(kind), rng.random((n, 3)).astype(kind)
        builds = {"mbkd": lambda: PointTree(data)}
        if spatial:
            builds["scipy"] = lambda: spatial.cKDTree(data)
        if pykdtree:
            builds["pykdtree"] = lambda: pykdtree.KDTree(data)
        trees = row(f"{kind.__name__}, build", builds, repeat)
        for k in (1, 8):
            asks = {name: (lambda tree=tree: tree.query(queries, k=k)) for name, tree in trees.items()}
            found = row(f"{kind.__name__}, k = {k}", asks, repeat)
            for name, (d, _) in found.items():
                np.testing.assert_allclose(d, found["mbkd"][0], rtol=1e-5, atol=1e-7, err_msg=name)
        del trees, asks, found


def periodic(n, repeat):
    """Queries in a periodic box, against the same ones without."""
    spatial = optional("scipy.spatial")
    rng = np.random.default_rng(4)
    for count in (min(n, 3000), n):
        data, queries = rng.random((count, 3), dtype=np.float32), rng.random((min(n, 100_000), 3))
        trees = {"mbkd": PointTree(data, boxsize=1), "mbkd, open": PointTree(data)}
        if spatial:
            trees["scipy"] = spatial.cKDTree(data, boxsize=1)
        r = float((NEIGHBORS / count * 3 / (4 * np.pi)) ** (1 / 3))
        for name, ask in (
            ("k = 1", lambda tree: tree.query(queries)),
            ("k = 8", lambda tree: tree.query(queries, 8)),
            (f"{NEIGHBORS} neighbours counted", lambda tree: tree.query_ball_point(queries, r, return_length=True)),
            (f"lists of {NEIGHBORS} neighbours", lambda tree: tree.query_ball_point(queries, r, return_sorted=False)),
        ):
            asks = {who: (lambda tree=tree: ask(tree)) for who, tree in trees.items()}
            found = row(f"{count} points, {len(queries)} queries, {name}", asks, repeat)
            if spatial and name.startswith("k"):
                np.testing.assert_allclose(found["scipy"][0], found["mbkd"][0], rtol=1e-4, atol=1e-6)


def lists(n, repeat):
    """All neighbours of all points."""
    spatial, vesin, matscipy = optional("scipy.spatial"), optional("vesin"), optional("matscipy.neighbours")
    rs = optional("neighborlist_rs")
    rng = np.random.default_rng(2)
    data = rng.random((n, 3), dtype=np.float32)
    wide = data.astype(np.float64)
    r = float((NEIGHBORS / n * 3 / (4 * np.pi)) ** (1 / 3))
    asks = {"mbkd": lambda: PointTree(data).neighbor_lists(r), "mbkd, rows in the order of the tree": lambda: PointTree(data).neighbor_lists(r, rows="tree")}
    if spatial:
        asks["scipy query_pairs (each pair once)"] = lambda: spatial.cKDTree(data).query_pairs(r, output_type="ndarray")
        asks["scipy query_ball_point (lists)"] = lambda: spatial.cKDTree(data).query_ball_point(data, r, return_sorted=False)
    if vesin:
        asks["vesin"] = lambda: vesin.NeighborList(cutoff=r, full_list=True, n_threads=1).compute(wide, np.eye(3), False, "ij")
    if matscipy:
        asks["matscipy"] = lambda: matscipy.neighbour_list("ij", positions=wide, cutoff=r, cell=np.eye(3), pbc=[False] * 3)
    if rs:
        cell = rs.PyCell(np.eye(3), [False] * 3)
        asks["neighborlist-rs (each pair once)"] = lambda: rs.build_neighborlists(cell, wide, r, parallel=False)
    found = row(f"{n} points with about {NEIGHBORS} neighbours, trees or cells included", asks, repeat)
    count = len(found["mbkd"].ids)
    for name, lists_ in found.items():
        if isinstance(lists_, np.ndarray):
            other = 2 * len(lists_) if lists_.ndim == 2 else sum(map(len, lists_)) - n
        elif isinstance(lists_, (tuple, list)):
            other = len(lists_[0])
        elif isinstance(lists_, dict):
            other = 2 * len(lists_["local"]["edge_i"]) if "local" in lists_ else count
        else:
            other = len(lists_.ids)
        assert abs(other - count) <= 1e-6 * count, f"{name}: {other} neighbours instead of {count}"
    for name, ask in (("points that move by a spacing, at a time", 0.5), ("swept over the shutter", None)):
        moving = PointTree(data, keys=data + rng.normal(0, r / 3.4 / 1.7, data.shape).astype(np.float32))
        begin = time.process_time()
        found = moving.neighbor_lists(r, time=ask) if ask else moving.neighbor_lists_swept(r)
        print(f"{name}: mbkd {time.process_time() - begin:.3f}, {len(found.ids) / n:.1f} neighbours each")


def sphere(levels):
    """A unit sphere of 20 * 4 ** levels triangles."""
    g = (1 + 5**0.5) / 2
    v = np.array([(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g), (0, -1, -g), (0, 1, -g), (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)])
    f = np.array([(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)])
    for _ in range(levels):
        edges = np.sort(np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]]), axis=1)
        unique, inverse = np.unique(edges, axis=0, return_inverse=True)
        middle = len(v) + inverse.reshape(3, -1)
        v = np.concatenate([v, v[unique].mean(axis=1)])
        a, b, c = f.T
        ab, bc, ca = middle
        f = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    return v * (1 + 0.1 * np.sin(9 * v[:, :1]) * np.sin(8 * v[:, 1:2])), f


def rays(n, repeat):
    """Rays into a bumpy sphere from all around, through trimesh."""
    trimesh, embree = optional("trimesh"), optional("embreex")
    v, f = sphere(7)
    rng = np.random.default_rng(3)
    origins = rng.normal(size=(n, 3))
    origins *= 3 / np.linalg.norm(origins, axis=1, keepdims=True)
    directions = rng.normal(size=(n, 3)) * 0.35 - origins / 3
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    builds = {"mbkd": lambda: RayTree(v.astype(np.float32), f)}
    if trimesh and embree:
        from trimesh.ray.ray_pyembree import RayMeshIntersector

        def build():
            other = RayMeshIntersector(trimesh.Trimesh(v, f, process=False))
            other.intersects_any(origins[:1], directions[:1])
            return other

        builds["trimesh with embree"] = build
    trees = row(f"{len(f)} triangles, build", builds, repeat)
    for name in ("intersects_any", "intersects_first"):
        asks = {who: (lambda tree=tree: getattr(tree, name)(origins, directions)) for who, tree in trees.items()}
        found = row(f"{n} rays, {name}", asks, repeat)
    asks = {
        who: (lambda tree=tree: tree.intersects_location(origins, directions, multiple_hits=False))
        for who, tree in trees.items()
    }
    row(f"{n} rays, intersects_location", asks, repeat)
    ours = found.pop("mbkd")
    for name, other in found.items():
        print(f"{name}: {np.sum((other < 0) & (ours >= 0))} rays hit for mbkd only, {np.sum((other >= 0) & (ours < 0))} for it only, {np.sum((other != ours) & (other >= 0) & (ours >= 0))} another triangle")
    # From the middle, every ray hits; edges and corners are aimed at.
    corners = v[rng.integers(len(v), size=n)]
    aimed = trees["mbkd"].intersects_any(np.zeros((n, 3)), corners)
    print(f"{n} rays from inside at corners of triangles: mbkd loses {np.sum(~aimed)}", end="")
    for who, tree in list(trees.items())[1:]:
        print(f", {who} {np.sum(~tree.intersects_any(np.zeros((n, 3)), corners))}", end="")
    print()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="*", default=["points", "periodic", "lists", "rays"], help="points, periodic, lists, rays")
    parser.add_argument("--n", type=int, default=1_000_000, help="points, queries and rays")
    parser.add_argument("--repeat", type=int, default=5)
    options = parser.parse_args()
    for what in options.what:
        {"points": points, "periodic": periodic, "lists": lists, "rays": rays}[what](options.n, options.repeat)


if __name__ == "__main__":
    main()
