"""Meshes, offsets and Booleans."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from conftest import box

import ravec


def volume(mesh: ravec.Mesh) -> float:
    return float(mesh.to_trimesh().volume)


def test_arrays_trimesh_and_paths_are_meshes(tmp_path: Path) -> None:
    vertices, faces = box()
    mesh = ravec.Mesh(vertices, faces)
    assert np.array_equal(mesh.vertices, vertices) and np.array_equal(mesh.faces, faces)
    assert mesh.vertices.dtype == np.float64 and mesh.faces.dtype == np.uint32
    assert np.array_equal(mesh.bounds, [[0, 0, 0], [1, 1, 1]])
    with pytest.raises(ValueError):
        mesh.vertices[0] = 1
    for suffix in ("stl", "ply", "obj", "off", "3mf", "glb"):
        path = tmp_path / f"box.{suffix}"
        assert mesh.save(path)["outputs"][0]["triangles"] == 12
        back = ravec.Mesh.load(path)
        assert back.check()["passed"] is True
        assert abs(volume(back) - 1) < 1e-6
        if suffix in ("stl", "ply", "obj", "off"):
            assert abs(trimesh.load(path, force="mesh").volume - 1) < 1e-6
    ball = trimesh.creation.icosphere(subdivisions=2)
    assert abs(volume(mesh | ball) - volume(ravec.boolean("a | b", a=(vertices, faces), b=ball))) < 1e-12
    strided = np.zeros((8, 6))
    strided[:, ::2] = vertices
    assert np.array_equal(ravec.Mesh(strided[:, ::2], faces.astype(np.int32)).vertices, vertices)
    single = ravec.Mesh(vertices.astype(np.float32), faces.astype(np.uint64))
    assert np.array_equal(single.vertices, vertices)


def test_what_is_no_mesh_is_refused(tmp_path: Path) -> None:
    vertices, faces = box()
    with pytest.raises(ValueError, match=r"\(N, 3\)"):
        ravec.Mesh(vertices[:, :2], faces)
    with pytest.raises(ValueError):
        ravec.Mesh(vertices, faces + 1)
    with pytest.raises(ValueError, match="from 0"):
        ravec.Mesh(vertices, faces - 1)
    with pytest.raises(ValueError, match="whole numbers"):
        ravec.Mesh(vertices, faces * 1.0)
    with pytest.raises(ValueError):
        ravec.Mesh(vertices * np.nan, faces)
    with pytest.raises(FileNotFoundError, match="missing.stl"):
        ravec.Mesh.load(tmp_path / "missing.stl")
    (tmp_path / "broken.ply").write_text("ply\nnonsense")
    with pytest.raises(ravec.Error, match="broken.ply"):
        ravec.Mesh.load(tmp_path / "broken.ply")
    with pytest.raises((OSError, ValueError)):
        ravec.Mesh(vertices, faces).save(tmp_path / "no" / "folder.stl")
    with pytest.raises(ValueError):
        ravec.Mesh(vertices, faces).save(tmp_path / "box.unknown")


def test_operators_and_expressions() -> None:
    a = ravec.Mesh(*box())
    b = ravec.Mesh(*box(at=(0.5, 0.5, 0.5)))
    assert abs(volume(a | b) - 1.875) < 1e-12
    assert abs(volume(a & b) - 0.125) < 1e-12
    assert abs(volume(a - b) - 0.875) < 1e-12
    assert abs(volume(a ^ b) - 1.75) < 1e-12
    c = ravec.Mesh(*box(size=0.25, at=(0.1, 0.1, 0.1)))
    mixed = ravec.boolean("(a | b) - c", a=a, b=b, c=c)
    assert abs(volume(mixed) - (1.875 - 0.25**3)) < 1e-12
    assert mixed.check()["passed"] is True and mixed.report["operation"] == "boolean"
    with pytest.raises(ValueError, match="expression"):
        ravec.boolean("a -", a=a)
    with pytest.raises(ValueError, match="name them"):
        ravec.boolean("a - b")


def test_offsets_have_their_distance() -> None:
    ball = trimesh.creation.icosphere(subdivisions=4)
    grown = ravec.offset(ball, 0.2, tolerance=0.005, side="outer")
    radius = np.linalg.norm(grown.vertices, axis=1)
    assert np.abs(radius - 1.2).max() < 0.01
    assert grown.report["passed"] is not False
    shrunk = ravec.Mesh(ball.vertices, ball.faces).offset(0.2, tolerance=0.005, side="inner")
    assert abs(volume(shrunk) - 4 / 3 * np.pi * 0.8**3) < 0.1
    with pytest.raises(ValueError):
        ravec.offset(ball, 0.2, tolerance=0.3)


def test_simplification_distance_and_pictures() -> None:
    ball = trimesh.creation.icosphere(subdivisions=4)
    mesh = ravec.Mesh(ball.vertices, ball.faces)
    small = mesh.simplify(error=0.01)
    assert len(small.faces) < len(mesh.faces) / 4
    distance = small.distance(mesh, within=0.02)
    assert distance["passed"] is True
    assert mesh.info()["triangles"] == len(ball.faces)
    image = mesh.render(width=120, height=90)
    assert image.shape == (90, 120, 3) and image.std() > 10
    assert mesh.render(width=40, height=40, transparent=True).shape == (40, 40, 4)
    png = small._repr_png_()
    assert png is not None and png.startswith(b"\x89PNG")
    doubled = ravec.Mesh(np.concatenate([ball.vertices, ball.vertices]), ball.faces)
    assert len(doubled.weld().vertices) == len(ball.vertices)
    open_mesh = ravec.Mesh(ball.vertices, ball.faces[1:])
    assert open_mesh.check()["passed"] is False
    assert open_mesh.check(open=True)["passed"] is True
