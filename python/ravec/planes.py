"""Planes in pictures: homographies, matches, proposals, grids that snap to edges, and straight views."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
    report_of,
    text,
)


class Homography:
    """A map between two planes, as a matrix of shape (3, 3)."""

    def __init__(self, matrix: ArrayLike) -> None:
        array = np.array(matrix, dtype=np.float64)
        if array.size != 9 or not np.isfinite(array).all():
            raise ValueError(f"a homography has 9 finite numbers, not an array of shape {array.shape}")
        array = array.reshape(3, 3)
        if abs(np.linalg.det(array / np.abs(array).max(initial=1e-300))) < 1e-14:
            raise ValueError("the matrix of a homography has no inverse")
        array.setflags(write=False)
        #: The matrix, which is not changed.
        self.matrix: NDArray[np.float64] = array
        #: Which pairs agree, if the map was found from pairs many of which may be wrong.
        self.inliers: NDArray[np.bool_] | None = None
        #: Standard deviation of the noise of the points in pixels, if it was found.
        self.sigma_px: float | None = None
        #: The report, if the map was found by :func:`match`.
        self.report: dict[str, Any] | None = None

    @classmethod
    def from_points(cls, src: Points, dst: Points) -> Homography:
        """The map of four or more pairs of points whose only error is noise."""
        return cls(_ravec.estimate(_points(src), _points(dst)))

    @classmethod
    def robust(cls, src: Points, dst: Points, *, max_sigma: float = 2.5, seed: int = 0) -> Homography:
        """The map of pairs of points many of which may be wrong.

        :param max_sigma: largest standard deviation of the noise of a coordinate that is thought possible, in pixels
        """
        rows, inliers, sigma = _ravec.estimate_robust(_points(src), _points(dst), max_sigma, seed)
        found = cls(rows)
        found.inliers, found.sigma_px = np.array(inliers, dtype=np.bool_), sigma
        return found

    def apply(self, points: Points) -> NDArray[np.float64]:
        """The points of shape (N, 2) on the other plane; NaN for those on the horizon."""
        given = _points(points)
        mapped = np.concatenate([given, np.ones((len(given), 1))], axis=1) @ self.matrix.T
        with np.errstate(divide="ignore", invalid="ignore"):
            found: NDArray[np.float64] = mapped[:, :2] / mapped[:, 2:]
        found[~np.isfinite(found).all(axis=1)] = np.nan
        return found

    def inverse(self) -> Homography:
        """The map back."""
        return Homography(np.linalg.inv(self.matrix))

    def __matmul__(self, first: Homography) -> Homography:
        """This map after ``first``."""
        return Homography(self.matrix @ first.matrix)

    def warp(
        self,
        image: ImageLike,
        width: int,
        height: int,
        *,
        color_space: ColorSpace = "srgb",
        progress: Progress = None,
    ) -> Picture:
        """The picture on the other plane, filtered in linear light where it is reduced; black beyond it.

        This map leads from pixels of ``image`` to those of the result.
        """
        with listener(progress) as listening:
            rows = [float(value) for value in self.matrix.ravel()]
            return picture(_ravec.warp(as_array(image), rows, width, height, color_space, listening))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.array(self.matrix, dtype=dtype)

    def __repr__(self) -> str:
        return f"Homography({np.array2string(self.matrix, separator=', ')})"


def _points(points: Points) -> NDArray[np.float64]:
    array = np.ascontiguousarray(points, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 2:
        raise ValueError(f"points have the shape (N, 2), not {array.shape}")
    return array


def match(
    first: ImageLike,
    second: ImageLike,
    *,
    features: int | None = None,
    upright: bool | None = None,
    seed: int | None = None,
    pixel_centers: PixelCenters = "half",
    progress: Progress = None,
) -> Homography:
    """The homography from the first photo of a plane to the second.

    :param features: number of features in each photo, 50 to 20000
    :param upright: the photos are not rotated against each other
    """
    outcome = operate(
        "match",
        {"first": "@first", "second": "@second", "output": "@output"},
        params={"features": features, "upright": upright, "seed": seed, "pixel_centers": pixel_centers},
        inputs={"@first": as_array(first), "@second": as_array(second)},
        progress=progress,
    )
    found = Homography([float(number) for number in outcome.text("@output").split()])
    found.report = report_of(outcome)
    found.sigma_px = found.report["figures"].get("sigma_px")
    return found


class PlaneProposals:
    """Planes that may be in a picture."""

    def __init__(self, report: dict[str, Any]) -> None:
        result = report["result"]
        #: Corners of a rectangle on each plane, in turn from the upper left one: shape (4, 2).
        self.quads: list[NDArray[np.float64]] = [
            np.array(plane["quad"], dtype=np.float64) for plane in result["planes"]
        ]
        #: The focal length in pixels, if it is known or was found.
        self.focal_px: float | None = result.get("focal_px")
        #: The report.
        self.report = report

    def __len__(self) -> int:
        return len(self.quads)


def propose(
    image: ImageLike,
    *,
    focal: str | float | None = None,
    most: int | None = None,
    pixel_centers: PixelCenters = "half",
    progress: Progress = None,
) -> PlaneProposals:
    """Proposes planes, from edges that meet in vanishing points.

    :param focal: focal length in pixels, or as in ``"28mm"`` on 35 mm film; then only what is at right angles is
        proposed
    :param most: maximum number of planes, 1 to 12
    """
    outcome = operate(
        "planes",
        {"input": "@input"},
        params={"focal": _focal(focal), "most": most, "pixel_centers": pixel_centers},
        inputs={"@input": as_array(image)},
        progress=progress,
    )
    return PlaneProposals(report_of(outcome))


def _focal(focal: str | float | None) -> str | None:
    return f"{focal}px" if isinstance(focal, (int, float)) else focal


class Snapped:
    """A grid that has snapped to edges."""

    def __init__(self, report: dict[str, Any]) -> None:
        result = report["result"]
        #: The corners, in turn from the upper left one: shape (4, 2).
        self.quad: NDArray[np.float64] = np.array(result["quad"], dtype=np.float64)
        #: Columns and rows of the grid.
        self.columns: int = result["columns"]
        self.rows: int = result["rows"]
        #: Share of the grid that lies on edges, 0 to 1.
        self.support: float = result["support"]
        #: The report.
        self.report = report


def snap(
    image: ImageLike,
    quad: Points,
    *,
    grid: tuple[int, int] | None = None,
    reach: float | None = None,
    pixel_centers: PixelCenters = "half",
    progress: Progress = None,
) -> Snapped:
    """Snaps a rough quadrilateral, with a grid on it, to edges of the picture.

    :param quad: the rough corners, in turn from the upper left one
    :param grid: columns and rows; searched for unless they are given
    :param reach: maximum error of a rough corner, in percent of the diagonal, 0 to 20
    """
    outcome = operate(
        "snap",
        {"input": "@input"},
        params={
            "quad": corners(quad, 4),
            "grid": None if grid is None else f"{grid[0]}x{grid[1]}",
            "reach": reach,
            "pixel_centers": pixel_centers,
        },
        inputs={"@input": as_array(image)},
        progress=progress,
    )
    return Snapped(report_of(outcome))


class Rectified:
    """A plane as if seen from the front."""

    def __init__(self, view: Picture, report: dict[str, Any]) -> None:
        result = report["result"]
        #: The picture.
        self.picture = view
        #: The map from the picture to this view.
        self.straight_from_image = Homography(result["straight_from_image"])
        #: Width of the rectangle by its height.
        self.aspect: float = result["aspect"]
        #: The report.
        self.report = report


def rectify(
    image: ImageLike,
    quad: Points,
    *,
    aspect: float | str | None = None,
    focal: str | float | None = None,
    width: int | None = None,
    height: int | None = None,
    margin: float | None = None,
    whole: bool | None = None,
    pixel_centers: PixelCenters = "half",
    color_space: ColorSpace = "srgb",
    progress: Progress = None,
) -> Rectified:
    """Shows a plane from the front; what lies beyond the picture is transparent.

    :param quad: corners of a rectangle on the plane, in turn from the upper left one
    :param aspect: width of the rectangle by its height, a number or as in ``"3:2"``; computed from the
        perspective unless it is given
    :param width: width of the rectangle in the result in pixels
    :param margin: margin around the rectangle, in its sides
    :param whole: show all of the plane that is in the picture
    """
    outcome = operate(
        "rectify",
        {"input": "@input", "output": "@output"},
        params={
            "quad": corners(quad, 4),
            "aspect": text(aspect),
            "focal": _focal(focal),
            "width": width,
            "height": height,
            "margin": margin,
            "whole": whole,
            "pixel_centers": pixel_centers,
        },
        inputs={"@input": as_array(image)},
        color_space=color_space,
        progress=progress,
    )
    return Rectified(picture(outcome.picture("@output")), report_of(outcome))
