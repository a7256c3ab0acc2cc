"""Point trees that are rebuilt for further steps against trees that are built of these steps."""

import copy
import pickle

import numpy as np
import pytest
from asking import answers_during, assert_each_is_one_of
from mbkd import PointTree

RNG = np.random.default_rng(12)
N = 3000
POINTS = RNG.random((N, 3), dtype=np.float32) * np.float32(0.8) + np.float32(0.1)
VELOCITY = RNG.normal(0, 0.004, (N, 3)).astype(np.float32)
QUERIES = RNG.random((200, 3), dtype=np.float32)
FAR = np.float64([1e9, -2e9, 3e9])


def step(number, kind=np.float32):
    return (POINTS + number * VELOCITY).astype(kind)


def answers(tree):
    lists = tree.neighbor_lists(0.06, sorted=True, distances=True)
    near = tree.query_ball_point(QUERIES, 0.1)
    met = tree.neighbor_lists_swept(0.02)
    return [*tree.query(QUERIES, 7), lists.ids, lists.offsets, lists.distances, near.ids, met.ids, met.enter, tree.positions()]


def assert_same(tree, other):
    for one, two in zip(answers(tree), answers(other)):
        np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("boxsize", [None, [1, 0, 2]])
def test_a_rebuilt_tree_answers_as_one_that_is_built(workers, boxsize):
    tree = PointTree(POINTS, boxsize=boxsize)
    for number in range(1, 5):
        assert tree.rebuild(step(number), workers=workers) is True
        assert_same(tree, PointTree(step(number), boxsize=boxsize))
        np.testing.assert_array_equal(tree.data, step(number))
    if boxsize is None:
        d = step(4)[None] - QUERIES[:, None]
        square = (d[..., 0] * d[..., 0] + d[..., 1] * d[..., 1]) + d[..., 2] * d[..., 2]
        np.testing.assert_array_equal(tree.query(QUERIES)[1], square.argmin(1))
    # Too far for the old order.
    elsewhere = RNG.permutation(step(4))
    assert tree.rebuild(elsewhere, workers=workers) is False
    assert_same(tree, PointTree(elsewhere, boxsize=boxsize))


SETS = {
    "fewer": lambda: (step(1)[:-1],),
    "none": lambda: (np.empty((0, 3), np.float32),),
    "moving": lambda: (step(1), step(2)),
    "many keys": lambda: (np.stack([step(1), step(2), step(0)]),),
    "active": lambda: (step(1), None, np.tile([0, 0.5], (N, 1))),
    "float64": lambda: (step(1) + FAR,),
    "moving float64": lambda: (step(1) + FAR, step(2) + FAR),
}


@pytest.mark.parametrize("of", SETS.values(), ids=SETS)
@pytest.mark.parametrize("how", [{}, {"structure": "time_slices:3", "precision": "float64"}], ids=["usual", "other"])
def test_all_other_sets_are_built_again(of, how):
    arguments = of()
    tree, new = PointTree(POINTS, **how), PointTree(*arguments, **how)
    assert tree.rebuild(*arguments) is False
    assert tree.statistics() == new.statistics() and len(tree) == len(new) and tree.nbytes == new.nbytes
    assert_same(tree, new)
    tree.rebuild(*arguments)
    assert_same(tree, new)
    # And again among points that stand still, those of a pickled tree as well.
    for again in (tree, pickle.loads(pickle.dumps(tree))):
        again.rebuild(step(3))
        assert_same(again, PointTree(step(3), **how))
        assert again.nbytes == PointTree(step(3), **how).nbytes


def test_float64_points_stay_in_float64():
    tree, moved = PointTree(POINTS + FAR), POINTS + FAR + 1e-7
    tree.rebuild(moved)
    assert_same(tree, PointTree(moved))
    np.testing.assert_array_equal(tree.positions(), moved)


WRONG = [
    (lambda tree: tree.rebuild(np.where(np.arange(N)[:, None] == 5, np.nan, POINTS)), ValueError, "point 5.*not finite"),
    (lambda tree: tree.rebuild(POINTS * np.float32(1e30)), ValueError, "1e18"),
    (lambda tree: tree.rebuild(POINTS[:, :2]), ValueError, "coordinates"),
    (lambda tree: tree.rebuild(POINTS, POINTS[1:]), ValueError, "later key"),
    (lambda tree: tree.rebuild(POINTS, active=[[0, 1]]), ValueError, f"1 active intervals of {N} points"),
    (lambda tree: tree.rebuild(POINTS, active=np.tile([1, 0], (N, 1))), ValueError, "point 0.*interval"),
    (lambda tree: tree.rebuild([["a"] * 3]), TypeError, "numbers"),
    (lambda tree: tree.rebuild(POINTS, workers=0), ValueError, "workers"),
]


@pytest.mark.parametrize("wrong, error, message", WRONG)
def test_what_is_wrong_is_said_and_changes_nothing(wrong, error, message):
    tree = PointTree(POINTS)
    with pytest.raises(error, match=message):
        wrong(tree)
    assert_same(tree, PointTree(POINTS))
    np.testing.assert_array_equal(tree.data, POINTS)


def test_points_outside_of_a_box_change_nothing():
    tree = PointTree(POINTS, boxsize=1)
    with pytest.raises(ValueError, match="inside of the periodic box"):
        tree.rebuild(POINTS + np.float32(0.5))
    with pytest.raises(ValueError, match="sixteen periods"):
        tree.rebuild(POINTS, POINTS * np.float32(40))
    assert_same(tree, PointTree(POINTS, boxsize=1))


@pytest.mark.parametrize("duplicate", [PointTree.copy, copy.copy, copy.deepcopy])
@pytest.mark.parametrize("boxsize", [None, 1])
def test_copies_are_rebuilt_by_themselves(duplicate, boxsize):
    tree = PointTree(POINTS, boxsize=boxsize)
    other = duplicate(tree)
    assert other.rebuild(step(1))
    assert_same(tree, PointTree(POINTS, boxsize=boxsize))
    assert_same(other, PointTree(step(1), boxsize=boxsize))
    np.testing.assert_array_equal(tree.data, POINTS)
    np.testing.assert_array_equal(other.data, step(1))
    third = duplicate(other)
    third.take_order()
    assert_same(other, PointTree(step(1), boxsize=boxsize))


@pytest.mark.parametrize("points, keys", [(POINTS, None), (POINTS, step(9)), (POINTS + FAR, None)], ids=["still", "moving", "f64"])
def test_the_order_of_a_tree(points, keys):
    tree = PointTree(points, keys)
    order = tree.take_order()
    assert order.dtype == np.intp and sorted(order) == list(range(N))
    np.testing.assert_array_equal(tree.data, points[order])
    keys = None if keys is None else keys[order]
    assert_same(tree, PointTree(points[order], keys))
    # Points that follow each other are near each other.
    length = lambda rows: np.linalg.norm(np.diff(rows, axis=0), axis=1).mean()
    assert length(points[order]) < 0.5 * length(points)
    assert tree.rebuild(points[order]) is (points.dtype == np.float32 and keys is None)
    loaded = pickle.loads(pickle.dumps(tree))
    loaded.data = None
    assert sorted(loaded.take_order()) == list(range(N)) and loaded.data is None


def test_a_query_in_progress_goes_on_in_the_tree_as_it_was():
    # So many queries that they are answered in several waves; the rebuild comes in between.
    tree, many = PointTree(POINTS), np.tile(QUERIES, (200, 1))
    for ask in (
        lambda progress: tree.query(many, 3, progress=progress)[0],
        lambda progress: tree.query_ball_point(many, 0.1, progress=progress).ids,
        lambda progress: tree.query_ball_point(many, 0.1, return_length=True, progress=progress),
        lambda progress: tree.closest_approach(many, many, progress=progress)[0],
    ):
        tree.rebuild(POINTS)
        expected, kept = ask(None), []
        found = ask(lambda _: kept.append(tree.rebuild(step(4))))
        np.testing.assert_array_equal(found, expected)
        assert len(kept) >= 2 and not np.array_equal(ask(None), expected)


def test_threads_see_one_step_or_another():
    tree, steps = PointTree(POINTS), [POINTS, step(3)]
    expected = [PointTree(of).query(QUERIES, 3)[0] for of in steps]
    found = answers_during(
        lambda: tree.query(QUERIES, 3)[0], lambda number: tree.rebuild(steps[number % 2], workers=2)
    )
    assert_each_is_one_of(found, expected)


class Busy(PointTree):
    """A tree that another thread rebuilds whenever this one has asked for the number of points."""

    @property
    def n(self):
        before = super().n
        self.rebuild(POINTS)
        return before


@pytest.mark.parametrize("k", [5, [1, 5]], ids=str)
def test_a_query_counts_the_points_of_the_tree_that_it_asks(k):
    found = Busy(POINTS[:2]).query(QUERIES, k)
    expected = [PointTree(of).query(QUERIES, k) for of in (POINTS[:2], POINTS)]
    assert any(np.array_equal(found, of) for of in expected)


def test_boxes_follow():
    tree = PointTree(POINTS)
    tree.rebuild(step(4))
    np.testing.assert_allclose(tree.bounds, [step(4).min(0), step(4).max(0)], atol=1e-5)
    tree.rebuild(POINTS, step(9))
    both = np.concatenate([POINTS, step(9)])
    np.testing.assert_allclose(tree.bounds, [both.min(0), both.max(0)], atol=1e-2)
    assert PointTree(np.empty((0, 3))).bounds is None
