"""Work that outgrows a machine, on a cluster of Dask (``pip install 'ravec[dask]'``).

- :func:`map_recipe` runs a recipe over many files, by path or URL of fsspec.
- :func:`clean`, :func:`smooth`, :func:`abstract`, :func:`sharpen`, :func:`enlarge` and :func:`render` take
  arrays of Dask, whose chunks they work on with the pixels around them.

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
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _ravec, pictures
from ._options import PathLike
from .recipes import run

#: Pieces are read and written in blocks of this many bytes.
_BLOCK = 1 << 20


def _check_version(wanted: str) -> None:
    """Refuses to work for a client of another version, whose results may differ."""
    if _ravec.__version__ != wanted:
        raise _ravec.Error(
            f"a worker has ravec {_ravec.__version__} and the client {wanted}: install the same version on all machines"
        )


def _use_threads_of_worker() -> None:
    """Takes the threads that the worker has, not all cores of its machine."""
    try:
        from distributed import get_worker
    except ImportError:
        return
    with contextlib.suppress(ValueError):
        _ravec.set_threads(max(1, get_worker().state.nthreads))


# --- many files


@contextlib.contextmanager
def _local_copy(url: str, options: Mapping[str, Any]) -> Iterator[str]:
    """The path of a file that may be far away."""
    import fsspec

    system, path = fsspec.core.url_to_fs(url, **options)
    if "file" in _protocols(system):
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="ravec-") as folder:
        local = os.path.join(folder, PurePosixPath(path).name)
        system.get_file(path, local)
        yield local


def _protocols(system: Any) -> tuple[str, ...]:
    protocol = system.protocol
    return (protocol,) if isinstance(protocol, str) else tuple(protocol)


def _placed(url: str, local: str, options: Mapping[str, Any]) -> None:
    """Puts a file where it belongs, whole or not at all."""
    import fsspec

    system, path = fsspec.core.url_to_fs(url, **options)
    parent = system._parent(path)
    if parent:
        system.makedirs(parent, exist_ok=True)
    if "file" in _protocols(system):
        part = f"{path}.{os.getpid()}.part"
        try:
            with open(local, "rb") as source, open(part, "wb") as target:
                while block := source.read(_BLOCK):
                    target.write(block)
            os.replace(part, path)
        finally:
            with contextlib.suppress(FileNotFoundError):
                os.remove(part)
        return
    # object stores show a file when it is complete
    system.put_file(local, path)


def _replaced(value: Any, paths: Mapping[str, str]) -> Any:
    """A recipe with paths in place of names."""
    if isinstance(value, dict):
        return {key: _replaced(inner, paths) for key, inner in value.items()}
    if isinstance(value, list):
        return [_replaced(inner, paths) for inner in value]
    return paths.get(value, value) if isinstance(value, str) else value


def _run_piece(
    recipe: dict[str, Any], source: str, target: str, version: str, options: Mapping[str, Any]
) -> dict[str, Any]:
    """Runs a recipe on one file."""
    _check_version(version)
    _use_threads_of_worker()
    with _local_copy(source, options) as local, tempfile.TemporaryDirectory(prefix="ravec-") as folder:
        made = os.path.join(folder, PurePosixPath(target).name)
        steps = _replaced(recipe, {"@input": local, "@output": made})
        report = run(steps).report
        _placed(target, made, options)
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
        steps = dict(recipe)
    else:
        steps = json.loads(Path(os.fspath(recipe)).read_text(encoding="utf-8"))
    text = json.dumps(steps)
    for name in ("@input", "@output"):
        if json.dumps(name) not in text:
            raise ValueError(f"the recipe has no {name}: that is where the files of the list go")
    sources = [os.fspath(source) for source in inputs]
    piece = dask.delayed(_run_piece, pure=True)
    options = dict(storage_options or {})
    return [
        piece(steps, source, target, _ravec.__version__, options)
        for source, target in zip(sources, targets(sources, output))
    ]


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
    _check_version(version)
    _use_threads_of_worker()
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
            if min(array.chunks[axis]) < halo_px + 8:
                least = min(halo_px + 8, array.shape[axis])
                chunks = dask.array.overlap.ensure_minimum_chunksize(least, array.chunks[axis])
                array = array.rechunk({axis: chunks})
        # cleaning looks at blocks of compression
        array = _aligned(array, 8)
    overlapped = array
    if halo_px:
        overlapped = dask.array.overlap.overlap(array, depth={0: halo_px, 1: halo_px}, boundary="none")
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


def main(arguments: Sequence[str] | None = None) -> int:
    """``python -m ravec.dask``."""
    import argparse
    import sys

    parser = argparse.ArgumentParser(
        prog="python -m ravec.dask",
        description="Runs a recipe, whose files are @input and @output, over many files on a cluster.",
    )
    parser.add_argument("recipe", help="the recipe as JSON")
    parser.add_argument("inputs", nargs="+", help="paths, or URLs of fsspec")
    parser.add_argument("-o", "--output", required=True, help="pattern of the outputs, as in out/{stem}.png")
    parser.add_argument("--scheduler", help="address of a scheduler, as in tcp://host:8786 [default: this machine]")
    parser.add_argument("--workers", type=int, help="number of worker processes on this machine [default: by its cores]")
    parser.add_argument("--memory", default="auto", help="memory of a worker on this machine, such as 4GiB")
    parser.add_argument("-q", "--quiet", action="store_true", help="show no progress")
    given = parser.parse_args(arguments)
    try:
        pieces = map_recipe(given.recipe, given.inputs, given.output)
    except (ValueError, OSError) as error:
        print(f"ravec: error: {error}", file=sys.stderr)
        return 2
    from distributed import Client, LocalCluster, as_completed, progress

    with contextlib.ExitStack() as stack:
        if given.scheduler:
            client = stack.enter_context(Client(given.scheduler))
        else:
            cluster = LocalCluster(n_workers=given.workers, memory_limit=given.memory, dashboard_address=None)
            client = stack.enter_context(Client(stack.enter_context(cluster)))
        futures = client.compute(pieces)
        if not given.quiet:
            progress(futures)
        failed = 0
        try:
            for future in as_completed(futures):
                reason = future.exception()
                if reason is not None:
                    failed += 1
                    print(f"\nravec: error: {reason}", file=sys.stderr)
        except KeyboardInterrupt:
            client.cancel(futures)
            print("\nravec: error: cancelled", file=sys.stderr)
            return 130
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
