"""Clips: a wall that moves, and a disc before it, of which everything is known."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import photo, psnr
from numpy.typing import NDArray
from PIL import Image

import ravec

WIDTH, HEIGHT, FRAMES = 160, 120, 10
#: Motion of the wall, in pixels a frame.
STEP = np.array([3.0, 2.0])


@pytest.fixture(scope="module")
def wall() -> NDArray[np.uint8]:
    """A wall larger than the frames."""
    return photo(WIDTH + 60, HEIGHT + 60)


def shot(wall: NDArray[np.uint8], disc: bool) -> list[NDArray[np.uint8]]:
    """Frames of the wall; a bright disc goes across them."""
    frames = []
    for index in range(FRAMES):
        x, y = (30 - STEP * index).astype(int)
        frame = wall[y : y + HEIGHT, x : x + WIDTH].copy()
        if disc:
            row, col = np.mgrid[:HEIGHT, :WIDTH]
            frame[(row - 60) ** 2 + (col - 25 - 12 * index) ** 2 < 144] = (250, 240, 30)
        frames.append(frame)
    return frames


def test_a_plane_is_followed_and_held_still(wall: NDArray[np.uint8], tmp_path: Path) -> None:
    clip = ravec.Clip.from_frames(shot(wall, disc=False))
    info = clip.info(count=True)
    assert info["size"] == [WIDTH, HEIGHT] and info["frames"] == FRAMES
    quad = [(40, 30), (120, 30), (120, 90), (40, 90)]
    track = clip.track(quad, precision="dense")
    moved = track.corners() - np.array(quad)
    expected = STEP * np.arange(FRAMES)[:, None, None]
    assert np.abs(moved - expected).max() < 0.2
    assert track.states() == ["tracked"] * FRAMES
    homographies = track.frame_from_reference()
    homographies /= homographies[:, 2:, 2:]
    assert np.abs(homographies[:, :2, 2] - STEP * np.arange(FRAMES)[:, None]).max() < 0.5
    track.save(tmp_path / "track.json")
    assert np.array_equal(ravec.Track(tmp_path / "track.json").corners(), track.corners())
    with pytest.raises(ValueError, match="1 planes"):
        track.corners(2)
    corrected = clip.track(track=track, corrections={5: track.corners()[5] + 1.0})
    assert np.abs(corrected.corners()[5] - track.corners()[5] - 1.0).max() < 0.3
    still = clip.stabilize(tmp_path / "still_%02d.png", track=track)
    first, last = (np.asarray(Image.open(tmp_path / f"still_{index:02}.png")) for index in (0, FRAMES - 1))
    inner = np.s_[40:80, 50:110]
    assert psnr(first[inner], last[inner]) > 30
    assert still.report["figures"]
    assert still.info()["size"] == [WIDTH, HEIGHT]


def test_a_disc_is_cut_out_removed_and_pasted(wall: NDArray[np.uint8], tmp_path: Path) -> None:
    clip = ravec.Clip.from_frames(shot(wall, disc=True))
    clean = shot(wall, disc=False)
    track = clip.track([(10, 10), (150, 10), (150, 110), (10, 110)], region="frame")
    plate = clip.plate(track=track, pad=8)
    assert plate.picture.shape[:2] == (HEIGHT + 16, WIDTH + 16)
    assert plate.seen.shape[:2] == plate.certainty.shape[:2] == plate.picture.shape[:2]
    assert plate.seen[60, 80].max() == 255
    assert plate.report["figures"]["agreeing_percent"] > 80 and not plate.report["warnings"]
    alpha = clip.matte(tmp_path / "alpha_%02d.png", plate.picture, track=track, pad=8)
    matte = np.asarray(Image.open(tmp_path / "alpha_05.png").convert("L"))
    row, col = np.mgrid[:HEIGHT, :WIDTH]
    inside = (row - 60) ** 2 + (col - 85) ** 2
    assert matte[inside < 100].min() > 200 and np.mean(matte[inside > 400] > 60) < 0.01
    empty = clip.remove(tmp_path / "empty_%02d.png", plate.picture, alpha, track=track, pad=8, grain="none")
    made = np.asarray(Image.open(tmp_path / "empty_05.png").convert("RGB"))
    assert psnr(made, clean[5]) > 30
    assert empty.report["operation"] == "video remove"
    sign = np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8)
    options: dict[str, Any] = {"track": track, "pad": 8, "quad": [(40, 30), (120, 30), (120, 90), (40, 90)]}
    clip.replace(tmp_path / "sign_%02d.png", plate.picture, alpha, sign, **options)
    made = np.asarray(Image.open(tmp_path / "sign_05.png").convert("RGB")).astype(int)
    assert made[60, 85].min() > 20 and made[50, 110].max() < 40, "before the sign, and on it"
    other = ravec.Clip.from_frames([np.full((HEIGHT, WIDTH, 3), 90, dtype=np.uint8)] * FRAMES)
    clip.paste(tmp_path / "pasted_%02d.png", plate.picture, alpha, other, track=track, pad=8)
    made = np.asarray(Image.open(tmp_path / "pasted_05.png").convert("RGB")).astype(int)
    assert made.max() > 200 and np.abs(made[:20] - 90).max() < 12
    with pytest.raises(TypeError, match="no option padding"):
        clip.remove(tmp_path / "x_%02d.png", plate.picture, alpha, padding=8)


def test_clips_are_converted_and_what_makes_no_sense_is_refused(wall: NDArray[np.uint8], tmp_path: Path) -> None:
    frames = shot(wall, disc=True)
    clip = ravec.Clip.from_frames(frames)
    clip.convert(tmp_path / "part_%02d.png", frames=(2, 5))
    assert len(list(tmp_path.glob("part_*.png"))) == 3
    converted = clip.convert(tmp_path / "clip.y4m", rate=30, size="50%")
    assert converted.info()["size"] == [WIDTH // 2, HEIGHT // 2]
    assert "clip.y4m" in repr(converted)
    with pytest.raises(ValueError, match="at least one frame"):
        ravec.Clip.from_frames([])
    with pytest.raises(FileNotFoundError):
        ravec.Clip(tmp_path / "none.mp4").info()
    with pytest.raises(ValueError):
        clip.track([(0, 0), (1, 1)])
