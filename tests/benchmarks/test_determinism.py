"""Same settings, same results, with any number of threads.

Scores agree to 1e-6 and pixels to one grey level.
"""

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
            (method,) = go(root, MATRIX, Serial(), keep="all").values()
    finally:
        numba.config.NUMBA_NUM_THREADS = before[0]
        cv2.setNumThreads(before[1])
    assert (method.status, len(method.scored.failures)) == ("done", 0)
    return Results(root)


def test_frames_poses_and_scores_are_the_same_within_a_tolerance(tmp_path: Path) -> None:
    serial = run(tmp_path / "serial", 1)
    other = run(tmp_path / "threads", 2)
    scores, expected = (list(results.scores(METHOD).rows()) for results in (other, serial))
    assert [row[:4] for row in scores] == [row[:4] for row in expected]
    values = ([row[4] for row in rows] for rows in (scores, expected))
    np.testing.assert_allclose(*values, rtol=1e-6, atol=1e-6)
    clips = serial.predictions(serial.by_name()[METHOD]).names
    assert len(clips) == 3
    for clip in clips:
        one, two = (
            results.predictions(results.by_name()[METHOD]).read(clip) for results in (serial, other)
        )
        assert np.abs(one.frames.astype(int) - two.frames).max() <= 1
        assert one.motion is not None
        assert two.motion is not None
        np.testing.assert_allclose(one.motion.futures, two.motion.futures, atol=1e-6)
