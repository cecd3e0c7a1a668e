"""Samples, channels and strides come back as they went in."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import edge, encoded, linear
from PIL import Image

import ravec


def channels(image: np.ndarray, count: int) -> np.ndarray:
    alpha = np.full((*image.shape[:2], 1), 255, image.dtype)
    alpha[:8, :8] = 128
    gray = image[..., 1:2]
    return {
        0: gray[..., 0],
        1: gray,
        2: np.concatenate([gray, alpha], axis=2),
        3: image,
        4: np.concatenate([image, alpha], axis=2),
    }[count]


def samples(image: np.ndarray, dtype: str) -> np.ndarray:
    if dtype == "uint8":
        return image
    if dtype == "uint16":
        return image.astype(np.uint16) * 257
    return (image / 255.0).astype(dtype)


@pytest.mark.parametrize("count", [0, 1, 2, 3, 4])
@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32", "float64"])
def test_the_same_size_gives_the_same_samples(dtype: str, count: int) -> None:
    image = samples(channels(edge(48, 32), count), dtype)
    same = ravec.retarget(image, 48, 32)
    assert same.shape == image.shape
    assert same.dtype == (np.float32 if dtype == "float64" else image.dtype)
    if image.dtype.kind == "u":
        assert np.array_equal(same, image)
    else:
        assert np.abs(same - image).max() < 1e-5
    smooth = ravec.smooth(image, window=5)
    assert smooth.shape == image.shape and smooth.dtype == same.dtype


def test_any_strides_are_read(picture: np.ndarray) -> None:
    expected = ravec.smooth(picture, window=5)
    wide = np.zeros((32, 96, 4), np.uint8)
    wide[:, ::2, :3] = picture
    backward = picture[::-1, ::-1].copy()
    planes = np.ascontiguousarray(picture.transpose(2, 0, 1))
    for view in (
        wide[:, ::2, :3],
        backward[::-1, ::-1],
        np.asfortranarray(picture),
        planes.transpose(1, 2, 0),
        picture[..., ::-1][..., ::-1],
    ):
        assert np.array_equal(view, picture)
        assert np.array_equal(ravec.smooth(view, window=5), expected)
    locked = picture.copy()
    locked.setflags(write=False)
    assert np.array_equal(ravec.smooth(locked, window=5), expected)
    big = (picture.astype(np.uint16) * 257).astype(">u2")
    assert np.array_equal(ravec.retarget(big, 48, 32), big)


def test_results_own_their_memory_and_inputs_stay(picture: np.ndarray) -> None:
    before = picture.copy()
    result = ravec.clean(picture)
    assert np.array_equal(picture, before)
    assert result.flags.c_contiguous
    result[:] = 0
    assert np.array_equal(picture, before)


def test_linear_floats_are_light(picture: np.ndarray) -> None:
    light = linear(picture / 255.0).astype(np.float32)
    result = ravec.smooth(light, window=5, color_space="linear")
    expected = ravec.smooth((picture / 255.0).astype(np.float32), window=5)
    assert np.abs(encoded(result.astype(np.float64)) - expected).max() < 1e-5
    with pytest.raises(ValueError, match="color_space"):
        ravec.smooth(picture, color_space="lab")  # type: ignore[arg-type]


def test_pictures_of_pillow(picture: np.ndarray) -> None:
    expected = ravec.smooth(picture, window=5)
    assert np.array_equal(ravec.smooth(Image.fromarray(picture), window=5), expected)
    gray = Image.fromarray(picture).convert("L")
    assert ravec.smooth(gray, window=5).shape == (32, 48)
    palette = Image.fromarray(picture).quantize(16)
    assert ravec.smooth(palette, window=5).shape == (32, 48, 3)
    assert ravec.smooth(Image.fromarray(picture).convert("RGBA"), window=5).shape == (32, 48, 4)


def test_what_is_no_picture_is_refused(picture: np.ndarray) -> None:
    with pytest.raises(TypeError, match="uint8, uint16 or float32, not of int64"):
        ravec.smooth(picture.astype(np.int64))
    for shape in [(4,), (4, 4, 5), (2, 4, 4, 3), (0, 4, 3), (4, 0)]:
        with pytest.raises(ValueError):
            ravec.smooth(np.zeros(shape, np.uint8))
    with pytest.raises(TypeError):
        ravec.smooth("photo.jpg")
    with pytest.raises(TypeError):
        ravec.smooth(None)


def test_values_that_are_not_numbers_are_no_bug() -> None:
    image = np.full((24, 24, 3), np.nan, np.float32)
    image[:12] = 0.5
    assert ravec.clean(image).shape == image.shape
    image[12:] = np.inf
    assert ravec.TwoColorField.fit(image).render().shape == image.shape


def test_pictures_show_themselves(picture: np.ndarray) -> None:
    png = ravec.smooth(picture, window=5)._repr_png_()
    assert png is not None and png.startswith(b"\x89PNG")
    assert isinstance(ravec.smooth(picture, window=5).mean(), float)
    assert type(ravec.smooth(picture, window=5) + 1) is np.ndarray
    column = ravec.smooth(picture, window=5)[0, 0]
    assert column._repr_png_() is None
