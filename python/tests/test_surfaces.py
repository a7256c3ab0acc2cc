"""Surfaces that rays hit: points, normals, motion vectors and rays that leave, against numpy."""

import numpy as np
import pytest
from mbkd import Hits, InstanceHits, InstanceTree, RayTree

RNG = np.random.default_rng(13)
FACES = np.arange(300).reshape(100, 3)
OPEN = (RNG.random((100, 1, 3)) + RNG.normal(0, 0.15, (100, 3, 3))).reshape(300, 3).astype(np.float32)
CLOSE = OPEN + np.repeat(RNG.normal(0, 0.3, (100, 3)), 3, axis=0).astype(np.float32)
CENTERS = np.stack([RNG.random((30, 3)), RNG.random((30, 3))])
RADII = np.stack([RNG.uniform(0.05, 0.1, 30), RNG.uniform(0.05, 0.1, 30)])
RAYS = 2000
ORIGINS = np.column_stack([RNG.random((RAYS, 2)), np.full(RAYS, 3.0)])
DIRECTIONS = RNG.normal([0, 0, -1], 0.1, (RAYS, 3)).astype(np.float32)
TIMES = RNG.random(RAYS).astype(np.float32)
OTHER = RNG.random(RAYS).astype(np.float32)


@pytest.fixture(scope="module")
def tree():
    return RayTree.from_meshes([(np.stack([OPEN, CLOSE]), FACES)], spheres=(CENTERS, RADII))


def corners(triangles, times):
    """The corners of triangles at times, (n, 3, 3)."""
    open, close = (key.astype(np.float64).reshape(-1, 3, 3)[triangles] for key in (OPEN, CLOSE))
    return open + (close - open) * times[:, None, None].astype(np.float64)


def points(hits, times):
    """The points of triangles with the weights of hits."""
    a, b, c = np.moveaxis(corners(hits.triangle, times), 1, 0)
    return a + (b - a) * hits.u[:, None] + (c - a) * hits.v[:, None]


@pytest.mark.parametrize("workers", [1, 2])
def test_points_and_normals_are_those_of_what_was_hit(tree, workers):
    hits = tree.closest_hits(ORIGINS, DIRECTIONS, time=TIMES)
    places, normals = tree.surface(ORIGINS, DIRECTIONS, hits, time=TIMES, workers=workers)
    later = tree.points_at(ORIGINS, DIRECTIONS, hits, OTHER, time=TIMES, workers=workers)
    assert places.dtype == later.dtype == np.float64 and normals.dtype == np.float32
    nothing, on_mesh, on_ball = hits.mesh < 0, hits.mesh == 0, hits.mesh == 1
    assert nothing.sum() > 100 and on_mesh.sum() > 100 and on_ball.sum() > 100
    for rows in (places, normals, later):
        assert np.isnan(rows[nothing]).all() and np.isfinite(rows[~nothing]).all()
    along = ORIGINS + DIRECTIONS.astype(np.float64) * np.where(nothing, 0, hits.t)[:, None]
    np.testing.assert_allclose(places[~nothing], along[~nothing], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(normals[~nothing], axis=1), 1, rtol=1e-6)

    some, times = hits[on_mesh], TIMES[on_mesh]
    np.testing.assert_allclose(places[on_mesh], points(some, times), atol=1e-6)
    np.testing.assert_allclose(later[on_mesh], points(some, OTHER[on_mesh]), atol=1e-6)
    np.testing.assert_allclose(normals[on_mesh], tree.normals(some.mesh, some.triangle, time=times), atol=1e-6)

    ball = hits.triangle[on_ball]
    at = lambda keys, times: keys[0, ball] + (keys[1, ball] - keys[0, ball]) * times[on_ball].reshape(-1, *[1] * (keys.ndim - 2))
    outward = (places[on_ball] - at(CENTERS, TIMES)) / at(RADII, TIMES)[:, None]
    np.testing.assert_allclose(normals[on_ball], outward, atol=1e-5)
    np.testing.assert_allclose(later[on_ball], at(CENTERS, OTHER) + outward * at(RADII, OTHER)[:, None], atol=1e-5)


def test_rays_leave_what_they_hit(tree):
    hits = tree.closest_hits(ORIGINS, DIRECTIONS, time=TIMES)
    some = hits.triangle >= 0
    rays = ORIGINS[some], DIRECTIONS[some], hits[some]
    times, (_, normals) = TIMES[some], tree.surface(*rays, time=TIMES[some])
    for side in (1, -1):
        outgoing = side * normals + RNG.normal(0, 0.3, normals.shape).astype(np.float32)
        outgoing[(outgoing * side * normals).sum(1) < 0.1] *= 0
        outgoing[(outgoing == 0).all(1)] = (side * normals)[(outgoing == 0).all(1)]
        origins = tree.secondary_origins(*rays, outgoing, time=times)
        index, every = tree.all_hits(origins, outgoing, time=times)
        # A ball is left on its other side when a ray goes inwards; that is far away.
        again = (every.mesh == rays[2].mesh[index]) & (every.triangle == rays[2].triangle[index]) & (every.t < 1e-4)
        assert not again.any() and len(index) > 100
    # Those that begin at rounded points would.
    rounded = ORIGINS[some] + DIRECTIONS[some].astype(np.float64) * hits[some].t[:, None]
    index, every = tree.all_hits(rounded, normals, time=times)
    assert ((every.triangle == rays[2].triangle[index]) & (every.t < 1e-4)).any()
    one = tree.secondary_origins(*rays, [0, 0, 1], time=times)
    np.testing.assert_array_equal(one, tree.secondary_origins(*rays, np.tile([0, 0, 1], (some.sum(), 1)), time=times))


def test_instances_place_surfaces(tree):
    turn = np.float64([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    begin, end = np.eye(4), np.eye(4)
    begin[:3, :3], end[:3, :3], end[:3, 3] = turn, turn, [0.5, 0, 0]
    inner = InstanceTree([tree], [0, 0], np.stack([np.stack([np.eye(4), begin]), np.stack([np.eye(4), end])]))
    placed = InstanceTree([inner, tree], [1, 0, 0], translations=[[9, 9, 9], [0, 0, 0], [0, 0, -2]])
    for of in (inner, placed):
        hits = of.closest_hits(ORIGINS, DIRECTIONS, time=TIMES)
        some = hits.instance >= 0
        assert len(set(map(tuple, hits.path.tolist()))) >= 3
        rays, times = (ORIGINS[some], DIRECTIONS[some], hits[some]), TIMES[some]
        assert isinstance(rays[2], InstanceHits)
        places, normals = of.surface(*rays, time=times)
        later = of.points_at(*rays, OTHER[some], time=times)
        on_mesh = rays[2].mesh == 0
        of_mesh, path = rays[2][on_mesh], rays[2].path[on_mesh]
        for found, at in ((places, times), (later, OTHER[some])):
            whole, own = of.matrices(path, time=at[on_mesh]), points(of_mesh, at[on_mesh])
            expected = np.einsum("nij,nj->ni", whole[:, :3, :3], own) + whole[:, :3, 3]
            np.testing.assert_allclose(found[on_mesh], expected, atol=1e-5)
        own = tree.normals(of_mesh.mesh, of_mesh.triangle, time=times[on_mesh])
        whole = of.matrices(path, time=times[on_mesh])[:, :3, :3]
        np.testing.assert_allclose(normals[on_mesh], np.einsum("nij,nj->ni", whole, own), atol=1e-5)
        origins = of.secondary_origins(*rays, normals, time=times)
        index, every = of.all_hits(origins, normals, time=times)
        again = (every.path == rays[2].path[index]).all(1) & (every.mesh == rays[2].mesh[index]) & (every.triangle == rays[2].triangle[index])
        assert not (again & (every.t < 1e-4)).any()
    wrong = InstanceHits(hits.t, hits.mesh, hits.triangle, hits.u, hits.v, np.where(hits.path >= 0, 77, hits.path))
    assert np.isnan(placed.points_at(ORIGINS, DIRECTIONS, wrong, 0.5, time=TIMES)).all()
    assert np.isnan(placed.surface(ORIGINS, DIRECTIONS, wrong, time=TIMES)[1]).all()


def test_rows_of_hits(tree):
    hits = tree.closest_hits(ORIGINS, DIRECTIONS, time=TIMES)
    for rows in (hits.mesh == 1, np.flatnonzero(hits.mesh == 1), slice(3, 90, 2), [5, 4], -1, np.int64(7)):
        some, at = hits[rows], np.atleast_1d(rows) if not isinstance(rows, slice) else rows
        assert isinstance(some, Hits) and len(some) == len(hits.t[at])
        for name in ("t", "mesh", "triangle", "u", "v"):
            np.testing.assert_array_equal(getattr(some, name), getattr(hits, name)[at])
    with pytest.raises(IndexError):
        hits[RAYS]
    assert len(hits[[False] * RAYS]) == len(hits[np.empty(0, int)]) == 0


@pytest.mark.parametrize("placed", [False, True])
def test_hits_know_the_times_of_their_rays(tree, placed):
    moving = [[[0, 0, 0], [0.5, 0, 0]], [[0, 1, 0], [0.5, 0, 1]]]
    of = InstanceTree([tree, tree], [0, 1], translations=moving) if placed else tree
    index, every = of.all_hits(ORIGINS, DIRECTIONS, time=TIMES)
    closest = of.closest_hits(ORIGINS, DIRECTIONS, time=TIMES)
    some = np.flatnonzero(closest.mesh == 0)[::-1]
    one_time = of.closest_hits(ORIGINS, DIRECTIONS, time=0.75)
    at_one = (slice(None), one_time, 0.75), (some, one_time[some], 0.75)
    for rays, hits, times in (
        (slice(None), closest, TIMES),
        (index, every, TIMES[index]),
        (some, closest[some], TIMES[some]),
        *at_one,
    ):
        rays = ORIGINS[rays], DIRECTIONS[rays], hits
        for query, more in ((of.surface, ()), (of.points_at, (1.0,)), (of.secondary_origins, ([0, 0, 1],))):
            np.testing.assert_array_equal(query(*rays, *more), query(*rays, *more, time=times))
        assert not np.array_equal(of.surface(*rays)[0], of.surface(*rays, time=0)[0], equal_nan=True)


def test_points_inside():
    # A cube that grows, and a ball beside it.
    corner = np.float32([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)]) * 2 - 1
    sides = [0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]
    faces = [corners for a, b, c, d in sides for corners in ([a, b, c], [a, c, d])]
    growing = np.stack([corner, 2 * corner]), faces
    tree = RayTree.from_meshes([growing], masks=[1], spheres=([[3.2, 0, 0]], 1.0), spheres_masks=[2])
    points, times = RNG.uniform(-3, 3, (9000, 3)), RNG.random(9000).astype(np.float32)
    cube = (np.abs(points) < 1 + times[:, None]).all(1)
    ball = np.linalg.norm(points - [3.2, 0, 0], axis=1) < 1
    assert cube.sum() > 500 and ball.sum() > 50
    for mask, expected in ((1, cube), (2, ball), (3, cube | ball)):
        np.testing.assert_array_equal(tree.contains_points(points, time=times, mask=mask), expected)
    placed = InstanceTree([tree], [0], translations=[[5, 0, 0]])
    np.testing.assert_array_equal(placed.contains_points(points + [5, 0, 0], time=times, workers=2), cube | ball)
    assert tree.contains_points(np.empty((0, 3))).shape == (0,)
    with pytest.raises(ValueError, match="points must have the shape"):
        tree.contains_points([1, 2])


DOWN = np.tile(np.float32([0, 0, -1]), (4, 1))
FEW = np.float64([[0.5, 0.5, 3]] * 4)
NONE = Hits(np.full(4, np.inf), np.full(4, -1), np.full(4, -1), np.full(4, np.nan), np.full(4, np.nan))
WRONG = [
    (lambda tree: tree.surface(FEW[:3], DOWN[:3], NONE), ValueError, "4 hits of 3 rays"),
    (lambda tree: tree.surface(FEW, DOWN, NONE, time=2), ValueError, "time 2"),
    (lambda tree: tree.surface(FEW, DOWN, NONE, workers=0), ValueError, "workers"),
    (lambda tree: tree.surface(FEW, DOWN, (1, 2, 3, 4, 5)), TypeError, "hits must be Hits, not tuple"),
    (lambda tree: tree.points_at(FEW, DOWN, NONE, 1.5), ValueError, "time 1.5"),
    (lambda tree: tree.points_at(FEW, DOWN, NONE, [0, 1]), ValueError, "at has the shape"),
    (lambda tree: tree.points_at(FEW, DOWN, NONE, np.nan), ValueError, "time NaN"),
    (lambda tree: tree.secondary_origins(FEW, DOWN, NONE, DOWN[:3]), ValueError, "outgoing has the shape"),
    (lambda tree: tree.secondary_origins(FEW, DOWN, NONE, "up"), TypeError, "outgoing must be numbers"),
    (lambda tree: InstanceTree([tree], [0]).surface(FEW, DOWN, NONE), TypeError, "hits must be InstanceHits, not Hits"),
]


@pytest.mark.parametrize("wrong, error, message", WRONG)
def test_what_is_wrong_is_said(tree, wrong, error, message):
    with pytest.raises(error, match=message):
        wrong(tree)


def test_what_is_not_there_has_no_surface(tree):
    assert all(np.isnan(rows).all() for rows in tree.surface(FEW, DOWN, NONE))
    assert np.isnan(tree.secondary_origins(FEW, DOWN, NONE, [0, 0, 1])).all()
    unknown = Hits(np.ones(4), np.int64([0, 1, 2, 0]), np.int64([100, 30, 0, 2**31]), np.zeros(4), np.zeros(4))
    assert np.isnan(tree.points_at(FEW, DOWN, unknown, 0.5)).all()
    assert np.isnan(tree.surface(FEW, DOWN, unknown)[1]).all()
    empty = tree.closest_hits(FEW[:0], DOWN[:0])
    assert [rows.shape for rows in tree.surface(FEW[:0], DOWN[:0], empty)] == [(0, 3)] * 2
    flat = RayTree(np.float32([[0, 0, 0], [1, 1, 0], [2, 2, 0]]), [[0, 1, 2]])
    on_line = Hits(np.float32([3]), np.int32([0]), np.int64([0]), np.float32([0.5]), np.float32([0]))
    assert np.isnan(flat.surface(FEW[:1], DOWN[:1], on_line)[1]).all()
