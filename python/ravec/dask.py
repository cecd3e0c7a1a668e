"""Work that outgrows a machine, on a cluster of Dask (``pip install 'ravec[dask]'``).

- :func:`map_recipe` runs a recipe over many files, by path or URL of fsspec.
- :func:`offset` computes the offset of a mesh by tiles of space.
- :func:`mosaic` makes a mosaic: workers search for candidates, scale photos and paint rows.
- :func:`clean`, :func:`smooth`, :func:`abstract`, :func:`sharpen`, :func:`enlarge` and :func:`render` take
  arrays of Dask, whose chunks they work on with the pixels around them; :func:`read` and :func:`write` are for
  TIFF files that are larger than the memory.

Each piece of work is a pure function of its input and its parameters, so that what a lost worker had is run
again by another one, and results are the same bytes as on one machine. Workers of another version of this
package are refused.

Every worker uses as many threads as Dask gives it.
"""

from __future__ import annotations

import contextlib
import functools
import json
import os
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from . import _ravec, pictures
from ._large import read as read
from ._large import write as write
from ._options import PathLike, Progress, text, without_none
from ._pieces import (
    check_version,
    default_client,
    local_copy,
    memory_of,
    place,
    run_in_pieces,
    use_threads_of_worker,
)
from .meshes import Length
from .mosaics import Catalogue, params_of
from .recipes import run

# --- many files


def _replaced(value: Any, paths: Mapping[str, str]) -> Any:
    """A recipe with paths in place of names."""
    if isinstance(value, dict):
        return {key: _replaced(inner, paths) for key, inner in value.items()}
    if isinstance(value, list):
        return [_replaced(inner, paths) for inner in value]
    return paths.get(value, value) if isinstance(value, str) else value


def _run_piece(
    recipe: dict[str, Any], folder: str, source: str, target: str, version: str, options: Mapping[str, Any]
) -> dict[str, Any]:
    """Runs a recipe on one file."""
    check_version(version)
    use_threads_of_worker()
    with local_copy(source, options) as local, tempfile.TemporaryDirectory(prefix="ravec-") as scratch:
        made = os.path.join(scratch, PurePosixPath(target).name)
        steps = _replaced(recipe, {"@input": local, "@output": made})
        report = run(steps, folder=folder).report
        place(target, made, options)
    report.update({"input": source, "output": target})
    return report


def targets(inputs: Sequence[str], pattern: str) -> list[str]:
    """The outputs of inputs: ``{stem}``, ``{name}`` and ``{index}`` in the pattern are replaced.

    Two inputs with the same output raise ``ValueError``.
    """
    found = []
    for index, source in enumerate(inputs):
        path = PurePosixPath(source)
        found.append(pattern.format(stem=path.stem, name=path.name, index=index))
    seen: set[str] = set()
    for target in found:
        if target in seen:
            raise ValueError(f"several inputs have the output {target}: use {{index}} in {pattern!r}")
        seen.add(target)
    return found


def map_recipe(
    recipe: Mapping[str, Any] | PathLike,
    inputs: Sequence[PathLike],
    output: str,
    *,
    storage_options: Mapping[str, Any] | None = None,
) -> list[Any]:
    """A recipe over many files, as delayed values of Dask.

    ``dask.compute(*map_recipe(...))`` gives the reports.

    :param recipe: a recipe, or a single operation, whose input is ``@input`` and whose output is ``@output``;
        other paths in it are those of the workers
    :param inputs: paths or URLs
    :param output: pattern of the outputs, as in ``"s3://bucket/{stem}.png"``; ``{name}`` is the name of the
        input, ``{index}`` its number
    :param storage_options: options of fsspec
    """
    import dask

    if isinstance(recipe, Mapping):
        steps, folder = dict(recipe), ""
    else:
        file = Path(os.fspath(recipe)).absolute()
        steps, folder = json.loads(file.read_text(encoding="utf-8")), str(file.parent)
    text = json.dumps(steps)
    for name in ("@input", "@output"):
        if json.dumps(name) not in text:
            raise ValueError(f"the recipe has no {name}: that is where the files of the list go")
    sources = [os.fspath(source) for source in inputs]
    piece = dask.delayed(_run_piece, pure=True)
    options = dict(storage_options or {})
    return [
        piece(steps, folder, source, target, _ravec.__version__, options)
        for source, target in zip(sources, targets(sources, output))
    ]


# --- meshes whose offset is too large for a machine


def offset(
    source: PathLike,
    target: PathLike,
    distance: Length,
    *,
    tolerance: Length | None = None,
    side: Literal["both", "outer", "inner", "shell"] | None = None,
    open: Literal["refuse", "thicken"] | None = None,
    no_simplify: bool | None = None,
    max_normal_deviation: float | None = None,
    memory: str | None = None,
    client: Any = None,
    scratch: str | None = None,
    storage_options: Mapping[str, Any] | None = None,
    progress: Progress = None,
) -> dict[str, Any]:
    """Writes the surface at a distance from a mesh, as :func:`ravec.offset`, computed by the workers of a client.

    The file is the same as that of ``ravec offset --memory`` with the same limit on one machine. Returns the report.

    :param source: path or URL of the mesh
    :param target: path or URL of the result
    :param memory: memory of a piece, such as ``"2GiB"``, which determines the number of pieces; by default 0.6 of the
        least memory limit of a worker
    :param client: client of Dask; by default the latest one
    :param scratch: folder or URL for the parts, about 300 bytes for each triangle before simplification, which all
        machines see; by default a temporary folder, if all workers are on this machine
    :param storage_options: options of fsspec
    """
    client = default_client(client)
    params = without_none(
        {
            "distance": text(distance),
            "tolerance": text(tolerance),
            "side": side,
            "open": open,
            "no_simplify": no_simplify,
            "max_normal_deviation": max_normal_deviation,
            "memory": memory or memory_of(client),
        }
    )
    return run_in_pieces(
        {"operation": "offset", "input": os.fspath(source), "output": os.fspath(target), "params": params},
        client=client,
        scratch=scratch,
        storage_options=storage_options,
        progress=progress,
    )


# --- mosaics of many photos


def mosaic(
    source: PathLike,
    target: PathLike,
    catalogue: Catalogue | PathLike,
    *,
    client: Any = None,
    scratch: str | None = None,
    storage_options: Mapping[str, Any] | None = None,
    progress: Progress = None,
    **options: Any,
) -> dict[str, Any]:
    """Writes a picture made of photos, as :func:`ravec.mosaic`: the workers of a client search for
    candidates, scale photos and paint rows.

    The file is the same as that of ``ravec mosaic`` on one machine, if every worker has the memory for every photo. All
    machines see the photos under the paths of the catalogue, which itself only the client reads. Returns the report.

    :param source: path or URL of the picture
    :param target: path or URL of the mosaic: PNG, JPEG or TIFF
    :param client: client of Dask; by default the latest one
    :param scratch: folder or URL for scaled photos and painted rows, which all machines see; by default a temporary
        folder, if all workers are on this machine
    :param storage_options: options of fsspec
    :param options: those of :func:`ravec.mosaic`, and ``quality`` of a JPEG, 1 to 100
    """
    path = catalogue.path if isinstance(catalogue, Catalogue) else os.fspath(catalogue)
    step = {"operation": "mosaic", "input": os.fspath(source), "output": os.fspath(target), "catalogue": path}
    return run_in_pieces(
        {**step, "params": params_of(options)},
        client=default_client(client),
        scratch=scratch,
        storage_options=storage_options,
        progress=progress,
    )


# --- pictures too large for memory


def _piece(
    chunk: NDArray[Any],
    work: Callable[[NDArray[Any]], NDArray[Any]],
    halo_px: int,
    scale: int,
    version: str,
    block_info: Any = None,
) -> NDArray[Any]:
    """The result for a chunk, without that of its halo."""
    if chunk.size == 0 or block_info is None:
        return chunk
    check_version(version)
    use_threads_of_worker()
    found = work(np.ascontiguousarray(chunk)).view(np.ndarray)
    place, count = block_info[0]["chunk-location"], block_info[0]["num-chunks"]
    sides = []
    for axis in (0, 1):
        first = halo_px * scale if place[axis] > 0 else 0
        last = halo_px * scale if place[axis] + 1 < count[axis] else 0
        sides.append(slice(first, found.shape[axis] - last))
    return np.ascontiguousarray(found[tuple(sides)])


def _aligned(array: Any, step_px: int) -> Any:
    """The array in chunks that end at multiples of a step."""
    for axis in (0, 1):
        edges = np.cumsum(array.chunks[axis])[:-1]
        inner = {int(-(-edge // step_px) * step_px) for edge in edges}
        ends = [*sorted(edge for edge in inner if edge < array.shape[axis]), array.shape[axis]]
        array = array.rechunk({axis: tuple(np.diff([0, *ends]).tolist())})
    return array


def _on_chunks(array: Any, work: Callable[[NDArray[Any]], NDArray[Any]], halo_px: int, scale: int = 1) -> Any:
    """Work on the chunks of an array of Dask, each with the pixels around it."""
    import dask.array

    if array.ndim not in (2, 3):
        raise ValueError(f"a picture has the shape (rows, columns) or (rows, columns, channels), not {array.shape}")
    if array.ndim == 3:
        array = array.rechunk({2: -1})
    if halo_px:
        for axis in (0, 1):
            if len(array.chunks[axis]) > 1 and min(array.chunks[axis]) < halo_px + 8:
                least = min(halo_px + 8, array.shape[axis])
                chunks = dask.array.overlap.ensure_minimum_chunksize(least, array.chunks[axis])
                array = array.rechunk({axis: chunks})
        # cleaning looks at blocks of compression
        array = _aligned(array, 8)
    overlapped = array
    if halo_px:
        # a single chunk has no neighbors, and may be smaller than the halo
        depth = {axis: halo_px if len(array.chunks[axis]) > 1 else 0 for axis in (0, 1)}
        overlapped = dask.array.overlap.overlap(array, depth=depth, boundary="none")
    chunks = tuple(
        tuple(scale * side for side in sides) if axis < 2 else sides for axis, sides in enumerate(array.chunks)
    )
    return overlapped.map_blocks(
        functools.partial(_piece, work=work, halo_px=halo_px, scale=scale, version=_ravec.__version__),
        chunks=chunks,
        dtype=array.dtype,
        meta=np.empty((0,) * array.ndim, dtype=array.dtype),
    )


def _call(name: str, chunk: NDArray[Any], **options: Any) -> NDArray[Any]:
    found: NDArray[Any] = getattr(pictures, name)(chunk, **options)
    return found


def _halo_px(window: int | None, iterations: int | None) -> int:
    """Pixels around a chunk that a filter may look at: two windows for each pass, on the grid of blocks of 8 pixels."""
    reach = (window or 9) * (iterations or 1)
    return 8 * -(-reach // 8)


def clean(array: Any, *, noise_sigma: float, strength: float | None = None, window: int | None = None) -> Any:
    """Removes noise, as :func:`ravec.clean`. The noise is given: each chunk alone would find another one."""
    options = _given(noise_sigma=noise_sigma, strength=strength, window=window)
    return _on_chunks(array, functools.partial(_call, "clean", **options), _halo_px(window, 1))


def smooth(
    array: Any, *, strength: float | None = None, iterations: int | None = None, window: int | None = None
) -> Any:
    """Smooths areas and keeps edges, as :func:`ravec.smooth`."""
    options = _given(strength=strength, iterations=iterations, window=window)
    return _on_chunks(array, functools.partial(_call, "smooth", **options), _halo_px(window, iterations))


def abstract(
    array: Any, *, strength: float | None = None, iterations: int | None = None, window: int | None = None
) -> Any:
    """Makes even areas with crisp edges, as :func:`ravec.abstract`."""
    options = _given(strength=strength, iterations=iterations, window=window)
    return _on_chunks(array, functools.partial(_call, "abstract", **options), _halo_px(window, iterations))


def sharpen(
    array: Any, *, strength: float | None = None, iterations: int | None = None, window: int | None = None
) -> Any:
    """Makes edges crisper, as :func:`ravec.sharpen`."""
    options = _given(strength=strength, iterations=iterations, window=window)
    return _on_chunks(array, functools.partial(_call, "sharpen", **options), _halo_px(window, iterations))


def enlarge(array: Any, scale: int, *, window: int | None = None) -> Any:
    """Enlarges with crisp edges, as :func:`ravec.enlarge`, by a whole number."""
    if scale < 1 or int(scale) != scale:
        raise ValueError(f"chunks are enlarged by whole numbers from 1, not by {scale}")
    options = _given(scale=float(scale), window=window)
    return _on_chunks(array, functools.partial(_call, "enlarge", **options), _halo_px(window, 1), int(scale))


def _rendered(chunk: NDArray[Any], size: int, scale: int, mosaic: bool) -> NDArray[Any]:
    return pictures.TwoColorField.fit(chunk, size=size).render(float(scale), mosaic=mosaic)


def render(array: Any, *, size: int = 8, scale: int = 1, mosaic: bool = False) -> Any:
    """Two-color pixels at ``scale`` times the size, a whole number, as :meth:`ravec.TwoColorField.render`.

    Chunks are made to end where blocks of ``size`` pixels do.
    """
    if scale < 1 or int(scale) != scale:
        raise ValueError(f"chunks are rendered at whole numbers from 1, not at {scale}")
    array = _aligned(array, size)
    work = functools.partial(_rendered, size=size, scale=int(scale), mosaic=mosaic)
    return _on_chunks(array, work, 0, int(scale))


def _given(**options: Any) -> dict[str, Any]:
    return {name: value for name, value in options.items() if value is not None}


# --- the command line


#: Operations in pieces, which take the options of the command line.
_IN_PIECES = ("offset", "mosaic")

#: Filters of large pictures.
_FILTERS = ("clean", "smooth", "abstract", "sharpen", "enlarge", "render")

_USAGE = """\
Runs work on a cluster of Dask: of this machine, or of a scheduler that runs elsewhere.

commands:
  map      run a recipe, whose files are @input and @output, over many files
  offset   compute the offset of a mesh by tiles of space; takes the options of ravec offset
  mosaic   make a mosaic by tiles, photos and rows; takes the options of ravec mosaic
  clean, smooth, abstract, sharpen, enlarge, render
           filter a TIFF file that may be larger than the memory; NAME=VALUE are options of the function

examples:
  python -m ravec.dask map clean.json scans/*.png -o "clean/{stem}.png"
  python -m ravec.dask --workers 8 offset part.stl -o out.ply --distance 2% --tolerance 0.001% --memory 2GiB
  python -m ravec.dask clean scan.tif -o clean.tif noise_sigma=6
  python -m ravec.dask mosaic photo.jpg --catalogue photos.ravec -o mosaic.png --tiles 200 --crop center
  python -m ravec.dask --scheduler tcp://10.0.0.1:8786 --scratch s3://bucket/tmp offset s3://bucket/part.stl -o out.ply
"""


def _error(sentence: object) -> None:
    import sys

    print(f"\nravec: error: {sentence}", file=sys.stderr)


def _map(client: Any, given: Any) -> int:
    """The command ``map``."""
    from distributed import as_completed, progress

    try:
        pieces = map_recipe(given.recipe, given.inputs, given.output)
    except (ValueError, OSError) as error:
        _error(error)
        return 2
    futures = client.compute(pieces)
    if not given.quiet:
        progress(futures)
    failed = 0
    try:
        for future in as_completed(futures):
            reason = future.exception()
            if reason is not None:
                failed += 1
                _error(reason)
    except KeyboardInterrupt:
        client.cancel(futures)
        _error("cancelled")
        return 130
    return 1 if failed else 0


def _filter(given: Any) -> int:
    """A filter of a large picture."""
    import inspect

    work = globals()[given.command]
    known = inspect.signature(work).parameters
    options: dict[str, Any] = {}
    for option in given.options:
        name, equals, value = option.partition("=")
        if not equals or name not in known or name == "array":
            choices = ", ".join(name for name in known if name != "array")
            _error(f"{option} is no option of {given.command}: NAME=VALUE with one of {choices}")
            return 2
        try:
            options[name] = json.loads(value.lower())
        except json.JSONDecodeError:
            _error(f"the value of {name} is {value}, but must be a number, true or false")
            return 2
    required = [name for name, parameter in known.items() if parameter.default is inspect.Parameter.empty]
    missing = [name for name in required if name not in ("array", *options)]
    if missing:
        _error(f"{given.command} needs {missing[0]}=VALUE")
        return 2
    try:
        write(work(read(given.input), **options), given.output)
    except KeyboardInterrupt:
        _error("cancelled")
        return 130
    except Exception as error:  # the sentences of all of them are for the user
        _error(error)
        return 1
    return 0


def _in_pieces(client: Any, step: dict[str, Any], given: Any) -> int:
    """An operation in pieces."""
    import sys

    try:
        if step["operation"] == "offset":
            step["params"].setdefault("memory", None)
            step["params"]["memory"] = step["params"]["memory"] or memory_of(client)
        report = run_in_pieces(
            step,
            client=client,
            scratch=given.scratch,
            storage_options=None,
            progress=not given.quiet and sys.stderr.isatty(),
        )
    except KeyboardInterrupt:
        _error("cancelled")
        return 130
    except Exception as error:  # the sentences of all of them are for the user
        _error(error)
        return 1
    for warning in report.get("warnings", []):
        print(f"ravec: warning: {warning}", file=sys.stderr)
    if not given.quiet:
        figures = report.get("figures", {})
        shown = ", ".join(f"{name} {value:g}" for name, value in figures.items() if isinstance(value, (int, float)))
        print(f"{report['output']}: {shown}")
    return 5 if report.get("passed") is False else 0


def main(arguments: Sequence[str] | None = None) -> int:
    """``python -m ravec.dask``."""
    import argparse
    import sys

    shared = argparse.ArgumentParser(
        prog="python -m ravec.dask",
        description=_USAGE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    shared.add_argument("--scheduler", help="address of a scheduler, as in tcp://host:8786 [default: this machine]")
    shared.add_argument("--workers", type=int, help="number of worker processes on this machine [default: by its cores]")
    shared.add_argument("--worker-memory", default="auto", help="memory limit of a worker on this machine, as in 4GiB")
    shared.add_argument("--scratch", help="folder or URL for parts, which all machines see [default: a temporary one]")
    shared.add_argument("-q", "--quiet", action="store_true", help="show no progress")
    shared.add_argument("command", choices=("map", *_IN_PIECES, *_FILTERS), metavar="COMMAND")
    shared.add_argument("rest", nargs=argparse.REMAINDER, help="options of the command; --help shows them")
    given = shared.parse_args(arguments)
    step: dict[str, Any] = {}
    if given.command == "map":
        own = argparse.ArgumentParser(prog="python -m ravec.dask map", description="Runs a recipe over many files.")
        own.add_argument("recipe", help="the recipe as JSON, whose files are @input and @output")
        own.add_argument("inputs", nargs="+", help="paths, or URLs of fsspec")
        own.add_argument("-o", "--output", required=True, help="pattern of the outputs, as in out/{stem}.png")
        own.parse_args(given.rest, namespace=given)
        if not os.path.exists(given.recipe):
            _error(f"there is no recipe {given.recipe}")
            return 2
    elif given.command in _FILTERS:
        own = argparse.ArgumentParser(prog=f"python -m ravec.dask {given.command}", description=globals()[given.command].__doc__)
        own.add_argument("input", help="path or URL of a TIFF file")
        own.add_argument("-o", "--output", required=True, help="path or URL of the result, .tif or .tiff")
        own.add_argument("options", nargs="*", metavar="NAME=VALUE", help="options of the function")
        own.parse_intermixed_args(given.rest, namespace=given)
    else:
        recipe, code = _ravec.recipe_of(["ravec", given.command, *given.rest])
        if recipe is None:
            return code
        (step,) = json.loads(recipe)["steps"]
        if not step.get("output"):
            _error("an operation in pieces writes a file: give -o")
            return 2
    from distributed import Client, LocalCluster

    with contextlib.ExitStack() as stack:
        if given.scheduler:
            client = stack.enter_context(Client(given.scheduler))
        else:
            cluster = LocalCluster(n_workers=given.workers, memory_limit=given.worker_memory, dashboard_address=None)
            client = stack.enter_context(Client(stack.enter_context(cluster)))
        if given.command == "map":
            return _map(client, given)
        if given.command in _FILTERS:
            return _filter(given)
        return _in_pieces(client, step, given)


if __name__ == "__main__":
    raise SystemExit(main())
