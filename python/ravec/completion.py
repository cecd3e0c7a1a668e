"""Holes filled from the rest of a picture, in perspective where planes are known."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np

from . import _ravec
from ._options import (
    ColorSpace,
    ImageLike,
    Picture,
    PixelCenters,
    Points,
    Progress,
    as_array,
    corners,
    listener,
    operate,
    picture,
)


def complete(
    image: ImageLike,
    mask: ImageLike | None = None,
    *,
    polygons: Sequence[Points] = (),
    planes: Sequence[Points] = (),
    features: ImageLike | None = None,
    sources: Sequence[ImageLike] = (),
    engine: Literal["offsets", "fragments"] | None = None,
    search: int | None = None,
    unblended: bool | None = None,
    radius: int | None = None,
    mirror: bool | None = None,
    turns: Sequence[float] | None = None,
    scales: Sequence[float] | None = None,
    pixel_centers: PixelCenters = "half",
    color_space: ColorSpace = "srgb",
    progress: Progress = None,
) -> Picture:
    """Fills what a mask covers.

    :param mask: white (or ``True``) is replaced, black kept, gray mixed
    :param polygons: polygons that are replaced as well, each of shape (N, 2)
    :param planes: corners of a rectangle on each plane, of shape (4, 2): what is on it is filled in its perspective
    :param features: mask of structure to continue, inside and outside the hole
    :param sources: other photos that fragments may come from
    :param engine: as a whole by offsets, or step by step by fragments; by default what the options need
    :param search: radius around the hole in which sources are sought, in pixels, 16 to 65535
    :param unblended: keep the tones of what is copied
    :param radius: radius of fragments in pixels, 2 to 124
    :param mirror: use mirrored fragments, too
    :param turns: use fragments turned by these angles in degrees, too
    :param scales: use fragments scaled by these factors, 0.25 to 4, too
    """
    inputs: dict[str, Any] = {"@input": as_array(image)}
    fields: dict[str, Any] = {"input": "@input", "output": "@output"}
    if mask is not None:
        fields["mask"], inputs["@mask"] = "@mask", as_array(mask)
    if features is not None:
        fields["features"], inputs["@features"] = "@features", as_array(features)
    names = [f"@source{index}" for index in range(len(sources))]
    if names:
        fields["sources"] = names
        inputs.update(zip(names, map(as_array, sources)))
    outcome = operate(
        "complete",
        fields,
        params={
            "polygons": _corners(polygons),
            "planes": _corners(planes),
            "engine": engine,
            "search": search,
            "unblended": unblended,
            "radius": radius,
            "mirror": mirror,
            "turns": None if turns is None else list(turns),
            "scales": None if scales is None else list(scales),
            "pixel_centers": pixel_centers,
        },
        inputs=inputs,
        color_space=color_space,
        progress=progress,
    )
    return picture(outcome.picture("@output"))


def _corners(polygons: Sequence[Points]) -> list[list[list[float]]] | None:
    if len(polygons) == 0:
        return None
    for polygon in polygons:
        corners(polygon)
    return [[[float(x), float(y)] for x, y in polygon] for polygon in polygons]


class FragmentIndex:
    """Everything that may be copied into a hole, prepared for searches.

    Takes about 50 bytes and 100 nanoseconds of one core for each pixel. Options are those of :func:`complete`.
    """

    def __init__(
        self,
        image: ImageLike,
        mask: ImageLike,
        *,
        planes: Sequence[Points] = (),
        features: ImageLike | None = None,
        sources: Sequence[ImageLike] = (),
        mirror: bool = False,
        turns: Sequence[float] = (),
        scales: Sequence[float] = (),
        color_space: ColorSpace = "srgb",
        progress: Progress = None,
    ) -> None:
        quads = [np.asarray(plane, dtype=np.float64) for plane in planes]
        for quad in quads:
            corners(quad, 4)
        options = {
            "planes": [quad.tolist() for quad in quads],
            "photos": [as_array(source) for source in sources],
            "features": None if features is None else as_array(features),
            "mirror": mirror,
            "turns": [float(turn) for turn in turns],
            "scales": [float(scale) for scale in scales],
            "color_space": color_space,
        }
        with listener(progress) as listening:
            self._index = _ravec.FragmentIndex(as_array(image), as_array(mask), options, listening)


class Retouch:
    """A picture whose hole is filled step by step.

    A step is a dict that says what is replaced by what; the same steps on the same picture give the same bytes.
    """

    def __init__(self, index: FragmentIndex, steps: Sequence[dict[str, Any]] = ()) -> None:
        self._index = index._index
        #: The steps so far, the first one first.
        self.steps: list[dict[str, Any]] = list(steps)

    def best(
        self,
        at: Sequence[float],
        radius: int,
        *,
        square: bool = False,
        plane: int | None = None,
        count: int = 8,
        apart: float = 0.5,
        progress: Progress = None,
    ) -> list[dict[str, Any]]:
        """The sources that fit best around a point, the best first.

        Each has a ``step`` for :meth:`apply` and its ``mismatch``, the mean squared difference of colors and gradients.

        :param at: the middle ``(x, y)`` in pixels
        :param radius: from the middle to the rim in pixels, 2 to 124
        :param plane: index of the plane in whose view the fragment is cut out
        :param count: number of sources
        :param apart: least distance of two of them, as a share of the radius, 0 to 2
        """
        options = {
            "at": [float(at[0]), float(at[1])],
            "radius": radius,
            "square": square,
            "plane": plane,
            "count": count,
            "apart": apart,
        }
        with listener(progress) as listening:
            found: list[dict[str, Any]] = json.loads(self._index.best(json.dumps(self.steps), options, listening))
        return found

    def apply(self, step: dict[str, Any]) -> int:
        """Takes a step, and returns how many pixels of the hole are open still."""
        steps = [*self.steps, step.get("step", step)]
        left: int = self._index.open_px(json.dumps(steps))
        self.steps = steps
        return left

    def undo(self) -> dict[str, Any] | None:
        """Takes the last step back, and returns it; ``None`` if there is none."""
        return self.steps.pop() if self.steps else None

    def fill(self, *, radius: int | None = None, square: bool = False, progress: Progress = None) -> int:
        """Fills what is open, and returns how many pixels there is no source for.

        :param radius: radius of fragments in pixels; chosen from the picture unless it is given
        """
        with listener(progress) as listening:
            self.steps = json.loads(self._index.fill(json.dumps(self.steps), radius, square, listening))
        return self.open_px

    @property
    def open_px(self) -> int:
        """Pixels of the hole that are open."""
        return self._index.open_px(json.dumps(self.steps))

    @property
    def picture(self) -> Picture:
        """The picture as it is now."""
        return picture(self._index.picture(json.dumps(self.steps)))
