from dataclasses import replace

import numpy as np
import pytest
import street

from geovp_classic.errors import Incompatible
from geovp_classic.forecasting.constant import Hold
from geovp_classic.geometry import se3
from geovp_classic.interfaces import PoseSource
from geovp_classic.odometry.recorded_past import RecordedPast
from geovp_classic.pose_sources.chained import Chained
from geovp_classic.pose_sources.constant_turn import ConstantTurn
from geovp_classic.pose_sources.constant_velocity import ConstantVelocity
from geovp_classic.pose_sources.ground_truth import GroundTruth
from geovp_classic.pose_sources.planar import Planar
from geovp_classic.pose_sources.registered import Registered
from geovp_classic.pose_sources.stand_still import StandStill
from geovp_classic.types import Clip, Context, FloatArray, Intrinsics, PrivilegedInput, Trajectory

SOURCES = [GroundTruth(), Planar(GroundTruth()), StandStill(), ConstantVelocity(), ConstantTurn()]
WORLD = se3.exp(np.array([4.0, -1.0, 2.0, 0.3, 0.2, -0.1]))  # the first pose is not the identity


def clip(poses: FloatArray) -> Clip:
    times_s = 0.1 * np.arange(len(poses))
    camera = Intrinsics(10.0, 10.0, 3.5, 3.5, 8, 8)
    frames = np.zeros((len(poses), 8, 8, 3), dtype=np.uint8)
    return Clip(
        "drive", frames, times_s, camera, Trajectory(WORLD @ poses, times_s, is_metric=True)
    )


def drive(num: int = 9, turn_rad: float = 0.02, pitch_rad: float = 0.0) -> Clip:
    """1 m per step ahead, turning right, in the camera's own x-z plane unless it pitches."""
    return clip(se3.exp(np.outer(np.arange(num), [0.0, 0.0, 1.0, pitch_rad, turn_rad, 0.0])))


def context(drive: Clip) -> Context:
    return drive.split(5, ~PrivilegedInput.NONE)[0]


def test_ground_truth_is_the_recording() -> None:
    whole = drive()
    motion = GroundTruth().estimate(context(whole), num_samples=4)
    np.testing.assert_array_equal(motion.past.world_from_cam, whole.trajectory.world_from_cam[:5])
    np.testing.assert_array_equal(motion.futures, whole.trajectory.world_from_cam[None, 5:])
    assert motion.tracked.all()


def test_a_constant_turn_is_continued_at_the_future_times() -> None:
    whole = drive()
    futures = ConstantTurn().estimate(context(whole)).futures
    np.testing.assert_allclose(futures[0], whole.trajectory.world_from_cam[5:], atol=1e-9)


def test_chained_keeps_one_of_equal_samples() -> None:
    motion = Chained(RecordedPast(), Hold()).estimate(context(drive()), num_samples=5)
    assert len(motion.futures) == 1


def test_registered_corrects_poses_that_contradict_future_images() -> None:
    street_clip = street.clip()
    truth = street_clip.trajectory
    error = np.zeros((len(truth), 6))
    error[5:, 3] = np.deg2rad(0.4) * np.arange(1, 6)  # of pitch; 0.4 degrees are a pixel
    recorded = replace(truth, world_from_cam=truth.world_from_cam @ se3.exp(error))
    given = context(replace(street_clip, trajectory=recorded))
    motion = Registered().estimate(given)
    np.testing.assert_array_equal(motion.past.world_from_cam[-1], truth.world_from_cam[4])
    left = se3.inverse(truth.world_from_cam[5:]) @ motion.futures[0]
    assert np.rad2deg(se3.rotation_angle_rad(left)).max() < 1.1  # of 2.0


def test_planar_removes_height_pitch_and_roll() -> None:
    whole = drive(turn_rad=0.1, pitch_rad=0.05)
    motion = Planar(GroundTruth()).estimate(context(whole))
    last_from_future = se3.inverse(motion.past.world_from_cam[-1]) @ motion.futures[0]
    np.testing.assert_allclose(last_from_future[:, 1, 3], 0.0, atol=1e-12)  # no height
    np.testing.assert_allclose(
        last_from_future[:, 1, :3], [[0, 1, 0]] * 4, atol=1e-12
    )  # a turn about the normal only
    recorded = se3.inverse(motion.past.world_from_cam[-1]) @ whole.trajectory.world_from_cam[5:]
    np.testing.assert_allclose(last_from_future[:, [0, 2], 3], recorded[:, [0, 2], 3], atol=1e-12)
    np.testing.assert_array_equal(motion.past.world_from_cam, whole.trajectory.world_from_cam[:5])


@pytest.mark.parametrize("source", SOURCES, ids=lambda source: type(source).__name__)
def test_a_clip_without_poses_is_refused(source: PoseSource) -> None:
    bare = replace(drive(), trajectory=None)
    with pytest.raises(Incompatible, match="the clip has none: choose an odometry"):
        source.estimate(context(bare))
