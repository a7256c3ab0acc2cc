"""Trees saved, loaded and pickled."""

import multiprocessing
import pickle

import numpy as np
import pytest
from mbkd import PointTree, RayTree

RNG = np.random.default_rng(3)
POINTS = RNG.random((500, 3), dtype=np.float32)
MOVED = POINTS + RNG.normal(0, 0.1, POINTS.shape).astype(np.float32)
QUERIES = RNG.random((50, 3), dtype=np.float32)
TIMES = RNG.random(50)


@pytest.mark.parametrize("structure", ["automatic", "linear", "time_slices:3", "kd"])
def test_point_trees_come_back(structure, tmp_path):
    trees = [PointTree(POINTS), PointTree(POINTS.astype(np.float64) + 0.1)]
    trees += [PointTree(POINTS, keys=MOVED, structure=structure, active=np.tile([0.0, 0.9], (500, 1)))]
    for tree in trees:
        tree.save(tmp_path / "tree")
        for again in (PointTree.load(tmp_path / "tree"), PointTree.load(str(tmp_path / "tree")), pickle.loads(pickle.dumps(tree))):
            assert len(again) == 500
            for new, old in zip(again.query(QUERIES, k=5, time=TIMES), tree.query(QUERIES, k=5, time=TIMES)):
                np.testing.assert_array_equal(new, old)
    assert PointTree.load(tmp_path / "tree", workers=2).data is None
    with pytest.raises(ValueError, match="workers"):
        PointTree.load(tmp_path / "tree", workers=0)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(trees[0])).data, POINTS)


@pytest.mark.parametrize("points", [POINTS, POINTS.astype(np.float64) + 1e-9], ids=["f32", "f64"])
@pytest.mark.parametrize("keys", [None, MOVED], ids=["still", "moving"])
def test_loaded_trees_answer_everything(points, keys, tmp_path):
    tree = PointTree(points, keys=keys)
    tree.save(tmp_path / "tree")
    again = PointTree.load(tmp_path / "tree")
    for ask in (
        lambda of: of.query_pairs(0.2, time=0.5),
        lambda of: of.query_ball_point(QUERIES, 0.2, time=TIMES).ids,
        lambda of: of.count_neighbors(tree, [0.1, 0.2]),
        lambda of: of.neighbor_lists(0.2, sorted=True, distances=True).distances,
        lambda of: of.positions(0.5),
        lambda of: np.stack(of.closest_approach(QUERIES, QUERIES[::-1])),
        lambda of: (repr(of), of.nbytes, of.statistics(), of.n),
    ):
        np.testing.assert_array_equal(ask(again), ask(tree))
    counts = [len(tree.query_ball_point(at, 0.2, time=0.5)[0]) - 1 for at in tree.positions(0.5)]
    assert sum(counts) == 2 * len(tree.query_pairs(0.2, time=0.5))


def test_periodic_trees_are_pickled_only(tmp_path):
    tree = PointTree(POINTS, boxsize=[1, 1, 0])
    with pytest.raises(ValueError, match="pickle"):
        tree.save(tmp_path / "tree")
    again = pickle.loads(pickle.dumps(tree))
    np.testing.assert_array_equal(again.boxsize, tree.boxsize)
    for new, old in zip(again.query(QUERIES, k=5), tree.query(QUERIES, k=5)):
        np.testing.assert_array_equal(new, old)


def test_ray_trees_come_back(tmp_path):
    tree = RayTree(np.stack([POINTS, MOVED]), np.arange(498).reshape(-1, 3))
    tree.save(tmp_path / "tree")
    directions = RNG.normal(0, 1, (50, 3))
    for again in (RayTree.load(tmp_path / "tree"), pickle.loads(pickle.dumps(tree))):
        new, old = (of.closest_hits(QUERIES, directions, time=TIMES) for of in (again, tree))
        np.testing.assert_array_equal(new.t, old.t)
        np.testing.assert_array_equal(new.triangle, old.triangle)
        assert np.isfinite(old.t).any()


def test_what_is_no_tree_is_an_error(tmp_path):
    path = tmp_path / "tree"
    for load in (PointTree.load, RayTree.load):
        with pytest.raises(FileNotFoundError, match="none") as error:
            load(tmp_path / "none")
        assert error.value.filename == str(tmp_path / "none")
        with pytest.raises(IsADirectoryError):
            load(tmp_path)
        path.write_bytes(b"some text, but nothing that was ever a tree")
        with pytest.raises(ValueError, match="not a tree file"):
            load(path)
    PointTree(POINTS).save(path)
    with pytest.raises(ValueError, match="a point tree"):
        RayTree.load(path)
    whole = bytearray(path.read_bytes())
    path.write_bytes(whole[:-1])
    with pytest.raises(ValueError, match="bytes"):
        PointTree.load(path)
    whole[1000] ^= 1
    path.write_bytes(whole)
    with pytest.raises(ValueError, match="damaged"):
        PointTree.load(path)


def ask(tree):
    if isinstance(tree, PointTree):
        return tree.query(QUERIES, k=3)[1]
    return tree.closest_hits(QUERIES, [0, 0, 1]).triangle


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="no fork")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_forked_processes_get_trees_although_their_parent_has_read_some(tmp_path):
    # So many that they are checked by several threads, of which a forked process has none.
    points = RNG.random((200_000, 3), dtype=np.float32)
    triangles = (points[:, None] + np.float32([[0, 0, 0], [0.01, 0, 0], [0, 0.01, 0]])).reshape(-1, 3)
    for tree in (PointTree(points), RayTree(triangles, np.arange(600_000).reshape(-1, 3))):
        tree.save(tmp_path / "tree")
        type(tree).load(tmp_path / "tree")
        with multiprocessing.get_context("fork").Pool(1) as pool:
            np.testing.assert_array_equal(pool.apply_async(ask, (tree,)).get(timeout=60), ask(tree))
