"""One picture in many formats, with objects in shape and lines straight."""

from __future__ import annotations

import json
from typing import Literal

from . import _ravec
from ._options import ColorSpace, ImageLike, Picture, Progress, as_array, listener, picture, without_none


class Retargeter:
    """A picture that is analyzed once, and asked for many sizes.

    :param protect: mask of what keeps its shape
    :param give_way: mask of what is squeezed or stretched first
    :param grid: cells along the longer side, 2 to 400
    :param adaptive: large cells where the picture is even
    :param saliency: weight of regions that stand out, 0 to 1
    :param lines: weight of straight lines, 0 to 10
    :param object_scale: size of important content, 0.25 to 4
    :param borders: freedom of the border: along itself, opposite borders alike, or out of the frame
    :param crop: share of the width or height that may be cut off, 0 to 0.5
    """

    def __init__(
        self,
        image: ImageLike,
        *,
        protect: ImageLike | None = None,
        give_way: ImageLike | None = None,
        grid: int | None = None,
        adaptive: bool = False,
        saliency: float = 1.0,
        lines: float = 1.0,
        object_scale: float = 1.0,
        borders: Literal["slide", "symmetric", "free"] = "slide",
        crop: float = 0.0,
        color_space: ColorSpace = "srgb",
        progress: Progress = None,
    ) -> None:
        array = as_array(image)
        params = without_none(
            {
                "grid_cells": grid,
                "adaptive": adaptive,
                "saliency": saliency,
                "line_strength": lines,
                "object_scale": object_scale,
                "borders": borders,
                "max_crop": crop,
            }
        )
        with listener(progress) as listening:
            self._retargeter = _ravec.Retargeter(
                array,
                json.dumps(params),
                None if protect is None else as_array(protect),
                None if give_way is None else as_array(give_way),
                color_space,
                listening,
            )
        self._size = (array.shape[1], array.shape[0])

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows of the picture."""
        return self._size

    def picture(self, width: int, height: int, *, progress: Progress = None) -> Picture:
        """The picture with ``width`` columns and ``height`` rows, each at most 20 times as many or as few as before."""
        with listener(progress) as listening:
            return picture(self._retargeter.picture(width, height, listening))


def retarget(
    image: ImageLike,
    width: int,
    height: int,
    *,
    protect: ImageLike | None = None,
    give_way: ImageLike | None = None,
    grid: int | None = None,
    adaptive: bool = False,
    saliency: float = 1.0,
    lines: float = 1.0,
    object_scale: float = 1.0,
    borders: Literal["slide", "symmetric", "free"] = "slide",
    crop: float = 0.0,
    color_space: ColorSpace = "srgb",
    progress: Progress = None,
) -> Picture:
    """The picture in another format; for several of them keep a :class:`Retargeter`, whose options these are."""
    kept = Retargeter(
        image,
        protect=protect,
        give_way=give_way,
        grid=grid,
        adaptive=adaptive,
        saliency=saliency,
        lines=lines,
        object_scale=object_scale,
        borders=borders,
        crop=crop,
        color_space=color_space,
        progress=progress,
    )
    return kept.picture(width, height)
