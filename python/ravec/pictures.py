"""Two-color pixels, and filters and brushes that do not cross edges."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from . import _ravec
from ._options import (
    ColorSpace,
    ImageLike,
    PathLike,
    Picture,
    PixelCenters,
    Points,
    Progress,
    as_array,
    check_finite,
    listener,
    operate,
    picture,
    report_of,
)


class TwoColorField:
    """A picture as blocks, each a line and the color on each side of it.

    Use :meth:`fit`. The field keeps its lines sharp at any scale.
    """

    def __init__(self, field: _ravec.Field) -> None:
        self._field = field

    @classmethod
    def fit(
        cls,
        image: ImageLike,
        *,
        size: int = 8,
        adaptive: bool = False,
        max_size: int = 32,
        max_error: float = 0.06,
        flat_contrast: float = 0.01,
        whole_pixels: bool = False,
        color_space: ColorSpace = "srgb",
        progress: Progress = None,
    ) -> TwoColorField:
        """Fits the blocks of a picture: of all lines that split a block the best one.

        :param size: side of a block in pixels, 2 to 64; the smallest one, 2 to 32, with ``adaptive``
        :param adaptive: large blocks where the picture is even
        :param max_size: side of the largest blocks with ``adaptive``: ``size`` times a power of two, at most 64
        :param max_error: with ``adaptive``, root mean square distance in Oklab above which a block is divided
        :param flat_contrast: contrast in Oklab below which a block has one color, 0 to 1
        :param whole_pixels: keep each line between pixels, where the fit puts it
        """
        options = {
            "size": size,
            "adaptive": adaptive,
            "max_size": max_size,
            "max_error": max_error,
            "flat_contrast": flat_contrast,
            "whole_pixels": whole_pixels,
            "color_space": color_space,
        }
        with listener(progress) as listening:
            return cls(_ravec.Field.fit(as_array(image), options, listening))

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows of the picture."""
        return self._field.size

    def render(self, scale: float = 1.0, *, mosaic: bool = False, progress: Progress = None) -> Picture:
        """The picture at ``scale`` times its size, in the samples of the picture that was fitted.

        :param mosaic: each block in its mean color, without a line
        """
        with listener(progress) as listening:
            return picture(self._field.render(scale, mosaic, listening))

    def svg(self, *, title: str | None = None, color_levels: int = 256) -> str:
        """The drawing as SVG.

        :param color_levels: levels of each color channel, 2 to 256: fewer merge more neighbors into one shape
        """
        return self._field.svg(title, color_levels)

    def save_svg(self, path: PathLike, *, title: str | None = None, color_levels: int = 256) -> None:
        """Writes the drawing, whole or not at all."""
        part = f"{os.fspath(path)}.part"
        try:
            with open(part, "w", encoding="utf-8") as file:
                file.write(self.svg(title=title, color_levels=color_levels))
            os.replace(part, path)
        except BaseException:
            if os.path.exists(part):
                os.remove(part)
            raise

    def blocks(self) -> dict[str, NDArray[Any]]:
        """The blocks as arrays of the same length.

        ``corner_px`` (N, 2), ``side_px``, ``normal`` (N, 2) and ``offset_px`` of the line from the center of
        the block (NaN for a flat one), ``oklab`` (N, 2, 3) and ``alpha`` (N, 2) of both sides, ``error``.
        """
        return self._field.blocks()

    def _repr_svg_(self) -> str | None:
        svg = self.svg()
        return svg if len(svg) < 4_000_000 else None


def twocolor(image: ImageLike, **options: Any) -> TwoColorField:
    """Fits two-color pixels; see :meth:`TwoColorField.fit`."""
    return TwoColorField.fit(image, **options)


def _everywhere(
    image: ImageLike,
    mode: str,
    color_space: ColorSpace,
    progress: Progress,
    **params: Any,
) -> Picture:
    outcome = operate(
        "brush",
        {"input": "@input", "output": "@output", "everywhere": True},
        params={"mode": mode, **params},
        inputs={"@input": as_array(image)},
        color_space=color_space,
        progress=progress,
    )
    return picture(outcome.picture("@output"))


def clean(
    image: ImageLike,
    *,
    noise_sigma: float | None = None,
    strength: float | None = None,
    iterations: int | None = None,
    window: int | None = None,
    color_space: ColorSpace = "srgb",
    progress: Progress = None,
) -> Picture:
    """Removes noise and compression damage, and keeps edges and texture.

    :param noise_sigma: standard deviation of the noise in steps of 8 bit, 0 to 255; estimated unless it is given
    :param strength: share of the way from the old color to the new one, 0 to 1
    :param iterations: how often, 1 to 16
    :param window: side of the windows in pixels, odd, 3 to 31
    """
    return _everywhere(
        image,
        "clean",
        color_space,
        progress,
        noise_sigma=noise_sigma,
        strength=strength,
        iterations=iterations,
        window=window,
    )


def smooth(
    image: ImageLike,
    *,
    strength: float | None = None,
    iterations: int | None = None,
    window: int | None = None,
    color_space: ColorSpace = "srgb",
    progress: Progress = None,
) -> Picture:
    """Smooths areas and keeps edges; options as for :func:`clean`."""
    return _everywhere(
        image, "smooth", color_space, progress, strength=strength, iterations=iterations, window=window
    )


def abstract(
    image: ImageLike,
    *,
    strength: float | None = None,
    iterations: int | None = None,
    window: int | None = None,
    color_space: ColorSpace = "srgb",
    progress: Progress = None,
) -> Picture:
    """Makes even areas with crisp edges; options as for :func:`clean`."""
    return _everywhere(
        image, "abstract", color_space, progress, strength=strength, iterations=iterations, window=window
    )


def sharpen(
    image: ImageLike,
    *,
    strength: float | None = None,
    iterations: int | None = None,
    window: int | None = None,
    color_space: ColorSpace = "srgb",
    progress: Progress = None,
) -> Picture:
    """Makes edges crisper, without halos; options as for :func:`clean`."""
    return _everywhere(
        image, "sharpen", color_space, progress, strength=strength, iterations=iterations, window=window
    )


def antialias(
    image: ImageLike,
    *,
    strength: float | None = None,
    window: int | None = None,
    color_space: ColorSpace = "srgb",
    progress: Progress = None,
) -> Picture:
    """Makes smooth edges of stairs; options as for :func:`clean`."""
    return _everywhere(image, "antialias", color_space, progress, strength=strength, window=window)


def enlarge(
    image: ImageLike,
    scale: float,
    *,
    window: int | None = None,
    color_space: ColorSpace = "srgb",
    progress: Progress = None,
) -> Picture:
    """Enlarges a picture with crisp edges.

    :param scale: pixels of the result for each of the picture, above 0
    """
    return _everywhere(image, "antialias", color_space, progress, scale=scale, window=window)


Mode = Literal[
    "abstract",
    "smooth",
    "sharpen",
    "clean",
    "antialias",
    "stamp",
    "color",
    "dodge",
    "burn",
    "saturation",
    "recolor",
    "clone",
]


def brush(
    image: ImageLike,
    strokes: Points | Sequence[Mapping[str, Any]] | Mapping[str, Any],
    *,
    mode: Mode = "smooth",
    strength: float | None = None,
    iterations: int | None = None,
    window: int | None = None,
    noise_sigma: float | None = None,
    radius: float | None = None,
    hardness: float | None = None,
    across_edges: bool | None = None,
    color: tuple[int, int, int] | None = None,
    amount: float | None = None,
    offset: tuple[int, int] | None = None,
    undo: int | None = None,
    pixel_centers: PixelCenters = "half",
    color_space: ColorSpace = "srgb",
    progress: Progress = None,
) -> Picture:
    """Paints with a brush that stops at edges.

    :param strokes: points ``(x, y)`` of one stroke with the settings below, or strokes with settings of their own, as
        ``ravec brush --help`` describes them
    :param radius: radius of a stroke of points in pixels, above 0, up to 4096
    :param hardness: share of the radius with full effect, 0 to 1
    :param across_edges: let the stroke cross edges
    :param color: red, green and blue for ``color`` and ``recolor``, 0 to 255
    :param amount: change of the saturation, -1 to 4
    :param offset: columns and rows from each pixel to the one that ``clone`` copies
    :param undo: number of the last strokes that are left out
    """
    import json

    data: Any = strokes
    if not isinstance(strokes, Mapping):
        listed = list(strokes)
        if listed and not isinstance(listed[0], Mapping):
            data = [[float(x), float(y)] for x, y in listed]
            check_finite(np.asarray(data, dtype=np.float64))
        else:
            data = listed
    outcome = operate(
        "brush",
        {"input": "@input", "output": "@output", "stroke": "@strokes"},
        params={
            "mode": mode,
            "strength": strength,
            "iterations": iterations,
            "window": window,
            "noise_sigma": noise_sigma,
            "radius": radius,
            "hardness": hardness,
            "across_edges": across_edges,
            "color": None if color is None else list(color),
            "amount": amount,
            "offset": None if offset is None else list(offset),
            "undo": undo,
            "pixel_centers": pixel_centers,
        },
        inputs={"@input": as_array(image), "@strokes": json.dumps(data)},
        color_space=color_space,
        progress=progress,
    )
    return picture(outcome.picture("@output"))


