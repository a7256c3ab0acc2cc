"""Neighbour lists against queries one by one."""

import numpy as np
import pytest
from mbkd import PointTree, certified_duration

RNG = np.random.default_rng(6)
OPEN = RNG.random((400, 3), dtype=np.float32)
CLOSE = OPEN + RNG.normal(0, 0.2, (400, 3)).astype(np.float32)


def close_pairs(positions, r):
    d = positions.astype(np.float32)[None] - positions.astype(np.float32)[:, None]
    square = (d[..., 0] * d[..., 0] + d[..., 1] * d[..., 1]) + d[..., 2] * d[..., 2]
    near = square <= np.float32(r) * np.float32(r)
    np.fill_diagonal(near, False)
    return near, np.sqrt(square), d


@pytest.mark.parametrize("time", [0.0, 0.37, 1.0])
@pytest.mark.parametrize("workers", [1, 2])
def test_lists_are_brute_force(time, workers):
    tree = PointTree(OPEN, keys=CLOSE)
    near, far, ways = close_pairs(tree.positions(time), 0.15)
    lists = tree.neighbor_lists(0.15, time=time, distances=True, displacements=True, sorted=True, workers=workers)
    assert [row.tolist() for row in lists] == [np.flatnonzero(row).tolist() for row in near]
    i, j = lists.pairs().T
    np.testing.assert_array_equal(lists.distances, far[i, j])
    np.testing.assert_array_equal(lists.displacements, ways[i, j])
    assert lists.ids.dtype == np.int32 and lists.offsets[-1] == len(lists.ids)

    tree_order = tree.neighbor_lists(0.15, time=time, sorted=True, rows="tree")
    assert {p: row.tolist() for p, row in zip(tree_order.points.tolist(), tree_order)} == dict(enumerate(row.tolist() for row in lists))
    once = tree.neighbor_lists(0.15, time=time, pairs_once=True).pairs()
    assert set(map(tuple, once.tolist())) == set(zip(*np.nonzero(np.triu(near))))
    np.testing.assert_array_equal(tree.query_pairs(0.15, time=time), np.argwhere(np.triu(near)))


def test_own_radii_and_another_set():
    tree, other = PointTree(OPEN), PointTree(CLOSE[:50])
    radii = RNG.random(400).astype(np.float32) * 0.2
    d = np.linalg.norm(OPEN[None].astype(np.float64) - OPEN[:, None], axis=2) + np.eye(400) * 9
    own, larger = d <= radii[:, None], d <= np.maximum(radii[:, None], radii)
    assert [row.tolist() for row in tree.neighbor_lists(radii, sorted=True)] == [np.flatnonzero(r).tolist() for r in own]
    lists = tree.neighbor_lists(radii, larger=True, sorted=True)
    assert [row.tolist() for row in lists] == [np.flatnonzero(r).tolist() for r in larger]
    lists = tree.neighbor_lists(radii, summed=True, sorted=True)
    touching = d <= radii[:, None] + radii
    assert [row.tolist() for row in lists] == [np.flatnonzero(r).tolist() for r in touching]
    equal = [row.tolist() for row in tree.neighbor_lists(0.1, summed=True, sorted=True)]
    assert equal == [row.tolist() for row in tree.neighbor_lists(0.2, sorted=True)]
    with pytest.raises(ValueError, match="not both"):
        tree.neighbor_lists(radii, larger=True, summed=True)
    for both in ({"larger": True}, {"summed": True}):
        with pytest.raises(ValueError, match="those of both sets"):
            tree.neighbor_lists(radii, among=other, **both)
    walls = RNG.random(50).astype(np.float32) * 0.2
    apart = np.linalg.norm(CLOSE[None, :50].astype(np.float64) - OPEN[:, None], axis=2)
    for own, others in ((radii, walls), (0.05, walls), (radii, 0.05), (0.05, 0.1)):
        a, b = np.broadcast_to(own, 400)[:, None], np.broadcast_to(others, 50)
        for kind, reach in (({"larger": True}, np.maximum(a, b)), ({"summed": True}, a + b)):
            lists = tree.neighbor_lists(own, among=other, r_among=others, sorted=True, **kind)
            assert [row.tolist() for row in lists] == [np.flatnonzero(r).tolist() for r in apart <= reach]
            swept = tree.neighbor_lists_swept(own, (0, 0.5), among=other, r_among=others, **kind)
            np.testing.assert_array_equal(swept.ids, lists.ids)
    for wrong, message in (
        ({"r_among": walls, "summed": True}, "r_among has the radii"),
        ({"r_among": walls, "among": other}, "r_among has the radii"),
        ({"r_among": walls[1:], "among": other, "summed": True}, r"r_among must be one radius or have the shape \(50,\)"),
        ({"r_among": -walls, "among": other, "summed": True}, "negative or NaN"),
        ({"r_among": walls, "among": other, "summed": True, "larger": True}, "not both"),
    ):
        for ask in (tree.neighbor_lists, tree.neighbor_lists_swept, lambda r, **how: tree.neighbor_lists_with_skin(r, 0.1, **how)):
            with pytest.raises(ValueError, match=message):
                ask(radii, **wrong)
    among = tree.neighbor_lists(0.1, among=other, sorted=True)
    expected = other.query_ball_point(OPEN, 0.1)
    assert [row.tolist() for row in among] == [row.tolist() for row in expected]


def test_periodic_lists_are_those_of_queries():
    tree = PointTree(OPEN, boxsize=1)
    lists = tree.neighbor_lists(0.2, sorted=True, displacements=True)
    balls = tree.query_ball_point(OPEN, 0.2)
    assert [row.tolist() for row in lists] == [[j for j in row if j != i] for i, row in enumerate(balls)]
    assert np.abs(lists.displacements).max() <= 0.2


def test_a_limit_of_neighbours():
    tree = PointTree(OPEN)
    lists = tree.neighbor_lists(0.2, sorted=True)
    most = np.diff(lists.offsets).max()
    limited = tree.neighbor_lists(0.2, sorted=True, max_neighbors=most)
    np.testing.assert_array_equal(limited.ids, lists.ids)
    with pytest.raises(ValueError, match="more neighbours"):
        tree.neighbor_lists(0.2, max_neighbors=most - 1)
    assert len(tree.neighbor_lists(0.2, max_neighbors=2**32).ids) == len(lists.ids)
    many = np.tile(OPEN, (10, 1))
    for box in (None, 1):
        tree = PointTree(OPEN, boxsize=box)
        lists = tree.query_ball_point(many, 0.2)
        most = int(lists.counts.max())
        np.testing.assert_array_equal(tree.query_ball_point(many, 0.2, max_neighbors=most).ids, lists.ids)
        first = int(np.argmax(lists.counts == most))
        for workers in (1, 2):
            with pytest.raises(ValueError, match=f"query {first} has more neighbours than `max_neighbors`"):
                tree.query_ball_point(many, 0.2, max_neighbors=most - 1, workers=workers)


# In float64, so far away that float32 does not tell the points from each other.
FAR = np.array([1e9, -2e9, 3e9])


@pytest.mark.parametrize("keys", [(OPEN, CLOSE), (OPEN + FAR, CLOSE + FAR)], ids=["f32", "f64"])
def test_swept_lists_are_all_that_meet(keys):
    first, last = keys
    tree = PointTree(first, keys=last)
    met = tree.neighbor_lists_swept(0.1)
    a, way = (x.astype(np.float64)[:, None] - x.astype(np.float64)[None] for x in keys)
    way = way - a
    with np.errstate(invalid="ignore", divide="ignore"):
        t = np.clip(-(a * way).sum(2) / (way * way).sum(2), 0, 1)
    least = np.linalg.norm(a + way * t[..., None], axis=2)
    np.fill_diagonal(least, 9)
    assert [row.tolist() for row in met] == [np.flatnonzero(row <= 0.1).tolist() for row in least]
    assert len(met.ids) > len(tree.neighbor_lists(0.1).ids)
    np.testing.assert_array_equal(met.counts, np.diff(met.offsets))
    np.testing.assert_array_equal(met.pairs(), np.argwhere(least <= 0.1))
    points, others = met.pairs().T
    np.testing.assert_allclose(met.distances, least[points, others], atol=1e-6)
    assert (met.enter <= met.closest).all() and (met.closest <= met.leave).all()
    most = int(np.diff(met.offsets).max())
    assert len(tree.neighbor_lists_swept(0.1, max_neighbors=most)) == len(met)
    with pytest.raises(ValueError, match="max_neighbors"):
        tree.neighbor_lists_swept(0.1, max_neighbors=most - 1)
    radii = RNG.random(400).astype(np.float32) * np.float32(0.1)
    touching = tree.neighbor_lists_swept(radii, summed=True, pairs_once=True)
    reach = (radii[:, None] + radii[None]).astype(np.float64)
    sure = np.abs(least - reach) > 1e-7
    for i, row in enumerate(touching):
        expected = np.flatnonzero((least[i] <= reach[i]) & (np.arange(400) > i) & sure[i])
        assert row[sure[i][row]].tolist() == expected.tolist()
    part = tree.neighbor_lists_swept(0.1, (0.25, 0.5))
    assert 0 < len(part.ids) < len(met.ids)


@pytest.mark.parametrize("keys", [(OPEN, CLOSE), (OPEN + FAR, CLOSE + FAR)], ids=["f32", "f64"])
def test_lists_with_a_skin_miss_nothing_until_they_say(keys):
    first, last = keys
    tree = PointTree(first, keys=last)
    lists = tree.neighbor_lists_with_skin(0.1, 0.05, time=0.25)
    assert 0.25 < lists.valid_until < 1
    listed = {(int(p), int(j)) for p, row in enumerate(lists) for j in row}
    for time in np.linspace(0.25, np.nextafter(np.float32(lists.valid_until), np.float32(0)), 20):
        assert set(map(tuple, tree.query_pairs(0.1, time=time).tolist())) <= listed
    assert 0 < certified_duration(0.1, 0.05, 2.0) <= 0.0125
    still = PointTree(first).neighbor_lists_with_skin(0.1, 0.05)
    assert still.valid_until == 1


@pytest.mark.parametrize("far", [0, FAR], ids=["f32", "f64"])
def test_swept_lists_and_skins_among_another_set(far):
    # One set of both, with two keys, has the pairs of the two sets, which have one and two.
    one, wall = PointTree(OPEN + far, keys=CLOSE + far), PointTree(CLOSE[:50] + far)
    both = PointTree(np.concatenate([OPEN, CLOSE[:50]]) + far, keys=np.concatenate([CLOSE, CLOSE[:50]]) + far)
    met, of_both = one.neighbor_lists_swept(0.1, among=wall), both.neighbor_lists_swept(0.1)
    expected = [of_both[i][of_both[i] >= 400] - 400 for i in range(400)]
    assert [row.tolist() for row in met] == [row.tolist() for row in expected] and len(met.ids) > 100
    of_walls = np.concatenate([of_both.enter[slice(*of_both.offsets[i : i + 2])][of_both[i] >= 400] for i in range(400)])
    np.testing.assert_allclose(met.enter, of_walls, atol=1e-6)
    lists = one.neighbor_lists_with_skin(0.1, 0.05, time=0.25, among=wall, sorted=True, distances=True, displacements=True)
    at_once = one.neighbor_lists(np.float32(0.1) + np.float32(0.05), time=0.25, among=wall, sorted=True, distances=True, displacements=True)
    for name in ("offsets", "ids", "distances", "displacements"):
        np.testing.assert_array_equal(getattr(lists, name), getattr(at_once, name))
    assert 0.25 < lists.valid_until < 1
    listed = set(map(tuple, lists.pairs().tolist()))
    for time in np.linspace(0.25, np.nextafter(np.float32(lists.valid_until), np.float32(0)), 20):
        assert set(map(tuple, one.neighbor_lists(0.1, time=time, among=wall).pairs().tolist())) <= listed
    first = one.neighbor_lists_swept(0.1, (lists.valid_until, 1), among=wall)
    assert set(map(tuple, np.column_stack([np.repeat(np.arange(400), np.diff(first.offsets)), first.ids]).tolist())) - listed
    for wrong in ({"summed": True}, {"larger": True}):
        with pytest.raises(ValueError, match="those of both sets"):
            one.neighbor_lists_swept(np.full(400, 0.1), among=wall, **wrong)
    for ask in (one.neighbor_lists_swept, lambda r, among: one.neighbor_lists_with_skin(r, 0.1, among=among)):
        with pytest.raises(TypeError, match="among must be a PointTree"):
            ask(0.1, among=OPEN)
        with pytest.raises(ValueError, match="float64 and the other in float32"):
            ask(0.1, among=PointTree(OPEN, precision="float32" if np.any(far) else "float64"))


@pytest.mark.parametrize("kind", [{}, {"larger": True}, {"summed": True}], ids=["own", "larger", "summed"])
@pytest.mark.parametrize("boxsize", [None, 1.5])
def test_lists_with_a_skin_and_radii_of_their_own_miss_nothing_until_they_say(kind, boxsize):
    tree = PointTree(OPEN, keys=CLOSE, boxsize=boxsize)
    radii = RNG.uniform(0.02, 0.12, len(OPEN)).astype(np.float32)
    lists = tree.neighbor_lists_with_skin(radii, 0.04, time=0.25, **kind)
    assert 0.25 < lists.valid_until < 1
    listed = set(map(tuple, lists.pairs().tolist()))
    longer = radii + np.float32(0.02 if kind.get("summed") else 0.04)
    assert listed == set(map(tuple, tree.neighbor_lists(longer, time=0.25, **kind).pairs().tolist()))
    for time in np.linspace(0.25, np.nextafter(np.float32(lists.valid_until), np.float32(0)), 20):
        assert set(map(tuple, tree.neighbor_lists(radii, time=time, **kind).pairs().tolist())) <= listed
    # A pair that comes within its radius soon afterwards is missing.
    later = tree.neighbor_lists_swept(radii, (0.25, min(lists.valid_until + 1e-4, 1)), **kind)
    pairs = np.column_stack([np.repeat(np.arange(len(OPEN)), np.diff(later.offsets)), later.ids])
    assert set(map(tuple, pairs.tolist())) - listed
    for wrong in ({"skin": -0.01}, {"skin": np.nan}):
        with pytest.raises(ValueError, match="negative or NaN"):
            tree.neighbor_lists_with_skin(radii, **wrong, **kind)


@pytest.mark.parametrize("kind", [{"larger": True}, {"summed": True}], ids=["larger", "summed"])
def test_lists_with_a_skin_among_others_with_radii_of_their_own(kind):
    tree, wall = PointTree(OPEN, keys=CLOSE), PointTree(CLOSE[:50])
    own, others = (RNG.uniform(0.02, 0.12, n).astype(np.float32) for n in (400, 50))
    how = {"among": wall, **kind}
    lists = tree.neighbor_lists_with_skin(own, 0.04, time=0.25, r_among=others, **how)
    assert 0.25 < lists.valid_until < 1
    listed, skin = set(map(tuple, lists.pairs().tolist())), np.float32(0.02 if kind.get("summed") else 0.04)
    assert listed == set(map(tuple, tree.neighbor_lists(own + skin, time=0.25, r_among=others + skin, **how).pairs().tolist()))
    for time in np.linspace(0.25, np.nextafter(np.float32(lists.valid_until), np.float32(0)), 20):
        assert set(map(tuple, tree.neighbor_lists(own, time=time, r_among=others, **how).pairs().tolist())) <= listed
    # A pair that comes within its radius soon afterwards is missing.
    later = tree.neighbor_lists_swept(own, (0.25, min(lists.valid_until + 1e-4, 1)), r_among=others, **how)
    pairs = np.column_stack([np.repeat(np.arange(400), np.diff(later.offsets)), later.ids])
    assert set(map(tuple, pairs.tolist())) - listed


def test_options_of_lists_with_a_skin():
    tree = PointTree(OPEN, keys=CLOSE)
    usual, most = tree.neighbor_lists_with_skin(0.1, 0.05), tree.neighbor_lists(0.15).counts.max()
    once = tree.neighbor_lists_with_skin(0.1, 0.05, pairs_once=True, max_neighbors=int(most))
    assert once.valid_until == usual.valid_until and 2 * len(once.ids) == len(usual.ids)
    assert usual.distances is None and usual.displacements is None
    with pytest.raises(ValueError, match="max_neighbors"):
        tree.neighbor_lists_with_skin(0.1, 0.05, max_neighbors=int(most) - 1)
    for wrong in ((-1, 0.1), (np.nan, 0.1), (0.1, -0.05), (0.1, np.nan)):
        with pytest.raises(ValueError, match="negative or NaN"):
            tree.neighbor_lists_with_skin(*wrong)
    for until in (-0.5, 0.1, 2, np.nan):
        with pytest.raises(ValueError, match="until"):
            tree.neighbor_lists_with_skin(0.1, 0.05, time=0.25, until=until)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_swept_lists_and_skins_in_periodic_boxes_are_those_of_copies(kind):
    # Multiples of 1/1024, so that copies of them are exact.
    first = np.floor(RNG.random((300, 3)) * 1024).astype(kind) / 1024
    last = first + np.floor(RNG.random((300, 3)) * 256 - 128).astype(kind) / 1024
    tree = PointTree(first, keys=last, boxsize=1, precision="float64" if kind is np.float64 else "float32")
    shifts = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)], dtype=kind)
    shifts = shifts[np.argsort(np.abs(shifts).sum(axis=1), kind="stable")]
    copies = [(key[None] + shifts[:, None]).reshape(-1, 3) for key in (first, last)]
    among = PointTree(copies[0], keys=copies[1])
    met, of_copies = tree.neighbor_lists_swept(0.08), among.neighbor_lists_swept(0.08)
    for i in range(300):
        assert met[i].tolist() == sorted(set((of_copies[i] % 300).tolist()) - {i})
    lists = tree.neighbor_lists_with_skin(0.05, 0.02, time=0.25)
    assert 0.25 <= lists.valid_until <= 1
    listed = {(int(p), int(j)) for p, row in enumerate(lists) for j in row}
    for time in np.linspace(0.25, np.nextafter(np.float32(lists.valid_until), np.float32(0)), 5):
        pairs = tree.neighbor_lists(0.05, time=time)
        assert {(p, int(j)) for p, row in enumerate(pairs) for j in row} <= listed


def test_lists_of_points_that_do_not_exist_are_empty():
    active = np.tile(np.float32([0, 1]), (400, 1))
    active[::2] = [0, 0.5]
    tree = PointTree(OPEN, active=active)
    lists = tree.neighbor_lists(0.2, time=0.75)
    assert len(lists) == 400 and not lists.counts[::2].any() and (lists.ids % 2 == 1).all()
    assert repr(lists).startswith("<NeighborLists") and lists[-1].tolist() == lists[399].tolist()
    with pytest.raises(IndexError):
        lists[400]
    assert lists.to_objects()[1] == lists[1].tolist()


@pytest.mark.parametrize("box", [None, 1.0, [0.3, 0, 0.7]])
def test_lists_of_float64_points(box):
    rng = np.random.default_rng(5)
    size = np.broadcast_to(1.0 if box is None else np.where(np.float64(box) > 0, box, 1.0), 3)
    places = rng.random((500, 3)) * size
    tree = PointTree(places, boxsize=box)
    way = places[None] - places[:, None]
    if box is not None:
        length = np.broadcast_to(np.float64(box), 3)
        way -= np.where(length > 0, np.round(way / np.where(length > 0, length, 1)) * length, 0)
    far = np.linalg.norm(way, axis=2) + np.eye(500) * 9
    radii = rng.random(500) * 0.1
    for lists, reach in [
        (tree.neighbor_lists(0.13, distances=True, displacements=True, sorted=True), np.float64(0.13)),
        (tree.neighbor_lists(radii, summed=True, distances=True, displacements=True, sorted=True), radii[:, None] + radii),
        (tree.neighbor_lists(radii, larger=True, distances=True, displacements=True, sorted=True), np.maximum(radii[:, None], radii)),
    ]:
        rows, columns = np.nonzero(far <= reach)
        assert np.array_equal(lists.ids, columns)
        assert np.array_equal(np.diff(lists.offsets), np.bincount(rows, minlength=500))
        assert np.allclose(lists.distances, far[rows, columns], rtol=1e-6)
        assert np.allclose(lists.displacements, way[rows, columns], rtol=1e-6, atol=1e-12)
    pairs = tree.query_pairs(0.13)
    assert {tuple(pair) for pair in pairs} == {(i, j) for i, j in zip(*np.nonzero(far <= 0.13)) if i < j}
