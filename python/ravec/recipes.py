"""Recipes: lists of operations of the command line."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from . import _ravec
from ._options import ColorSpace, PathLike, Picture, Progress, as_array, listener, picture, report_of
from .meshes import Mesh


class Result:
    """What a recipe left: its report, and its outputs in memory by names such as ``@wide``."""

    def __init__(self, outcome: _ravec.Outcome) -> None:
        self._outcome = outcome
        #: The report, with those of the steps.
        self.report: dict[str, Any] = report_of(outcome)

    def picture(self, name: str) -> Picture:
        """The picture of a name; ``KeyError`` if there is none."""
        return picture(self._outcome.picture(name))

    def mesh(self, name: str) -> Mesh:
        """The mesh of a name; ``KeyError`` if there is none."""
        return Mesh._of(self._outcome.mesh(name), self.report)

    def text(self, name: str) -> str:
        """The text of a name, such as a track; ``KeyError`` if there is none."""
        return self._outcome.text(name)


def run(
    recipe: Mapping[str, Any] | PathLike,
    inputs: Mapping[str, Any] | None = None,
    *,
    folder: PathLike | None = None,
    color_space: ColorSpace = "srgb",
    progress: Progress = None,
) -> Result:
    """Runs a recipe: a file as ``--recipe`` writes it, or the same as a dict.

    ``{"operation": ..., ...}`` alone is a recipe of one step. Paths that begin with ``@`` stay in memory: as inputs
    they are those of ``inputs``, as outputs they are found in the result.

    :param inputs: pictures, meshes and texts by names such as ``@photo``
    :param folder: where a dict that is ``relative_to`` the recipe finds its files; by default the working folder
    """
    if isinstance(recipe, Mapping):
        steps = dict(recipe)
        if "steps" not in steps:
            steps = {"version": 1, "steps": [steps]}
        text, file = json.dumps(steps), Path(os.fspath(folder or "."), "recipe.json")
    else:
        file = Path(os.fspath(recipe))
        text = file.read_text(encoding="utf-8")
    given: dict[str, Any] = {}
    for name, value in (inputs or {}).items():
        if isinstance(value, str):
            given[name] = value
        elif Mesh._is_like(value):
            given[name] = Mesh._from(value)._data
        else:
            given[name] = as_array(value)
    with listener(progress) as listening:
        outcome = _ravec.run_recipe(text, str(file), given, color_space, listening)
    return Result(outcome)
