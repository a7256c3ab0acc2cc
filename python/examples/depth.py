"""A motion-blurred depth picture: a torus turns over a wavy floor while the shutter is open.

Every ray has a time of its own. Writes depth.png: one sharp moment, the mean depth over the shutter, and how much of the
time the torus covers each pixel.
"""

import time

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from mbkd import RayTree

WIDTH, HEIGHT, SAMPLES, KEYS = 480, 300, 32, 9


def grid(rows, columns, closed):
    """Triangles of a grid of vertices, which may close around both ways."""
    i, j = np.meshgrid(np.arange(rows if closed else rows - 1), np.arange(columns if closed else columns - 1), indexing="ij")
    at = lambda i, j: (i % rows) * columns + j % columns
    a, b, c, d = at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)
    return np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])


u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 160, endpoint=False), np.linspace(0, 2 * np.pi, 60, endpoint=False), indexing="ij")
ring = 1 + 0.32 * np.cos(v)
torus = np.stack([ring * np.cos(u), 0.32 * np.sin(v), ring * np.sin(u)], axis=-1).reshape(-1, 3)


def turned(t):
    angle = 0.2 + 0.9 * t
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    return torus @ turn.T + (0.8 * (t - 0.5), 0.2, 1.35)


x, y = np.meshgrid(np.linspace(-6, 6, 200), np.linspace(-4, 9, 200), indexing="ij")
floor = np.stack([x, y, 0.15 * np.sin(2 * x) * np.sin(2 * y)], axis=-1).reshape(-1, 3)
moving = np.stack([turned(t) for t in np.linspace(0, 1, KEYS)]).astype(np.float32)

begin = time.perf_counter()
tree = RayTree.from_meshes([(moving, grid(160, 60, True)), (floor.astype(np.float32), grid(200, 200, False))])
print(f"{tree!r} built in {time.perf_counter() - begin:.2f} s")

eye, ahead = np.array([0.0, -5.0, 2.4]), np.array([0.0, 5.0, -1.1])
ahead /= np.linalg.norm(ahead)
right = np.cross(ahead, (0, 0, 1))
right /= np.linalg.norm(right)
up = np.cross(right, ahead)
rng = np.random.default_rng(3)


def look(times):
    """Depths and meshes of a picture, one ray per pixel at its time, through a random place in the pixel."""
    px, py = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    jitter = rng.random((2, HEIGHT, WIDTH))
    sx = (2 * (px + jitter[0]) / WIDTH - 1) * 0.62
    sy = (1 - 2 * (py + jitter[1]) / HEIGHT) * 0.62 * HEIGHT / WIDTH
    directions = (ahead + sx[..., None] * right + sy[..., None] * up).reshape(-1, 3)
    origins = np.broadcast_to(eye, directions.shape)
    hits = tree.closest_hits(origins, directions, time=times)
    return hits.t.reshape(HEIGHT, WIDTH), hits.mesh.reshape(HEIGHT, WIDTH)


begin = time.perf_counter()
sharp = look(np.float32(0.5))[0]
total, torus_share = np.zeros((HEIGHT, WIDTH)), np.zeros((HEIGHT, WIDTH))
for sample in range(SAMPLES):
    # Stratified: each ray of a pixel has its own part of the shutter.
    times = ((sample + rng.random(WIDTH * HEIGHT)) / SAMPLES).astype(np.float32)
    depth, mesh = look(times)
    total += 1 / depth
    torus_share += mesh == 0
spent = time.perf_counter() - begin
rays = (SAMPLES + 1) * WIDTH * HEIGHT
print(f"{rays / 1e6:.1f} M rays in {spent:.1f} s, {rays / spent / 1e6:.2f} M rays/s")

figure, axes = plt.subplots(1, 3, figsize=(15, 3.6), constrained_layout=True)
for axis, image, title, colors in (
    (axes[0], 1 / sharp, "A ray per pixel, all at the middle of the shutter", "magma"),
    (axes[1], total / SAMPLES, f"{SAMPLES} rays per pixel, each at a time of its own", "magma"),
    (axes[2], torus_share / SAMPLES, "Share of the shutter that the torus covers", "gray"),
):
    drawn = axis.imshow(image, cmap=colors, vmin=0)
    figure.colorbar(drawn, ax=axis, shrink=0.8, label="1 / depth" if colors == "magma" else "")
    axis.set(title=title, xticks=[], yticks=[])
figure.savefig("depth.png", dpi=110)
print("wrote depth.png")
