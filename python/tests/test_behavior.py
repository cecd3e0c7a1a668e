"""Recipes, errors, progress, interruption, threads and processes."""

from __future__ import annotations

import inspect
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import textwrap
import threading
from pathlib import Path

import numpy as np
import pytest
from conftest import box, edge, photo
from PIL import Image

import ravec


def test_recipes_run_with_inputs_and_outputs_in_memory(picture: np.ndarray, tmp_path: Path) -> None:
    steps = [
        {
            "operation": "brush",
            "input": "@photo",
            "output": "@clean",
            "everywhere": True,
            "params": {"mode": "clean"},
        },
        {"operation": "retarget", "input": "@clean", "output": "@wide", "params": {"sizes": ["150%x100%"]}},
    ]
    recipe = {"version": 1, "steps": steps}
    result = ravec.run(recipe, {"@photo": picture})
    assert result.picture("@wide").shape == (32, 72, 3)
    assert np.array_equal(result.picture("@clean"), ravec.clean(picture))
    assert [step["operation"] for step in result.report["steps"]] == ["brush", "retarget"]
    with pytest.raises(KeyError):
        result.picture("@nothing")
    with pytest.raises(ValueError, match="@photo"):
        ravec.run(recipe)
    # a file of its own folder
    Image.fromarray(picture).save(tmp_path / "in.png")
    steps = [dict(steps[0], input="in.png", output="out.png")]
    (tmp_path / "recipe.json").write_text(json.dumps({"version": 1, "relative_to": "recipe", "steps": steps}))
    ravec.run(tmp_path / "recipe.json")
    assert np.array_equal(np.asarray(Image.open(tmp_path / "out.png")), ravec.clean(picture))
    mesh = ravec.run(
        {"operation": "mesh convert", "input": "@in", "output": "@out", "params": {"weld": "0"}},
        {"@in": ravec.Mesh(*box())},
    )
    assert len(mesh.mesh("@out").faces) == 12
    with pytest.raises(ValueError, match="there is no operation"):
        ravec.run({"operation": "levitate"})
    with pytest.raises(FileNotFoundError):
        ravec.run(tmp_path / "missing.json")
    with pytest.raises(ValueError, match="must begin with @"):
        ravec.run(recipe, {"photo": picture})


def test_errors_are_sentences(picture: np.ndarray) -> None:
    with pytest.raises(ValueError, match="window"):
        ravec.smooth(picture, window=4)
    with pytest.raises(ValueError, match="unknown variant"):
        ravec.brush(picture, [(3, 3)], mode="varnish")  # type: ignore[arg-type]
    assert issubclass(ravec.Error, Exception) and not issubclass(ravec.Error, ValueError)


def test_progress_is_reported(picture: np.ndarray) -> None:
    updates: list[tuple[str, int, int]] = []
    image = photo(640, 480)
    ravec.clean(image, progress=lambda *update: updates.append(update))
    assert updates and all(0 <= done <= total for _, done, total in updates)
    assert ravec.smooth(picture, window=5, progress=True).shape == picture.shape


def test_exceptions_of_the_listener_stop_the_work() -> None:
    class Enough(Exception):
        pass

    def listen(phase: str, done: int, total: int) -> None:
        raise Enough

    with pytest.raises(Enough):
        ravec.clean(photo(1600, 1200), progress=listen)
    # and nothing is left behind
    assert ravec.clean(photo(64, 48)).shape == (48, 64, 3)


@pytest.mark.skipif(not hasattr(signal, "SIGINT") or os.name != "posix", reason="signals of POSIX")
def test_an_interruption_stops_the_work() -> None:
    script = textwrap.dedent(
        """
        import os, signal, threading, numpy as np, ravec
        # a program in the background may have been started with interruptions ignored
        signal.signal(signal.SIGINT, signal.default_int_handler)
        image = np.random.default_rng(0).integers(0, 255, (3000, 4000, 3), dtype=np.uint8)
        started = threading.Event()
        def interrupt():
            started.wait()
            os.kill(os.getpid(), signal.SIGINT)
        threading.Thread(target=interrupt, daemon=True).start()
        try:
            ravec.clean(image, iterations=16, progress=lambda *update: started.set())
        except KeyboardInterrupt:
            print("interrupted")
        print(ravec.smooth(image[:32, :32], window=5).shape)
        """
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300)
    assert done.stdout.split("\n")[:2] == ["interrupted", "(32, 32, 3)"], done.stderr


def test_threads_work_at_the_same_time() -> None:
    image = photo(200, 160)
    expected = ravec.clean(image)
    results: list[np.ndarray] = []

    def work() -> None:
        for _ in range(3):
            results.append(ravec.clean(image))

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(results) == 12 and all(np.array_equal(result, expected) for result in results)


def _forked(connection: object) -> None:
    connection.send(ravec.clean(edge(48, 32)))  # type: ignore[attr-defined]


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="a system without fork")
def test_a_forked_process_works(picture: np.ndarray) -> None:
    expected = ravec.clean(picture)
    context = multiprocessing.get_context("fork")
    here, there = context.Pipe()
    child = context.Process(target=_forked, args=(there,))
    child.start()
    assert here.poll(120)
    assert np.array_equal(here.recv(), expected)
    child.join(60)
    assert child.exitcode == 0


def test_the_command_line_is_a_module(tmp_path: Path) -> None:
    version = subprocess.run([sys.executable, "-m", "ravec", "--version"], capture_output=True, text=True)
    assert version.returncode == 0 and ravec.__version__ in version.stdout
    wrong = subprocess.run([sys.executable, "-m", "ravec", "levitate"], capture_output=True, text=True)
    assert wrong.returncode == 2 and "ravec:" in wrong.stderr


def test_everything_public_is_documented() -> None:
    for name in ravec.__all__:
        thing = getattr(ravec, name)
        if inspect.isclass(thing) or inspect.isfunction(thing):
            assert inspect.getdoc(thing), name
            members = inspect.getmembers(thing) if inspect.isclass(thing) else []
            for member, value in members:
                own = not member.startswith("_") and getattr(value, "__module__", "").startswith("ravec")
                assert not own or inspect.getdoc(value), f"{name}.{member}"


def test_the_command_line_runs_again_in_a_process(tmp_path: Path) -> None:
    program = (
        "import sys, ravec; "
        "codes = [ravec._ravec.main(['ravec', '-q', 'scenes', '-o', folder, '--scene', 'disc']) for folder in sys.argv[1:]]; "
        "sys.exit(max(codes))"
    )
    folders = [str(tmp_path / name) for name in ("one", "two")]
    done = subprocess.run([sys.executable, "-c", program, *folders], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert len(list(tmp_path.iterdir())) == 2


def test_types_are_checked() -> None:
    mypy = pytest.importorskip("mypy.api")
    root = Path(__file__).parent.parent
    options = ["--no-incremental", "--config-file", str(root / "pyproject.toml")]
    output, errors, code = mypy.run([*options, str(root / "ravec"), str(root / "tests" / "typed_example.py")])
    assert code == 0, output + errors


def test_a_gpu_fits_and_cleans_to_the_same_bits(picture: np.ndarray) -> None:
    with pytest.raises(ValueError, match="cpu"):
        ravec.set_device("no such adapter")
    fitted, cleaned = ravec.twocolor(picture, whole_pixels=True), ravec.clean(picture)
    narrow, turned = ravec.retarget(picture, 30, 32), ravec.Homography([[0, -1, 32], [1, 0, 0], [0, 0, 1]])
    straight = turned.warp(picture, 32, 48)
    try:
        adapter = ravec.set_device("llvmpipe")
    except ValueError as error:
        pytest.skip(f"KERNELS FOR GPUS ARE NOT TESTED: {error}")
    try:
        assert adapter is not None and "llvmpipe" in adapter
        for name, values in ravec.twocolor(picture, whole_pixels=True).blocks().items():
            assert np.array_equal(values, fitted.blocks()[name], equal_nan=True), name
        assert np.array_equal(ravec.clean(picture), cleaned)
        # renderings and warps may differ by a step
        for there, here in [
            (ravec.twocolor(picture, whole_pixels=True).render(2), fitted.render(2)),
            (ravec.retarget(picture, 30, 32), narrow),
            (turned.warp(picture, 32, 48), straight),
        ]:
            assert np.abs(there.astype(int) - here.astype(int)).max() <= 1
        # nothing was left to the CPU
        recipe = {"operation": "twocolor", "input": "@in", "output": "@out"}
        report = ravec.run(recipe, {"@in": picture}).report
        assert "warnings" not in report or not any("CPU" in text for text in report["warnings"])
        # drivers do not survive a fork: the CPU does the work, and says so
        if hasattr(os, "fork"):
            child = os.fork()
            if child == 0:
                passed = False
                try:
                    with pytest.warns(RuntimeWarning, match="forked"):
                        passed = np.array_equal(ravec.clean(picture), cleaned)
                    with pytest.raises(ValueError, match="spawn"):
                        ravec.set_device("llvmpipe")
                except BaseException:
                    passed = False
                finally:
                    os._exit(0 if passed else 1)
            assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    finally:
        assert ravec.set_device("cpu") is None
