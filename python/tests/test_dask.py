"""Work on a cluster: the same bytes as on one machine, whatever happens to a worker."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import photo
from PIL import Image

import ravec

dask = pytest.importorskip("dask")
distributed = pytest.importorskip("distributed")
import dask.array  # noqa: E402

import ravec.dask as cluster_of_ravec  # noqa: E402
from ravec import _pieces  # noqa: E402

CLEAN = {
    "operation": "brush",
    "input": "@input",
    "output": "@output",
    "everywhere": True,
    "params": {"mode": "clean", "noise_sigma": 10},
}


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster, distributed.Client(cluster) as client:
        yield client


@pytest.mark.parametrize("chunks", [(64, 80, 3), (37, 53, 3), (5, 160, 1)])
def test_filters_on_chunks_give_the_bytes_of_the_whole(client: Any, chunks: tuple[int, ...]) -> None:
    image = photo(160, 120)
    array = dask.array.from_array(image, chunks=chunks)
    for found, expected in [
        (cluster_of_ravec.clean(array, noise_sigma=10), ravec.clean(image, noise_sigma=10)),
        (cluster_of_ravec.smooth(array), ravec.smooth(image)),
        (cluster_of_ravec.abstract(array, iterations=3), ravec.abstract(image, iterations=3)),
        (cluster_of_ravec.sharpen(array, window=5), ravec.sharpen(image, window=5)),
        (cluster_of_ravec.enlarge(array, 2), ravec.enlarge(image, 2)),
        (cluster_of_ravec.render(array, size=8, scale=2), ravec.TwoColorField.fit(image).render(2)),
    ]:
        assert found.shape == expected.shape and found.dtype == expected.dtype
        assert np.array_equal(found.compute(), expected)


def test_chunks_keep_samples_and_gray(client: Any) -> None:
    gray = photo(96, 64)[..., 0].astype(np.uint16) * 257
    found = cluster_of_ravec.smooth(dask.array.from_array(gray, chunks=(32, 48)))
    assert np.array_equal(found.compute(), ravec.smooth(gray))
    with pytest.raises(ValueError, match="whole numbers"):
        cluster_of_ravec.enlarge(dask.array.from_array(gray, chunks=32), 1.5)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="shape"):
        cluster_of_ravec.smooth(dask.array.zeros((4,), dtype=np.uint8))


def photos(folder: Path, count: int, size: tuple[int, int] = (96, 64)) -> list[str]:
    paths = []
    for index in range(count):
        path = folder / f"{index:02}.png"
        Image.fromarray(photo(*size, seed=index)).save(path)
        paths.append(str(path))
    return paths


def test_many_files_by_path_and_url(client: Any, tmp_path: Path) -> None:
    import fsspec

    sources = photos(tmp_path, 5)
    reports = dask.compute(*cluster_of_ravec.map_recipe(CLEAN, sources, str(tmp_path / "out" / "{stem}_clean.png")))
    assert [report["input"] for report in reports] == sources
    for index, source in enumerate(sources):
        made = np.asarray(Image.open(tmp_path / "out" / f"{index:02}_clean.png"))
        assert np.array_equal(made, ravec.clean(np.asarray(Image.open(source)), noise_sigma=10))
    assert not list((tmp_path / "out").glob("*.part"))
    urls = [f"file://{source}" for source in sources]
    again = dask.compute(*cluster_of_ravec.map_recipe(CLEAN, urls, f"file://{tmp_path}/again/{{index}}.png"))
    assert len(again) == 5 and (tmp_path / "again" / "4.png").exists()
    # a file system in the memory of this process
    memory = fsspec.filesystem("memory")
    memory.put_file(sources[0], "/photos/a.png")
    with dask.config.set(scheduler="synchronous"):
        dask.compute(*cluster_of_ravec.map_recipe(CLEAN, ["memory://photos/a.png"], "memory://made/{stem}.png"))
    assert memory.cat("/made/a.png").startswith(b"\x89PNG")


def test_recipes_find_their_own_files(client: Any, tmp_path: Path) -> None:
    sources = photos(tmp_path, 2)
    folder = tmp_path / "recipe"
    folder.mkdir()
    mask = np.zeros((64, 96), dtype=np.uint8)
    mask[20:30, 30:50] = 255
    Image.fromarray(mask).save(folder / "mask.png")
    step = {"operation": "complete", "input": "@input", "output": "@output", "mask": "mask.png"}
    recipe = folder / "complete.json"
    recipe.write_text(json.dumps({"version": 1, "relative_to": "recipe", "steps": [step]}))
    dask.compute(*cluster_of_ravec.map_recipe(recipe, sources, str(tmp_path / "out" / "{stem}.png")))
    for source in sources:
        made = np.asarray(Image.open(tmp_path / "out" / Path(source).name))
        before = np.asarray(Image.open(source))
        assert np.array_equal(made[mask == 0], before[mask == 0]) and not np.array_equal(made, before)


def test_what_makes_no_sense_is_refused(client: Any, tmp_path: Path) -> None:
    sources = photos(tmp_path, 2)
    with pytest.raises(ValueError, match="several inputs"):
        cluster_of_ravec.map_recipe(CLEAN, sources, str(tmp_path / "same.png"))
    with pytest.raises(ValueError, match="no @output"):
        cluster_of_ravec.map_recipe(dict(CLEAN, output="x.png"), sources, "{stem}.png")
    missing = cluster_of_ravec.map_recipe(CLEAN, [str(tmp_path / "none.png")], str(tmp_path / "{stem}_out.png"))
    with pytest.raises(FileNotFoundError, match="none.png"):
        dask.compute(*missing)
    assert not (tmp_path / "none_out.png").exists()


def test_a_worker_of_another_version_is_refused(client: Any, tmp_path: Path) -> None:
    piece = dask.delayed(cluster_of_ravec._run_piece)
    source = photos(tmp_path, 1)[0]
    with pytest.raises(ravec.Error, match="install the same version"):
        piece(CLEAN, "", source, str(tmp_path / "out.png"), "0.0.0", {}).compute()


@pytest.mark.skipif(os.name != "posix", reason="processes are killed")
def test_a_worker_that_is_killed_is_replaced(tmp_path: Path) -> None:
    sources = photos(tmp_path, 8, (480, 360))
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster, distributed.Client(cluster) as client:
        futures = client.compute(cluster_of_ravec.map_recipe(CLEAN, sources, str(tmp_path / "out" / "{stem}.png")))
        distributed.wait(futures[0])
        (victim, *_) = client.run(os.getpid).values()
        os.kill(victim, signal.SIGKILL)
        reports = client.gather(futures)
    assert len(reports) == 8
    for source in sources:
        made = np.asarray(Image.open(tmp_path / "out" / Path(source).name))
        assert np.array_equal(made, ravec.clean(np.asarray(Image.open(source)), noise_sigma=10))
    assert not [path for path in (tmp_path / "out").iterdir() if path.suffix != ".png"]


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="a system without a full device")
def test_a_full_disk_is_an_error_of_its_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = photos(tmp_path, 1)[0]
    target = tmp_path / "out.png"
    target.write_bytes(b"old")
    real = open

    def full(path: Any, mode: str = "r", *rest: Any, **options: Any) -> Any:
        return real("/dev/full" if str(path).endswith(".part") else path, mode, *rest, **options)

    monkeypatch.setattr("builtins.open", full)
    with pytest.raises(OSError, match="No space left"):
        _pieces.place(str(target), source, {})
    assert target.read_bytes() == b"old"


def test_the_command_line(tmp_path: Path) -> None:
    sources = photos(tmp_path, 3)
    recipe = tmp_path / "clean.json"
    recipe.write_text(json.dumps(CLEAN))
    command = [sys.executable, "-m", "ravec.dask", "--workers", "2", "--quiet", "map"]
    command += ["-o", str(tmp_path / "out" / "{stem}.png"), str(recipe), *sources]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert len(list((tmp_path / "out").glob("*.png"))) == 3
    broken = tmp_path / "broken.png"
    broken.write_bytes(b"nothing")
    done = subprocess.run([*command, str(broken)], capture_output=True, text=True, timeout=300)
    assert done.returncode == 1 and "broken.png" in done.stderr
    none = [*command[:5], "map", "-o", "x.png", str(tmp_path / "none.json"), "x"]
    done = subprocess.run(none, capture_output=True, text=True)
    assert done.returncode == 2


@pytest.mark.parametrize("kind", ["strips", "tiles", "gray", "alpha"])
def test_large_files_are_filtered_in_rows(client: Any, tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    tifffile = pytest.importorskip("tifffile")
    from ravec import _large

    image = photo(230, 170)
    if kind == "gray":
        image = (image[..., 1].astype(np.uint16) * 257).astype(np.uint16)
    if kind == "alpha":
        image = np.dstack([image, np.tile(np.arange(230, dtype=np.uint8), (170, 1))])
    straight: dict[str, Any] = {"photometric": "rgb", "extrasamples": ["unassalpha"]} if kind == "alpha" else {}
    layout: dict[str, Any] = {"tile": (64, 48)} if kind == "tiles" else {"rowsperstrip": 9, "compression": "zlib"}
    tifffile.imwrite(tmp_path / "large.tif", image, **layout, **straight)
    # chunks of some rows
    monkeypatch.setattr(_large, "_CHUNK_BYTES", 30_000)
    array = cluster_of_ravec.read(tmp_path / "large.tif")
    assert len(array.chunks[0]) > 1 and array.dtype == image.dtype
    assert np.array_equal(array.compute(), image)
    cluster_of_ravec.write(cluster_of_ravec.clean(array, noise_sigma=6), tmp_path / "clean.tif")
    assert np.array_equal(tifffile.imread(tmp_path / "clean.tif"), ravec.clean(image, noise_sigma=6))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["clean.tif", "large.tif"]
    cluster_of_ravec.write(cluster_of_ravec.enlarge(array, 2), "memory://large/twice.tif")
    import fsspec

    with fsspec.open("memory://large/twice.tif", "rb") as file:
        assert np.array_equal(tifffile.imread(file), ravec.enlarge(image, 2))


def test_pictures_smaller_than_the_halo_are_filtered(client: Any) -> None:
    for shape in ((1, 1, 3), (5, 300, 3), (40, 7)):
        image = np.full(shape, 90, dtype=np.uint8)
        array = dask.array.from_array(image, chunks=(30, 60) + ((-1,) if len(shape) == 3 else ()))
        assert np.array_equal(cluster_of_ravec.smooth(array).compute(), ravec.smooth(image))
        assert cluster_of_ravec.enlarge(array, 2).compute().shape[:2] == (2 * shape[0], 2 * shape[1])


def test_files_with_other_colors_are_refused(tmp_path: Path) -> None:
    tifffile = pytest.importorskip("tifffile")
    gray, four = np.zeros((10, 10), np.uint8), np.zeros((10, 10, 4), np.uint8)
    for image, options in (
        (gray, {"photometric": "palette", "colormap": np.zeros((3, 256), np.uint16)}),
        (gray, {"photometric": "miniswhite"}),
        (four, {"photometric": "separated"}),
        (four, {"photometric": "rgb", "extrasamples": ["assocalpha"]}),
        (gray, {"extratags": [(274, "H", 1, 6, True)]}),
    ):
        tifffile.imwrite(tmp_path / "other.tif", image, **options)
        with pytest.raises(ValueError, match="gray or RGB"):
            cluster_of_ravec.read(tmp_path / "other.tif")


def test_files_that_are_no_tiff_are_refused(tmp_path: Path) -> None:
    pytest.importorskip("tifffile")
    (tmp_path / "broken.tif").write_bytes(b"nothing")
    with pytest.raises(ValueError, match=r"broken\.tif.*only TIFF"):
        cluster_of_ravec.read(tmp_path / "broken.tif")
    with pytest.raises(FileNotFoundError):
        cluster_of_ravec.read(tmp_path / "none.tif")
    array = dask.array.zeros((20, 20, 3), dtype=np.uint8)
    with pytest.raises(ValueError, match=r"\.tif or \.tiff"):
        cluster_of_ravec.write(array, tmp_path / "out.png")
    with pytest.raises(ValueError, match="shape"):
        cluster_of_ravec.write(array[None], tmp_path / "out.tif")

    def broken(block: Any) -> Any:
        raise OSError("a worker has no more disk")

    with dask.config.set(scheduler="synchronous"), pytest.raises(OSError, match="no more disk"):
        cluster_of_ravec.write(array.map_blocks(broken, dtype=np.uint8, meta=np.empty((0, 0, 0), np.uint8)), tmp_path / "out.tif")
    assert [path.name for path in tmp_path.iterdir()] == ["broken.tif"]


def test_the_command_line_filters_large_files(tmp_path: Path) -> None:
    tifffile = pytest.importorskip("tifffile")
    image = photo(120, 90)
    tifffile.imwrite(tmp_path / "large.tif", image)
    command = [sys.executable, "-m", "ravec.dask", "--workers", "1", "clean", str(tmp_path / "large.tif")]
    command += ["-o", str(tmp_path / "clean.tif")]
    done = subprocess.run([*command, "noise_sigma=6"], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert np.array_equal(tifffile.imread(tmp_path / "clean.tif"), ravec.clean(image, noise_sigma=6))
    for options, sentence in (([], "needs noise_sigma"), (["size=3"], "no option"), (["noise_sigma=much"], "number")):
        wrong = subprocess.run([*command, *options], capture_output=True, text=True, timeout=300)
        assert wrong.returncode == 2 and sentence in wrong.stderr
