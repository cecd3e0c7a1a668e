"""Repair, offset and subtract for printing.

    python printing.py [MESH] [FOLDER]

Without a mesh, a torus with a hole in its surface and doubled vertices stands for a scan.
"""

# %% Read a scan, or make one that is broken
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

import ravec

arguments = [argument for argument in sys.argv[1:] if not argument.startswith("-")]
folder = Path(arguments[1] if len(arguments) > 1 else tempfile.mkdtemp())
folder.mkdir(parents=True, exist_ok=True)


def torus(rows: int = 48, columns: int = 24) -> ravec.Mesh:
    """A torus of radii 20 and 7 whose quadrilaterals have corners of their own, some of them missing."""
    around, along = np.meshgrid(np.arange(columns + 1), np.arange(rows + 1))
    a, b = 2 * np.pi * along / rows, 2 * np.pi * around / columns
    grid = np.stack(
        [(20 + 7 * np.cos(b)) * np.cos(a), (20 + 7 * np.cos(b)) * np.sin(a), 7 * np.sin(b)], axis=-1
    )
    # the last row and column lie where the first ones are
    grid[-1], grid[:, -1] = grid[0], grid[:, 0]
    quads = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], axis=2).reshape(-1, 4, 3)
    quads = np.delete(quads, [100, 101, 125], axis=0)
    first = 4 * np.arange(len(quads))[:, None]
    faces = np.concatenate([first + [0, 1, 2], first + [0, 2, 3]])
    return ravec.Mesh(quads.reshape(-1, 3), faces)


scan = ravec.Mesh.load(arguments[0]) if arguments else torus()
report = scan.check()
print(scan, "is sound" if report["passed"] else "has defects:")
for finding in report["findings"]:
    if finding["count"]:
        print(f"  {finding['count']} {finding['what']}")

# %% Weld what belongs together
welded = scan.weld()
print(welded)

# %% An offset takes any triangles, also open ones, and is closed: a shell of 1.2 around the scan
grown = ravec.offset(welded, 1.2, tolerance=0.05, side="outer")
print(grown, "closed" if grown.check()["passed"] else "not closed")

# %% Drill a hole for a screw
low, high = grown.bounds
middle, reach = (low + high) / 2, high[2] - low[2]
angles = 2 * np.pi * np.arange(64) / 64
ring = np.stack([2.5 * np.cos(angles), 2.5 * np.sin(angles)], axis=1) + [high[0] - 0.25 * reach, middle[1]]
vertices = np.concatenate([np.insert(ring, 2, z, axis=1) for z in (low[2] - reach, high[2] + reach)])
index = np.arange(64)
following = (index + 1) % 64
side = np.concatenate(
    [
        np.stack([index, following, following + 64], axis=1),
        np.stack([index, following + 64, index + 64], axis=1),
    ]
)
fan = np.stack([np.zeros(62, int), index[1:-1], index[2:]], axis=1)
drill = ravec.Mesh(vertices, np.concatenate([side, fan[:, ::-1], fan + 64]))
part = grown - drill
print(part, "closed" if part.check()["passed"] else "not closed")

# %% Fewer triangles, with a distance that is proved, and a file for the printer
printable = part.simplify(error=0.02)
distance = printable.distance(part, tolerance=0.004, within=0.03)
print(printable, "is within 0.03 of it" if distance["passed"] else "is too far from it")
printable.save(folder / "printable.3mf")

# %% Look at it
view = printable.render(width=800, height=600)
Image.fromarray(view).save(folder / "printable.png")
print(folder / "printable.3mf")
view
