"""Gathers against sums with numpy."""

import numpy as np
import pytest
from mbkd import PhotonMap

RNG = np.random.default_rng(8)
POSITIONS = np.column_stack([RNG.random((3000, 2)), np.zeros(3000)]).astype(np.float32)
TIMES = RNG.random(3000).astype(np.float32)
FLUX = RNG.random((3000, 3)).astype(np.float32)
UP = np.tile(np.float32([0, 0, 1]), (3000, 1))
PLACES = np.column_stack([RNG.random((40, 2)) * 0.6 + 0.2, np.zeros(40)]).astype(np.float32)


def test_a_gather_is_the_sum_of_photons():
    photons = PhotonMap(POSITIONS, UP, FLUX, TIMES)
    when = np.linspace(0.2, 0.8, 40).astype(np.float32)
    found = photons.gather(PLACES, [0, 0, 1], when, radius=0.1, window=0.1)
    for place, time, density, count in zip(PLACES, when, found.density, found.count):
        counted = (np.linalg.norm(POSITIONS - place, axis=1) <= 0.1) & (np.abs(TIMES - time) <= np.float32(0.1))
        assert abs(int(counted.sum()) - count) <= 1, "but for rounding at the edges"
        np.testing.assert_allclose(density, FLUX[counted].sum(0) / (np.pi * 0.1**2 * 0.2), rtol=0.05)
    dense = photons.gather(PLACES, [0, 0, 1], when, radius=0.1, window=0.1, volume=True)
    np.testing.assert_allclose(dense.density * (4 / 3 * 0.1), found.density, rtol=1e-5)
    gray = PhotonMap(POSITIONS, UP, FLUX[:, 0], TIMES).gather(PLACES, [0, 0, 1], when, radius=0.1, window=0.1)
    np.testing.assert_array_equal(gray.density, found.density[:, 0])
    most = photons.gather(PLACES, [0, 0, 1], 0.5, k=20, window=0.3, kernels=("cone", "gaussian"), cosine=0.5, workers=2)
    assert (most.count == 20).all() and most.density.shape == (40, 3)
    assert photons.nbytes >= POSITIONS.nbytes + FLUX.nbytes


def test_a_periodic_box_is_what_images_of_all_photons_are():
    shifts = np.float32([[x, y, 0] for x in (-1, 0, 1) for y in (-1, 0, 1)])
    images = (POSITIONS + shifts[:, None]).reshape(-1, 3)
    count = len(shifts)
    around = PhotonMap(images, np.tile(UP, (count, 1)), np.tile(FLUX, (count, 1)), np.tile(TIMES, count))
    places = np.float32([[0.02, 0.5, 0], [0.98, 0.01, 0], [0.5, 0.5, 0]])
    how = {"time": 0.5, "radius": 0.1, "window": 0.2}
    expected = around.gather(places, [0, 0, 1], **how)
    found = PhotonMap(POSITIONS, UP, FLUX, TIMES, boxsize=[1, 1, 0]).gather(places + [3, -2, 0], [0, 0, 1], **how)
    np.testing.assert_allclose(found.count, expected.count, atol=1, err_msg="but for rounding at the edges")
    np.testing.assert_allclose(found.density, expected.density, rtol=0.05)
    outside = PhotonMap(POSITIONS, UP, FLUX, TIMES).gather(places, [0, 0, 1], **how)
    assert (outside.count[:2] < 0.8 * expected.count[:2]).all() and outside.count[2] == expected.count[2]


# So many places that they are gathered in several parts. One in the last has a normal that is no unit vector.
MANY = np.tile(PLACES, (1000, 1))
NORMALS = np.where(np.arange(len(MANY))[:, None] == 39_007, [0, 0, 2], [0, 0, 1])

WRONG = [
    (lambda: PhotonMap(POSITIONS, UP, FLUX, TIMES + 1), "time"),
    (lambda: PhotonMap(POSITIONS, UP[1:], FLUX, TIMES), "equally many"),
    (lambda: PhotonMap(POSITIONS, UP, FLUX, TIMES, window=0), "window"),
    (lambda: PhotonMap(POSITIONS, UP, FLUX, TIMES, neighbors=-1), "neighbors"),
    (lambda: PhotonMap(POSITIONS, UP, FLUX, TIMES, neighbors=2**40), "neighbors"),
    (lambda: PhotonMap(POSITIONS, UP, FLUX, TIMES, boxsize=-1), "boxsize"),
    (lambda: PhotonMap(POSITIONS, UP, FLUX, TIMES, boxsize=0.01), "sixteen periods"),
    (lambda: PhotonMap(POSITIONS, UP, FLUX, TIMES).gather(PLACES, [0, 0, 1]), "radius"),
    (lambda: PhotonMap(POSITIONS, UP, FLUX, TIMES).gather(PLACES, [0, 0, 1], k=-1), "k must be"),
    (lambda: PhotonMap(POSITIONS, UP, FLUX, TIMES).gather(MANY, NORMALS, k=1, cosine=0), "element 39007: .*normal"),
    (lambda: PhotonMap(POSITIONS, UP, FLUX, TIMES).gather(PLACES, [0, 0, 1], radius=1, kernels=("tent", "box")), "kernel"),
]


def test_what_is_not_a_number_is_said():
    for wrong in (
        lambda: PhotonMap(POSITIONS, UP, ["1"] * len(POSITIONS), TIMES),
        lambda: PhotonMap(POSITIONS, UP, FLUX, ["0.5"] * len(POSITIONS)),
        lambda: PhotonMap(POSITIONS, UP, FLUX, TIMES).gather(PLACES, ["0", "0", "1"], radius=1),
    ):
        with pytest.raises(TypeError, match="must be numbers"):
            wrong()


@pytest.mark.parametrize("wrong, message", WRONG)
def test_what_is_wrong_is_said(wrong, message):
    with pytest.raises(ValueError, match=message):
        wrong()
