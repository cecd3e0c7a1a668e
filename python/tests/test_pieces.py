"""Offsets by tiles and mosaics by tiles, photos and rows on a cluster: the bytes of one machine, whatever happens on the way."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ravec

distributed = pytest.importorskip("distributed")

import ravec.dask as cluster_of_ravec  # noqa: E402
from ravec import _pieces  # noqa: E402

#: Tiles of some thousand triangles.
OFFSET: dict[str, Any] = {"tolerance": 0.0008, "side": "outer", "memory": "66MiB"}


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster, distributed.Client(cluster) as client:
        yield client


def ring(path: Path) -> Path:
    """A torus of radii 1 and 0.4."""
    u, v = np.meshgrid(np.arange(24) / 24 * 2 * np.pi, np.arange(16) / 16 * 2 * np.pi, indexing="ij")
    radius = 1 + 0.4 * np.cos(v)
    vertices = np.stack([radius * np.cos(u), radius * np.sin(u), 0.4 * np.sin(v)], axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(24), np.arange(16), indexing="ij")
    at = lambda a, b: (a % 24) * 16 + b % 16  # noqa: E731
    quads = np.stack([at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)], axis=-1).reshape(-1, 4)
    ravec.Mesh(vertices, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])).save(path)
    return path


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, bytes]:
    """The mesh, and the file of its offset by one machine."""
    folder = tmp_path_factory.mktemp("alone")
    source = ring(folder / "ring.ply")
    target = folder / "ring_offset.ply"
    ravec.run(
        {
            "operation": "offset",
            "input": str(source),
            "output": str(target),
            "params": {"distance": "0.08", **OFFSET, "tolerance": "0.0008"},
        }
    )
    return source, target.read_bytes()


def test_offsets_by_tiles_are_those_of_one_machine(client: Any, alone: tuple[Path, bytes], tmp_path: Path) -> None:
    source, expected = alone
    seen: list[str] = []
    report = cluster_of_ravec.offset(
        source,
        tmp_path / "out" / "ring.ply",
        0.08,
        client=client,
        scratch=str(tmp_path),
        progress=lambda phase, done, total: seen.append(phase),
        **OFFSET,
    )
    assert (tmp_path / "out" / "ring.ply").read_bytes() == expected
    assert report["passed"] and report["figures"]["tiles"] > 1
    assert "tiles" in seen and "simplify" in seen
    assert [path.name for path in tmp_path.iterdir()] == ["out"], "parts are removed"


def test_parts_may_lie_where_there_are_no_paths(alone: tuple[Path, bytes], tmp_path: Path) -> None:
    source, expected = alone
    import fsspec

    memory = fsspec.filesystem("memory")
    memory.pipe("/in/ring.ply", source.read_bytes())
    with distributed.Client(processes=False, n_workers=1, threads_per_worker=1, dashboard_address=None) as client:
        cluster_of_ravec.offset(
            "memory://in/ring.ply",
            "memory://out/ring.ply",
            0.08,
            client=client,
            scratch="memory://parts",
            **OFFSET,
        )
    assert memory.cat_file("/out/ring.ply") == expected
    assert not memory.exists("/parts") or memory.ls("/parts") == []


@pytest.mark.skipif(os.name != "posix", reason="processes are killed")
def test_a_worker_is_killed_and_parts_are_lost(
    alone: tuple[Path, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, expected = alone
    folders: list[str] = []
    kept = _pieces._Executor.submit
    lost: list[str] = []
    killed: list[int] = []
    numbers: set[int] = set()
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster, distributed.Client(cluster) as client:

        def submit(executor: Any, number: int, piece: bytes) -> None:
            folder = executor._work[1]
            folders.append(folder)
            # once each: a part that is always lost is an error
            if number % 7 == 0 and number not in numbers:
                numbers.add(number)
                parts = sorted(Path(folder).glob("part-*"))
                if parts:
                    lost.append(parts[len(parts) // 2].name)
                    parts[len(parts) // 2].unlink()
            kept(executor, number, piece)
            if number == 12:
                (victim, *_) = client.run(os.getpid).values()
                os.kill(victim, signal.SIGKILL)
                killed.append(victim)

        monkeypatch.setattr(_pieces._Executor, "submit", submit)
        cluster_of_ravec.offset(source, tmp_path / "ring.ply", 0.08, client=client, **OFFSET)
    assert (tmp_path / "ring.ply").read_bytes() == expected
    assert lost and killed
    assert not Path(folders[0]).exists()


def test_a_full_disk_and_another_version_are_reasons(
    client: Any, alone: tuple[Path, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, _ = alone
    target = tmp_path / "ring.ply"

    class Full:
        def __init__(self, *_: Any) -> None:
            self.parts = 0

        def write(self, name: str, content: bytes) -> None:
            raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(_pieces, "_store", lambda *_: Full())
        with pytest.raises(ravec.Error, match="No space left"):
            cluster_of_ravec.offset(source, target, 0.08, client=client, **OFFSET)
    assert not target.exists()
    with monkeypatch.context() as patched:
        real = _pieces._Executor.__init__

        def other(executor: Any, *arguments: Any) -> None:
            real(executor, *arguments)
            executor._work = (*executor._work[:3], "0.0.0")

        patched.setattr(_pieces._Executor, "__init__", other)
        with pytest.raises(ravec.Error, match="install the same version"):
            cluster_of_ravec.offset(source, target, 0.08, client=client, **OFFSET)
    assert not target.exists()


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_an_interruption_cancels_what_is_queued(client: Any, alone: tuple[Path, bytes], tmp_path: Path) -> None:
    source, _ = alone
    timer = threading.Timer(1.0, lambda: os.kill(os.getpid(), signal.SIGINT))
    # a process that was started in the background ignores it
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            cluster_of_ravec.offset(
                source, tmp_path / "ring.ply", 0.08, client=client, **dict(OFFSET, tolerance=0.0001)
            )
    finally:
        timer.cancel()
        signal.signal(signal.SIGINT, before)
    assert not (tmp_path / "ring.ply").exists()
    deadline = time.monotonic() + 60
    while client.processing() and any(client.processing().values()):
        assert time.monotonic() < deadline
        time.sleep(0.1)


def test_what_makes_no_sense_is_refused(client: Any, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"none\.ply"):
        cluster_of_ravec.offset(tmp_path / "none.ply", tmp_path / "out.ply", 1.0, client=client)
    with pytest.raises(ValueError, match="distance"):
        cluster_of_ravec.offset(ring(tmp_path / "a.ply"), tmp_path / "out.ply", -1.0, client=client)
    with pytest.raises(ValueError, match="in pieces"):
        ravec._ravec.Worker("brush", str(tmp_path))
    with pytest.raises(ravec.Error):
        ravec._ravec.Worker("offset", str(tmp_path))


def test_the_command_line_takes_the_options_of_the_operation(alone: tuple[Path, bytes], tmp_path: Path) -> None:
    source, expected = alone
    target = tmp_path / "ring.ply"
    command = [sys.executable, "-m", "ravec.dask", "--workers", "2", "offset", str(source), "-o", str(target)]
    command += ["--distance", "0.08", "--tolerance", "0.0008", "--side", "outer", "--memory", "66MiB"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert "tiles" in done.stdout and target.read_bytes() == expected
    wrong = subprocess.run([*command, "--nonsense"], capture_output=True, text=True, timeout=300)
    assert wrong.returncode == 2 and "--nonsense" in wrong.stderr


def test_mosaics_are_those_of_one_machine(client: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from PIL import Image

    random = np.random.default_rng(5)
    folder = tmp_path / "photos"
    folder.mkdir()
    for index in range(150):
        corners = random.integers(0, 256, (2, 2, 3), dtype=np.uint8)
        Image.fromarray(corners).resize((80, 60), Image.Resampling.BICUBIC).save(folder / f"{index:03}.png")
    catalogue = ravec.Catalogue(tmp_path / "photos.ravec")
    catalogue.add(folder)
    source = tmp_path / "picture.png"
    Image.fromarray(random.integers(0, 256, (6, 8, 3), dtype=np.uint8)).resize((320, 240)).save(source)
    options: dict[str, Any] = {"tiles": 16, "tile_size": 24, "crop": "center", "min_repeat_distance": 2}
    # photos that are gone are replaced, in the same way
    for index in (3, 77):
        (folder / f"{index:03}.png").write_bytes(b"gone")
    expected = ravec.mosaic(np.asarray(Image.open(source)), catalogue, **options)
    report = cluster_of_ravec.mosaic(source, tmp_path / "mosaic.png", catalogue, client=client, **options)
    assert np.array_equal(np.asarray(Image.open(tmp_path / "mosaic.png")), expected)
    assert report["figures"]["used"] > 64, "several pieces"

    # a lost part is recomputed
    killed: list[int] = []
    real = _pieces._Executor.next

    def next_answer(executor: Any) -> Any:
        for part in Path(executor._work[1]).glob("part-2"):
            if len(killed) < 3:
                part.unlink()
                killed.append(0)
        return real(executor)

    monkeypatch.setattr(_pieces._Executor, "next", next_answer)
    cluster_of_ravec.mosaic(source, tmp_path / "again.png", catalogue, client=client, **options)
    assert killed
    assert (tmp_path / "again.png").read_bytes() == (tmp_path / "mosaic.png").read_bytes()
    with pytest.raises(ValueError, match="nonsense"):
        cluster_of_ravec.mosaic(source, tmp_path / "x.png", catalogue, client=client, nonsense=1)


@pytest.mark.skipif(os.name != "posix", reason="processes are killed")
@pytest.mark.parametrize("killed_in", ["search", "photos", "write"])
def test_a_worker_of_a_mosaic_is_killed(killed_in: str, tmp_path: Path) -> None:
    from PIL import Image

    random = np.random.default_rng(6)
    folder = tmp_path / "photos"
    folder.mkdir()
    for index in range(200):
        color = random.integers(0, 256, (2, 3, 3), dtype=np.uint8)
        Image.fromarray(color).resize((400, 300), Image.Resampling.BICUBIC).save(folder / f"{index:03}.jpg")
    catalogue = ravec.Catalogue(tmp_path / "photos.ravec")
    catalogue.add(folder)
    source = tmp_path / "picture.png"
    Image.fromarray(random.integers(0, 256, (20, 20, 3), dtype=np.uint8)).resize((400, 400)).save(source)
    options: dict[str, Any] = {"tiles": (20, 20), "tile_size": 16, "crop": "center", "max_uses": 2}
    expected = ravec.mosaic(np.asarray(Image.open(source)), catalogue, **options)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster, distributed.Client(cluster) as client:
        seen: list[int] = []

        def kill(phase: str, done: int, total: int) -> None:
            if phase == killed_in and not seen:
                (victim, *_) = client.run(os.getpid).values()
                os.kill(victim, signal.SIGKILL)
                seen.append(victim)

        cluster_of_ravec.mosaic(source, tmp_path / "mosaic.png", catalogue, client=client, progress=kill, **options)
    assert seen
    assert np.array_equal(np.asarray(Image.open(tmp_path / "mosaic.png")), expected)
