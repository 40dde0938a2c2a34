from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from geovp_classic import registry
from geovp_classic.data.formats import pose_files
from geovp_classic.errors import BadData, Incompatible
from geovp_classic.geometry import se3
from geovp_classic.pose_sources.commanded import Commanded
from geovp_classic.types import Context, FloatArray, Intrinsics, PrivilegedInput, Trajectory

OTHER_FROM_WORLD = se3.exp(np.array([9.0, -2.0, 4.0, 0.3, 1.2, -0.4]))
TWIST = np.array([0.1, 0.0, 5.0, 0.0, 0.5, 0.02])  # per second


def screw(times_s: FloatArray) -> FloatArray:
    return se3.exp(np.asarray(times_s)[:, None] * TWIST)


@pytest.fixture
def context() -> Context:
    """Three past frames up to 100.2 s, two to predict, unevenly spaced."""
    times_s = np.array([100.0, 100.1, 100.2, 100.35, 100.6])
    past = Trajectory(
        se3.exp(np.outer(np.arange(3), [0, 0, 1.0, 0, 0, 0])), times_s[:3], is_metric=True
    )
    camera = Intrinsics(10.0, 10.0, 3.5, 3.5, 8, 8)
    return Context(np.zeros((3, 8, 8, 3), np.uint8), times_s, camera, past=past)


def last_from_future(source: Commanded, context: Context) -> FloatArray:
    motion = source.estimate(context.only(source.needs))
    return se3.inverse(motion.past.world_from_cam[-1]) @ motion.futures[0]


def test_speed_and_turn_rate_drive_a_circle(context: Context) -> None:
    """5 m/s and 90 deg/s to the right: a radius of 10/pi m; a quarter of it after one second."""
    one_second = replace(context, times_s=np.array([0.0, 0.5, 1.0, 2.0]))
    (quarter,) = last_from_future(Commanded(speed_m_s=5.0, turn_deg_s=90.0), one_second)
    np.testing.assert_allclose(quarter[:3, 3], [10 / np.pi, 0, 10 / np.pi], atol=1e-12)
    np.testing.assert_allclose(quarter[:3, 2], [1, 0, 0], atol=1e-12)  # looks to where right was


@pytest.mark.parametrize("start_s", [0.0, 100.2, 1.7e9])
def test_a_tum_file_is_interpolated_at_the_times_to_predict(
    tmp_path: Path, context: Context, start_s: float
) -> None:
    path, times_s = tmp_path / "command.txt", np.array([0.0, 0.07, 0.2, 0.4, 0.9])
    pose_files.write_tum(
        path, Trajectory(OTHER_FROM_WORLD @ screw(times_s), start_s + times_s, is_metric=True)
    )
    np.testing.assert_allclose(
        last_from_future(Commanded(path), context), screw([0.15, 0.4]), atol=1e-5
    )


def test_a_kitti_file_has_one_pose_per_frame(tmp_path: Path, context: Context) -> None:
    path = tmp_path / "command.txt"
    pose_files.write_kitti(
        path, Trajectory(OTHER_FROM_WORLD @ screw([0, 1, 2]), np.arange(3.0), is_metric=True)
    )
    np.testing.assert_allclose(last_from_future(Commanded(path), context), screw([1, 2]), atol=1e-9)


def test_a_command_that_ends_too_early_is_rejected(tmp_path: Path, context: Context) -> None:
    path = tmp_path / "command.txt"
    pose_files.write_tum(path, Trajectory(screw([0.0, 0.3]), np.array([0.0, 0.3]), is_metric=True))
    with pytest.raises(BadData, match=r"lasts 0\.3 s"):
        Commanded(path).estimate(context)


def test_missing_inputs_are_reported(context: Context) -> None:
    command = Commanded(speed_m_s=5.0)
    with pytest.raises(Incompatible, match="the clip has none"):
        command.estimate(context.only(PrivilegedInput.NONE))
    with pytest.raises(Incompatible, match="command by a trajectory file"):
        command.estimate(replace(context, past=replace(context.past, is_metric=False)))


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({}, "give exactly one of them"),
        ({"futures": "command.txt", "turn_deg_s": 3}, "leave turn_deg_s out"),
        ({"futures": "nowhere.txt"}, r"nowhere\.txt is missing"),
    ],
)
def test_bad_settings_are_rejected(table: dict[str, object], message: str) -> None:
    with pytest.raises(BadData, match=message):
        registry.build("pose_sources", {"name": "commanded", **table})
