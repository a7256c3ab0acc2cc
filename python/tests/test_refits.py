"""Trees refitted to further frames against trees that are built of these frames."""

import copy
import pickle

import numpy as np
import pytest
from asking import answers_during, assert_each_is_one_of
from mbkd import InstanceTree, RayTree, Refit, RefitError

RNG = np.random.default_rng(11)
COUNTS = (700, 300, 40)
FACES = [np.arange(3 * n, dtype=np.uint32).reshape(n, 3) for n in COUNTS]
SPHERES = 60
RAYS = 3000
ORIGINS = np.column_stack([RNG.random((RAYS, 2)), np.full(RAYS, 3.0)])
DIRECTIONS = RNG.normal([0, 0, -1], 0.1, (RAYS, 3)).astype(np.float32)
TIMES = RNG.random(RAYS).astype(np.float32)
START = [(RNG.random((n, 1, 3)) + RNG.normal(0, 0.05, (n, 3, 3))).reshape(3 * n, 3) for n in COUNTS]
SPEED = [RNG.normal(0, 0.05, start.shape) for start in START]
BALLS = RNG.random((SPHERES, 3))


def frame(number, keys=2, kind=np.float32):
    """The meshes of a frame. The first one stands still."""
    times = number + np.linspace(0, 1, keys)
    moving = [np.stack([a + v * t for t in times]).astype(kind) for a, v in zip(START[1:], SPEED[1:])]
    return list(zip([START[0].astype(kind), *moving], FACES))


def balls(number):
    """Centers at two keys, and radii."""
    return np.stack([BALLS + 0.1 * number, BALLS + 0.1 * number + 0.05]), 0.02 + 0.01 * number


def answers(tree, **options):
    """All that rays and nearest points find."""
    hits = tree.closest_hits(ORIGINS, DIRECTIONS, time=TIMES, **options)
    index, every = tree.all_hits(ORIGINS, DIRECTIONS, time=TIMES, **options)
    parts = [getattr(of, name) for of in (hits, every) for name in ("t", "mesh", "triangle", "u", "v")]
    some = tree.intersects_any(ORIGINS, DIRECTIONS, time=TIMES, **options)
    nearest = tree.closest_point(ORIGINS[:300] - [0, 0, 2], time=TIMES[:300], **options)
    return [*parts, index, some, *nearest, tree.triangles(1, np.arange(300), time=0.3)]


def assert_same(tree, other, **options):
    for one, two in zip(answers(tree, **options), answers(other, **options)):
        np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_refitted_tree_answers_as_one_that_is_built(workers, kind, precision):
    tree = RayTree.from_meshes(frame(0, kind=kind), precision=precision)
    for number in range(1, 4):
        now = frame(number, kind=kind)
        refit = tree.refit_meshes(now, workers=workers)
        new = RayTree.from_meshes(now, precision=precision)
        assert_same(tree, new)
        assert isinstance(refit, Refit) and refit.leaves > 0 and refit.skipped == 0
        assert refit.is_worn == (refit.cost > 1.5)
    assert refit.cost > 1
    again = tree.refit_meshes(now)
    assert (again.nodes, again.leaves, again.cost) == (0, 0, refit.cost) and again.kept > 0


def test_a_refitted_tree_is_brute_force():
    before, after = (frame(number)[2] for number in (0, 3))
    tree = RayTree(*before)
    tree.refit(*after)
    open, close = after[0].astype(np.float64)
    checked = 0
    for origin, direction, time, triangle, t in zip(
        ORIGINS, DIRECTIONS.astype(np.float64), TIMES, *_first(tree), strict=True
    ):
        a, b, c = np.moveaxis((open + (close - open) * np.float64(time)).reshape(-1, 3, 3), 1, 0)
        p = np.cross(direction, c - a)
        det = ((b - a) * p).sum(1)
        u, q = ((origin - a) * p).sum(1) / det, np.cross(origin - a, b - a)
        v, at = (q * direction).sum(1) / det, ((c - a) * q).sum(1) / det
        edge = np.minimum(np.minimum(u, v), 1 - u - v)
        if np.abs(edge).min() < 1e-4:
            continue
        checked += 1
        at = np.where((edge > 0) & (at > 0), at, np.inf)
        assert triangle == (np.argmin(at) if np.isfinite(at).any() else -1)
        np.testing.assert_allclose(t, at.min(), rtol=1e-4)
    assert checked > 1000


def _first(tree):
    hits = tree.closest_hits(ORIGINS, DIRECTIONS, time=TIMES)
    assert 50 < (hits.triangle >= 0).sum() < RAYS
    return hits.triangle, hits.t


@pytest.mark.parametrize("workers", [1, 2])
def test_a_refit_of_what_moved_skips_the_rest(workers):
    many = np.concatenate([START[0] + [0.1 * i, 0, 0] for i in range(10)]).astype(np.float32)
    first = [(many, np.arange(len(many)).reshape(-1, 3)), *frame(0)[1:]]
    beside = lambda number: (frame(number)[2][0] * np.float32(0.1) + np.float32([0.3, 0.3, 0.3]), FACES[2])
    tree, told = (RayTree.from_meshes([*first[:2], beside(0)]) for _ in range(2))
    for number in range(1, 4):
        now = [*first[:2], beside(number)]
        refit = tree.refit_meshes(now, workers=workers)
        of_moved = told.refit_meshes(now, moved=[2], workers=workers)
        assert_same(told, tree)
        assert of_moved.cost == refit.cost and of_moved.leaves == refit.leaves > 0
        assert refit.skipped == 0 and of_moved.skipped > 100, of_moved
    # What is not named is not looked at.
    elsewhere = [now[0], (now[1][0] * np.float32(0.5), FACES[1]), now[2]]
    assert told.refit_meshes(elsewhere, moved=[]).leaves == 0
    assert_same(told, tree)
    assert told.refit_meshes(elsewhere, moved=np.array([1])).leaves > 0
    assert_same(told, RayTree.from_meshes(elsewhere))


def test_spheres_move_or_stay():
    options = {"spheres_active": np.tile([0.0, 0.9], (SPHERES, 1))}
    tree = RayTree.from_meshes(frame(0), spheres=balls(0), **options)
    tree.refit_meshes(frame(1))
    assert_same(tree, RayTree.from_meshes(frame(1), spheres=balls(0), **options))
    tree.refit_meshes(frame(1), moved=[], spheres=balls(1), **options)
    assert_same(tree, RayTree.from_meshes(frame(1), spheres=balls(1), **options))
    tree.refit_meshes(frame(2), spheres=balls(2), **options)
    expected = RayTree.from_meshes(frame(2), spheres=balls(2), **options)
    assert_same(tree, expected)
    assert (expected.closest_hits(ORIGINS, DIRECTIONS, time=TIMES).mesh == 3).any()
    masks = 1 << (np.arange(SPHERES) % 3)
    tree.refit_meshes(frame(2), spheres=balls(2), spheres_masks=masks)
    expected = RayTree.from_meshes(frame(2), spheres=balls(2), spheres_masks=masks)
    for mask in (1, 6):
        assert_same(tree, expected, mask=mask)
        hits = tree.closest_hits(ORIGINS, DIRECTIONS, mask=mask)
        assert set(masks[hits.triangle[hits.mesh == 3]]) == {bit for bit in (1, 2, 4) if bit & mask}
    only = RayTree.from_meshes([], spheres=balls(0))
    only.refit_meshes([], spheres=balls(1))
    np.testing.assert_array_equal(
        only.closest_hits(ORIGINS, DIRECTIONS).t, RayTree.from_meshes([], spheres=balls(1)).closest_hits(ORIGINS, DIRECTIONS).t
    )


def test_masks_and_active_intervals_stay_unless_they_are_given():
    masks, active = [1, 2, 4], [(0, 1), (0.25, 0.75), (0, 0.5)]
    tree = RayTree.from_meshes(frame(0), masks=masks, active=active)
    tree.refit_meshes(frame(1))
    new = RayTree.from_meshes(frame(1), masks=masks, active=active)
    for mask in (1, 2, 6):
        assert_same(tree, new, mask=mask)
    shorter = [(0, 1), (0.5, 0.75), (0, 0.5)]
    tree.refit_meshes(frame(1), masks=[4, 2, 1], active=shorter)
    tree.copy().refit_meshes(frame(3), masks=[7, 7, 7])
    tree.refit_meshes(frame(2))
    new = RayTree.from_meshes(frame(2), masks=[4, 2, 1], active=shorter)
    for mask in (1, 2, 6):
        assert_same(tree, new, mask=mask)
    one = RayTree(*frame(0)[2], active=(0, 0.5))
    one.refit(*frame(1)[2])
    assert not one.intersects_any(ORIGINS, DIRECTIONS, time=0.75).any()
    assert one.intersects_any(ORIGINS, DIRECTIONS, time=0.25).any()
    one.refit(*frame(1)[2], active=(0, 0.25))
    assert not one.intersects_any(ORIGINS, DIRECTIONS, time=0.25).any()


def test_kept_keys_have_a_place_in_later_frames():
    still, faces = START[2].astype(np.float32), FACES[2]
    bent = np.stack([still, still + np.float32([0, 0, 1]), still])
    straight = np.stack([still, still + np.float32([0, 0, 0.5]), still + np.float32([0, 0, 1])])
    tree = RayTree(straight, faces)
    with pytest.raises(RefitError, match="mesh 0 needs 3 keys.*built for 2.*keep_keys"):
        tree.refit(bent, faces)
    tree.refit(straight[[0, 2]], faces)
    tree.refit(still, faces)
    for keep in (True, [True]):
        kept = RayTree.from_meshes([(straight, faces)], keep_keys=keep)
        for now in (bent, straight, still):
            kept.refit(now, faces)
            np.testing.assert_array_equal(*(_first(of)[1] for of in (kept, RayTree(now, faces, keep_keys=True))))
    both = RayTree.from_meshes([(straight, faces)] * 2, keep_keys=[False, True])
    both.refit_meshes([(straight, faces), (bent, faces)])
    with pytest.raises(RefitError, match="mesh 0"):
        both.refit_meshes([(bent, faces), (bent, faces)])
    assert RayTree(straight, faces, keep_keys=True).nbytes > tree.nbytes


WORN = frame(2)
REFUSED = [
    (lambda tree: tree.refit(*WORN[0]), "built of 3 meshes, not of 1"),
    (lambda tree: tree.refit_meshes([WORN[0], WORN[1], (WORN[2][0], FACES[2][::-1])]), "mesh 2 has other triangles"),
    (lambda tree: tree.refit_meshes([WORN[0], WORN[1], (WORN[2][0], FACES[2][:-1])]), "mesh 2 has other triangles"),
    (lambda tree: tree.refit_meshes(WORN, spheres=([[0, 0, 0]], 1)), "built of 60 spheres, not of 1"),
    (lambda tree: RayTree.from_meshes(frame(0), precision="float64").refit_meshes([]), "3 meshes"),
    (lambda tree: pickle.loads(pickle.dumps(tree)).refit_meshes(WORN), "loaded or unpickled"),
]


@pytest.fixture(scope="module")
def tree():
    return RayTree.from_meshes(frame(0), spheres=balls(0))


@pytest.mark.parametrize("wrong, message", REFUSED)
def test_what_a_tree_has_no_place_for_is_refused(tree, wrong, message):
    with pytest.raises(RefitError, match=message) as error:
        wrong(tree)
    assert isinstance(error.value, ValueError)
    assert_same(tree, RayTree.from_meshes(frame(0), spheres=balls(0)))


NOT_FINITE = (np.where(np.arange(120)[:, None] == 7, np.nan, START[2]), FACES[2])
WRONG = [
    (lambda tree: tree.refit_meshes([*WORN[:2], NOT_FINITE]), ValueError, "vertex 7"),
    (lambda tree: tree.refit_meshes([*WORN[:2], (WORN[2][0][:, :50], FACES[2])]), ValueError, "vertex"),
    (lambda tree: tree.refit_meshes(WORN, spheres=(BALLS * np.inf, 1)), ValueError, "^sphere 0 is not finite"),
    (lambda tree: tree.refit_meshes(WORN, moved=[3]), ValueError, "mesh 3 is named as moved, but there are only 3"),
    (lambda tree: tree.refit_meshes(WORN, moved=[-1]), ValueError, "moved"),
    (lambda tree: tree.refit_meshes(WORN, moved=[True, False, False]), TypeError, "moved must be whole numbers"),
    (lambda tree: tree.refit_meshes(WORN, moved=[0.0]), TypeError, "moved must be whole numbers"),
    (lambda tree: tree.refit_meshes(WORN, masks=[1]), ValueError, "3 meshes and 1 masks"),
    (lambda tree: tree.refit_meshes(WORN, active=[(0, 1)]), ValueError, "3 meshes and 1 active"),
    (lambda tree: tree.refit_meshes(WORN, active=[(0, 1), (1, 0), (0, 1)]), ValueError, "mesh 1.*interval"),
    (lambda tree: tree.refit_meshes(WORN, spheres_active=[(0, 1)]), ValueError, "spheres_active without spheres"),
    (lambda tree: tree.refit_meshes(WORN, spheres_masks=[1]), ValueError, "spheres_masks without spheres"),
    (lambda tree: tree.refit_meshes(WORN, spheres=balls(1), spheres_masks=[1]), ValueError, "spheres_masks must have the shape"),
    (lambda tree: tree.refit_meshes(WORN, spheres=balls(1), spheres_masks=[-1] * SPHERES), ValueError, "32 bits"),
    (lambda tree: tree.refit_meshes(WORN, spheres=balls(1), spheres_masks=[0.5] * SPHERES), TypeError, "whole numbers"),
    (lambda tree: tree.refit_meshes(WORN, workers=0), ValueError, "workers"),
    (lambda tree: tree.refit_meshes([vertices for vertices, _ in WORN]), TypeError, "pair"),
    (lambda tree: tree.refit(WORN[0][0], FACES[0] + 0.5), TypeError, "faces"),
    (lambda tree: RayTree(*WORN[0], precision="half"), ValueError, "precision must be"),
    (lambda tree: RayTree.from_meshes(WORN, keep_keys=[True]), ValueError, "3 meshes and 1 elements of keep_keys"),
]


@pytest.mark.parametrize("wrong, error, message", WRONG)
def test_what_is_wrong_is_said_and_changes_nothing(tree, wrong, error, message):
    with pytest.raises(error, match=message) as found:
        wrong(tree)
    assert not isinstance(found.value, RefitError)
    assert_same(tree, RayTree.from_meshes(frame(0), spheres=balls(0)))


@pytest.mark.parametrize("duplicate", [RayTree.copy, copy.copy, copy.deepcopy])
def test_copies_are_refitted_by_themselves(duplicate):
    tree = RayTree.from_meshes(frame(0))
    other = duplicate(tree)
    other.refit_meshes(frame(1))
    assert_same(tree, RayTree.from_meshes(frame(0)))
    assert_same(other, RayTree.from_meshes(frame(1)))
    third = duplicate(other)
    other.refit_meshes(frame(2))
    third.refit_meshes([frame(1)[0], frame(1)[1], frame(3)[2]], moved=[2])
    assert_same(third, RayTree.from_meshes([frame(1)[0], frame(1)[1], frame(3)[2]]))
    assert_same(other, RayTree.from_meshes(frame(2)))


def test_instances_keep_the_tree_that_they_were_made_of():
    tree = RayTree.from_meshes(frame(0))
    places = [[0, 0, 0], [0.3, 0, -2]]
    placed = InstanceTree([tree], [0, 0], translations=places)
    tree.refit_meshes(frame(3))
    before, after = (InstanceTree([RayTree.from_meshes(frame(n))], [0, 0], translations=places) for n in (0, 3))
    t = lambda of: of.closest_hits(ORIGINS, DIRECTIONS, time=TIMES).t
    np.testing.assert_array_equal(t(placed), t(before))
    np.testing.assert_array_equal(t(InstanceTree([tree], [0, 0], translations=places)), t(after))
    assert (t(before) != t(after)).any()


def test_a_query_in_progress_goes_on_in_the_tree_as_it_was():
    # So many rays that they are answered in several blocks; the refit comes in between.
    tree = RayTree.from_meshes(frame(0))
    many = [np.tile(rows, (60, 1)) for rows in (ORIGINS, DIRECTIONS)]
    times, refits = np.tile(TIMES, 60), []
    expected = tree.closest_hits(*many, time=times)
    found = tree.closest_hits(*many, time=times, progress=lambda _: refits.append(tree.refit_meshes(frame(3))))
    assert len(refits) >= 2 and refits[1].leaves == 0
    np.testing.assert_array_equal(found.t, expected.t)
    np.testing.assert_array_equal(found.triangle, expected.triangle)
    assert_same(tree, RayTree.from_meshes(frame(3)))


def test_threads_see_one_frame_or_another():
    tree, frames = RayTree.from_meshes(frame(0)), [frame(0), frame(3)]
    expected = [RayTree.from_meshes(of).closest_hits(ORIGINS, DIRECTIONS, time=TIMES).t for of in frames]
    assert (expected[0] != expected[1]).any()
    found = answers_during(
        lambda: tree.closest_hits(ORIGINS, DIRECTIONS, time=TIMES, workers=2).t,
        lambda number: tree.refit_meshes(frames[number % 2], workers=2),
    )
    assert_each_is_one_of(found, expected)
    np.testing.assert_array_equal(tree.closest_hits(ORIGINS, DIRECTIONS, time=TIMES).t, expected[0])


def test_boxes_follow():
    tree = RayTree(*frame(0)[2])
    tree.refit(frame(0)[2][0] + np.float32(4), FACES[2])
    moved = (frame(0)[2][0] + np.float32(4)).reshape(-1, 3)
    np.testing.assert_allclose(tree.bounds, [moved.min(0), moved.max(0)], atol=1e-4)
    assert tree.bounds.shape == (2, 3) and (tree.bounds[0] <= moved.min(0)).all() and (tree.bounds[1] >= moved.max(0)).all()
    placed = InstanceTree([tree], [0], translations=[[1, 2, 3]])
    np.testing.assert_allclose(placed.bounds, tree.bounds + [1, 2, 3], atol=1e-3)
    assert RayTree.from_meshes([]).bounds is None and InstanceTree([], []).bounds is None
