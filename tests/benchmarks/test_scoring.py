"""Which numbers a prediction gets."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geovp_benchmarks.results.store import Scores
from geovp_benchmarks.running.scoring import Metrics, ScoredClip, score
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.metrics.image import Psnr
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Clip,
    FloatArray,
    Intrinsics,
    Motion,
    Prediction,
    Trajectory,
)

CAMERA = Intrinsics(80.0, 80.0, 31.5, 31.5, 64, 64)
PAST, FUTURE = 3, 2
METRICS = Metrics({"psnr": Psnr()}, {})


def drive() -> Clip:
    """A stationary camera that sees nothing."""
    count = PAST + FUTURE
    times_s = 0.1 * np.arange(count)
    path = Trajectory(np.tile(np.eye(4), (count, 1, 1)), times_s, is_metric=True)
    return Clip("drive", np.zeros((count, 64, 64, 3), np.uint8), times_s, CAMERA, path)


def values(scores: Scores, metric: str, sample: int = 0) -> list[float]:
    return list(scores.values[metric][0, sample])


@dataclass(frozen=True)
class Brightness:
    """The mean grey value of the predicted pixels; remembers how often it was asked."""

    unit: str = "grey"
    higher_is_better: bool = True
    asked: list[str] = field(default_factory=list)

    def __call__(
        self, predicted: ByteArray, target: ByteArray, mask: BoolArray | None = None
    ) -> FloatArray:
        self.asked.append("one")
        chosen = np.ones(predicted.shape[:3], bool) if mask is None else mask
        return np.array(
            [
                frame[pixels].mean() if pixels.any() else np.nan
                for frame, pixels in zip(predicted, chosen, strict=True)
            ]
        )


@dataclass(frozen=True)
class Masked(Brightness):
    """The same with all masks at once."""

    def over(
        self, predicted: ByteArray, target: ByteArray, masks: Sequence[BoolArray | None]
    ) -> list[FloatArray]:
        self.asked.append("many")
        return [Brightness()(predicted, target, mask) for mask in masks]


def standing() -> Clip:
    """A camera that stands in front of a wall at one metre, before whose upper quarter something
    moves.
    """
    moving = np.zeros((PAST + FUTURE, 64, 64), bool)
    moving[:, :16] = True
    return replace(drive(), depths=np.ones(moving.shape, np.float32), moving=moving)


def halves(samples: int, sideways_m: Sequence[float] | None = None) -> Prediction:
    """Sample s at step k: grey 10 s + k, 100 more in the left half and 40 more above; only step 1
    has a left half.
    """
    frames = np.zeros((samples, FUTURE, 64, 64, 3), np.uint8)
    frames += (10 * np.arange(samples)[:, None] + np.arange(1, FUTURE + 1)).astype(np.uint8)[
        ..., None, None, None
    ]
    frames[:, :, :, :32] += 100
    frames[:, :, :16] += 40
    covered = np.zeros(frames.shape[:4], bool)
    covered[:, 0, :, :32] = True
    if sideways_m is None:
        return Prediction(frames, covered)
    own_from_world = se3.compose(
        Rotation.from_euler("y", 90, degrees=True).as_matrix(), np.array([5.0, 0, 7])
    )
    futures = np.tile(own_from_world, (len(sideways_m), FUTURE, 1, 1))
    futures[..., :3, 3] += np.multiply.outer(sideways_m, own_from_world[:3, 0])[:, None]
    past = Trajectory(np.tile(own_from_world, (PAST, 1, 1)), 0.1 * np.arange(PAST), is_metric=True)
    motion = Motion(past, futures, np.array([True, False, True]))
    return Prediction(frames, covered, motion, np.tile([0.5, 0.25], (samples, 1)))


@pytest.mark.parametrize("metric", [Brightness(), Masked()])
def test_every_set_of_pixels_has_a_column_and_every_step_a_row(metric: Brightness) -> None:
    rows = score(ScoredClip(standing(), PAST), halves(2), Metrics({"grey": metric}, {}))
    base = {"grey": 60, "grey@covered": 110, "grey@moving": 90, "grey@static": 50, "grey@seen": 50}
    for sample in (0, 1):
        for name, value in base.items():
            late = np.nan if name == "grey@covered" else value + 10.0 * sample + 2
            expected = [value + 10.0 * sample + 1, late]
            np.testing.assert_array_equal(values(rows, name, sample), expected)
        assert np.isnan(values(rows, "grey@disoccluded", sample)).all()
        assert values(rows, "coverage", sample) == [0.5, 0.0]
    assert {values.shape for values in rows.values.values()} == {(1, 2, 2)}
    assert (len(rows.values), rows.clips) == (7, ["drive"])
    assert set(metric.asked) == {"many" if isinstance(metric, Masked) else "one"}


def test_facts_are_shares_of_the_futures_pixels_and_of_the_path() -> None:
    facts = ScoredClip(standing(), PAST).facts
    assert (facts["moving"], facts["static"], facts["seen"], facts["disoccluded"]) == (
        0.25,
        0.75,
        0.75,
        0.0,
    )
    assert facts["speed_m_s"] == 0.0


@pytest.mark.parametrize("shape", [(1, 64, 64), (3, 64, 64), (2, 32, 64), (2, 64, 128)])
def test_a_prediction_of_another_size_is_refused(shape: tuple[int, ...]) -> None:
    prediction = Prediction(np.zeros((1, *shape, 3), np.uint8))
    with pytest.raises(
        BadData, match=r"frames have shape \(1, \d.*, 3\), expected \(S, 2, 64, 64, 3\)$"
    ):
        score(ScoredClip(drive(), PAST), prediction, METRICS)


@pytest.mark.parametrize("values", [1.0, np.zeros(FUTURE + 1)])
def test_a_metric_has_a_value_for_each_frame(values: object) -> None:
    with pytest.raises(BadData, match="odd has values of shape"):
        score(ScoredClip(drive(), PAST), halves(2), Metrics({"odd": lambda *_: values}, {}))


@pytest.mark.parametrize("futures", [2, 4])
def test_more_futures_than_one_and_not_one_a_sample_are_refused(futures: int) -> None:
    with pytest.raises(
        BadData,
        match=f"{futures} predicted futures for 3 samples, expected one each or one for all",
    ):
        score(ScoredClip(drive(), PAST), halves(3, [0.0] * futures), METRICS)
