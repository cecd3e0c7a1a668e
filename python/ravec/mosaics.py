"""Photo mosaics, and the catalogues of photos that they are made of."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any, Literal

from ._options import (
    ColorSpace,
    ImageLike,
    PathLike,
    Picture,
    Progress,
    as_array,
    operate,
    picture,
    report_of,
    without_none,
)


def _sides(value: int | tuple[int, int] | str | None) -> str | None:
    if value is None or isinstance(value, str):
        return value
    return str(value) if isinstance(value, int) else f"{value[0]}x{value[1]}"


def params_of(options: Mapping[str, Any]) -> dict[str, Any]:
    """Options as the command line takes them."""
    return without_none(
        {
            **options,
            "tiles": _sides(options.get("tiles")),
            "tile_size": _sides(options.get("tile_size")),
            "pins": list(options.get("pins") or ()) or None,
            "bans": list(options.get("bans") or ()) or None,
        }
    )


class Catalogue:
    """A catalogue of photos in one file, which stays valid whatever happens to the program."""

    def __init__(self, path: PathLike) -> None:
        #: The file, which the first :meth:`add` creates.
        self.path = os.fspath(path)

    def _run(self, operation: str, fields: Mapping[str, Any], progress: Progress = None) -> dict[str, Any]:
        given = {"catalogue": self.path, **fields}
        return report_of(operate(operation, given, progress=progress))

    def add(self, *paths: PathLike, progress: Progress = None) -> dict[str, Any]:
        """Adds photos, and folders with everything below them. Returns the report."""
        return self._run("library add", {"paths": [os.fspath(path) for path in paths]}, progress)

    def remove(self, *paths: PathLike) -> dict[str, Any]:
        """Removes photos and folders from the catalogue, not from the disk. Returns the report."""
        return self._run("library remove", {"paths": [os.fspath(path) for path in paths]})

    def clean(self, *, dry_run: bool = False) -> dict[str, Any]:
        """Removes photos that are gone or nearly the same as others. Returns the report."""
        return self._run("library clean", {"params": {"dry_run": dry_run}})

    def photos(self, *, all: bool = False) -> Any:
        """The photos as the command line lists them; ``all`` includes those that were cleaned away."""
        return self._run("library list", {"params": {"all": all}})["result"]

    def stats(self) -> dict[str, Any]:
        """Figures of the catalogue."""
        figures: dict[str, Any] = self._run("library stats", {})["figures"]
        return figures

    def __repr__(self) -> str:
        return f"Catalogue({self.path!r})"


def mosaic(
    image: ImageLike,
    catalogue: Catalogue | PathLike,
    *,
    tiles: int | tuple[int, int] | None = None,
    tile_size: int | tuple[int, int] | None = None,
    crop: Literal["never", "center"] | None = None,
    max_uses: int | None = None,
    min_repeat_distance: float | None = None,
    use_all: bool | None = None,
    degree: int | None = None,
    detail: float | None = None,
    feature_degree: int | None = None,
    feature_weight: float | None = None,
    adaptive: bool | None = None,
    seed: int | None = None,
    pins: Sequence[str] = (),
    bans: Sequence[str] = (),
    blend: float | None = None,
    rounds: int | None = None,
    preview: bool | None = None,
    deep_zoom: PathLike | None = None,
    color_space: ColorSpace = "srgb",
    progress: Progress = None,
) -> Picture:
    """A picture made of photos.

    :param tiles: columns and rows of tiles; of one number the rows follow
    :param tile_size: width and height of a tile in pixels
    :param crop: use of photos of another shape: never, or their middle
    :param max_uses: maximum uses of a photo
    :param min_repeat_distance: distance between tiles with the same photo, in tiles
    :param use_all: use every photo at least once
    :param detail: weight of structure against color, 0 to 1
    :param adaptive: larger tiles where the picture is even
    :param pins: tiles with the photo that they have, as in ``"3,0:/photos/a.jpg"``
    :param bans: photos that are not used, or not at a tile
    :param blend: weight with which neighbors compensate one another's errors, 0 to 1
    :param preview: a quick look, made of the small pictures in the catalogue
    :param deep_zoom: folder of a page that zooms into the photos
    """
    path = catalogue.path if isinstance(catalogue, Catalogue) else os.fspath(catalogue)
    outcome = operate(
        "mosaic",
        without_none(
            {
                "input": "@input",
                "catalogue": path,
                "output": "@output",
                "deep_zoom": None if deep_zoom is None else os.fspath(deep_zoom),
            }
        ),
        params=params_of(
            {
                "tiles": tiles,
                "tile_size": tile_size,
                "crop": crop,
                "max_uses": max_uses,
                "min_repeat_distance": min_repeat_distance,
                "use_all": use_all,
                "degree": degree,
                "detail": detail,
                "feature_degree": feature_degree,
                "feature_weight": feature_weight,
                "adaptive": adaptive,
                "seed": seed,
                "pins": pins,
                "bans": bans,
                "blend": blend,
                "rounds": rounds,
                "preview": preview,
            }
        ),
        inputs={"@input": as_array(image)},
        color_space=color_space,
        progress=progress,
    )
    return picture(outcome.picture("@output"))
