"""Work in pieces on a cluster of Dask: workers, and what carries pieces to them."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import shutil
import tempfile
import threading
import uuid
from collections.abc import Iterator, Mapping
from pathlib import PurePosixPath
from typing import Any

from . import _ravec
from ._options import Progress, listener

#: Files are read and written in blocks of this many bytes.
BLOCK = 1 << 20

#: Share of the memory limit of a worker that a piece may take; the rest is for the interpreter and for Dask.
_SHARE = 0.6


def check_version(wanted: str) -> None:
    """Refuses to work for a client of another version, whose results may differ."""
    if _ravec.__version__ != wanted:
        raise _ravec.Error(
            f"a worker has ravec {_ravec.__version__} and the client {wanted}: install the same version on all machines"
        )


def use_threads_of_worker() -> None:
    """Takes the threads that the worker has, not all cores of its machine."""
    try:
        from distributed import get_worker
    except ImportError:
        return
    with contextlib.suppress(ValueError):
        _ravec.set_threads(max(1, get_worker().state.nthreads))


# --- files by URL


def _protocols(system: Any) -> tuple[str, ...]:
    protocol = system.protocol
    return (protocol,) if isinstance(protocol, str) else tuple(protocol)


def is_local(system: Any) -> bool:
    """Whether a file system of fsspec is that of this machine."""
    return "file" in _protocols(system)


@contextlib.contextmanager
def local_copy(url: str, options: Mapping[str, Any]) -> Iterator[str]:
    """The path of a file that may be far away."""
    import fsspec

    system, path = fsspec.core.url_to_fs(url, **options)
    if is_local(system):
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="ravec-") as folder:
        local = os.path.join(folder, PurePosixPath(path).name)
        system.get_file(path, local)
        yield local


def place(url: str, local: str, options: Mapping[str, Any]) -> None:
    """Puts a file where it belongs, whole or not at all."""
    import fsspec

    system, path = fsspec.core.url_to_fs(url, **options)
    parent = system._parent(path)
    if parent:
        system.makedirs(parent, exist_ok=True)
    if is_local(system):
        part = f"{path}.{os.getpid()}.part"
        try:
            with open(local, "rb") as source, open(part, "wb") as target:
                while block := source.read(BLOCK):
                    target.write(block)
            os.replace(part, path)
        finally:
            with contextlib.suppress(FileNotFoundError):
                os.remove(part)
        return
    # object stores show a file when it is complete
    system.put_file(local, path)


# --- parts


class _UrlStore:
    """Parts in a folder of fsspec, such as an object store."""

    def __init__(self, url: str, options: Mapping[str, Any]) -> None:
        import fsspec

        self._system, self._folder = fsspec.core.url_to_fs(url, **options)

    def _path(self, name: str) -> str:
        return f"{self._folder.rstrip('/')}/{name}"

    def write(self, name: str, content: bytes) -> None:
        self._system.pipe_file(self._path(name), content)

    def read(self, name: str, start: int, end: int) -> bytes:
        found: bytes = self._system.cat_file(self._path(name), start=start, end=end)
        return found

    def read_all(self, name: str) -> bytes:
        found: bytes = self._system.cat_file(self._path(name))
        return found

    def remove(self, name: str) -> None:
        with contextlib.suppress(FileNotFoundError):
            self._system.rm_file(self._path(name))


def _store(url: str, options: Mapping[str, Any]) -> Any:
    """The store of a folder: its path, if it is one of this machine."""
    import fsspec

    system, path = fsspec.core.url_to_fs(url, **options)
    return path if is_local(system) else _UrlStore(url, options)


@contextlib.contextmanager
def _folder_of_parts(client: Any, scratch: str | None, options: Mapping[str, Any]) -> Iterator[str]:
    """A new folder for the parts of one work, which is removed afterwards."""
    import fsspec

    if scratch is None:
        hosts = {address.rsplit("://", 1)[-1].rsplit(":", 1)[0] for address in _workers(client)}
        if not hosts <= {"127.0.0.1", "localhost", "[::1]"} and not all("inproc" in a for a in _workers(client)):
            raise ValueError("workers are on several machines: give scratch=, a folder or URL that all of them see")
        folder = tempfile.mkdtemp(prefix="ravec-")
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)
        return
    system, path = fsspec.core.url_to_fs(scratch, **options)
    name = f"ravec-{uuid.uuid4().hex}"
    folder = f"{scratch.rstrip('/')}/{name}"
    system.makedirs(f"{path.rstrip('/')}/{name}", exist_ok=True)
    try:
        yield folder
    finally:
        with contextlib.suppress(FileNotFoundError):
            system.rm(f"{path.rstrip('/')}/{name}", recursive=True)


# --- workers

#: A worker of Dask may have several threads: one piece at a time keeps to the memory of one piece.
_ONE_PIECE = threading.Lock()

#: The latest work of this process, and its worker.
_latest: tuple[str, _ravec.Worker] | None = None


def _memory_here() -> int | None:
    """The memory that a piece may take in this worker, in bytes."""
    try:
        from distributed import get_worker

        limit = get_worker().memory_manager.memory_limit
    except (ImportError, ValueError, AttributeError):
        return None
    return int(_SHARE * limit) if limit else None


def run_piece(operation: str, folder: str, options: Mapping[str, Any], version: str, piece: bytes) -> bytes:
    """Runs a piece in a worker of Dask."""
    global _latest
    check_version(version)
    with _ONE_PIECE:
        use_threads_of_worker()
        if _latest is None or _latest[0] != folder:
            # two works at once would take twice the memory
            _latest = None
            _latest = (folder, _ravec.Worker(operation, _store(folder, options), _memory_here()))
        return _latest[1].run(piece)


class _Executor:
    """Carries pieces to the workers of a client."""

    def __init__(self, client: Any, operation: str, folder: str, options: Mapping[str, Any]) -> None:
        self._client = client
        self._work = (operation, folder, dict(options), _ravec.__version__)
        self._answers: queue.SimpleQueue[tuple[int, Any]] = queue.SimpleQueue()
        self._out: dict[int, Any] = {}

    def submit(self, number: int, piece: bytes) -> None:
        future = self._client.submit(run_piece, *self._work, piece, key=f"ravec-{uuid.uuid4().hex}", pure=False)
        self._out[id(future)] = future
        future.add_done_callback(lambda done: self._answers.put((number, done)))

    def next(self) -> tuple[int, bytes] | None:
        try:
            number, future = self._answers.get(timeout=0.05)
        except queue.Empty:
            return None
        answer: bytes = future.result()
        self._out.pop(id(future), None)
        return number, answer

    def cancel(self) -> None:
        """Cancels what is queued."""
        if self._out:
            self._client.cancel(list(self._out.values()))
            self._out.clear()


def _workers(client: Any) -> dict[str, Any]:
    """The workers of a client by address."""
    try:
        information = client.scheduler_info(n_workers=-1)
    except TypeError:
        information = client.scheduler_info()
    found: dict[str, Any] = information["workers"]
    if not found:
        raise ValueError("the cluster has no workers")
    return found


def memory_of(client: Any) -> str:
    """The memory that a piece may take on every worker of a client."""
    limits = [worker.get("memory_limit") or 0 for worker in _workers(client).values()]
    if not all(limits):
        raise ValueError("workers have no memory limit: give memory=, as in '2GiB'")
    return f"{int(_SHARE * min(limits)) >> 20}MiB"


def default_client(client: Any) -> Any:
    """The client that was given, or the latest one."""
    if client is not None:
        return client
    from distributed import get_client

    return get_client()


def run_in_pieces(
    step: Mapping[str, Any],
    *,
    client: Any,
    scratch: str | None,
    storage_options: Mapping[str, Any] | None,
    progress: Progress,
) -> dict[str, Any]:
    """Runs an operation with the paths or URLs ``input`` and ``output``, in pieces on a cluster. Returns the report."""
    import fsspec

    options = dict(storage_options or {})
    source, target = step["input"], step["output"]
    system, path = fsspec.core.url_to_fs(target, **options)
    with contextlib.ExitStack() as stack:
        local = stack.enter_context(local_copy(source, options))
        made = path
        if not is_local(system):
            made = os.path.join(stack.enter_context(tempfile.TemporaryDirectory(prefix="ravec-")), PurePosixPath(path).name)
        elif system._parent(path):
            system.makedirs(system._parent(path), exist_ok=True)
        folder = stack.enter_context(_folder_of_parts(client, scratch, options))
        executor = _Executor(client, step["operation"], folder, options)
        listening = stack.enter_context(listener(progress))
        fields = json.dumps({**step, "input": local, "output": made})
        try:
            cluster = (_store(folder, options), executor)
            outcome = _ravec.run_operation(fields, {}, "srgb", listening, cluster)
        finally:
            executor.cancel()
        if made != path:
            place(target, made, options)
    report: dict[str, Any] = json.loads(outcome.report)
    report.update({"input": source, "output": target})
    return report
