"""Instances against meshes that are where the instances place them."""

import numpy as np
import pytest
from mbkd import InstanceTree, RayTree

RNG = np.random.default_rng(5)
FACES = np.arange(90).reshape(30, 3)
VERTICES = (RNG.random((30, 1, 3)) + RNG.normal(0, 0.2, (30, 3, 3))).reshape(90, 3).astype(np.float32)
ORIGINS = RNG.normal(0, 1, (1200, 3)) * [4, 4, 1] + [0, 0, 8]
DIRECTIONS = RNG.normal(0, 1, (1200, 3)) * [2, 2, 1] - ORIGINS
TIMES = RNG.random(1200)


def matrices(n):
    """Matrices that turn and stretch, with places."""
    whole = np.tile(np.eye(4), (n, 1, 1))
    whole[:, :3, :3] += RNG.normal(0, 0.2, (n, 3, 3))
    whole[:, :3, 3] = RNG.normal(0, 2, (n, 3))
    return whole


def moved(matrix):
    return (VERTICES @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float64)


def compare(hits, expected, instances):
    """Hits of instances and of meshes in their places are those of other roundings."""
    same = hits.t == hits.t
    same &= np.isclose(hits.t, expected.t, rtol=1e-4) | (np.isinf(hits.t) & np.isinf(expected.t))
    assert same.mean() > 0.98  # others pass an edge on its other side
    both = same & np.isfinite(hits.t)
    assert both.sum() > 30
    np.testing.assert_array_equal(instances[both], expected.mesh[both])
    np.testing.assert_array_equal(hits.triangle[both], expected.triangle[both])


@pytest.mark.parametrize("workers", [1, 2])
def test_matrices_place_meshes(workers):
    begin, end = matrices(5), matrices(5)
    tree = RayTree(VERTICES, FACES)
    placed = InstanceTree([tree], np.zeros(5, int), np.stack([begin, end]), workers=workers)
    flat = RayTree.from_meshes([(np.stack([moved(a), moved(b)]), FACES) for a, b in zip(begin, end)])
    hits = placed.closest_hits(ORIGINS, DIRECTIONS, time=TIMES, workers=workers)
    compare(hits, flat.closest_hits(ORIGINS, DIRECTIONS, time=TIMES), hits.instance)
    np.testing.assert_array_equal(placed.intersects_any(ORIGINS, DIRECTIONS, time=TIMES), np.isfinite(hits.t))
    index, every = placed.all_hits(ORIGINS, DIRECTIONS, time=TIMES)
    first = np.r_[True, np.diff(index) > 0]
    np.testing.assert_array_equal(every.t[first], hits.t[index[first]])
    some = np.flatnonzero(hits.instance >= 0)[:20]
    between = placed.matrices(hits.path[some], time=TIMES[some])
    at = TIMES[some].astype(np.float32).astype(np.float64)[:, None, None]
    np.testing.assert_allclose(between, begin[hits.instance[some]] * (1 - at) + end[hits.instance[some]] * at, atol=1e-12)
    assert np.isnan(placed.matrices([[7]])[:, :3]).all()


def test_poses_masks_active_intervals_and_nesting():
    tree = RayTree(VERTICES, FACES)
    half = np.sqrt(0.5)
    turned = InstanceTree([tree], [0, 0], translations=[[0, 0, 0], [3, 0, 0]], rotations=[[0, 0, half, half]] * 2, scales=[1, 2])
    turn = np.float64([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    flat = [(VERTICES @ turn.T * scale + [x, 0, 0], FACES) for x, scale in ((0, 1), (3, 2))]
    hits = turned.closest_hits(ORIGINS, DIRECTIONS)
    compare(hits, RayTree.from_meshes(flat).closest_hits(ORIGINS, DIRECTIONS), hits.instance)

    nested = InstanceTree([turned, tree], [1, 0], np.stack([np.eye(4)] * 2), masks=[1, 2], active=[[0, 1], [0, 0.5]])
    inner = nested.closest_hits(ORIGINS, DIRECTIONS, mask=2)
    np.testing.assert_array_equal(inner.t, hits.t)
    some = inner.instance >= 0
    np.testing.assert_array_equal(inner.path[some, 0], 1)
    np.testing.assert_array_equal(inner.path[some, 1], hits.instance[some])
    assert (inner.path[some, 2:] == -1).all() and (inner.path[~some] == -1).all()
    assert not nested.intersects_any(ORIGINS, DIRECTIONS, mask=2, time=0.75).any()
    np.testing.assert_array_equal(nested.closest_hits(ORIGINS, DIRECTIONS, mask=1).t, tree.closest_hits(ORIGINS, DIRECTIONS).t)
    assert len(nested) == 2 and nested.nbytes > tree.nbytes and "InstanceTree" in repr(nested) and nested.statistics()


def test_no_query_sees_a_mask_of_zero():
    hidden = RayTree.from_meshes([(VERTICES, FACES)], masks=[0])
    placed = {"translations": [[0, 0, 0]]}
    for tree in (InstanceTree([RayTree(VERTICES, FACES)], [0], masks=[0], **placed), InstanceTree([hidden], [0], **placed)):
        assert (tree.closest_hits(ORIGINS, DIRECTIONS).instance == -1).all()
        assert not tree.intersects_any(ORIGINS, DIRECTIONS).any()
        assert len(tree.all_hits(ORIGINS, DIRECTIONS)[0]) == 0
        assert np.isinf(tree.closest_point(ORIGINS)[1]).all()


def test_instances_of_scale_zero_are_hidden():
    tree = RayTree(VERTICES, FACES)
    places, sizes = [[0, 0, 0], [3, 0, 0], [0, 0, 0]], np.float64([0, 1, 0])
    alone = InstanceTree([tree], [0], translations=places[1:2])
    zero = np.stack([np.eye(4)] * 3)
    zero[[0, 2], :3, :3] = 0
    zero[:, :3, 3] = places
    for placed in (InstanceTree([tree], [0] * 3, translations=places, scales=sizes), InstanceTree([tree], [0] * 3, zero)):
        hits, expected = (of.closest_hits(ORIGINS, DIRECTIONS) for of in (placed, alone))
        np.testing.assert_array_equal(hits.t, expected.t)
        assert np.isfinite(hits.t).any()
        np.testing.assert_array_equal(hits.instance, np.where(expected.instance == 0, 1, -1))
        assert len(placed) == 3
        np.testing.assert_array_equal(placed.closest_point([[0, 0, 0]])[1], alone.closest_point([[0, 0, 0]])[1])
    with pytest.raises(ValueError, match="1e-6 instead of 0"):
        InstanceTree([tree], [0], scales=[[[0, 0, 0]], [[1, 1, 1]]])


@pytest.mark.parametrize("workers", [1, 2])
def test_closest_points_are_those_of_meshes_in_their_places(workers):
    begin, end = matrices(5), matrices(5)
    tree = RayTree(VERTICES, FACES)
    placed = InstanceTree([tree], np.zeros(5, int), np.stack([begin, end]), masks=1 << np.arange(5))
    flat = RayTree.from_meshes([(np.stack([moved(a), moved(b)]), FACES) for a, b in zip(begin, end)])
    points, times = RNG.normal(0, 3, (1200, 3)), TIMES.astype(np.float32)
    told = []
    closest, distance, near = placed.closest_point(points, time=times, workers=workers, progress=told.append)
    expected = flat.closest_point(points, time=times)
    np.testing.assert_allclose(distance, expected[1], rtol=1e-4, atol=1e-5)
    np.testing.assert_array_equal(distance, near.t)
    np.testing.assert_allclose(np.linalg.norm(closest - points, axis=1), distance, rtol=1e-5)
    assert (near.triangle == expected[2]).mean() > 0.98  # others are as near, at a shared corner
    assert len(set(near.instance)) == 5 and told[-1] == 1
    # Where names and weights say it is: on that triangle of that mesh, placed there at that time.
    corners = tree.triangles(near.mesh, near.triangle, time=times)
    weights = np.column_stack([1 - near.u.astype(float) - near.v, near.u, near.v])
    inside = np.append(np.einsum("nc,ncx->nx", weights, corners), np.ones((1200, 1)), axis=1)
    outside = np.einsum("nij,nj->ni", placed.matrices(near.path, time=times), inside)
    np.testing.assert_allclose(outside[:, :3], closest, atol=1e-5)

    some = slice(0, 200)
    within = placed.closest_point(points[some], time=times[some], max_distance=2)
    found = distance[some] <= 2
    assert 10 < found.sum() < 190
    np.testing.assert_array_equal(within[2].path, np.where(found[:, None], near.path[some], -1))
    assert np.isinf(within[1][~found]).all() and np.isnan(within[0][~found]).all()
    only = placed.closest_point(points[some], time=times[some], mask=4)
    np.testing.assert_array_equal(only[2].instance, 2)
    alone = InstanceTree([tree], [0], np.stack([begin[2:3], end[2:3]])).closest_point(points[some], time=times[some])
    np.testing.assert_array_equal(only[0], alone[0])
    with pytest.raises(ValueError, match="max_distance"):
        placed.closest_point(points, max_distance=np.nan)
    nothing = InstanceTree([], [], np.empty((0, 4, 4))).closest_point([[0, 0, 0]])
    assert np.isnan(nothing[0]).all() and nothing[1] == np.inf and nothing[2].instance == -1


def test_what_can_not_be_placed_is_an_error():
    tree = RayTree(VERTICES, FACES)
    one = np.eye(4)[None]
    for wrong in (
        lambda: InstanceTree([tree], [1], one),
        lambda: InstanceTree([tree], [-1], one),
        lambda: InstanceTree([tree], [0, 0], one),
        lambda: InstanceTree([tree], [0], np.zeros((1, 4, 4))),
        lambda: InstanceTree([tree], [0], one * [[1], [1], [0], [1]]),
        lambda: InstanceTree([tree], [0], one * np.nan),
        lambda: InstanceTree([tree], [0], one, translations=[[0, 0, 0]]),
        lambda: InstanceTree([tree], [0], rotations=[[0, 0, 0, 2]]),
        lambda: InstanceTree([tree], [0], translations=[[0, 0]]),
        lambda: InstanceTree([tree], [0], one, masks=[-1]),
        lambda: InstanceTree([tree], [0], one, active=[[1, 0]]),
        lambda: InstanceTree([tree], [0], one).matrices([[0]], time=2),
        lambda: InstanceTree([tree], [0], one).matrices([[0]], time=np.nan),
        lambda: InstanceTree([tree], [0], one).matrices([[0], [0]], time=[0, 1, 1]),
        lambda: InstanceTree([tree], [0], one).matrices(np.empty((3, 0), int)),
    ):
        with pytest.raises(ValueError):
            wrong()
    with pytest.raises(ValueError, match="instance 1.*interval"):
        InstanceTree([tree], [0, 0], np.concatenate([one, one]), active=[[0, 1], [1, 0]])
    for wrong in (
        lambda: InstanceTree([VERTICES], [0], one),
        lambda: InstanceTree(tree, [0], one),
        lambda: InstanceTree([tree], [0.5], one),
        lambda: InstanceTree([tree], [0], one, masks=[1.5]),
        lambda: InstanceTree([tree], [0], one).matrices([[0.5]]),
    ):
        with pytest.raises(TypeError):
            wrong()
    nothing = InstanceTree([], [], np.empty((0, 4, 4)))
    assert not nothing.intersects_any(ORIGINS, DIRECTIONS).any()


def test_paths_that_lead_nowhere_have_no_matrix():
    tree = InstanceTree([RayTree(VERTICES, FACES)], [0, 0], translations=[[0, 0, 0], [5, 0, 0]])
    paths = [[1, -1], [-1, -1], [2, -1], [1, 0], [1, 2**40], [-1, 1], [-2, -1], [1, -2], [2**32 + 1, -1]]
    found = tree.matrices(paths)[:, 0, 3]
    assert found[0] == 5 and np.isnan(found[1:]).all()
    assert tree.matrices(np.empty((0, 4), int)).shape == (0, 4, 4)
