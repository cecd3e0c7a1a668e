"""Measures the package beside what users of Python have: OpenCV, manifold3d, MeshLib and seam-carving.

    python against_peers.py FOLDER_OF_PHOTOS FIRST_MESH SECOND_MESH

Prints medians of CPU and elapsed seconds. Programs that are not installed are left out, with a line that says so.
"""

from __future__ import annotations

import functools
import os
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import ravec


def measured(work: Callable[[], Any], runs: int = 5) -> tuple[float, float, Any]:
    """Median CPU and elapsed seconds, and the last result."""
    cpu, elapsed, result = [], [], None
    for _ in range(runs):
        before, start = os.times(), time.perf_counter()
        result = work()
        after = os.times()
        elapsed.append(time.perf_counter() - start)
        cpu.append(after.user - before.user + after.system - before.system)
    return statistics.median(cpu), statistics.median(elapsed), result


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    return float(10 * np.log10(255**2 / np.mean((a.astype(float) - b.astype(float)) ** 2)))


def calls() -> None:
    """Calls on a picture of one block, and a fit of 12 megapixels."""
    small = np.zeros((8, 8, 3), np.uint8)
    seconds = []
    for _ in range(2000):
        start = time.perf_counter()
        ravec.TwoColorField.fit(small)
        seconds.append(time.perf_counter() - start)
    large = np.random.default_rng(0).integers(0, 255, (3000, 4000, 3), dtype=np.uint8)
    _, elapsed, _ = measured(lambda: ravec.TwoColorField.fit(large))
    print(f"a call: {1e6 * statistics.median(seconds):.0f} us; fit of 12 megapixels: {elapsed:.3f} s")


def clean(photos: list[Path]) -> None:
    """Noise of 15 steps, against the bilateral filter with the best of nine settings for each photo."""
    try:
        import cv2
    except ImportError:
        return print("OpenCV is not installed: clean is not compared")
    gains, ratios = [], []
    for path in photos:
        photo = np.asarray(Image.open(path).convert("RGB"))
        noisy = photo + np.random.default_rng(0).normal(0, 15, photo.shape)
        noisy = np.clip(noisy, 0, 255).round().astype(np.uint8)
        settings = [(color, space) for color in (30, 45, 60) for space in (2, 3, 5)]
        best = max(settings, key=lambda given: psnr(cv2.bilateralFilter(noisy, 0, *given), photo))
        theirs, _, filtered = measured(lambda: cv2.bilateralFilter(noisy, 0, *best), 3)
        ours, _, cleaned = measured(lambda: ravec.clean(noisy), 3)
        gains.append(psnr(cleaned, photo) - psnr(filtered, photo))
        ratios.append(ours / theirs)
    print(f"clean: {statistics.mean(gains):.2f} dB more, {statistics.median(ratios):.2f} times the CPU of OpenCV")


def boolean(first: Path, second: Path) -> None:
    """The difference of two meshes of about the same size, from arrays to arrays."""
    try:
        import manifold3d
    except ImportError:
        return print("manifold3d is not installed: boolean is not compared")

    def placed(path: Path, shift: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
        mesh = ravec.Mesh.load(path)
        centered = mesh.vertices - mesh.vertices.mean(axis=0)
        return centered / np.abs(centered).max() + np.array(shift), mesh.faces

    a, b = placed(first, (0, 0, 0)), placed(second, (0.13, 0.07, 0.11))

    def ours() -> Any:
        result = ravec.boolean("a - b", a=a, b=b)
        return result.vertices, result.faces

    def theirs() -> Any:
        solids = [
            manifold3d.Manifold(manifold3d.Mesh(vertices.astype(np.float32), faces.astype(np.uint32)))
            for vertices, faces in (a, b)
        ]
        result = (solids[0] - solids[1]).to_mesh()
        return result.vert_properties, result.tri_verts

    own, peer = measured(ours), measured(theirs)
    print(f"boolean: {own[0] / peer[0]:.2f} times the CPU and {own[1] / peer[1]:.2f} times the time of manifold3d")


def offset(path: Path) -> None:
    """The outer surface at 2 % of the diagonal within a thousandth of it, against the sharpening mode of MeshLib.

    The voxels of MeshLib are as large as an error of a thousandth allows on the samples: vertices and middles of triangles.
    """
    try:
        import meshlib.mrmeshnumpy as arrays
        import meshlib.mrmeshpy as meshlib
    except ImportError:
        return print("meshlib is not installed: offset is not compared")
    mesh = ravec.Mesh.load(path)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    distance, tolerance = 0.02 * diagonal, 0.001 * diagonal
    given = arrays.meshFromFacesVerts(faces.astype(np.int32), vertices)

    def theirs(voxel: float, mode: Any) -> tuple[np.ndarray, np.ndarray]:
        params = meshlib.GeneralOffsetParameters()
        params.voxelSize, params.mode = voxel, mode
        params.signDetectionMode = meshlib.SignDetectionMode.HoleWindingRule
        found = meshlib.generalOffsetMesh(meshlib.MeshPart(given), distance, params)
        return arrays.getNumpyVerts(found), arrays.getNumpyFaces(found.topology)

    def error(found: tuple[np.ndarray, np.ndarray]) -> float:
        points = np.concatenate([found[0], found[0][found[1]].mean(axis=1)])
        tree = meshlib.MeshPart(given)
        step = max(1, len(points) // 50_000)
        apart = [
            meshlib.findProjection(meshlib.Vector3f(*map(float, point)), tree).distSq ** 0.5 for point in points[::step]
        ]
        return float(np.abs(np.array(apart) - distance).max())

    def ours(limit: float | None) -> Any:
        return ravec.offset(
            (vertices, faces), distance, tolerance=tolerance, side="outer", max_normal_deviation=limit
        )

    # degrees: the default, and a limit at which normals are still nearer than those of MeshLib
    own = {limit: measured(functools.partial(ours, limit), 3) for limit in (None, 6.0)}
    for name, mode in (("sharpening", meshlib.OffsetMode.Sharpening), ("marching cubes", meshlib.OffsetMode.Standard)):
        for factor in (11.3, 8.0, 5.66, 4.0, 2.83, 2.0, 1.41, 1.0, 0.71, 0.5, 0.35, 0.25):
            reached = error(theirs(factor * tolerance, mode))
            if reached <= tolerance:
                break
        peer = measured(lambda: theirs(factor * tolerance, mode), 3)
        print(f"offset, {name}, voxel {factor:g} times the tolerance, error {reached / tolerance:.2f} of it:")
        for limit, (cpu, elapsed, found) in own.items():
            print(
                f"  normals {'by default' if limit is None else f'within {limit:g} degrees'}: "
                f"{cpu / peer[0]:.2f} times the CPU and {elapsed / peer[1]:.2f} times the time of MeshLib, "
                f"1/{len(peer[2][1]) / len(found.faces):.0f} of the triangles"
            )


def retarget(photo: Path) -> None:
    """A further size of a photo that is analyzed already: three quarters of the width."""
    try:
        import seam_carving
    except ImportError:
        return print("seam-carving is not installed: retargeting is not compared")
    image = np.asarray(Image.open(photo).convert("RGB"))
    height, width = image.shape[:2]
    kept = ravec.Retargeter(image)
    own = measured(lambda: kept.picture(width * 3 // 4, height))
    peer = measured(lambda: seam_carving.resize(image, (width * 3 // 4, height), energy_mode="forward"), 1)
    print(f"retargeting: {peer[1] / own[1]:.0f} times as fast as seam-carving, {peer[0] / own[0]:.0f} by CPU time")


def main() -> None:
    photos = sorted(path for path in Path(sys.argv[1]).iterdir() if path.suffix in (".png", ".jpg"))
    calls()
    clean(photos[:8])
    boolean(Path(sys.argv[2]), Path(sys.argv[3]))
    offset(Path(sys.argv[2]))
    retarget(photos[0])


if __name__ == "__main__":
    main()
