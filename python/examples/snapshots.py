"""Moving points against snapshots: who is nearest at a time between two steps of a simulation?

The usual way is a tree for each of a few snapshots, and the answer of the snapshot next in time. Here points move, and the
query has a time. Writes snapshots.png: where snapshots give another neighbour, and how often, the more of them there are.
"""

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from mbkd import PointTree
from scipy.spatial import cKDTree

rng = np.random.default_rng(1)
n = 20_000

# A disc that turns by half a radian while the shutter is open, inner parts faster; a few steps further every point has
# moved by many times the distance to its neighbours. Keys are dense enough for straight lines between them.
radius, phase = np.sqrt(rng.random(n)), rng.random(n) * 2 * np.pi
height = rng.normal(0, 0.01, n)


def positions(time):
    angle = phase + 0.5 * time / (0.2 + radius)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1).astype(np.float32)


keys = np.stack([positions(t) for t in np.linspace(0, 1, 17)])
tree = PointTree(keys)

# Queries rest on a grid, each at a time of its own.
side = 300
x, y = np.meshgrid(np.linspace(-1.1, 1.1, side), np.linspace(-1.1, 1.1, side))
queries = np.stack([x.ravel(), y.ravel(), np.zeros(side * side)], axis=1)
times = rng.random(side * side).astype(np.float32)
_, exact = tree.query(queries, time=times)

counts, wrong, picture = [2, 3, 5, 9, 17, 33, 65], [], None
for count in counts:
    trees = [cKDTree(tree.positions(t)) for t in np.linspace(0, 1, count)]
    nearest_in_time = np.rint(times * (count - 1)).astype(int)
    found = np.empty_like(exact)
    for snapshot, other in enumerate(trees):
        these = nearest_in_time == snapshot
        found[these] = other.query(queries[these])[1]
    wrong.append(100 * np.mean(found != exact))
    if count == 5:
        picture = (found != exact).reshape(side, side)
    print(f"{count:3} snapshots: {wrong[-1]:5.1f} % of the neighbours are others")

figure, (left, middle, right) = plt.subplots(1, 3, figsize=(14, 4.6), constrained_layout=True)
some = rng.choice(n, 400, replace=False)
for way in np.moveaxis(keys[:, some], 1, 0):
    left.plot(way[:, 0], way[:, 1], color="tab:blue", alpha=0.5, linewidth=0.8)
left.plot(keys[-1, some, 0], keys[-1, some, 1], ".", color="tab:blue", markersize=3)
left.set(title="400 of 20 000 points while the shutter is open", aspect="equal")
middle.imshow(picture, extent=(-1.1, 1.1, -1.1, 1.1), origin="lower", cmap="Reds", interpolation="nearest")
middle.set(title="Queries to which 5 snapshots give another neighbour")
right.plot(counts, wrong, "o-", color="tab:red", label="the nearest of so many snapshots")
right.axhline(0, color="tab:blue", label="one tree of moving points")
right.set(xscale="log", xlabel="trees", ylabel="% of neighbours that are others", title="Snapshots against a query at a time")
right.set_xticks(counts, [str(c) for c in counts])
right.minorticks_off()
right.legend()
figure.savefig("snapshots.png", dpi=110)
print("wrote snapshots.png")
