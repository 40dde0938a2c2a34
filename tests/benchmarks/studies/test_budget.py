"""The error budget and the sensitivity curves: toy images by hand, and whole runs on the synthetic
street.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geovp_benchmarks.analysis.intervals import Interval
from geovp_benchmarks.evaluation.budget import offsets, stages
from geovp_benchmarks.evaluation.budget.images import ClipImages, with_true_depth
from geovp_benchmarks.evaluation.budget.offsets import Offset
from geovp_benchmarks.evaluation.budget.poses import ClipMotions
from geovp_benchmarks.evaluation.budget.scores import Scores, Subject, find_method, text
from geovp_benchmarks.evaluation.budget.stages import NONE, Budget
from geovp_benchmarks.matrix import schema
from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.depth.given import Given
from geovp_classic.forecasting.constant import ConstantVelocity
from geovp_classic.metrics.image import Psnr
from geovp_classic.odometry.recorded import Recorded as RecordedPast
from geovp_classic.pose_sources.chained import Chained
from geovp_classic.pose_sources.registered import Registered
from geovp_classic.pose_sources.stand_still import StandStill
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.renderers.depth_fusion import DepthFusion
from geovp_classic.renderers.ground_far_plane import GroundFarPlane
from geovp_classic.types import (
    BoolArray,
    Clip,
    Context,
    FloatArray,
    Intrinsics,
    PrivilegedInput,
    Trajectory,
    Views,
)
from tests.benchmarks.conftest import Says
from tests.benchmarks.made import write_matrix

PAST = {
    "name": "chained",
    "odometry": {"name": "ground-truth"},
    "forecaster": {"name": "constant-velocity"},
}
TABLES: dict[str, dict[str, Any]] = {
    "protocol": {
        "dataset": {"name": "synthetic", "num_clips": 2},
        "num_past": 6,
        "num_future": 6,
        "stride": 10,
    },
    "pose_sources": {"past": PAST},
    "renderers": {"fusion": "depth-fusion"},
    "predictors": {"copy-last": "copy-last"},
    "metrics": {"frame": ["psnr", "ssim"]},
}
TABLES["protocol"]["size_px"] = [96, 96]


@pytest.fixture
def matrix_file(tmp_path: Path) -> Path:
    return write_matrix(tmp_path / "street.toml", TABLES)


def subject_of(metric: Psnr) -> Subject:
    """A row of two parts that nothing is asked of, on one clip."""
    read = schema.parse("m", TABLES)
    dataset = Synthetic(num_clips=1, num_frames=12, size_px=(96, 96))
    return Subject(
        "row",
        GeometricPredictor(StandStill(), Half()),
        read,
        dataset,
        1,
        dataset[0],
        {"psnr": metric},
    )


@dataclass(frozen=True)
class Half:
    """Grey 100, of which the right half is inpainted as 0; nothing at all is known from 10 units
    ahead on.
    """

    needs = PrivilegedInput.NONE

    def reconstruct(self, context: Context, past: Trajectory) -> "Half":
        return self

    def view(
        self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics
    ) -> Views:
        shape = (len(times_s), intrinsics.height_px, intrinsics.width_px)
        covered = np.zeros(shape, dtype=bool)
        covered[world_from_cam[:, 2, 3] < 10, :, : shape[2] // 2] = True
        frames = np.where(covered[..., None], 100, 0) * np.ones(3, np.uint8)
        return Views(frames.astype(np.uint8), covered, np.ones(shape, np.float32))


def toy_images(moving: BoolArray | None = None, step: float = 1.0) -> ClipImages:
    """Real frames are grey 150; five observed and three future ones."""
    poses = np.tile(np.eye(4), (8, 1, 1))
    poses[:, 2, 3] = step * np.arange(8)
    times_s, camera = 0.1 * np.arange(8), Intrinsics(90.0, 90.0, 31.5, 31.5, 64, 64)
    frames = np.full((8, 64, 64, 3), 150, np.uint8)
    clip = Clip("toy", frames, times_s, camera, Trajectory(poses, times_s, True), moving=moving)
    context, target = clip.split(5, Registered().needs)
    motions = ClipMotions(Chained(RecordedPast(), ConstantVelocity()), context)
    return ClipImages(motions, Half(), None, context, target, (0, 2))


def test_holes_come_from_the_real_frame() -> None:
    predicted, real = toy_images().frames(frozenset({"holes"}))
    assert predicted.shape == real.shape == (2, 64, 64, 3)
    assert (predicted[:, :, :32] == 100).all()
    assert (predicted[:, :, 32:] == 150).all()


def test_exposure_is_matched_where_pixels_were_not_inpainted() -> None:
    predicted, _ = toy_images().frames(frozenset({"exposure"}))
    assert abs(predicted[:, :, :32].astype(int) - 150).max() <= 1
    assert (predicted[:, :, 32:] == 0).all()


def test_dynamic_objects_come_from_the_real_frame() -> None:
    moving = np.zeros((8, 64, 64), dtype=bool)
    moving[7, :10] = True  # the third future frame
    predicted, _ = toy_images(moving).frames(frozenset({"dynamic objects"}))
    assert (predicted[0, :, :32] == 100).all()
    assert (predicted[1, :10] == 150).all()
    assert (predicted[1, 10:, :32] == 100).all()


def test_true_depth_is_recorded_or_there_is_none() -> None:
    clip = Synthetic(num_clips=1, num_frames=12, size_px=(96, 96))[0]
    swapped = with_true_depth(DepthFusion(), clip)
    assert isinstance(swapped, DepthFusion)
    assert swapped.depth == Given()
    assert with_true_depth(GroundFarPlane(), clip) is None
    assert (
        with_true_depth(DepthFusion(frames="full"), clip) is None
    )  # depth is recorded for the crop alone
    unknown = Clip(clip.name, clip.frames, clip.times_s, clip.intrinsics, clip.trajectory)
    assert with_true_depth(DepthFusion(), unknown) is None


def test_changes_are_paired_and_leave_out_clips_without_a_value() -> None:
    values = {
        "a": np.array([[1.0], [2.0], [30.0], [4.0]]),
        "b": np.array([[2.0], [4.0], [np.nan], [7.0]]),
    }
    scores = Scores(values, {"b": "no scale"}, subject_of(Psnr()), ["03"] * 4)
    assert scores.change(["b"], "a", "psnr").mean == pytest.approx(2.0)  # 1, 2, 3
    assert scores.change(["a", "b"], "a", "psnr").mean == pytest.approx(1.0)
    assert (scores.count("a"), scores.count("a", "b")) == (4, 3)
    assert text(Interval(1.234, 1.0, -0.5, 4, 0.1), Psnr()) == "+1.23 [+1.00, -0.50]"
    assert text(Interval(1.234, np.nan, np.nan, 2, np.nan), Psnr()) == "+1.23"


def test_the_budget_of_the_street_adds_up(matrix_file: Path, printed: Says) -> None:
    out = matrix_file.parent / "figures"
    lines = printed("budget", matrix_file, "--out", out).splitlines()
    assert lines[0] == "past + fusion: 2 clips of synthetic, every 10 frames, horizons 1, 5"
    rows = [line for line in lines if line.endswith("   2")]
    assert len(rows) == 24  # twelve stages in two metrics: depth and masks are exact here
    ends = next(line for line in lines if line.startswith("PSNR (dB) ↑: all forecast"))
    forecast, truth = (float(words.split()[-1]) for words in ends.split(","))
    one_by_one = [float(row[18:].split()[1]) for row in rows[:12]]
    assert sum(one_by_one) == pytest.approx(
        truth - forecast, abs=0.07
    )  # each is rounded to hundredths
    assert truth > forecast + 1
    names = {f"budget-{metric}.{kind}" for metric in ("psnr", "ssim") for kind in ("png", "svg")}
    assert {path.name for path in out.iterdir()} == names
    assert (out / "budget-psnr.png").read_bytes().startswith(b"\x89PNG")
    drawn = (out / "budget-ssim.svg").read_text()
    assert all(
        stage in drawn for stage in ("past poses", "dynamic objects", "one by one", "SSIM ↑")
    )
    assert not [
        line for line in [*lines, drawn] if "nan" in line or "95 %" in line
    ]  # two clips have no intervals


def test_what_cannot_be_measured_is_named() -> None:
    values = {
        variant: np.full((3, 1), 20.0)
        for variant in (NONE, frozenset({"yaw"}), frozenset({"roll"}), frozenset({"yaw", "roll"}))
    }
    scores = Scores(values, {}, subject_of(Psnr()), ["03"] * 3)
    budget = Budget(scores, ("yaw", "roll"), {"depth": "needs recorded depth"})
    lines = list(stages.tables(budget))
    assert "95 %" in lines[-1]
    assert "depth: not measurable here, it needs recorded depth" in lines
    assert budget.pair("put in one by one", "roll") == ({"yaw"}, {"yaw", "roll"})
    assert budget.pair("put in alone", "roll") == (NONE, {"roll"})
    assert budget.pair("taken away alone", "roll") == ({"yaw", "roll"}, {"yaw"})


def test_a_predictor_made_of_both_parts_is_a_row() -> None:
    whole = {
        "name": "geometric",
        "pose_source": {"name": "stand-still"},
        "renderer": {"name": "depth-fusion"},
    }
    label, predictor = find_method(
        schema.parse("m", {**TABLES, "predictors": {"whole": whole}}), "whole"
    )
    assert label == "whole"
    assert isinstance(predictor.renderer, DepthFusion)


@pytest.mark.parametrize(
    ("offset", "axis", "expected"),
    [
        (Offset("yaw", 30.0), 2, (0.5, 0, 0.75**0.5)),  # the view, to the right
        (Offset("pitch", 30.0), 2, (0, -0.5, 0.75**0.5)),  # the view, up
        (Offset("roll", -30.0), 0, (0.75**0.5, -0.5, 0)),  # the image's right, up: anticlockwise
        (Offset("y", -0.2), 3, (0, -0.2, 0)),
    ],
)
def test_an_offset_is_a_turn_or_a_shift_of_the_camera(
    offset: Offset, axis: int, expected: tuple[float, ...]
) -> None:
    np.testing.assert_allclose(offsets.cam_from_offset(offset)[:3, axis], expected, atol=1e-12)


def test_larger_errors_cost_more(matrix_file: Path, printed: Says) -> None:
    out = matrix_file.parent / "figures"
    lines = printed("sensitivity", matrix_file, "--limit", "1", "--out", out).splitlines()
    loss = {
        line[:28].strip(): float(line[28:].split()[0])
        for line in lines
        if line.startswith(("pitch", "y 0"))
    }
    assert loss["pitch 2 deg"] < loss["pitch 0.5 deg"] < 0
    assert loss["y 0.5 m (30% of height)"] < loss["y 0.1 m (6% of height)"] < 0.05  # of 1.65 m
    assert (out / "sensitivity-psnr.png").read_bytes().startswith(b"\x89PNG")
    drawn = (out / "sensitivity-ssim.svg").read_text()
    assert "offset (degrees)" in drawn
    assert not [
        line for line in [*lines, drawn] if "nan" in line or "95 %" in line
    ]  # one clip has no intervals
