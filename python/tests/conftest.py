"""Scenes with known truth."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray


def edge(width: int, height: int, angle: float = 0.6) -> NDArray[np.uint8]:
    """Two areas that meet at a line through the middle, with covered pixels mixed in linear light."""
    y, x = np.mgrid[0 : 4 * height, 0 : 4 * width] / 4.0 + 0.125
    side = (x - width / 2) * np.cos(angle) + (y - height / 2) * np.sin(angle) > 0
    share = side.reshape(height, 4, width, 4).mean(axis=(1, 3))[..., None]
    low, high = (np.array(color) / 255.0 for color in ((200, 60, 40), (40, 70, 120)))
    mixed = (1 - share) * linear(low) + share * linear(high)
    return np.round(255 * encoded(mixed)).astype(np.uint8)


def linear(value: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def encoded(value: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)


def psnr(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> float:
    error = np.mean((a.astype(np.float64) - b.astype(np.float64)) ** 2)
    return float(10 * np.log10(255**2 / max(error, 1e-9)))


def photo(width: int = 160, height: int = 120, seed: int = 3) -> NDArray[np.uint8]:
    """Noise of many scales: texture that can be matched."""
    random = np.random.default_rng(seed)
    image = np.zeros((height, width, 3))
    for step in (32, 16, 8, 4, 2):
        coarse = random.normal(0, step, (height // step + 2, width // step + 2, 3))
        image += np.kron(coarse, np.ones((step, step, 1)))[:height, :width]
    return np.clip(128 + 1.2 * image, 0, 255).astype(np.uint8)


def box(size: float = 1.0, at: tuple[float, float, float] = (0, 0, 0)) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """A cube of two triangles a side."""
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=np.float64)
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    faces = [triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))]
    return size * corners + np.array(at), np.array(faces)


@pytest.fixture
def picture() -> NDArray[np.uint8]:
    return edge(48, 32)
