"""A program of a user, checked by mypy in strict mode."""

from __future__ import annotations

import numpy as np

import ravec


def report(phase: str, done: int, total: int) -> None:
    print(phase, done / total)


image = np.zeros((32, 48, 3), np.uint8)
field = ravec.TwoColorField.fit(image, size=8, progress=report)
large: ravec.Picture = field.render(2.0)
svg: str = field.svg(title="edges")
kept = ravec.Retargeter(image, lines=2.0, borders="free")
formats = [kept.picture(width, height) for width, height in ((48, 27), (27, 48))]
homography = ravec.Homography.from_points([(0, 0), (1, 0), (1, 1), (0, 1)], [(0, 0), (2, 0), (2, 2), (0, 2)])
points = homography.apply(np.array([(0.5, 0.5)])).tolist()
mesh = ravec.Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))
solid = ravec.boolean("a | b", a=mesh, b=mesh)
thick = ravec.offset(solid, "2%", side="outer", tolerance=0.01)
passed: bool = thick.check()["passed"]
cleaned = ravec.run({"operation": "mesh convert", "input": "@in", "output": "@out"}, {"@in": mesh}).mesh("@out")
