"""A small results folder whose numbers and images can be worked out by hand, for the figures and
the report.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geovp_benchmarks.results.store import Method, Results, ScoreRecord, Scores
from geovp_classic.types import Clip, Intrinsics, Motion, Prediction, Trajectory
from tests.benchmarks.made import scores, write_protocol

PAST, FUTURE, SIDE = 3, 6, 16
CLIPS = ("a/b[0:9) <x> & $y", "b", "c")
KEPT = CLIPS[0]
CAMERA = Intrinsics(16.0, 16.0, 7.5, 7.5, SIDE, SIDE)
FACTS: dict[str, Any] = {
    "final-gap": {
        "role": "trajectory",
        "unit": "m",
        "higher_is_better": False,
        "unavailable": None,
    },
    "psnr": {
        "role": "frame",
        "unit": "dB",
        "higher_is_better": True,
        "definition": "RGB jointly",
        "unavailable": None,
    },
    "lpips": {"role": "frame", "unavailable": "frame metric 'lpips' needs torch: install it"},
    "translation-error": {
        "role": "trajectory",
        "unit": "m",
        "higher_is_better": False,
        "unavailable": None,
    },
}
# name: (pose source, renderer, status, samples, metres a step, is metric)
METHODS: dict[str, tuple[str | None, str | None, str, int, float, bool]] = {
    "gt--far": ("gt", "far", "done", 1, 1.0, True),
    "_vo--far": ("_vo", "far", "partial", 1, 0.5, False),
    "kalman--far": ("kalman", "far", "done", 3, 1.2, True),
    "copy-last": (None, None, "done", 1, 0.0, True),
    "skipped--far": ("skipped", "far", "skipped", 1, 0.0, True),
    "failed--far": ("failed", "far", "failed", 1, 0.0, True),
}


def straight(metres_a_step: float, count: int, *, is_metric: bool = True) -> Trajectory:
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, 2, 3] = metres_a_step * np.arange(count)
    return Trajectory(poses, 0.1 * np.arange(count), is_metric)


def record(name: str) -> Method:
    source, renderer, status, *_ = METHODS[name]
    facts: dict[str, Any] = {
        "components": {"predictor": {"name": name}},
        "privileged_inputs": ["PAST_POSES"] if source == "gt" else [],
        "status": status,
        "fingerprint": "f",
    }
    if source:
        facts["components"] = {
            "pose_source": {"name": "chained", "note": "<i>odd</i>"},
            "renderer": {"name": "far-plane", "fill": 3.5},
        }
    if status == "skipped":
        facts["reason"] = "the poses are not in metres: give the odometry a scale"
    if status == "failed":
        facts["reason"] = "ValueError: <b>bold</b>"
        facts["traceback"] = "Traceback\n  <script>alert(1)</script>"
    # Three samples were asked for; those that are always equal are stored once
    return Method.of(3, source or name, renderer).model_copy(update=facts)


def rows(name: str) -> Scores:
    """PSNR is 20 + clip + sample - step for every method: its mean over three clips is 21 - step with
    one sample.
    """
    clips = CLIPS[:2] if METHODS[name][2] == "partial" else CLIPS
    found = []
    for number, clip in enumerate(clips):
        for sample in range(METHODS[name][3]):
            for step in range(1, FUTURE + 1):
                found.append((clip, sample, step, "psnr", 20.0 + number + sample - step))
                if METHODS[name][0] is not None:
                    found.append((clip, sample, step, "translation-error", 0.1 * step))
                    found.append((clip, sample, step, "final-gap", 1.0 if step == FUTURE else None))
                    found.append(
                        (clip, sample, step, "psnr@covered", None if step > 4 else 30.0 - step)
                    )
    return scores(found)


def keep(results: Results, name: str) -> None:
    """Keep predictions whose images say the method and the step."""
    source, _, _, samples, metres, is_metric = METHODS[name]
    tones = 10 * list(METHODS).index(name) + np.arange(1, FUTURE + 1, dtype=np.uint8)
    frames = np.tile(tones[:, None, None, None], (samples, 1, SIDE, SIDE, 3)).astype(np.uint8)
    covered = motion = None
    if source is not None:
        covered = np.ones(frames.shape[:4], bool)
        covered[..., :4] = False
        past = straight(metres, PAST, is_metric=is_metric)
        ahead = straight(metres, PAST + FUTURE).world_from_cam[PAST:]
        motion = Motion(past, np.tile(ahead, (samples, 1, 1, 1)), np.ones(PAST, bool))
    kept = results.predictions(results.by_name()[name])
    kept.write(KEPT, Prediction(frames, covered, motion))


def fill(root: Path) -> Path:
    results = Results(root)
    protocol = {"num_past": PAST, "num_future": FUTURE, "size_px": [SIDE, SIDE], "stride": 9}
    protocol |= {"dataset": {"name": "toy", "split": "val"}, "dataset_name": "toy <val>"}
    protocol |= {"name": "toy & matrix", "fingerprint": "p", "metrics": FACTS}
    write_protocol(results, METHODS, CLIPS, **protocol)
    frames = np.full((PAST + FUTURE, SIDE, SIDE, 3), 200, np.uint8)
    frames += np.arange(PAST + FUTURE, dtype=np.uint8)[:, None, None, None]
    drive = straight(1.0, PAST + FUTURE)
    results.clips().write(KEPT, Clip(KEPT, frames, drive.times_s, CAMERA, drive))
    for name, (_, _, status, _, _, _) in METHODS.items():
        results.write_method(record(name))
        if status in ("done", "partial"):
            scored = rows(name)
            about = ScoreRecord(name, [*scored.clips], "f", {}, {"motion": 1.25, "metrics": 2.5})
            results.write_scores([(scored, replace(about, peak_memory_mb=321.0))])
            keep(results, name)
    return root


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results folder; for reading only, figures and reports aside."""
    return fill(tmp_path_factory.mktemp("views") / "results")
