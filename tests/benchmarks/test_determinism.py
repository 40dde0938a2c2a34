"""Same settings, same bytes: with any number of processes and threads, and compiled for any
processor.
"""

from pathlib import Path
from typing import Any

import cv2
import numba
import pytest
from threadpoolctl import threadpool_limits

from geovp_benchmarks.executors import Executor, Processes, Serial
from geovp_benchmarks.store import Results
from tests.benchmarks.made import go, rows

MATRIX: dict[str, Any] = {
    "protocol": {
        "dataset": {"name": "synthetic", "num_clips": 3},
        "num_past": 8,
        "num_future": 3,
        "size_px": [96, 96],
        "stride": 10,
    },
    "pose_sources": {"vo": "chained"},
    "renderers": {"fusion": "depth-fusion"},
    "metrics": {"frame": ["psnr", "ssim"], "trajectory": ["translation-error"]},
}
CELL = "vo--fusion"


def outcome(
    root: Path, threads: int, executor: Executor
) -> tuple[Any, dict[str, tuple[bytes, bytes]]]:
    """All rows, and the bytes of all predicted frames and poses."""
    before = numba.get_num_threads(), cv2.getNumThreads()
    numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))
    cv2.setNumThreads(threads)
    try:
        with threadpool_limits(threads):
            (cell,) = go(root, MATRIX, executor, keep=None).values()
    finally:
        numba.set_num_threads(before[0])
        cv2.setNumThreads(before[1])
    results = Results(root)
    assert (cell.status, cell.num_failed) == ("done", 0)
    kept = {clip: results.prediction(CELL, clip) for clip, _ in results.predictions(CELL)}
    images = {
        clip: (one.frames.tobytes(), b"" if one.motion is None else one.motion.futures.tobytes())
        for clip, one in kept.items()
    }
    return rows(root, CELL), images


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Any:
    return outcome(tmp_path_factory.mktemp("plain"), 1, Serial())


@pytest.mark.parametrize(
    ("threads", "executor", "environment"),
    [
        (2, Serial(), {}),
        (1, Processes(2), {}),
        (1, Processes(1), {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}),
    ],
    ids=["threads", "workers", "processors"],
)
def test_frames_poses_and_scores_are_the_same_to_the_last_bit(
    plain: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    threads: int,
    executor: Executor,
    environment: dict[str, str],  # of the processes that are started
) -> None:
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    stored, images = outcome(tmp_path, threads, executor)
    assert len(images) == 3
    assert images == plain[1]
    assert stored == plain[0]
