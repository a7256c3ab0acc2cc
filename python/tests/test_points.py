"""Queries of points against brute force with numpy and against scipy."""

import itertools
import os
import pathlib
import pickle
import signal
from time import sleep

import numpy as np
import pytest
from mbkd import PointTree, RayTree
from scipy.spatial import cKDTree

RNG = np.random.default_rng(5)
SINGLE = RNG.random((500, 3), dtype=np.float32)
DOUBLE = RNG.random((500, 3))
QUERIES = RNG.random((60, 3)) * 1.4 - 0.2
CLOSE = SINGLE + RNG.normal(0, 0.3, (500, 3)).astype(np.float32)


def squares(positions, queries):
    """Squared distances (m, n) in float32, in the order of the library's sums."""
    d = positions.astype(np.float32)[None] - queries.astype(np.float32)[:, None]
    return (d[..., 0] * d[..., 0] + d[..., 1] * d[..., 1]) + d[..., 2] * d[..., 2]


def nearest(square, k):
    """Ids (m, k) and distances of the k nearest, ties by id."""
    ids = np.argsort(square, axis=1, kind="stable")[:, :k]
    return np.sqrt(np.take_along_axis(square, ids, 1).astype(np.float64)), ids


@pytest.mark.parametrize("k", [1, 2, 8, 40, 700, [1], [3, 1]])
@pytest.mark.parametrize("points", [SINGLE, DOUBLE], ids=["f32", "f64"])
def test_query_is_as_scipy(points, k):
    theirs, ours = cKDTree(points), PointTree(points)
    for x in (QUERIES, QUERIES[0], QUERIES.reshape(4, 15, 3), QUERIES[:0], QUERIES.astype(np.float32)[::2]):
        d, i = theirs.query(x.astype(points.dtype), k)
        distances, ids = ours.query(x.astype(points.dtype), k)
        assert np.shape(distances) == np.shape(d) and np.shape(ids) == np.shape(i)
        np.testing.assert_allclose(distances, d, rtol=2e-6)
        np.testing.assert_array_equal(ids, i)
        assert np.asarray(ids).dtype == np.asarray(i).dtype and np.asarray(distances).dtype == np.asarray(d).dtype


def test_query_is_brute_force_to_the_bit():
    square = squares(SINGLE, QUERIES)
    for workers in (1, 3, -1):
        d, i = PointTree(SINGLE, workers=workers).query(QUERIES.astype(np.float32), 7, workers=workers)
        distances, ids = nearest(square, 7)
        np.testing.assert_array_equal(i, ids)
        np.testing.assert_array_equal(d, distances)


@pytest.mark.parametrize("structure", ["automatic", "linear", "time_slices:3", "kd"])
def test_moving_points_are_those_of_a_snapshot(structure):
    tree = PointTree(SINGLE, keys=CLOSE, structure=structure)
    times = RNG.random(len(QUERIES)).astype(np.float32)
    d, i = tree.query(QUERIES, 5, time=times)
    for query, time, near, ids in zip(QUERIES, times, d, i):
        positions = tree.positions(time)
        exact = SINGLE + (CLOSE - SINGLE) * np.float64(time)
        np.testing.assert_allclose(positions, exact, atol=3e-7)
        distances, expected = nearest(squares(positions, query[None]), 5)
        np.testing.assert_array_equal(ids, expected[0])
        np.testing.assert_array_equal(near, distances[0])


def test_many_keys_and_active_intervals():
    keys = np.stack([SINGLE, CLOSE, SINGLE[::-1], CLOSE[::-1]])
    active = np.sort(RNG.random((500, 2)), axis=1).astype(np.float32)
    tree = PointTree(keys, active=active)
    for time in (0.0, 0.2, 0.5, 1.0):
        exist = (active[:, 0] <= time) & ((time < active[:, 1]) | ((time == 1) & (active[:, 1] == 1)))
        np.testing.assert_array_equal(~np.isnan(tree.positions(time)[:, 0]), exist)
        d, i = tree.query(QUERIES, 400, time=time)
        assert set(i[0][np.isfinite(d[0])]) == set(np.flatnonzero(exist)[: (d[0] < np.inf).sum()]) or exist.sum() > 400
        assert ((i == 500) == np.isinf(d)).all()
        assert len(tree.query_ball_point(QUERIES, 9, time=time).ids) == exist.sum() * len(QUERIES)
    same = PointTree(keys[0], keys=keys[1:], active=active)
    np.testing.assert_array_equal(same.positions(0.3), tree.positions(0.3))
    several = tree.positions([[0.3, 0.7], [1, 0]])
    assert several.shape == (2, 2, 500, 3) and tree.positions([]).shape == (0, 500, 3)
    np.testing.assert_array_equal(several[0, 1], tree.positions(0.7))


def test_bounds_and_eps():
    theirs, ours = cKDTree(DOUBLE), PointTree(DOUBLE)
    for bound in (0, 0.05, 0.2, np.inf):
        d, i = theirs.query(QUERIES, 4, distance_upper_bound=bound)
        distances, ids = ours.query(QUERIES, 4, distance_upper_bound=bound)
        np.testing.assert_array_equal(ids, i)
        np.testing.assert_allclose(distances, d, rtol=1e-6)
    # As in scipy the bound itself is too far.
    assert PointTree([[0, 0, 0]]).query([1, 0, 0], distance_upper_bound=1) == (np.inf, 1)
    exact, near = ours.query(QUERIES, 4)[0], ours.query(QUERIES, 4, eps=0.5)[0]
    assert (near <= exact * 1.5 + 1e-6).all()


@pytest.mark.parametrize("points", [SINGLE, DOUBLE], ids=["f32", "f64"])
def test_balls(points):
    theirs, ours = cKDTree(points), PointTree(points)
    radii = RNG.random(len(QUERIES)) * 0.3
    for r in (0.17, 0.0, radii):
        lists = ours.query_ball_point(QUERIES, r, workers=2)
        expected = theirs.query_ball_point(QUERIES, r, return_sorted=True)
        assert [row.tolist() for row in lists] == expected.tolist()
        np.testing.assert_array_equal(lists.counts, ours.query_ball_point(QUERIES, r, return_length=True))
        objects = ours.query_ball_point(QUERIES.reshape(6, 10, 3), np.reshape(r, (6, 10)) if np.ndim(r) else r, output_type="object")
        assert objects.shape == (6, 10) and objects.ravel().tolist() == expected.tolist()
    assert sorted(ours.query_ball_point(QUERIES[0], 0.3, output_type="object")) == sorted(theirs.query_ball_point(QUERIES[0], 0.3))
    assert isinstance(ours.query_ball_point(QUERIES[0], 0.3, return_length=True), int)
    unsorted = ours.query_ball_point(QUERIES, 0.17, return_sorted=False)
    np.testing.assert_array_equal(np.sort(unsorted[5]), ours.query_ball_point(QUERIES, 0.17)[5])


@pytest.mark.parametrize("points", [SINGLE, DOUBLE], ids=["f32", "f64"])
def test_pairs_and_counts(points):
    theirs, ours = cKDTree(points), PointTree(points)
    other, others = cKDTree(points[:77] + 0.1), PointTree(points[:77] + points.dtype.type(0.1))
    assert ours.query_pairs(0.1, output_type="set") == theirs.query_pairs(0.1)
    assert len(ours.query_pairs(0.0)) == 0
    pairs = ours.query_pairs(0.1)
    assert pairs.dtype == np.intp and (pairs[:, 0] < pairs[:, 1]).all()
    assert (np.lexsort((pairs[:, 1], pairs[:, 0])) == np.arange(len(pairs))).all()
    radii = np.array([0.0, 0.1, 0.4])
    np.testing.assert_array_equal(ours.count_neighbors(others, radii), theirs.count_neighbors(other, radii))
    assert ours.count_neighbors(ours, 0.1, workers=2) == theirs.count_neighbors(theirs, 0.1) == 500 + 2 * len(pairs)


@pytest.mark.parametrize("box", [1.0, [1.0, 0.0, 1.5], [0.0, 1.0, 1.0]])
@pytest.mark.parametrize("points", [SINGLE, DOUBLE], ids=["f32", "f64"])
def test_periodic_boxes(points, box):
    theirs, ours = cKDTree(points, boxsize=box), PointTree(points, boxsize=box)
    for k in (1, 6, 500, 600):
        d, i = theirs.query(QUERIES, k)
        distances, ids = ours.query(QUERIES, k)
        np.testing.assert_allclose(distances, d, rtol=1e-5, atol=1e-7)
        assert (ids != i).mean() < 0.001, "but for near-ties"
    for r in (0.1, 0.45, 0.8):
        lists = ours.query_ball_point(QUERIES, r)
        assert [row.tolist() for row in lists] == theirs.query_ball_point(QUERIES, r, return_sorted=True).tolist()
        assert ours.count_neighbors(ours, r) == theirs.count_neighbors(theirs, r)
    assert ours.query_pairs(0.2, output_type="set") == theirs.query_pairs(0.2)


def images(points, queries, box):
    """Squared distances (m, n) to the nearest images, each computed as the library does."""
    box = np.broadcast_to(np.float64(box), 3)
    home = np.where(box > 0, queries.astype(np.float64) % np.where(box > 0, box, 1), queries)
    least = np.full((len(queries), len(points)), np.inf, np.float32)
    for shift in itertools.product(*([-2, -1, 0, 1, 2] if length else [0] for length in box)):
        place = (home + np.float64(shift) * box).astype(points.dtype)
        d = points[None] - place[:, None]
        square = (d[..., 0] * d[..., 0] + d[..., 1] * d[..., 1]) + d[..., 2] * d[..., 2]
        least = np.minimum(least, square.astype(np.float32))
    return least


@pytest.mark.parametrize("box", [1.0, [1.0, 1.25, 0.0], [1.0, 1.0, 2.0]], ids=str)
@pytest.mark.parametrize(
    "points",
    [SINGLE, DOUBLE, SINGLE[:40] * np.float32(0.3), SINGLE[:1], np.round(SINGLE * 8) / 8 % 1],
    ids=["f32", "f64", "part", "one", "lattice"],
)
def test_periodic_boxes_are_brute_force_to_the_bit(points, box):
    ours, rng = PointTree(points, boxsize=box), np.random.default_rng(3)
    length = np.broadcast_to(box, 3) + 1.0 * (np.broadcast_to(box, 3) == 0)
    middle, any_place = 0.4 + 0.2 * rng.random((20, 3)), rng.random((20, 3))
    faces = any_place.copy()
    faces[np.arange(20), np.arange(20) % 3] = rng.choice([0, 1e-9, 1e-3, 0.03, 0.97, 0.999, 1 - 1e-9], 20)
    corners = np.float64(list(itertools.product([0, 1e-3, 0.98], repeat=3)))
    outside = np.concatenate([rng.normal(0, 3, (20, 3)), np.float64(list(itertools.product([-1, 0, 1, 2], repeat=3)))])
    queries = np.concatenate([middle, any_place, faces, corners, outside]) * length
    square = images(points, queries, box)
    for k in (1, 2, 9, len(points)):
        distances, expected = nearest(square, k)
        d, i = ours.query(queries, [*range(1, k + 1)])
        columns = expected.shape[1]
        np.testing.assert_array_equal(i[:, :columns], expected)
        np.testing.assert_array_equal(d[:, :columns], distances)
        assert (i[:, columns:] == len(points)).all()
    # About half a period, where two images begin to reach the same points, and the whole box.
    for r in (0.0, 0.03, 0.2, 0.49, 0.49995, 0.5, 0.51, 0.7, 1.2, np.inf):
        within = square <= np.float32(r) * np.float32(r)
        lists, some = ours.query_ball_point(queries, r), ours.query_ball_point(queries, r, return_sorted=False)
        np.testing.assert_array_equal(lists.ids, np.nonzero(within)[1])
        np.testing.assert_array_equal(lists.counts, within.sum(axis=1))
        assert [sorted(row) for row in some.to_objects()] == lists.to_objects().tolist()
        np.testing.assert_array_equal(ours.query_ball_point(queries, r, return_length=True), lists.counts)
        d, i = ours.query(queries, 5, distance_upper_bound=r)
        ranks = np.sort(np.where(square < np.float32(r) * np.float32(r), square, np.inf), axis=1)[:, :5]
        np.testing.assert_array_equal(d[:, : ranks.shape[1]], np.sqrt(ranks.astype(np.float64)))
        near = ours.query(queries, 5, eps=0.5, distance_upper_bound=r)[0]
        np.testing.assert_array_equal(np.isinf(near), np.isinf(d))
        assert (near <= d * (1.5 + 1e-6)).all()


@pytest.mark.parametrize("box", [[1.0, 0.0, 1.5], [0.0, 0.0, 0.0]])
def test_axes_with_an_infinite_period_are_open(box):
    # Open axes have no begin either.
    points = SINGLE - [0.0, 3.0, 0.0] if any(box) else SINGLE - 3
    infinite = [length or np.inf for length in box]
    zero, inf = (PointTree(points, boxsize=of) for of in (box, infinite))
    np.testing.assert_array_equal(inf.boxsize, box)
    for a, b in zip(zero.query(QUERIES, 6), inf.query(QUERIES, 6)):
        np.testing.assert_array_equal(a, b)
    assert zero.query_pairs(0.2, output_type="set") == inf.query_pairs(0.2, output_type="set") != set()
    for r in (0.1, 0.8):
        assert zero.count_neighbors(inf, r) == inf.count_neighbors(zero, r) == zero.count_neighbors(zero, r)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(inf)).query(QUERIES)[1], inf.query(QUERIES)[1])
    # One number for all axes.
    np.testing.assert_array_equal(PointTree(points, boxsize=np.inf).query(QUERIES)[1], PointTree(points).query(QUERIES)[1])


def test_periodic_boxes_that_points_leave():
    close = SINGLE + RNG.normal(0, 0.7, (500, 3)).astype(np.float32)
    tree = PointTree(SINGLE, keys=close, boxsize=1)
    for time in (0.0, 0.5, 1.0):
        there = cKDTree(tree.positions(time) % 1.0, boxsize=1)
        d, _ = there.query(QUERIES, 9)
        np.testing.assert_allclose(tree.query(QUERIES, 9, time=time)[0], d, rtol=1e-4, atol=1e-6)


def test_closest_approach():
    tree = PointTree(SINGLE, keys=CLOSE)
    start, end = QUERIES[:20], QUERIES[20:40]
    d, i, t = tree.closest_approach(start, end)
    steps = np.linspace(0, 1, 2001)
    for a, b, distance, index, time in zip(start, end, d, i, t):
        ways = [a + (b - a) * s - (SINGLE + (CLOSE - SINGLE).astype(np.float64) * s) for s in steps]
        far = np.linalg.norm(ways, axis=2)
        assert distance <= far.min() + 1e-6 and distance >= far.min() - 2e-3
        there = SINGLE[index] + (CLOSE[index] - SINGLE[index]).astype(np.float64) * time
        assert abs(np.linalg.norm(a + (b - a) * time - there) - distance) < 1e-5
    assert tree.closest_approach(start[0], end[0]) == (d[0], i[0], t[0])


def test_closest_approach_in_a_periodic_box():
    start, end = QUERIES[:30], QUERIES[30:60]
    by = np.stack(np.meshgrid(*3 * [np.arange(-3, 4)], indexing="ij"), -1).reshape(-1, 3)
    copies = PointTree(np.concatenate([SINGLE + b for b in by]), keys=np.concatenate([CLOSE + b for b in by]))
    tree = PointTree(SINGLE, keys=CLOSE, boxsize=1)
    d, i, t = tree.closest_approach(start, end)
    near, of, _ = copies.closest_approach(start, end)
    np.testing.assert_allclose(d, near, atol=1e-5)
    assert np.mean(i == of % len(SINGLE)) > 0.9
    again = tree.closest_approach(start + [2, -3, 0], end + [2, -3, 0])
    np.testing.assert_allclose(again[0], d, atol=1e-6)
    assert np.any(d < PointTree(SINGLE, keys=CLOSE).closest_approach(start, end)[0])
    d, i, t = tree.closest_approach([0, 0, 0], [17, 0, 0])
    assert d == np.inf and i == len(SINGLE) and np.isnan(t)


def test_input_of_any_kind():
    ours = PointTree(SINGLE)
    d, i = ours.query(QUERIES, 3)
    for points in (SINGLE[:, ::-1][:, ::-1], np.asfortranarray(SINGLE), SINGLE.astype(">f4"), SINGLE.tolist()):
        np.testing.assert_array_equal(PointTree(points).query(QUERIES, 3)[1], i)
    # In a buffer, beside the places where numbers of this size usually are.
    beside = [np.frombuffer(b"!" + array.tobytes(), array.dtype, offset=1).reshape(array.shape) for array in (SINGLE, QUERIES)]
    assert not beside[0].flags.aligned
    time = np.frombuffer(b"!" + bytes(4 * len(QUERIES)), np.float32, offset=1)
    np.testing.assert_array_equal(PointTree(beside[0]).query(beside[1], 3, time=time)[1], i)
    assert PointTree([[0, 0, 0], [5, 0, 0]]).query([4, 0, 0]) == (1.0, 1)
    assert PointTree(np.empty((0, 3))).query([[0, 0, 0]], 2)[1].tolist() == [[0, 0]]
    rounded = PointTree(DOUBLE, precision="float32")
    np.testing.assert_allclose(rounded.query(QUERIES)[0], PointTree(DOUBLE).query(QUERIES)[0], atol=1e-6)
    assert len(rounded.neighbor_lists(0.1)) == len(PointTree(DOUBLE).neighbor_lists(0.1)) == 500
    corners = np.float64([[-1, -1, -1], [1, 1, 1], [0.5, 0, 0]])
    near = [0.5 + 1e-9, 0, 0]
    assert PointTree(corners).query(near) == (0.0, 2)
    for given in (corners, corners.astype(np.float32)):
        np.testing.assert_allclose(PointTree(given, precision="float64").query(near)[0], 1e-9, rtol=1e-6)


WRONG_AT_7 = np.where(np.arange(len(QUERIES)) == 7, -1, 0.1)


def rounded(points):
    return PointTree(points, precision="float32")


WRONG = [
    (lambda: PointTree([[0, 0]]), ValueError, "coordinates"),
    (lambda: PointTree([0, 0, 0]), ValueError, "shape"),
    (lambda: PointTree([["a", "b", "c"]]), TypeError, "numbers"),
    (lambda: PointTree([[1j, 0, 0]]), TypeError, "numbers"),
    (lambda: PointTree([[np.nan, 0, 0]]), ValueError, "not finite"),
    (lambda: PointTree(np.float32([[1e30, 0, 0]])), ValueError, "1e18"),
    (lambda: PointTree(SINGLE, keys=CLOSE[1:]), ValueError, "499 points"),
    (lambda: PointTree(SINGLE, active=[[0, 1]]), ValueError, "1 active intervals of 500 points"),
    (lambda: PointTree(SINGLE, active=[0, 1]), ValueError, "active must have the shape"),
    (lambda: PointTree(None), TypeError, "numbers"),
    (lambda: PointTree(np.empty((0, 500, 3))), ValueError, "at least one key"),
    (lambda: PointTree(np.ma.masked_greater(SINGLE, 0.5)), ValueError, "masked"),
    (lambda: PointTree(SINGLE).query(QUERIES[:2], time=np.ma.array([0, 1], mask=[0, 1])), ValueError, "time has masked"),
    (lambda: PointTree(SINGLE).neighbor_lists(np.ma.masked_greater(SINGLE[:, 0], 0.5)), ValueError, "r has masked"),
    (lambda: PointTree(SINGLE, boxsize=[1, 1]), ValueError, "boxsize"),
    (lambda: PointTree(SINGLE, active=np.full((500, 2), 0.5)), ValueError, "point 0.*time interval"),
    (lambda: PointTree(SINGLE, active=[[0, 1]] * 77 + [[1, 0]] + [[0, 1]] * 422), ValueError, "point 77.*time interval"),
    (lambda: PointTree(SINGLE, structure="best"), ValueError, "structure"),
    (lambda: PointTree(SINGLE, precision="double"), ValueError, "precision"),
    (lambda: PointTree(SINGLE, keys=CLOSE, structure="time_slices:0"), ValueError, "structure must have from 1 to 1024 time slices"),
    (lambda: PointTree(DOUBLE, keys=DOUBLE + 1, structure="kd"), ValueError, "structure='kd' .* precision='float32'"),
    (lambda: PointTree(SINGLE, max_references=0), ValueError, "max_references"),
    (lambda: PointTree(SINGLE, workers=0), ValueError, "workers"),
    (lambda: PointTree(SINGLE, boxsize=0.5), ValueError, "periodic"),
    (lambda: PointTree(SINGLE, boxsize=-1), ValueError, "boxsize"),
    (lambda: PointTree(SINGLE, SINGLE + 1e19, boxsize=-1), ValueError, "boxsize"),  # before the points, of which a tree takes long
    (lambda: PointTree(SINGLE, boxsize=[1, 1, -np.inf]), ValueError, "boxsize"),
    (lambda: PointTree(SINGLE, boxsize=[1, 1, np.nan]), ValueError, "boxsize"),
    (lambda: PointTree(SINGLE, boxsize=[np.inf, 1, 0.5]), ValueError, "periodic"),
    (lambda: PointTree(SINGLE).query([0, 0]), ValueError, "shape.*third coordinate"),
    (lambda: PointTree(SINGLE.astype(object)), TypeError, r"np.asarray\(points, dtype=float\)"),
    (lambda: PointTree([[1, 2, 3], [4, 5]]), ValueError, "points must be an array"),
    (lambda: PointTree(SINGLE).positions([0, 2]), ValueError, "the time 2 is not in"),
    (lambda: PointTree(SINGLE).positions("0"), TypeError, "time must be numbers"),
    (lambda: PointTree(SINGLE).query([0, 0, np.inf]), ValueError, "finite"),
    (lambda: PointTree(SINGLE).query([0, 0, 0], 0), ValueError, "k must"),
    (lambda: PointTree(SINGLE).query([0, 0, 0], -1), ValueError, "k must"),
    (lambda: PointTree(SINGLE).query([0, 0, 0], 2.0), ValueError, "k must"),
    (lambda: PointTree(SINGLE).query([0, 0, 0], "3"), ValueError, "k must"),
    (lambda: PointTree(SINGLE).query([0, 0, 0], []), ValueError, "k must"),
    (lambda: PointTree(SINGLE).query([0, 0, 0], 2**70), ValueError, "k must"),
    (lambda: PointTree(SINGLE).query([0, 0, 0], eps=np.nan), ValueError, "eps"),
    (lambda: PointTree(SINGLE).query([0, 0, 0], distance_upper_bound=-1), ValueError, "distance_upper_bound"),
    (lambda: PointTree(SINGLE).query(QUERIES, distance_upper_bound=np.ones(60)), TypeError, "one number"),
    (lambda: PointTree(SINGLE).query(QUERIES, progress=3), TypeError, "callable"),
    (lambda: PointTree(SINGLE).query([0, 0, 0], p=1), ValueError, "Euclidean"),
    (lambda: PointTree(SINGLE).query([0, 0, 0], time=1.5), ValueError, r"\[0, 1\]"),
    (lambda: PointTree(SINGLE).query([0, 0, 0], time=np.nan), ValueError, r"\[0, 1\]"),
    (lambda: PointTree(SINGLE).query(QUERIES, time=[0, 1]), ValueError, "time has the shape"),
    (lambda: PointTree(SINGLE).query(QUERIES, time=WRONG_AT_7), ValueError, r"the time -1 of query 7 is not in \[0, 1\]"),
    (lambda: PointTree(SINGLE).query_ball_point(QUERIES, 0.1, time=WRONG_AT_7), ValueError, "query 7"),
    (lambda: PointTree(SINGLE).query_ball_point(QUERIES, WRONG_AT_7), ValueError, "the radius -1 of query 7 is negative"),
    (lambda: PointTree(SINGLE, boxsize=1).query_ball_point(QUERIES, WRONG_AT_7, return_length=True), ValueError, "query 7"),
    (lambda: PointTree(SINGLE).query_ball_point([0, 0, 0], -1), ValueError, "radius"),
    (lambda: PointTree(SINGLE).query_ball_point([0, 0, 0], np.nan), ValueError, "radius"),
    (lambda: PointTree(SINGLE).query_ball_point(QUERIES, [0.1, 0.2]), ValueError, "r has the shape"),
    (lambda: PointTree(SINGLE).query_pairs(np.nan), ValueError, "radius"),
    (lambda: PointTree(SINGLE).count_neighbors(SINGLE, 0.1), TypeError, "PointTree"),
    (lambda: PointTree(SINGLE).count_neighbors(cKDTree(SINGLE), 0.1), TypeError, "other must be a PointTree, not cKDTree"),
    (lambda: PointTree(SINGLE).count_neighbors(PointTree(SINGLE), [0.1, -1]), ValueError, "the radius -1 at index 1"),
    (lambda: PointTree(SINGLE).neighbor_lists(0.1, among=cKDTree(SINGLE)), TypeError, "among must be a PointTree, not cKDTree"),
    (lambda: PointTree(SINGLE).neighbor_lists_swept(0.1, between=(0.5, 0.2)), ValueError, "interval"),
    (lambda: PointTree(SINGLE).neighbor_lists_swept(0.1, between=(0.5, 0.2, 1)), ValueError, "interval"),
    (lambda: PointTree(SINGLE).neighbor_lists_swept(np.nan), ValueError, "radius"),
    (lambda: PointTree(SINGLE).closest_approach(SINGLE, SINGLE[:3]), ValueError, "shape"),
    (lambda: PointTree(SINGLE).neighbor_lists(0.1)[500], IndexError, "no list 500"),
    (lambda: PointTree(SINGLE).neighbor_lists(0.1)[1:3], TypeError, "slice"),
    (lambda: PointTree(SINGLE).neighbor_lists(-1), ValueError, "radius"),
    (lambda: PointTree(DOUBLE).neighbor_lists(0.1, among=PointTree(SINGLE)), ValueError, "float64.*float32.*same precision"),
    (lambda: rounded(DOUBLE).neighbor_lists(0.1, among=rounded(DOUBLE + 1)), ValueError, "precision='float64'"),
    (lambda: PointTree(SINGLE, boxsize=[1, 1, 1e39]).neighbor_lists(0.1), ValueError, "boxsize of axis 2"),
    (lambda: PointTree(SINGLE * [1, 1, 0], boxsize=[1, 1, 1e-40]), ValueError, "sixteen periods .* axis 2"),
    (lambda: PointTree(SINGLE).neighbor_lists(0.1, max_neighbors=-1), ValueError, "max_neighbors"),
    (lambda: PointTree(SINGLE).neighbor_lists(0.1, max_neighbors=2.0), TypeError, "max_neighbors"),
    (lambda: PointTree(SINGLE).neighbor_lists(9, max_neighbors=498), ValueError, "point 0 has more neighbours"),
    (lambda: PointTree(SINGLE).neighbor_lists(np.ones(3)), ValueError, "r must"),
]


@pytest.mark.parametrize("wrong, error, message", WRONG)
def test_what_is_wrong_is_said(wrong, error, message):
    with pytest.raises(error, match=message):
        wrong()


def test_nothing_among_nothing():
    none, some = PointTree(np.empty((0, 3), np.float32)), PointTree(SINGLE)
    assert none.query([0, 0, 0]) == (np.inf, 0)
    assert none.query_pairs(1).shape == (0, 2)
    assert none.count_neighbors(some, 1) == some.count_neighbors(none, 1) == 0
    assert len(none.query_ball_point([[0, 0, 0]], 1)[0]) == 0
    lists = none.neighbor_lists(1, distances=True, displacements=True)
    assert len(lists) == 0 and lists.displacements.shape == (0, 3) and lists.distances.shape == (0,)
    assert len(none.neighbor_lists_swept(1)) == 0
    d, i, t = none.closest_approach([0, 0, 0], [1, 0, 0])
    assert (d, i) == (np.inf, 0) and np.isnan(t)
    for k in (1, 4, [2, 3]):
        d, i = some.query(np.empty((0, 3)), k)
        assert len(d) == len(i) == 0
    assert len(some.query_ball_point(np.empty((0, 3)), 1)) == 0


def test_more_neighbours_than_there_are():
    tree = PointTree(SINGLE[:3])
    d, i = tree.query(QUERIES, [1, 5, 10**15])
    np.testing.assert_array_equal(i[:, 0], tree.query(QUERIES)[1])
    assert (i[:, 1:] == 3).all() and np.isinf(d[:, 1:]).all() and d.shape == (60, 3)
    # Positions that no point can be near to.
    assert PointTree(SINGLE).query([1e30, 0, 0], 2)[1].tolist() == [500, 500]
    assert PointTree(SINGLE).query(SINGLE[7], distance_upper_bound=0) == (np.inf, 500)
    # The square of the bound is zero in f32.
    assert PointTree(SINGLE).query(SINGLE[7], distance_upper_bound=1e-30) == (0, 7)
    assert PointTree(SINGLE + np.float64(0.1)).query(SINGLE[7] + np.float64(0.1), distance_upper_bound=1e-30) == (0, 7)


def test_more_answers_than_memory_holds_are_an_error():
    # More than the addresses of a process, which no system promises.
    tree = PointTree(np.zeros((2**22, 3), np.float32))
    with pytest.raises(MemoryError):
        tree.query(np.zeros((2**23, 3), np.float32), k=2**22)


def test_arrays_are_read_where_they_are_and_not_kept():
    fixed = SINGLE.copy()
    fixed.setflags(write=False)
    tree = PointTree(fixed)
    assert tree.data is fixed
    changing = SINGLE.copy()
    tree = PointTree(changing)
    expected = tree.query(QUERIES)[1]
    changing[:] = 0
    np.testing.assert_array_equal(tree.query(QUERIES)[1], expected)
    np.testing.assert_array_equal(PointTree(SINGLE).query(np.asfortranarray(QUERIES)[::-1])[1], expected[::-1])
    assert PointTree(SINGLE, workers=100_000).query(QUERIES, workers=100_000)[1].tolist() == expected.tolist()


def test_ctrl_c_ends_queries():
    tree, many = PointTree(SINGLE), RNG.random((1_000_000, 3))
    for ask in (
        lambda hear: tree.query(many, 40, progress=hear),
        lambda hear: tree.query_ball_point(many, 0.3, progress=hear),
        lambda hear: tree.query_ball_point(many, 0.3, return_length=True, workers=2, progress=hear),
    ):
        told = []

        def press(done):
            told.append(done)
            if len(told) == 1:
                os.kill(os.getpid(), signal.SIGINT)

        before = signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            with pytest.raises(KeyboardInterrupt):
                ask(press)
        finally:
            signal.signal(signal.SIGINT, before)
        assert told[-1] < 0.5


def test_progress_is_told_and_may_end_a_query():
    tree, many = PointTree(SINGLE), RNG.random((100_000, 3))
    done = []
    tree.query(many, progress=done.append)
    assert len(done) > 2 and done == sorted(done) and done[-1] == 1.0

    def enough(done):
        raise RuntimeError("enough")

    # Few queries may cost much, so the first ones are told soon.
    for ask in (tree.query, lambda at, **how: tree.count_neighbors(PointTree(at), [0.1, 0.2, 0.3], **how)):
        done = []
        ask(many[:2000], progress=done.append)
        assert len(done) >= 2 and done == sorted(done) and done[-1] == 1.0
        assert done[0] < 0.2

    for ask in (lambda: tree.query(many, progress=enough), lambda: tree.query_ball_point(many, 0.1, progress=enough, workers=2)):
        with pytest.raises(RuntimeError, match="enough"):
            ask()


def test_more_queries_than_can_be_numbered_are_refused(tmp_path):
    # Of a file without contents, which takes no memory.
    try:
        with open(tmp_path / "empty", "wb") as file:
            file.truncate(2**32 * 24)
        many = np.memmap(tmp_path / "empty", np.float32, "r", shape=(2**32, 3))
        wide = np.memmap(tmp_path / "empty", np.float64, "r", shape=(2**32, 3))
    except (OSError, ValueError):
        pytest.skip("no file of this size")
    tree, one, mesh = PointTree(SINGLE)._tree, np.float32([0.5]), RayTree(SINGLE[:3], [[0, 1, 2]])._tree
    for ask in (
        lambda: tree.query(many, one, 1, 0.0, 1.0, 1, None),
        lambda: tree.within(many, one, one, False, None, 1, None),
        lambda: tree.count(many, one, one, 1, None),
        lambda: tree.closest_approach(wide, wide, [0, 1], 1, None),
        lambda: mesh.all_hits((wide, many, one, one, one), 1, 1, None),
        lambda: mesh.closest_points((wide, one, one), 1, 1, None),
    ):
        with pytest.raises(ValueError, match="4294967296 queries"):
            ask()


def test_few_pools_of_threads_are_kept():
    tasks = pathlib.Path("/proc/self/task")
    if not tasks.exists():
        pytest.skip("threads cannot be counted")
    for workers in range(2, 42):
        PointTree(SINGLE, workers=workers)
    # Those that are not kept end by themselves, after a while. All of them together would be 860.
    for _ in range(3000):
        if len(list(tasks.iterdir())) < 200:
            return
        sleep(0.01)
    raise AssertionError("there are too many threads")


def test_trees_are_asked_from_threads():
    from concurrent.futures import ThreadPoolExecutor

    tree = PointTree(SINGLE)
    expected = tree.query(QUERIES, 3)[1]
    with ThreadPoolExecutor(4) as pool:
        for ids in pool.map(lambda _: tree.query(QUERIES, 3)[1], range(50)):
            np.testing.assert_array_equal(ids, expected)


def test_what_is_far_larger_than_the_cache_is_asked_in_another_order():
    points = RNG.random((200_000, 3), dtype=np.float32)
    queries = RNG.random((3000, 3), dtype=np.float32)
    tree = PointTree(points)
    assert tree.nbytes > 1 << 20
    d, i = cKDTree(points).query(queries, 3)
    ours = [tree.query(queries, 3, workers=workers) for workers in (1, 2)]
    for distances, ids in ours:
        np.testing.assert_allclose(distances, d, rtol=1e-5)
        assert (ids != i).mean() < 0.001
    for a, b in itertools.pairwise(ours) if hasattr(itertools, "pairwise") else []:
        np.testing.assert_array_equal(a[1], b[1])
    lists = tree.query_ball_point(queries, 0.02)
    np.testing.assert_array_equal(lists.counts, tree.query_ball_point(queries, 0.02, return_length=True))
