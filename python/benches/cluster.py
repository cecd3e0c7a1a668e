"""One worker, two, and 64 on paper: offsets by tiles and mosaics by tiles, photos and rows.

    python python/benches/cluster.py offset dragon.ply --distance 2% --tolerance 0.001% --side outer --memory 1GiB
    python python/benches/cluster.py mosaic photo.jpg photos.ravec --tiles 200x150 --tile-size 32x24

Each worker is a process with one thread. The serial part is the time in which the client does not wait for an answer:
its plan, its merge, and what it does with answers while workers go on. The table for more workers replays the times of
the pieces that one worker took: a batch begins when all pieces before it have their answers, a free worker takes the
next piece, and nothing of the serial part runs beside pieces.
"""

from __future__ import annotations

import argparse
import filecmp
import heapq
import json
import resource
import tempfile
import time
from pathlib import Path
from typing import Any

import distributed

import ravec
from ravec import _pieces


class Recorder:
    """Records which pieces are out together, and how long the client waits for answers."""

    def __init__(self) -> None:
        self.batches: list[list[str]] = []
        self.out = 0
        self.waited_s = 0.0

    def submitted(self, key: str) -> None:
        if self.out == 0:
            self.batches.append([])
        self.batches[-1].append(key)
        self.out += 1

    def answered(self) -> None:
        self.out -= 1


def recorded(recorder: Recorder) -> None:
    """Makes executors report to the recorder."""
    real_submit, real_next = _pieces._Executor.submit, _pieces._Executor.next

    def submit(executor: Any, number: int, piece: bytes) -> None:
        real_submit(executor, number, piece)
        recorder.submitted(list(executor._out.values())[-1].key)

    def next_answer(executor: Any) -> tuple[int, bytes] | None:
        start = time.perf_counter()
        answer = real_next(executor)
        recorder.waited_s += time.perf_counter() - start
        if answer is not None:
            recorder.answered()
        return answer

    _pieces._Executor.submit, _pieces._Executor.next = submit, next_answer  # type: ignore[method-assign]
    recorder.restore = lambda: (  # type: ignore[attr-defined]
        setattr(_pieces._Executor, "submit", real_submit),
        setattr(_pieces._Executor, "next", real_next),
    )


def measured(step: dict[str, Any], workers: int, memory: str, target: Path) -> dict[str, Any]:
    """Wall time, times of pieces, and peaks of the workers."""
    recorder = Recorder()
    recorded(recorder)
    ravec._ravec.set_threads(1)
    with distributed.LocalCluster(
        n_workers=workers, threads_per_worker=1, memory_limit=memory, dashboard_address=None
    ) as cluster, distributed.Client(cluster) as client:
        with distributed.get_task_stream() as stream:
            start = time.perf_counter()
            report = _pieces.run_in_pieces(
                {**step, "output": str(target)}, client=client, scratch=None, storage_options=None, progress=None
            )
            wall_s = time.perf_counter() - start
        peaks = client.run(lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    recorder.restore()  # type: ignore[attr-defined]
    times = {
        task["key"]: sum(part["stop"] - part["start"] for part in task["startstops"] if part["action"] == "compute")
        for task in stream.data
    }
    return {
        "wall_s": wall_s,
        "serial_s": wall_s - recorder.waited_s,
        "batches": [[times.get(key, 0.0) for key in batch] for batch in recorder.batches],
        "peaks_mib": [round(peak) for peak in peaks.values()],
        "report": report,
    }


def replayed(batches: list[list[float]], serial_s: float, workers: int) -> float:
    """Wall time with more workers, on paper."""
    total = serial_s
    for batch in batches:
        free = [0.0] * workers
        for piece in batch:
            heapq.heappush(free, heapq.heappop(free) + piece)
        total += max(free)
    return total


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worker-memory", default="3GiB", help="memory limit of a worker")
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("operation", choices=("offset", "mosaic"))
    parser.add_argument("rest", nargs=argparse.REMAINDER)
    given = parser.parse_args()
    rest = given.rest
    if given.operation == "mosaic":
        rest = [rest[0], "--catalogue", rest[1], *rest[2:]]
    suffix = ".ply" if given.operation == "offset" else ".png"
    recipe, code = ravec._ravec.recipe_of(["ravec", given.operation, *rest, "-o", f"out{suffix}"])
    if recipe is None:
        raise SystemExit(code)
    (step,) = json.loads(recipe)["steps"]
    with tempfile.TemporaryDirectory() as folder:
        one_file, two_file = (Path(folder) / f"{name}{suffix}" for name in ("one", "two"))
        for _ in range(given.runs):
            one = measured(step, 1, given.worker_memory, one_file)
            two = measured(step, 2, given.worker_memory, two_file)
            assert filecmp.cmp(one_file, two_file, shallow=False), "the same bytes"
            pieces_s = sum(map(sum, one["batches"]))
            count = sum(map(len, one["batches"]))
            print(f"one worker {one['wall_s']:.1f} s, two {two['wall_s']:.1f} s: {one['wall_s'] / two['wall_s']:.2f}")
            print(f"{count} pieces in {len(one['batches'])} batches, {pieces_s:.1f} s; longest {max(map(max, one['batches'])):.1f} s")
            share = 100 * one["serial_s"] / (pieces_s + one["serial_s"])
            print(f"serial part {one['serial_s']:.1f} s ({share:.1f} %); peaks {one['peaks_mib']} {two['peaks_mib']} MiB")
            for workers in (1, 2, 4, 8, 16, 32, 64):
                wall_s = replayed(one["batches"], one["serial_s"], workers)
                print(f"  {workers:2} workers: {wall_s:7.1f} s, {(pieces_s + one['serial_s']) / wall_s:5.1f} times")


if __name__ == "__main__":
    main()
