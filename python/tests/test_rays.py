"""Rays and nearest points against brute force with numpy."""

import pickle

import numpy as np
import pytest
from mbkd import RayTree

RNG = np.random.default_rng(7)
FACES = np.arange(300).reshape(100, 3)
OPEN = (RNG.random((100, 1, 3)) + RNG.normal(0, 0.15, (100, 3, 3))).reshape(300, 3).astype(np.float32)
CLOSE = OPEN + np.repeat(RNG.normal(0, 0.3, (100, 3)), 3, axis=0).astype(np.float32)
ORIGINS = np.column_stack([RNG.random((200, 2)), np.full(200, 3.0)])
DIRECTIONS = RNG.normal([0, 0, -1], 0.1, (200, 3)).astype(np.float32)
TIMES = RNG.random(200).astype(np.float32)


def crossings(origin, direction, time):
    """t of each triangle at a time, nan where it is missed (Moeller and Trumbore)."""
    corners = (OPEN + (CLOSE - OPEN).astype(np.float64) * time).reshape(100, 3, 3)
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = np.cross(direction.astype(np.float64), e2)
    det = (e1 * p).sum(1)
    s = origin - corners[:, 0]
    u, q = (s * p).sum(1) / det, np.cross(s, e1)
    v, t = (q * direction).sum(1) / det, (e2 * q).sum(1) / det
    edge = np.minimum(np.minimum(u, v), 1 - u - v)
    return np.where((edge > 0) & (t > 0), t, np.nan), edge


@pytest.mark.parametrize("workers", [1, 2])
def test_rays_hit_what_brute_force_hits(workers):
    tree = RayTree(np.stack([OPEN, CLOSE]), FACES, workers=workers)
    hits = tree.closest_hits(ORIGINS, DIRECTIONS, time=TIMES, workers=workers)
    some = tree.intersects_any(ORIGINS, DIRECTIONS, time=TIMES, workers=workers)
    index, every = tree.all_hits(ORIGINS, DIRECTIONS, time=TIMES, workers=workers)
    locations, index_ray, index_tri = tree.intersects_location(ORIGINS, DIRECTIONS, time=TIMES)
    np.testing.assert_array_equal(index_ray, index)
    np.testing.assert_array_equal(index_tri, every.triangle)
    checked = 0
    for ray in range(200):
        t, edge = crossings(ORIGINS[ray], DIRECTIONS[ray], TIMES[ray])
        if np.abs(edge).min() < 1e-5:
            continue  # at an edge: float64 decides otherwise than float32
        checked += 1
        hit = np.flatnonzero(~np.isnan(t))
        assert some[ray] == (len(hit) > 0)
        assert set(every.triangle[index == ray]) == set(hit)
        if len(hit):
            first = np.nanargmin(t)
            assert hits.triangle[ray] == first and hits.mesh[ray] == 0
            np.testing.assert_allclose(hits.t[ray], t[first], rtol=1e-5)
        else:
            assert (hits.t[ray], hits.triangle[ray], hits.mesh[ray]) == (np.inf, -1, -1)
    assert checked > 150 and some.any() and not some.all()
    np.testing.assert_array_equal(tree.intersects_first(ORIGINS, DIRECTIONS, time=TIMES), hits.triangle)
    triangles, rays = tree.intersects_id(ORIGINS, DIRECTIONS, False, time=TIMES)
    np.testing.assert_array_equal(rays, np.flatnonzero(some))
    corners = tree.triangles(0, index_tri, time=TIMES[index_ray])
    flat = ((locations - corners[:, 0]) * tree.normals(0, index_tri, time=TIMES[index_ray])).sum(1)
    assert np.abs(flat).max() < 1e-5


def test_many_rays_are_as_few():
    tree = RayTree(np.stack([OPEN, CLOSE]), FACES)
    reps = 700
    many = [np.tile(a, (reps, 1)) for a in (ORIGINS, DIRECTIONS)]
    told = []
    hits = tree.closest_hits(*many, time=np.tile(TIMES, reps), workers=2, progress=told.append)
    few = tree.closest_hits(ORIGINS, DIRECTIONS, time=TIMES)
    np.testing.assert_array_equal(hits.t.reshape(reps, -1), np.tile(few.t, (reps, 1)))
    np.testing.assert_array_equal(hits.triangle.reshape(reps, -1), np.tile(few.triangle, (reps, 1)))
    some = tree.intersects_any(*many, time=np.tile(TIMES, reps))
    np.testing.assert_array_equal(some, hits.triangle >= 0)
    assert told[-1] == 1


def test_meshes_masks_active_intervals_and_ranges():
    square = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    meshes = [(square, [[0, 1, 2]]), (square + np.float32([0, 0, 1]), [[0, 1, 2]])]
    tree = RayTree.from_meshes(meshes, masks=[1, 2], active=[(0, 1), (0, 0.5)])
    down = ([[0.2, 0.2, 3]], [0, 0, -1])
    assert tree.closest_hits(*down).mesh == 1
    assert tree.closest_hits(*down, time=0.5).mesh == 0
    assert tree.closest_hits(*down, mask=1).mesh == 0
    assert tree.closest_hits(*down, mask=4).mesh == -1
    assert tree.closest_hits(*down, t_min=2.5).t == 3 and tree.closest_hits(*down, t_max=1.5).mesh == -1
    assert tree.intersects_any(*down, mask=2).tolist() == [True]
    assert tree.all_hits(*down)[1].t.tolist() == [2, 3]
    assert tree.closest_hits(down[0], [0, 0, 0]).mesh == -1
    assert np.isnan(tree.triangles([-1, 0], [0, 9])).all()
    assert [tree.closest_point([[0.2, 0.2, 3]], mask=mask)[1].item() for mask in (1, 2, 3, 4)] == [3, 2, 2, np.inf]


def test_no_query_sees_a_mask_of_zero():
    square = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    tree = RayTree.from_meshes([(square, [[0, 1, 2]])], masks=[0], spheres=([[0.2, 0.2, 1]], [0.5]), spheres_masks=[0])
    for rays in (1, 1000):
        down = (np.tile([0.2, 0.2, 3], (rays, 1)), [0, 0, -1])
        assert (tree.closest_hits(*down).mesh == -1).all() and (tree.intersects_first(*down) == -1).all()
        assert not tree.intersects_any(*down).any()
        assert len(tree.all_hits(*down)[0]) == 0 and len(tree.intersects_location(*down)[0]) == 0
        assert np.isinf(tree.closest_point(down[0])[1]).all()


def test_closest_points():
    tree = RayTree(np.stack([OPEN, CLOSE]), FACES)
    points = RNG.random((50, 3)) * 2 - 0.5
    closest, distance, triangle = tree.closest_point(points, time=TIMES[:50], workers=2)
    np.testing.assert_allclose(np.linalg.norm(closest - points, axis=1), distance, rtol=1e-5)
    # Points of a fine grid on all triangles are never nearer, and some is nearly as near.
    u, v = (grid.ravel() for grid in np.meshgrid(np.linspace(0, 1, 60), np.linspace(0, 1, 60)))
    inside = u + v <= 1
    weights = np.column_stack([1 - u - v, u, v])[inside]
    for point, time, far, index in zip(points, TIMES, distance, triangle):
        corners = (OPEN + (CLOSE - OPEN).astype(np.float64) * time).reshape(100, 3, 3)
        grid = np.einsum("gc,tcx->tgx", weights, corners)
        least = np.linalg.norm(grid - point, axis=2).min(axis=1)
        assert far <= least.min() + 1e-6 and least[index] <= far + 0.02
    near = tree.closest_point(points, time=TIMES[:50], max_distance=0.01)[2]
    np.testing.assert_array_equal(near >= 0, distance <= np.float32(0.01))
    place, hits = tree.closest_points(points, time=TIMES[:50])
    for ours, theirs in ((place, closest), (hits.t, distance), (hits.triangle, triangle)):
        np.testing.assert_array_equal(ours, theirs)
    # The weights are those of the point.
    weights = np.column_stack([1 - hits.u.astype(np.float64) - hits.v, hits.u, hits.v])
    corners = tree.triangles(hits.mesh, hits.triangle, time=TIMES[:50])
    np.testing.assert_allclose(np.einsum("nc,ncx->nx", weights, corners), place, atol=1e-6)


def test_closest_points_tell_the_mesh():
    corners = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    meshes = [(corners + np.float32([0, 0, z]), [[0, 1, 2]]) for z in (0, 4)]
    tree = RayTree.from_meshes(meshes, spheres=([[0, 0, 20]], 1))
    points = [[0.2, 0.2, 1], [0.2, 0.2, 3.5], [0, 0, 30], [0, 0, -50]]
    closest, near = tree.closest_points(points, max_distance=20)
    assert near.mesh.tolist() == [0, 1, 2, -1] and near.triangle.tolist() == [0, 0, 0, -1]
    assert near.t.tolist() == [1, 0.5, 9, np.inf] and closest[2].tolist() == [0, 0, 21] and np.isnan(closest[3]).all()
    closest, near = tree.closest_points(points[:2], mask=0)
    assert np.isnan(closest).all() and (near.mesh == -1).all()


def test_one_origin_has_many_directions_and_one_direction_many_origins():
    tree = RayTree(np.stack([OPEN, CLOSE]), FACES)
    eye, down = np.float64([0.5, 0.5, 3]), np.float32([0, 0, -1])
    for some, all_of_them in (
        ((eye, DIRECTIONS), (np.tile(eye, (200, 1)), DIRECTIONS)),
        ((eye[None], DIRECTIONS), (np.tile(eye, (200, 1)), DIRECTIONS)),
        ((ORIGINS, down), (ORIGINS, np.tile(down, (200, 1)))),
        ((ORIGINS, down[None]), (ORIGINS, np.tile(down, (200, 1)))),
    ):
        hits, expected = (tree.closest_hits(*rays, time=TIMES) for rays in (some, all_of_them))
        np.testing.assert_array_equal(hits.t, expected.t)
        assert len(hits) == 200 and np.isfinite(hits.t).sum() > 5
        np.testing.assert_array_equal(tree.intersects_any(*some, time=TIMES), hits.triangle >= 0)
        for ours, theirs in zip(*(tree.intersects_location(*rays, time=TIMES) for rays in (some, all_of_them))):
            np.testing.assert_array_equal(ours, theirs)
        surface, expected = (tree.surface(*rays, hits, time=TIMES)[0] for rays in (some, all_of_them))
        np.testing.assert_array_equal(surface, expected)
    assert len(tree.closest_hits(eye, down).t) == 1
    assert len(tree.closest_hits(np.empty((0, 3)), down).t) == 0
    with pytest.raises(ValueError, match="200 origins and 3 directions"):
        tree.closest_hits(ORIGINS, DIRECTIONS[:3])


@pytest.mark.parametrize("multiple", [False, True])
def test_locations_lie_on_the_surface_also_far_from_the_origin(multiple):
    plane = np.float32([[-50, -50, 0], [50, -50, 0], [0, 50, 0]])
    tree = RayTree(np.stack([plane, plane + np.float32([0, 0, 1])]), [[0, 1, 2]])
    origins = np.column_stack([RNG.random((50, 2)), np.full(50, 1e5 + 1 / 3)])
    directions = -(origins - np.column_stack([RNG.random((50, 2)), np.zeros(50)]))
    times = RNG.integers(0, 5, 50) / 4
    locations, index, triangle = tree.intersects_location(origins, directions, multiple, time=times)
    assert index.tolist() == list(range(50)) and (triangle == 0).all()
    # origin + t * direction is off by some thousandths.
    np.testing.assert_allclose(locations[:, 2], times, atol=1e-6)
    assert np.abs(locations[:, 2] - times).max() < 1e-6
    same = tree.intersects_id(origins, directions, multiple, return_locations=True, time=times)[2]
    np.testing.assert_array_equal(same, locations)
    assert len(tree.intersects_location(origins, -directions, multiple)[0]) == 0


def test_few_rays_that_cost_much_are_told_in_parts():
    layers = np.repeat(np.float32([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]]), 200, axis=0)
    tree = RayTree(layers.reshape(-1, 3), np.arange(600).reshape(200, 3))
    origins = np.tile([0.2, 0.2, 3], (2000, 1))
    for ask in (tree.closest_hits, tree.all_hits, tree.intersects_any):
        told = []
        ask(origins, [0, 0, -1], progress=told.append)
        assert len(told) >= 2 and told == sorted(told) and told[-1] == 1
    told = []
    tree.closest_points(origins, progress=told.append, workers=2)
    assert len(told) >= 3 and told == sorted(told) and told[-1] == 1


def test_spheres_are_hit_where_brute_force_hits_them():
    n, keys = 200, 3
    centers, radii = RNG.random((keys, n, 3)), RNG.uniform(0.01, 0.1, (keys, n))
    active = np.sort(RNG.random((n, 2)), axis=1)
    tree = RayTree.from_meshes([(OPEN, FACES)], masks=[1], spheres=(centers, radii), spheres_active=active)
    hits = tree.closest_hits(ORIGINS, DIRECTIONS, time=TIMES, mask=2)  # the mesh is hidden
    found = 0
    for ray, time in enumerate(TIMES.astype(np.float64)):
        segment = min(int(time * (keys - 1)), keys - 2)
        w = time * (keys - 1) - segment
        center = centers[segment] * (1 - w) + centers[segment + 1] * w
        radius = radii[segment] * (1 - w) + radii[segment + 1] * w
        d = DIRECTIONS[ray].astype(np.float64)
        middle = (center - ORIGINS[ray]) @ d / (d @ d)
        inside = radius**2 - ((ORIGINS[ray] + middle[:, None] * d - center) ** 2).sum(1)
        if np.abs(inside).min() < 1e-9 or np.abs(active - time).min() < 1e-6:
            continue  # a grazing ray
        exists = (active[:, 0] <= time) & (time <= active[:, 1])
        t = np.where((inside > 0) & exists, middle - np.sqrt(np.maximum(inside, 0) / (d @ d)), np.inf)
        if np.isfinite(t).any():
            ball = np.argmin(t)
            found += 1
            assert (hits.mesh[ray], hits.triangle[ray]) == (1, ball)
            np.testing.assert_allclose(hits.t[ray], t[ball], rtol=1e-5)
            normal = (ORIGINS[ray] + t[ball] * d - center[ball]) / radius[ball]
            np.testing.assert_allclose([hits.u[ray], hits.v[ray]], normal[:2], atol=1e-3)
        else:
            assert hits.triangle[ray] == -1
    assert 20 < found < 180
    both = tree.closest_hits(ORIGINS, DIRECTIONS, time=TIMES)
    assert {0, 1} <= set(both.mesh)
    again = pickle.loads(pickle.dumps(tree)).closest_hits(ORIGINS, DIRECTIONS, time=TIMES)
    np.testing.assert_array_equal(again.triangle, both.triangle)


def test_float64_positions_are_kept_on_request():
    # Small parts far from each other, so that no place is near all of them.
    far = np.stack([OPEN, CLOSE]).astype(np.float64) * 1e-3 + [4e3, -3e3, 5e3]
    meshes = [(far, FACES), (-far, FACES)]
    tree, rounded = RayTree.from_meshes(meshes, precision="float64"), RayTree.from_meshes(meshes)
    corners = far[0].reshape(100, 3, 3)
    np.testing.assert_array_equal(tree.triangles(0, np.arange(100)), corners)
    assert np.abs(rounded.triangles(0, np.arange(100)) - corners).max() > 1e-5
    # As near zero, where everything is a thousand times as large, but for what float64 rounds.
    near, origins = RayTree(np.stack([OPEN, CLOSE]), FACES), ORIGINS * 1e-3 + [4e3, -3e3, 5e3]
    hits, expected = (of.closest_hits(at, DIRECTIONS, time=TIMES) for of, at in ((tree, origins), (near, ORIGINS)))
    same = hits.triangle == expected.triangle
    assert same.mean() > 0.99 and (hits.triangle >= 0).any()
    np.testing.assert_allclose(hits.t[same] * 1000, expected.t[same], rtol=1e-5)
    one = RayTree(np.concatenate([far, -far], axis=1), np.concatenate([FACES, FACES + 300]), precision="float64")
    np.testing.assert_array_equal(one.triangles(0, np.arange(100)), corners)
    mixed = RayTree.from_meshes([(OPEN, FACES), (far, FACES), (-far, FACES)], precision="float64")
    np.testing.assert_array_equal(mixed.triangles(0, np.arange(100)), OPEN.reshape(100, 3, 3))
    np.testing.assert_array_equal(mixed.triangles(1, np.arange(100)), corners)


def test_numbers_of_keys_of_spheres_may_differ_from_those_of_their_radii():
    for centers, radii in (
        ([[0, 0, 0]], [[1], [2]]),
        ([[[0, 0, 0]], [[0, 0, 0]]], [[1], [2]]),
        ([[[0, 0, -0.5]], [[0, 0, 0.5]]], 1.5),
        ([[[0, 0, -0.5]], [[0, 0, 0.5]]], [1.5]),
    ):
        tree = RayTree.from_meshes([], spheres=(centers, radii))
        np.testing.assert_allclose(tree.closest_hits([0, 0, 9], [0, 0, -1], time=0.5).t, 7.5)
    none = RayTree.from_meshes([], spheres=(np.empty((0, 3)), 1))
    assert not none.intersects_any(ORIGINS, DIRECTIONS).any()


WRONG = [
    (lambda: RayTree.from_meshes([], spheres=OPEN), TypeError, "pair"),
    (lambda: RayTree.from_meshes([], spheres=(OPEN, [1, 2])), ValueError, "radii"),
    (lambda: RayTree.from_meshes([], spheres=(OPEN, np.ones((2, 3, 4)))), ValueError, "radii"),
    (lambda: RayTree.from_meshes([], spheres=(OPEN[:, :2], 1)), ValueError, "centers"),
    (lambda: RayTree.from_meshes([], spheres=([["a"] * 3], 1)), TypeError, "numbers"),
    (lambda: RayTree.from_meshes([], spheres=([[0, np.nan, 0]], 1)), ValueError, "^sphere 0 is not finite"),
    (lambda: RayTree.from_meshes([], spheres=([[0, 0, 0], [1, 0, 0]], [1, np.inf])), ValueError, "sphere 1"),
    (lambda: RayTree.from_meshes([], spheres=([[0, 0, 0]], 1), spheres_active=[0, 1]), ValueError, "spheres_active"),
    (lambda: RayTree.from_meshes([], spheres=([[0, 0, 0]], 1), spheres_active=[[1, 0]]), ValueError, "sphere 0.*interval"),
    (lambda: RayTree.from_meshes([], spheres_active=[[0, 1]]), ValueError, "spheres"),
    (lambda: RayTree(OPEN[:2], [[0, 1, 2]]), ValueError, "vertex 2"),
    (lambda: RayTree(OPEN, [[0, 1, -2]]), ValueError, "indices"),
    (lambda: RayTree(OPEN, [[0, 1]]), ValueError, "shape"),
    (lambda: RayTree(OPEN, [[0.5, 1, 2]]), TypeError, "whole"),
    (lambda: RayTree(OPEN, np.ma.array([[0, 1, 2]], mask=[[0, 0, 1]])), ValueError, "faces has masked elements"),
    (lambda: RayTree(OPEN, FACES).triangles([0], [0.5]), TypeError, "triangle must be whole numbers"),
    (lambda: RayTree(OPEN, FACES).normals(0.5, [0]), TypeError, "mesh must be whole numbers"),
    (lambda: RayTree([[0, 0, np.nan]] * 3, [[0, 1, 2]]), ValueError, "NaN"),
    (lambda: RayTree(OPEN[:, :2], FACES), ValueError, "coordinates"),
    (lambda: RayTree(OPEN, FACES, active=(1, 0)), ValueError, "interval"),
    (lambda: RayTree.from_meshes([(OPEN, FACES)] * 2, active=[(0, 1), (1, 0)]), ValueError, "mesh 1.*interval"),
    (lambda: RayTree.from_meshes([(OPEN, FACES)], masks=[]), ValueError, "masks"),
    (lambda: RayTree.from_meshes([(OPEN, FACES)], masks=[2**32]), ValueError, "mask"),
    (lambda: RayTree.from_meshes([OPEN]), TypeError, "pair"),
    (lambda: RayTree(OPEN, [[0, 1, 2**40]]), ValueError, "indices"),
    (lambda: RayTree(np.empty((0, 4, 3)), [[0, 1, 2]]), ValueError, "at least one key"),
    (lambda: RayTree(OPEN * np.float32(1e35), FACES), ValueError, "1e30"),
    (lambda: RayTree(OPEN, FACES).closest_hits([[0, 0, 0]], [0, 0, 1], mask=-1), ValueError, "mask"),
    (lambda: RayTree(OPEN, FACES).closest_hits([[0, 0, 0]], [0, 0, 1], mask=1.5), TypeError, "mask"),
    (lambda: RayTree(OPEN, FACES).intersects_any([[0, 0, 0]], [0, 0, 1], far=1), TypeError, "far"),
    (lambda: RayTree(OPEN, FACES).closest_point([[0, 0, np.nan]]), ValueError, "finite"),
    (lambda: RayTree(OPEN, FACES).intersects_any([[0, 0]], [0, 0, 1]), ValueError, "shape"),
    (lambda: RayTree(OPEN, FACES).intersects_any(np.zeros((2, 2, 3)), [0, 0, 1]), ValueError, r"origins.reshape\(-1, 3\)"),
    (lambda: RayTree(OPEN, FACES).intersects_any([[0, 0, 0]] * 2, [[0, 0, 1]] * 3), ValueError, "directions"),
    (lambda: RayTree(OPEN, FACES).intersects_any([[0, 0, 0]], [0, 0, 1], time=-1), ValueError, r"\[0, 1\]"),
    (lambda: RayTree(OPEN, FACES).closest_hits([[0, 0, 0]] * 2, [0, 0, 1], time=[0, 2]), ValueError, "time 2 of query 1"),
    (lambda: RayTree(OPEN, FACES).intersects_any([[0, 0, np.nan]], [0, 0, 1]), ValueError, "finite"),
    (lambda: RayTree(OPEN, FACES).closest_point([[0, 0, 0]], max_distance=-1), ValueError, "max_distance"),
]


@pytest.mark.parametrize("wrong, error, message", WRONG)
def test_what_is_wrong_is_said(wrong, error, message):
    with pytest.raises(error, match=message):
        wrong()


def test_numbers_of_no_triangle_give_no_corners():
    tree = RayTree(OPEN, FACES)
    meshes, triangles = np.int64([0, 2**32, -1, 2**31, 0, 0]), np.int64([0, 0, 0, 0, 2**32, -1])
    assert np.isfinite(tree.triangles(meshes, triangles)[:, 0, 0]).tolist() == [True] + [False] * 5
    assert tree.triangles([], []).shape == (0, 3, 3)
    assert np.isnan(tree.triangles(2**40, [0])).all()


def test_rays_that_hit_nothing_and_none_at_all():
    tree, none = RayTree(OPEN, FACES), RayTree(np.empty((0, 3)), [])
    origins, directions = RNG.normal(size=(2, 9, 3))
    assert not none.intersects_any(origins, directions).any()
    assert (none.closest_point(origins)[2] == -1).all()
    for wrong in ([0, 0, 0], [np.nan, 0, 1], [np.inf, 0, 1]):
        assert not tree.intersects_any(origins, wrong).any()
    for bounds in ({"t_min": np.nan}, {"t_max": np.nan}, {"t_min": 2, "t_max": 1}, {"mask": 0}):
        assert not tree.intersects_any(origins, directions, **bounds).any()
    empty = np.empty((0, 3))
    assert tree.intersects_first(empty, empty).shape == (0,)
    assert [len(part) for part in tree.intersects_location(empty, empty)] == [0, 0, 0]
    assert [len(part) for part in tree.closest_point(empty)] == [0, 0, 0]
    reversed_ = tree.intersects_first(np.asfortranarray(origins)[::-1], np.asfortranarray(directions)[::-1])
    np.testing.assert_array_equal(reversed_[::-1], tree.intersects_first(origins, directions))
