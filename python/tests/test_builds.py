"""Long builds tell how far they are, and end where they are told to."""

import os
import signal
import threading
import time

import numpy as np
import pytest
from mbkd import InstanceTree, PhotonMap, PointTree, RayTree

RNG = np.random.default_rng(3)


def surface(progress):
    """Half a million triangles."""
    side = np.linspace(0, 1, 500, dtype=np.float32)
    x, y = np.meshgrid(side, side)
    vertices = np.column_stack([x.ravel(), y.ravel(), np.sin(40 * x * y).ravel()]).astype(np.float32)
    corner = (np.arange(499)[:, None] * 500 + np.arange(499)).ravel()
    faces = np.concatenate([np.column_stack([corner, corner + 1, corner + 500])] * 2)
    return RayTree(vertices, faces, progress=progress)


def flight(structure, dtype=np.float32):
    """Half a million points that move far, and their build."""
    keys = RNG.random((2, 500_000, 3)).astype(dtype)
    return lambda progress: PointTree(keys, structure=structure, progress=progress)


def crowd(progress):
    """Four million points that stand still."""
    return PointTree(RNG.random((4_000_000, 3), dtype=np.float32), progress=progress)


def photons(progress):
    """Two million photons in a cube."""
    positions = RNG.random((2_000_000, 3), dtype=np.float32)
    up = np.tile(np.float32([0, 0, 1]), (len(positions), 1))
    return PhotonMap(positions, up, positions, positions[:, 2], progress=progress)


def instances(progress):
    """A hundred thousand instances of a triangle."""
    triangle = RayTree(np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), [[0, 1, 2]])
    places = RNG.random((2, 100_000, 3)) * 100
    return InstanceTree([triangle], np.zeros(100_000, int), translations=places, progress=progress)


BUILDS = {
    "triangles": surface,
    "points": crowd,
    "time slices": flight("time_slices:32"),
    "k-d tree": flight("kd"),
    "time slices in f64": flight("time_slices:32", np.float64),
    "photons": photons,
    "instances": instances,
}


@pytest.mark.parametrize("build", BUILDS.values(), ids=BUILDS)
def test_an_exception_of_progress_ends_a_build(build):
    def enough(done):
        assert 0 <= done < 1
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        build(enough)


@pytest.mark.parametrize("build", BUILDS.values(), ids=BUILDS)
def test_ctrl_c_ends_a_build(build):
    told, begun = [], threading.Event()

    def hear(done):
        told.append(done)
        begun.set()

    def press():
        begun.wait()
        time.sleep(0.01)  # let the build go on
        os.kill(os.getpid(), signal.SIGINT)

    presser = threading.Thread(target=press)
    presser.start()
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            build(hear)
            pytest.fail("the build went on to its end")
    finally:
        begun.set()
        presser.join()
        signal.signal(signal.SIGINT, before)
    assert told[-1] < 0.9
