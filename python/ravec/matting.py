"""Alpha and colors of the foreground."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any, Literal

from . import _ravec
from ._options import ColorSpace, ImageLike, Picture, Progress, as_array, operate, picture


def matte(
    image: ImageLike,
    *,
    trimap: ImageLike | None = None,
    strokes: ImageLike | None = None,
    plate: ImageLike | None = None,
    content: Literal["alpha", "foreground"] = "alpha",
    snap: float | None = None,
    shadows: Literal["foreground", "keep", "soften", "drop"] | None = None,
    color_space: ColorSpace = "srgb",
    progress: Progress = None,
) -> Picture:
    """Alpha of the foreground as a gray picture, or its colors with alpha.

    One of ``trimap``, ``strokes`` and ``plate`` is needed; strokes may go with a plate.

    :param trimap: white is foreground, black background, gray to be found
    :param strokes: white is foreground, black background, gray says nothing
    :param plate: the background without foreground
    :param content: ``alpha``, or ``foreground`` for its colors without those of the background, with alpha
    :param snap: with a plate, alpha up to this value is 0, and from one less it 1; 0 to 0.25
    :param shadows: with a plate, shadows are foreground, black with their alpha, with half of it, or background
    """
    inputs: dict[str, Any] = {"@input": as_array(image)}
    fields: dict[str, Any] = {"input": "@input", "output": "@output"}
    for name, value in (("trimap", trimap), ("plate", plate)):
        if value is not None:
            fields[name], inputs[f"@{name}"] = f"@{name}", as_array(value)
    solver = {key: value for key, value in (("snap", snap), ("shadows", shadows)) if value is not None}
    with tempfile.TemporaryDirectory(prefix="ravec-") as folder:
        if strokes is not None:
            # strokes belong to frames of clips, too, and are read from files
            fields["strokes"] = os.path.join(folder, "strokes.png")
            Path(fields["strokes"]).write_bytes(_ravec.png(as_array(strokes)))
        outcome = operate(
            "matte",
            fields,
            params={"content": content, "matte": solver or None},
            inputs=inputs,
            color_space=color_space,
            progress=progress,
        )
    found = outcome.picture("@output")
    if content == "alpha" and found.ndim == 3:
        found = found[..., 0].copy()
    return picture(found)
