"""Two-color pixels, filters, retargeting, planes, completion, mattes and mosaics."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import edge, photo, psnr
from PIL import Image

import ravec


def command_line(*arguments: object) -> None:
    command = [sys.executable, "-m", "ravec", "-q", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def read(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path))


def test_two_color_fields_find_the_line(picture: np.ndarray) -> None:
    field = ravec.TwoColorField.fit(picture)
    assert field.size == (48, 32)
    assert psnr(field.render(), picture) > 45
    assert field.render(2.5).shape == (80, 120, 3)
    assert psnr(field.render(mosaic=True), picture) < 30
    blocks = field.blocks()
    lined = ~np.isnan(blocks["offset_px"])
    assert blocks["normal"].shape == (24, 2) and 2 < lined.sum() < 16
    angles = np.arctan2(blocks["normal"][lined, 1], blocks["normal"][lined, 0])
    assert np.abs(np.cos(angles - 0.6)).min() > 0.999
    assert ravec.twocolor(picture, adaptive=True, size=4, max_size=16).blocks()["side_px"].max() == 16
    with pytest.raises(ValueError, match="2 to 64"):
        ravec.TwoColorField.fit(picture, size=65)
    with pytest.raises(ValueError, match="above 0"):
        field.render(0.0, mosaic=True)
    # refused before memory is taken
    for beyond in (lambda: field.render(1e5), lambda: ravec.Homography(np.eye(3)).warp(picture, 10**6, 10**6)):
        with pytest.raises(ValueError, match="more than the limit"):
            beyond()


def test_drawings_are_those_of_the_command_line(picture: np.ndarray, tmp_path: Path) -> None:
    Image.fromarray(picture).save(tmp_path / "a.png")
    command_line("twocolor", tmp_path / "a.png", "--svg", tmp_path / "a.svg", "-o", tmp_path / "b.png")
    field = ravec.TwoColorField.fit(picture)
    assert np.array_equal(field.render(), read(tmp_path / "b.png"))
    field.save_svg(tmp_path / "c.svg")
    drawn = (tmp_path / "c.svg").read_text()
    paths = [line for line in (tmp_path / "a.svg").read_text().splitlines() if "<title>" not in line]
    assert drawn.splitlines() == paths
    assert [path.name for path in tmp_path.glob("*.part")] == []


def test_filters_are_those_of_the_command_line(picture: np.ndarray, tmp_path: Path) -> None:
    noisy = np.clip(picture + np.random.default_rng(1).normal(0, 12, picture.shape), 0, 255)
    noisy = noisy.astype(np.uint8)
    Image.fromarray(noisy).save(tmp_path / "noisy.png")
    for mode, function in [
        ("clean", ravec.clean),
        ("smooth", ravec.smooth),
        ("abstract", ravec.abstract),
        ("sharpen", ravec.sharpen),
        ("antialias", ravec.antialias),
    ]:
        output = tmp_path / f"{mode}.png"
        command_line("brush", tmp_path / "noisy.png", "-o", output, "--mode", mode, "--everywhere")
        assert np.array_equal(function(noisy), read(output)), mode
    assert psnr(ravec.clean(noisy, noise_sigma=12), picture) > psnr(noisy, picture) + 6
    assert ravec.enlarge(picture, 1.5).shape == (48, 72, 3)


def test_brushes_stop_at_edges(picture: np.ndarray) -> None:
    painted = ravec.brush(picture, [(10, 16), (14, 16)], mode="color", color=(0, 255, 0), radius=40, hardness=1.0)
    assert tuple(painted[16, 12]) == (0, 255, 0)
    assert np.array_equal(painted[16, 40], picture[16, 40])
    stroke = {"tool": {"color": {"rgb": [0, 255, 0]}}, "points": [[10, 16], [14, 16]], "radius_px": 40, "hardness": 1}
    assert np.array_equal(ravec.brush(picture, [stroke]), painted)
    crossing = ravec.brush(
        picture, [(10, 16)], mode="color", color=(0, 255, 0), radius=40, hardness=1.0, across_edges=True
    )
    assert tuple(crossing[16, 40]) == (0, 255, 0)
    assert np.array_equal(ravec.brush(picture, [stroke], undo=1), picture)
    with pytest.raises(ValueError, match=r"point 1 is \[nan, 16\.0\]"):
        ravec.brush(picture, [(10, 16), (np.nan, 16)], mode="color", color=(0, 255, 0))


def test_a_retargeter_is_asked_many_times(tmp_path: Path) -> None:
    image = photo(120, 80)
    kept = ravec.Retargeter(image)
    narrow = kept.picture(80, 80)
    assert narrow.shape == (80, 80, 3)
    assert np.array_equal(narrow, ravec.retarget(image, 80, 80))
    Image.fromarray(image).save(tmp_path / "a.png")
    command_line("retarget", tmp_path / "a.png", "--size", "80x80", "-o", tmp_path / "b.png")
    assert np.array_equal(narrow, read(tmp_path / "b.png"))
    mask = np.zeros((80, 120), bool)
    mask[:, :40] = True
    protected = ravec.retarget(image, 80, 80, protect=mask)
    assert not np.array_equal(protected, narrow)
    # what is protected keeps its width
    assert psnr(protected[20:60, 8:32], image[20:60, 8:32]) > psnr(narrow[20:60, 8:32], image[20:60, 8:32])
    with pytest.raises(ValueError):
        kept.picture(120 * 21, 80)
    with pytest.raises(ValueError, match="mask"):
        ravec.Retargeter(image, protect=mask[:, 1:])


def test_homographies() -> None:
    truth = ravec.Homography([[1.1, 0.05, 8], [-0.04, 0.95, 5], [2e-4, -1e-4, 1]])
    random = np.random.default_rng(2)
    src = random.uniform(0, 200, (60, 2))
    dst = truth.apply(src)
    exact = ravec.Homography.from_points(src[:4], dst[:4])
    assert np.abs(exact.apply(src) - dst).max() < 1e-6
    noisy = dst + random.normal(0, 0.3, dst.shape)
    assert np.abs(ravec.Homography.from_points(src, noisy).apply(src) - dst).max() < 1.0
    wrong = noisy.copy()
    wrong[::2] = random.uniform(0, 200, (30, 2))
    robust = ravec.Homography.robust(src, wrong)
    assert robust.inliers is not None and robust.inliers[1::2].mean() > 0.9
    assert np.abs(robust.apply(src) - dst).max() < 1.5
    assert np.allclose((truth @ truth.inverse()).apply(src), src)
    opencv, _ = cv2.findHomography(src, noisy, 0)
    own = ravec.Homography.from_points(src, noisy)
    assert np.abs(own.apply(src) - cv2.perspectiveTransform(src[None], opencv)[0]).max() < 0.2
    with pytest.raises(ValueError, match=r"\(N, 2\)"):
        ravec.Homography.from_points(src[:, 0], dst)  # type: ignore[arg-type]
    with pytest.raises(ravec.Error):
        ravec.Homography.from_points(src[:3], dst[:3])
    with pytest.raises(ValueError, match="inverse"):
        ravec.Homography(np.zeros((3, 3)))


def test_matching_rectifying_and_snapping(tmp_path: Path) -> None:
    image = photo(200, 160)
    shift = ravec.Homography([[1, 0.02, 12], [0.01, 1, -6], [0, 1e-4, 1]])
    moved = shift.warp(image, 200, 160)
    found = ravec.match(image, moved)
    corners = np.array([(40.0, 40.0), (150.0, 50.0), (60.0, 130.0)])
    assert np.abs(found.apply(corners) - shift.apply(corners)).max() < 0.5
    assert found.report is not None and found.report["operation"] == "match"
    # a checkerboard seen at an angle
    y, x = np.mgrid[0:120, 0:160]
    board = np.where((x // 20 + y // 20) % 2 == 0, 220, 90).astype(np.uint8)
    tilted = ravec.Homography([[1, 0.1, 20], [0.02, 0.9, 15], [4e-4, 3e-4, 1]])
    view = tilted.warp(board, 200, 160)
    quad = tilted.apply([(20, 20), (140, 20), (140, 100), (20, 100)])
    snapped = ravec.snap(view, quad + 1.2, grid=(6, 4))
    assert np.abs(snapped.quad - quad).max() < 0.3
    straight = ravec.rectify(view, quad, aspect=1.5)
    # with a margin what lies beyond the picture is transparent
    assert straight.picture.ndim == 2
    assert ravec.rectify(view, quad, aspect=1.5, margin=1.0).picture.shape[2] == 2
    assert abs(straight.aspect - 1.5) < 1e-9
    assert straight.straight_from_image.apply(quad[:1]).shape == (1, 2)
    assert isinstance(ravec.propose(view).quads, list)


def test_holes_are_filled() -> None:
    y, x = np.mgrid[0:120, 0:160]
    tiles = np.where((x % 20 < 2) | (y % 15 < 2), 200, 90).astype(np.uint8)
    tiles = np.stack([tiles, tiles, 255 - tiles], axis=2)
    mask = np.zeros((120, 160), bool)
    mask[50:62, 70:86] = True
    stained = tiles.copy()
    stained[mask] = 0
    assert psnr(ravec.complete(stained, mask), tiles) > 40
    polygon = [(70, 50), (86, 50), (86, 62), (70, 62)]
    assert psnr(ravec.complete(stained, polygons=[polygon]), tiles) > 40
    retouch = ravec.Retouch(ravec.FragmentIndex(stained, mask))
    assert retouch.open_px == mask.sum()
    best = retouch.best((78, 56), 24)
    assert best[0]["mismatch"] <= best[-1]["mismatch"]
    assert retouch.apply(best[0]) == 0
    assert np.array_equal(retouch.picture, tiles)
    again = ravec.Retouch(ravec.FragmentIndex(stained, mask), retouch.steps)
    assert np.array_equal(again.picture, tiles)
    assert retouch.undo() is not None and retouch.undo() is None
    assert np.array_equal(retouch.picture, stained)
    assert retouch.fill() == 0 and psnr(retouch.picture, tiles) > 40
    with pytest.raises(ValueError):
        ravec.complete(stained, mask[1:])
    with pytest.raises(ValueError):
        retouch.best((78, 56), 500)


def test_mattes() -> None:
    plate = photo(96, 72)
    y, x = np.mgrid[0:72, 0:96]
    alpha = np.clip((20 - np.hypot(x - 48, y - 36)) / 4 + 0.5, 0, 1)
    image = (alpha[..., None] * np.array([230, 40, 60]) + (1 - alpha[..., None]) * plate).round().astype(np.uint8)
    found = ravec.matte(image, plate=plate)
    assert found.shape == (72, 96) and found.dtype == np.uint8
    assert np.abs(found / 255.0 - alpha).mean() < 0.01
    trimap = np.full((72, 96), 128, np.uint8)
    trimap[alpha == 1] = 255
    trimap[np.hypot(x - 48, y - 36) > 25] = 0
    assert np.abs(ravec.matte(image, trimap=trimap) / 255.0 - alpha).mean() < 0.02
    strokes = np.full((72, 96), 128, np.uint8)
    strokes[30:42, 42:54], strokes[:10], strokes[-10:] = 255, 0, 0
    assert ravec.matte(image, strokes=strokes)[36, 48] == 255
    held = strokes.copy()
    held[32:40, 44:52] = 0
    assert ravec.matte(image, plate=plate, strokes=held)[36, 48] == 0
    with pytest.raises(ValueError, match="4 x 4"):
        ravec.matte(image, strokes=np.zeros((4, 4), np.uint8))
    cut = ravec.matte(image, plate=plate, content="foreground")
    assert cut.shape == (72, 96, 4) and tuple(cut[36, 48, :3]) == (230, 40, 60)
    with pytest.raises(ValueError):
        ravec.matte(image)


def test_mosaics(tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    folder.mkdir()
    random = np.random.default_rng(4)
    for index in range(40):
        color = random.integers(0, 255, 3)
        tile = np.clip(color + random.normal(0, 8, (32, 32, 3)), 0, 255).astype(np.uint8)
        Image.fromarray(tile).save(folder / f"{index:02}.png")
    catalogue = ravec.Catalogue(tmp_path / "photos.ravec")
    assert catalogue.add(folder)["figures"]
    assert catalogue.stats()
    assert len(catalogue.photos()) > 0
    image = photo(64, 48)
    result = ravec.mosaic(image, catalogue, tiles=(8, 6), tile_size=16, min_repeat_distance=0)
    assert result.shape == (96, 128, 3)
    pinned = ravec.mosaic(
        image,
        catalogue,
        tiles=(8, 6),
        tile_size=16,
        min_repeat_distance=0,
        pins=[f"0,0:{folder / '07.png'}"],
    )
    seventh = read(folder / "07.png").mean(axis=(0, 1))
    assert np.abs(pinned[:16, :16].mean(axis=(0, 1)) - seventh).max() < 3
    with pytest.raises((FileNotFoundError, ravec.Error)):
        ravec.mosaic(image, tmp_path / "missing.ravec")
