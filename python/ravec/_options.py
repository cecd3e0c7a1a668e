"""What all functions share: pictures as arrays, options as JSON, progress."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Literal, TypeAlias, Union

import numpy as np
from numpy.typing import NDArray

from . import _ravec

#: An array, or a picture of Pillow.
ImageLike: TypeAlias = Any
#: The color space of floats.
ColorSpace: TypeAlias = Literal["srgb", "linear"]
#: The middle of the first pixel: (0.5, 0.5) or (0, 0).
PixelCenters: TypeAlias = Literal["half", "integer"]
#: ``True`` for a bar, or a callable that takes the phase, the units that are done and their total.
Progress: TypeAlias = Union[bool, Callable[[str, int, int], object], None]
#: Points ``(x, y)``: a sequence of pairs, or an array of shape (N, 2).
Points: TypeAlias = Union[Sequence[Sequence[float]], NDArray[Any]]
#: A path of a file.
PathLike: TypeAlias = Union[str, "os.PathLike[str]"]


class Picture(np.ndarray[Any, Any]):
    """An array of pixels that notebooks show. What is computed from it is a plain array or number."""

    def __array_wrap__(self, array: Any, context: Any = None, return_scalar: bool = False) -> Any:
        plain = np.asarray(array)
        return plain[()] if plain.ndim == 0 else plain

    def _repr_png_(self) -> bytes | None:
        if self.ndim not in (2, 3) or self.size == 0:
            return None
        try:
            return _ravec.png(np.ascontiguousarray(self))
        except (TypeError, ValueError):
            return None


def picture(array: NDArray[Any]) -> Picture:
    """The array as a picture, without a copy."""
    return array.view(Picture)


def as_array(image: ImageLike) -> NDArray[Any]:
    """The pixels of an array or of a picture of Pillow, in samples that the library reads."""
    mode = getattr(image, "mode", None)
    if mode is not None and hasattr(image, "getbands"):
        if mode in ("P", "PA") or mode not in ("L", "LA", "RGB", "RGBA", "I;16", "F", "1"):
            transparent = mode.lower().endswith("a") or "transparency" in getattr(image, "info", {})
            image = image.convert("RGBA" if transparent else "RGB")
    array = np.asarray(image)
    if array.dtype == np.bool_:
        return array.astype(np.uint8) * np.uint8(255)
    if array.dtype == np.float64 or array.dtype == np.float16:
        return array.astype(np.float32)
    if array.dtype.byteorder not in ("=", "|") and array.dtype.kind in "uf":
        return array.astype(array.dtype.newbyteorder("="))
    return array


def set_device(name: str) -> str | None:
    """Chooses the device that computes two-color pixels, filters and warps from now on; at first the CPU.

    Returns the adapter and its driver, or ``None`` for the CPU. Fits and cleaned pictures are the same bits on all
    devices; lines between pixel centers, renderings and warps differ by less than a step of 8 bits in nearly all samples. Where the
    device cannot be used any more, the CPU does the rest, with a ``RuntimeWarning`` or a warning in the report.

    :param name: ``"cpu"``, ``"gpu"`` for a hardware adapter, ``"auto"`` for a hardware adapter if there is one and
        else the CPU, or part of an adapter's name
    """
    return _ravec.set_device(name)


def without_none(options: Mapping[str, Any]) -> dict[str, Any]:
    """The options that were given; the others have their defaults."""
    return {name: value for name, value in options.items() if value is not None}


def corners(points: Points, count: int | None = None) -> str:
    """Points as the command line takes them: x,y,x,y,..."""
    array = np.asarray(points, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 2 or (count is not None and len(array) != count):
        wanted = "N" if count is None else str(count)
        raise ValueError(f"points have the shape ({wanted}, 2), not {array.shape}")
    check_finite(array)
    return ",".join(repr(float(value)) for value in array.ravel())


def check_finite(points: NDArray[np.float64]) -> None:
    """Refuses points that are not numbers."""
    wrong = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if wrong.size:
        raise ValueError(f"point {wrong[0]} is {points[wrong[0]].tolist()}, but coordinates must be finite numbers")


def text(value: object) -> str | None:
    """A number or a text as the command line takes it."""
    if value is None:
        return None
    return repr(float(value)) if isinstance(value, (float, np.floating)) else str(value)


@contextlib.contextmanager
def listener(progress: Progress) -> Iterator[Callable[[str, int, int], object] | None]:
    """What is called with the progress of some work."""
    if progress is None or progress is False:
        yield None
        return
    if progress is not True:
        yield progress
        return
    try:
        from tqdm.auto import tqdm  # type: ignore[import-untyped,unused-ignore]
    except ImportError as error:
        raise ImportError("progress=True needs tqdm: pip install tqdm, or pass a callable") from error
    bar = tqdm(total=1000, unit="‰", bar_format="{desc} {percentage:3.0f}%|{bar}| {elapsed}")

    def show(phase: str, done: int, total: int) -> None:
        bar.set_description(phase, refresh=False)
        bar.n = 1000 * done // max(total, 1)
        bar.refresh()

    try:
        yield show
    finally:
        bar.close()


def operate(
    operation: str,
    fields: Mapping[str, Any],
    *,
    params: Mapping[str, Any] | None = None,
    inputs: Mapping[str, Any] | None = None,
    color_space: ColorSpace = "srgb",
    progress: Progress = None,
) -> _ravec.Outcome:
    """Runs an operation of the command line; ``inputs`` are pictures, meshes and texts by names such as ``@input``."""
    step = {"operation": operation, **without_none(fields)}
    given = without_none(params or {})
    if given:
        step["params"] = given
    with listener(progress) as listening:
        return _ravec.run_operation(json.dumps(step), dict(inputs or {}), color_space, listening)


def report_of(outcome: _ravec.Outcome) -> dict[str, Any]:
    """The report of an operation."""
    report: dict[str, Any] = json.loads(outcome.report)
    return report
