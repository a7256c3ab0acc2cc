"""A drop of fluid falls into a basin: smoothed particle hydrodynamics in fifty lines of numpy.

Each step takes the neighbour lists of all particles, and from them densities, pressures and forces. Writes sph.png: six
moments of the fall, coloured by speed.

After Mueller, Charypar, Gross, "Particle-Based Fluid Simulation for Interactive Applications" (2003).
"""

import time

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from mbkd import PointTree

SPACING = 0.02
RADIUS = 2 * SPACING
MASS = 1000 * SPACING**3
STEP = 4e-4
STIFFNESS, VISCOSITY = 60.0, 0.35
BOX = np.float32([1.0, 0.2, 1.0])


def block(lo, hi):
    axes = [np.arange(a + SPACING / 2, b, SPACING) for a, b in zip(lo, hi)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


basin = block((0, 0, 0), (1.0, 0.2, 0.2))
drop = block((0.3, 0, 0.35), (0.7, 0.2, 0.75))
drop = drop[np.linalg.norm(drop[:, [0, 2]] - (0.5, 0.55), axis=1) < 0.2]
places = np.concatenate([basin, drop]).astype(np.float32)
places += np.random.default_rng(2).normal(0, 0.01 * SPACING, places.shape).astype(np.float32)
places = np.clip(places, 0, BOX)
speeds = np.zeros_like(places)
speeds[len(basin) :, 2] = -1.5


def sums(lists, values):
    """Sums of values over each list."""
    rows = np.repeat(np.arange(len(lists)), lists.counts)
    return np.stack([np.bincount(rows, column, len(lists)) for column in np.atleast_2d(values.T)], axis=-1)


searching = 0.0


def step(places, speeds):
    global searching
    begin = time.perf_counter()
    lists = PointTree(places).neighbor_lists(RADIUS, distances=True, displacements=True)
    searching += time.perf_counter() - begin
    i, j = np.repeat(np.arange(len(places)), lists.counts), lists.ids
    far, way = lists.distances.astype(np.float64), lists.displacements.astype(np.float64)

    poly6 = 315 / (64 * np.pi * RADIUS**9) * (RADIUS**2 - far**2) ** 3
    own = 315 / (64 * np.pi * RADIUS**9) * RADIUS**6
    density = MASS * (sums(lists, poly6)[:, 0] + own)
    pressure = STIFFNESS * np.maximum(density - 1000, 0)

    near = RADIUS - far
    spiky = 45 / (np.pi * RADIUS**6) * near**2 / np.maximum(far, 1e-9)
    push = -MASS * (pressure[i] + pressure[j]) / (2 * density[j]) * spiky
    drag = VISCOSITY * MASS / density[j] * 45 / (np.pi * RADIUS**6) * near
    force = push[:, None] * way + drag[:, None] * (speeds[j] - speeds[i])
    speeds = speeds + STEP * (sums(lists, force) / density[:, None] + (0, 0, -9.81))

    places = places + STEP * speeds
    for wall, out in ((0.0, places < 0), (BOX, places > BOX)):
        speeds = np.where(out, -0.3 * speeds, speeds)
        places = np.where(out, wall, places)
    return places.astype(np.float32), speeds.astype(np.float32)


steps, shots = 1000, 6
figure, axes = plt.subplots(2, 3, figsize=(13, 8), sharex=True, sharey=True, constrained_layout=True)
begin = time.perf_counter()
for number in range(steps + 1):
    if number % (steps // (shots - 1)) == 0:
        axis = axes.flat[number // (steps // (shots - 1))]
        fast = np.linalg.norm(speeds, axis=1)
        drawn = axis.scatter(places[:, 0], places[:, 2], c=fast, s=3, cmap="viridis", vmin=0, vmax=2.5)
        axis.set(title=f"{1000 * number * STEP:.0f} ms", aspect="equal", xlim=(0, 1), ylim=(0, 1))
    places, speeds = step(places, speeds)
spent = time.perf_counter() - begin
figure.colorbar(drawn, ax=axes, label="speed (m/s)", shrink=0.6)
figure.savefig("sph.png", dpi=110)
print(f"{len(places)} particles, {steps} steps in {spent:.0f} s, of which trees and lists took {searching:.1f} s")
print("wrote sph.png")
