"""Pictures larger than the memory: TIFF files as arrays of Dask, read and written some rows at a time."""

from __future__ import annotations

import collections
import os
import tempfile
import zlib
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._pieces import is_local, place

#: Chunks of a picture that is read have about this many bytes.
_CHUNK_BYTES = 32 << 20

#: Rows of a strip that is written.
_STRIP_ROWS = 64


def _page(tiff: Any, url: str) -> Any:
    page = tiff.pages[0]
    planes_apart = page.samplesperpixel > 1 and int(page.planarconfig) != 1
    if planes_apart or page.dtype not in (np.dtype(np.uint8), np.dtype(np.uint16), np.dtype(np.float32)):
        raise ValueError(f"{url}: only TIFF files with 8 or 16 bit or 32 bit floats, pixel by pixel, are read in rows")
    # grays from black to white, or colors, and at most straight alpha; rows from the top
    colors = {1: 1, 2: 3}.get(int(page.photometric))
    extra = [int(kind) for kind in page.extrasamples]
    orientation = page.tags.get(274)
    if (
        colors is None
        or page.samplesperpixel != colors + len(extra)
        or extra not in ([], [2])
        or (orientation is not None and int(orientation.value) != 1)
    ):
        raise ValueError(
            f"{url}: only gray or RGB with or without straight alpha, rows from the top, is read in rows: "
            "convert the file first"
        )
    return page


def _rows(url: str, options: Mapping[str, Any], first: int, last: int) -> NDArray[Any]:
    """Some rows of a TIFF file, from the strips or tiles that have them."""
    import fsspec
    import tifffile

    with fsspec.open(url, "rb", **options) as file, tifffile.TiffFile(file) as tiff:
        page = _page(tiff, url)
        columns, samples = page.imagewidth, page.samplesperpixel
        found = np.zeros((last - first, columns, samples), dtype=page.dtype)
        width = page.tilewidth if page.is_tiled else columns
        height = page.tilelength if page.is_tiled else page.rowsperstrip
        across = -(-columns // width)
        for index, (offset, count) in enumerate(zip(page.dataoffsets, page.databytecounts)):
            row, col = index // across * height, index % across * width
            if row >= last or row + height <= first or count == 0:
                continue
            file.seek(offset)
            segment = page.decode(file.read(count), index, jpegtables=page.jpegtables)[0]
            segment = segment.reshape(-1, segment.shape[-2], samples)[:, : columns - col]
            begin, end = max(row, first), min(row + len(segment), last)
            found[begin - first : end - first, col : col + segment.shape[1]] = segment[begin - row : end - row]
    return found


def read(source: str | os.PathLike[str], *, storage_options: Mapping[str, Any] | None = None) -> Any:
    """A TIFF file as an array of Dask, whose chunks are rows that workers read when they need them.

    All machines see the file under the same path or URL. Colors are taken for sRGB; rows of strips and tiles are read as
    a whole, so that strips of few rows suit best.

    :param source: path or URL of a TIFF or BigTIFF file of 8 or 16 bits or 32-bit floats
    :param storage_options: options of fsspec
    """
    import dask
    import dask.array
    import fsspec
    import tifffile

    url, options = os.fspath(source), dict(storage_options or {})
    with fsspec.open(url, "rb", **options) as file:
        try:
            tiff = tifffile.TiffFile(file)
        except tifffile.TiffFileError as error:
            raise ValueError(f"{url}: {error}: only TIFF files are read in rows") from error
        with tiff:
            page = _page(tiff, url)
            shape, dtype = (page.imagelength, page.imagewidth, page.samplesperpixel), page.dtype
            unit = page.tilelength if page.is_tiled else min(page.rowsperstrip, page.imagelength)
    row_bytes = shape[1] * shape[2] * dtype.itemsize
    rows = max(1, _CHUNK_BYTES // max(1, row_bytes * unit)) * unit
    part = dask.delayed(_rows, pure=True)
    blocks = []
    for first in range(0, shape[0], rows):
        last = min(first + rows, shape[0])
        block = part(url, options, first, last)
        blocks.append(dask.array.from_delayed(block, (last - first, *shape[1:]), dtype=dtype))
    array = dask.array.concatenate(blocks, axis=0)
    return array[:, :, 0] if shape[2] == 1 else array


def _ahead() -> int:
    """Number of rows of chunks to compute at once: one for each worker."""
    try:
        from distributed import get_client

        return max(1, len(get_client().nthreads()))
    except (ImportError, ValueError):
        return 1


def _chunk_rows(array: Any) -> Iterator[NDArray[Any]]:
    """The rows of chunks in order, of which the next ones are computed already."""
    edges = [0, *np.cumsum(array.chunks[0]).tolist()]
    waiting: collections.deque[Future[Any]] = collections.deque()
    ahead = _ahead()
    pool = ThreadPoolExecutor(ahead)
    try:
        for first, last in zip(edges, edges[1:]):
            waiting.append(pool.submit(array[first:last].compute))
            if len(waiting) > ahead:
                yield np.asarray(waiting.popleft().result())
        while waiting:
            yield np.asarray(waiting.popleft().result())
    finally:
        pool.shutdown(cancel_futures=True)


def _strips(array: Any) -> Iterator[NDArray[Any]]:
    """The strips of an array."""
    array = array.astype(array.dtype.newbyteorder("<"))
    left = np.empty((0, *array.shape[1:]), dtype=array.dtype)
    done = 0
    for rows in _chunk_rows(array):
        done += len(rows)
        rows = np.concatenate([left, rows])
        whole = len(rows) if done == array.shape[0] else len(rows) // _STRIP_ROWS * _STRIP_ROWS
        for row in range(0, whole, _STRIP_ROWS):
            yield rows[row : min(row + _STRIP_ROWS, whole)]
        left = rows[whole:]


def write(array: Any, target: str | os.PathLike[str], *, storage_options: Mapping[str, Any] | None = None) -> None:
    """Writes an array of Dask as a TIFF file, as a whole or not at all.

    Rows of chunks are computed by the latest client if there is one, as many at once as it has workers, and pass through the
    memory of this process. Beyond 4 GiB the file is a BigTIFF.

    :param target: path or URL, with the extension ``.tif`` or ``.tiff``
    :param storage_options: options of fsspec
    """
    import fsspec
    import tifffile

    url, options = os.fspath(target), dict(storage_options or {})
    name = PurePosixPath(url).name
    if not name.lower().endswith((".tif", ".tiff")):
        raise ValueError(f"{url}: pictures in rows are written as .tif or .tiff")
    samples = array.shape[2] if array.ndim == 3 else 1
    if array.ndim not in (2, 3) or samples not in (1, 2, 3, 4):
        raise ValueError(f"a picture has the shape (rows, columns) or (rows, columns, channels), not {array.shape}")
    system, path = fsspec.core.url_to_fs(url, **options)
    beside = os.path.dirname(path) or "." if is_local(system) else None
    if beside is not None:
        os.makedirs(beside, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".ravec-", dir=beside) as folder:
        local = os.path.join(folder, name)
        with tifffile.TiffWriter(local, byteorder="<", bigtiff=array.nbytes > (4 << 30) - (16 << 20)) as tiff:
            tiff.write(
                (zlib.compress(strip.tobytes(), 1) for strip in _strips(array)),
                shape=array.shape,
                dtype=array.dtype,
                photometric="rgb" if samples > 2 else "minisblack",
                extrasamples=["unassalpha"] if samples in (2, 4) else None,
                planarconfig="contig" if samples > 1 else None,
                rowsperstrip=_STRIP_ROWS,
                compression="zlib",
            )
        if beside is not None:
            os.replace(local, path)
        else:
            place(url, local, options)
