"""The stabilised columns: beside the plain ones, by each row's own rotation, and absent where a row has none."""

from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from scipy.spatial.transform import Rotation

from geovp_benchmarks import matrix
from geovp_benchmarks.metric_set import MetricSet
from geovp_benchmarks.scoring import Metrics, ScoringContext, score
from geovp_benchmarks.stored_facts import title
from geovp_classic.errors import GeovpError
from geovp_classic.geometry import pinhole, se3
from geovp_classic.metrics.image import Psnr
from geovp_classic.metrics.stabilised import Stabilised
from geovp_classic.types import ByteArray, Clip, FloatArray, Intrinsics, Motion, Prediction, Trajectory

CAMERA = Intrinsics(80.0, 80.0, 31.5, 31.5, 64, 64)
PAST, FUTURE = 3, 2
METRICS = Metrics({"psnr": Psnr(), "psnr-stabilised": Stabilised()}, {})


def looking(right_deg: FloatArray) -> FloatArray:
    rotation_vectors = np.deg2rad(right_deg)[..., None] * np.array([0.0, 1.0, 0.0])
    return se3.compose(Rotation.from_rotvec(rotation_vectors).as_matrix(), np.zeros(3))


def panorama(world_from_cam: FloatArray) -> ByteArray:
    """Frames [T, H, W, 3] of vertical stripes at infinity, 7 degrees apart."""
    directions = pinhole.rays(CAMERA) @ np.swapaxes(world_from_cam[:, None, :3, :3], -1, -2)
    azimuth_deg = np.rad2deg(np.arctan2(directions[..., 0], directions[..., 2]))
    grey = np.rint(127.5 + 100 * np.sin(2 * np.pi * azimuth_deg / 7))
    return np.repeat(grey[..., None], 3, axis=-1).astype(np.uint8)


def drive() -> Clip:
    """A camera that turns right, three degrees a step, from an odd heading."""
    poses = looking(40 + 3.0 * np.arange(PAST + FUTURE))
    times_s = 0.1 * np.arange(PAST + FUTURE)
    return Clip("drive", panorama(poses), times_s, CAMERA, Trajectory(poses, times_s, is_metric=True))


def predicted(clip: Clip, *wrong_deg: float) -> Prediction:
    """Samples that turn a little wrong, in a world of their own, and show exactly what they would have seen."""
    assert clip.trajectory is not None
    poses = clip.trajectory.world_from_cam
    futures = np.stack([poses[PAST:] @ looking(np.full(FUTURE, wrong)) for wrong in wrong_deg])
    own_from_world = looking(np.array(-77.0))
    past = Trajectory(own_from_world @ poses[:PAST], clip.times_s[:PAST], is_metric=False)
    motion = Motion(past, own_from_world @ futures, np.ones(PAST, bool))
    return Prediction(np.stack([panorama(future) for future in futures]), motion=motion)


def values(rows: pa.Table, metric: str, sample: int = 0) -> list[float]:
    chosen = pc.and_(pc.equal(rows["metric"], metric), pc.equal(rows["sample"], sample))
    found: list[float] = rows.filter(chosen)["value"].to_pylist()
    return found


def test_every_sample_is_stabilised_by_its_own_rotation() -> None:
    clip = drive()
    rows = score(ScoringContext(clip, PAST), predicted(clip, 0.0, 1.0, -0.4), METRICS)
    assert values(rows, "psnr", 0) == values(rows, "psnr-stabilised", 0) == [100.0] * FUTURE
    # stripes of amplitude 100 that are off by 1 / 7 and .4 / 7 of a period differ by 2 * 100 sin(pi / 7) cos(...):
    # a mean square of 2 * 100^2 sin^2(pi / 7), 12.4 dB, and of 2 * 100^2 sin^2(.4 pi / 7), 20.1 dB
    np.testing.assert_allclose(values(rows, "psnr", 1), 12.4, atol=0.3)
    np.testing.assert_allclose(values(rows, "psnr", 2), 20.1, atol=0.3)
    for sample in (1, 2):
        assert min(values(rows, "psnr-stabilised", sample)) > 42


def test_equal_images_of_unequal_rotations_are_not_confused() -> None:
    clip, context = drive(), ScoringContext(drive(), PAST)
    right = predicted(clip, 1.0)
    lying = replace(right, motion=predicted(clip, 0.0).motion)
    honest, false = (score(context, each, METRICS) for each in (right, lying))
    assert values(honest, "psnr") == values(false, "psnr") == values(false, "psnr-stabilised")
    assert min(values(honest, "psnr-stabilised")) > 42


def test_the_order_of_the_columns_changes_no_number() -> None:
    clip = drive()
    backwards = Metrics(dict(reversed(list(METRICS.frame.items()))), {})
    tables = [score(ScoringContext(clip, PAST), predicted(clip, 1.0), each) for each in (METRICS, backwards)]
    for metric in METRICS.frame:
        assert values(tables[0], metric) == values(tables[1], metric)


def test_a_row_without_a_camera_has_no_stabilised_score() -> None:
    clip = drive()
    still = Prediction(np.tile(clip.frames[PAST - 1], (1, FUTURE, 1, 1, 1)))
    rows = score(ScoringContext(clip, PAST), still, METRICS)
    assert set(rows["metric"].to_pylist()) == {"psnr"}
    unknown = replace(clip, trajectory=None)
    assert set(score(ScoringContext(unknown, PAST), predicted(clip, 1.0), METRICS)["metric"].to_pylist()) == {"psnr"}


def content(**metrics: Any) -> dict[str, Any]:
    protocol = {"dataset": {"name": "synthetic"}, "num_past": 3, "num_future": 2, "size_px": [32, 32], "stride": 5}
    return {"protocol": protocol, "predictors": {"copy": {"name": "copy-last"}}, "metrics": metrics}


def test_a_matrix_asks_for_them_by_the_names_of_its_frame_metrics() -> None:
    frame = {"psnr": {"name": "psnr", "ceiling_db": 60.0}, "ssim": {"name": "ssim"}}
    parsed = matrix.parse("m", content(frame=frame, stabilised=["psnr"]))
    assert list(parsed.frame_metrics) == ["psnr", "ssim", "psnr-stabilised"]
    built = MetricSet.build(parsed.frame_metrics, {}).built["psnr-stabilised"]
    assert built == Stabilised(Psnr(ceiling_db=60.0))
    assert title("psnr-stabilised") == "PSNR, stabilised"


@pytest.mark.parametrize(
    ("metrics", "says"),
    [
        ({"stabilised": "psnr"}, r"metrics.stabilised is 'psnr', expected a list of frame metrics such as"),
        ({"stabilised": ["psn"]}, r"metrics.stabilised has an unknown frame metric 'psn': did you mean 'psnr'"),
        (
            {"stabilised": ["psnr"], "frame": {"psnr": "psnr", "psnr-stabilised": "ssim"}},
            r"metrics.frame has 'psnr-stabilised', as metrics.stabilised calls its own: give another name",
        ),
    ],
)
def test_a_wrong_word_is_one_sentence(metrics: dict[str, Any], says: str) -> None:
    with pytest.raises(GeovpError, match=says):
        matrix.parse("m", content(**metrics))
