"""Same settings, same results, with any number of threads."""

from pathlib import Path
from typing import Any

import cv2
import numba
import numpy as np
from threadpoolctl import threadpool_limits

from geovp_benchmarks.results.store import Results
from geovp_benchmarks.running.executors import Serial
from tests.benchmarks.made import go

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
METHOD = "vo--fusion"


def run(root: Path, threads: int) -> Results:
    before = numba.config.NUMBA_NUM_THREADS, cv2.getNumThreads()
    numba.config.NUMBA_NUM_THREADS = threads
    cv2.setNumThreads(threads)
    try:
        with threadpool_limits(threads):
            (method,) = go(root, MATRIX, Serial()).values()
    finally:
        numba.config.NUMBA_NUM_THREADS = before[0]
        cv2.setNumThreads(before[1])
    assert (method.status, len(method.scored.failures)) == ("done", 0)
    return Results(root)


def test_scores_are_the_same_within_a_tolerance(tmp_path: Path) -> None:
    serial, threads = (
        [*run(tmp_path / f"{count}", count).scores(METHOD).rows()] for count in (1, 2)
    )
    assert [row[:4] for row in threads] == [row[:4] for row in serial]
    values = ([row[4] for row in rows] for rows in (threads, serial))
    np.testing.assert_allclose(*values, rtol=1e-6, atol=1e-6)
