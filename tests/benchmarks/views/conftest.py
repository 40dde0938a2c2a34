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
from tests.benchmarks.made import scores

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


def record(name: str) -> dict[str, Any]:
    source, renderer, status, samples, _, _ = METHODS[name]
    geometric = {
        "label": f"{source} + far",
        "kind": "geometric",
        "pose_source": source,
        "renderer": renderer,
    }
    parts = {
        "pose_source": {"name": "chained", "note": "<i>odd</i>"},
        "renderer": {"name": "far-plane", "fill": 3.5},
    }
    facts: dict[str, Any] = geometric if source else {"label": name, "kind": "predictor"}
    facts |= {"components": parts if source else {"predictor": {"name": name}}, "fingerprint": "f"}
    facts |= {
        "status": status,
        "num_samples": samples,
        "privileged_inputs": ["PAST_POSES"] if source == "gt" else [],
    }
    if status == "skipped":
        facts["reason"] = "the poses are not in metres: give the odometry a scale"
    if status == "failed":
        facts |= {
            "reason": "ValueError: <b>bold</b>",
            "traceback": "Traceback\n  <script>alert(1)</script>",
        }
    return facts


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
    source, _, _, samples, metres, is_metric = METHODS[name]
    tone = 10 * list(METHODS).index(name)
    frames = np.full((samples, FUTURE, SIDE, SIDE, 3), tone, np.uint8)
    frames += np.arange(1, FUTURE + 1, dtype=np.uint8)[
        :, None, None, None
    ]  # the image says the step
    if source is None:
        results.predictions(results.by_name()[name]).write(KEPT, Prediction(frames))
        return
    covered = np.ones(frames.shape[:4], bool)
    covered[..., :4] = False
    past = straight(metres, PAST, is_metric=is_metric)
    ahead = straight(metres, PAST + FUTURE).world_from_cam[PAST:]
    motion = Motion(past, np.tile(ahead, (samples, 1, 1, 1)), np.ones(PAST, bool))
    results.predictions(results.by_name()[name]).write(KEPT, Prediction(frames, covered, motion))


def fill(root: Path) -> Path:
    results = Results(root)
    sizes = {"num_past": PAST, "num_future": FUTURE, "size_px": [SIDE, SIDE], "stride": 9}
    data = {
        "dataset": {"name": "toy", "split": "val"},
        "dataset_name": "toy <val>",
        "split_hash": "abc123" * 8,
    }
    some = {
        "versions": {"numpy": "9.9.9"},
        "methods": list(METHODS),
        "clips": list(CLIPS),
        "fingerprint": "p",
    }
    results.write_protocol(
        {"name": "toy & matrix", "id": "d3m0", **data, **sizes, **some, "metrics": FACTS}
    )
    frames = np.full((PAST + FUTURE, SIDE, SIDE, 3), 200, np.uint8)
    frames += np.arange(PAST + FUTURE, dtype=np.uint8)[:, None, None, None]
    drive = straight(1.0, PAST + FUTURE)
    results.clips().write(KEPT, Clip(KEPT, frames, drive.times_s, CAMERA, drive))
    for name, (_, _, status, _, _, _) in METHODS.items():
        results.write_method(Method(name=name, **record(name)))
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
