from dataclasses import replace

import numpy as np
import pytest

from geovp_classic import registry
from geovp_classic.errors import BadData, Incompatible
from geovp_classic.forecasting import constant
from geovp_classic.forecasting.motion_prior import MotionPrior
from geovp_classic.geometry import se3
from geovp_classic.interfaces import Odometry, PoseSource
from geovp_classic.odometry.monocular import Monocular
from geovp_classic.odometry.recorded import Recorded as RecordedPast
from geovp_classic.pose_sources.chained import Chained
from geovp_classic.pose_sources.constant_turn import ConstantTurn
from geovp_classic.pose_sources.constant_velocity import ConstantVelocity
from geovp_classic.pose_sources.ground_truth import GroundTruth
from geovp_classic.pose_sources.planar import Planar
from geovp_classic.pose_sources.stand_still import StandStill
from geovp_classic.types import (
    BoolArray,
    Clip,
    Context,
    FloatArray,
    Intrinsics,
    PrivilegedInput,
    Trajectory,
)

SOURCES = [GroundTruth(), Planar(GroundTruth()), StandStill(), ConstantVelocity(), ConstantTurn()]
EVERYTHING = ~PrivilegedInput.NONE
WORLD = se3.exp(
    np.array([4.0, -1.0, 2.0, 0.3, 0.2, -0.1])
)  # nobody may assume that the first pose is the identity


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


def context(drive: Clip, grant: PrivilegedInput = EVERYTHING) -> Context:
    return drive.split(5, grant)[0]


def test_ground_truth_is_the_recording() -> None:
    whole = drive()
    motion = GroundTruth().estimate(context(whole), num_samples=4)
    np.testing.assert_array_equal(motion.past.world_from_cam, whole.trajectory.world_from_cam[:5])
    np.testing.assert_array_equal(motion.futures, whole.trajectory.world_from_cam[None, 5:])
    assert motion.tracked.all()


def test_constant_turn_foresees_a_constant_turn_and_the_others_do_not() -> None:
    whole = drive()
    errors_m = {}
    for source in (ConstantTurn(), ConstantVelocity(), StandStill()):
        ahead = source.estimate(context(whole)).futures[0]
        errors_m[type(source)] = np.linalg.norm(
            (ahead - whole.trajectory.world_from_cam[5:])[-1, :3, 3]
        )
    assert errors_m[ConstantTurn] < 1e-9
    assert (
        0.05 < errors_m[ConstantVelocity] < 0.5
    )  # 4 steps of 1 m, drifting from 0.01 to 0.09 rad off the chord
    assert errors_m[StandStill] == pytest.approx(4.0, abs=0.02)


def test_planar_keeps_a_planar_drive() -> None:
    whole = drive(turn_rad=0.1)
    motion = Planar(GroundTruth()).estimate(context(whole))
    np.testing.assert_allclose(motion.futures[0], whole.trajectory.world_from_cam[5:], atol=1e-9)


def test_planar_takes_out_height_pitch_and_roll() -> None:
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


def test_planar_with_the_mounting_pitch_keeps_a_drive_of_a_pitched_camera() -> None:
    """A camera that looks 10 degrees down at the road it drives along."""
    car_from_cam = se3.exp(np.array([0.0, 0.0, 0.0, np.deg2rad(-10.0), 0.0, 0.0]))
    car = se3.exp(np.outer(np.arange(9), [0.0, 0.0, 1.0, 0.0, 0.1, 0.0]))
    whole = clip(car @ car_from_cam)
    recorded = whole.trajectory.world_from_cam[5:]
    known = Planar(GroundTruth(), pitch_deg=-10.0).estimate(context(whole)).futures[0]
    np.testing.assert_allclose(known, recorded, atol=1e-9)
    own_plane = Planar(GroundTruth()).estimate(context(whole)).futures[0]
    assert np.linalg.norm(own_plane[-1, :3, 3] - recorded[-1, :3, 3]) == pytest.approx(
        4 * np.sin(np.deg2rad(10)), abs=0.1
    )


@pytest.mark.parametrize("source", SOURCES, ids=lambda source: type(source).__name__)
class TestEverySource:
    def test_says_what_a_clip_without_poses_lacks(self, source: PoseSource) -> None:
        bare = replace(drive(), trajectory=None)
        with pytest.raises(Incompatible, match="the clip has none: choose an odometry"):
            source.estimate(context(bare))


class _Blind:
    """An odometry that notes what it was shown."""

    needs = PrivilegedInput.CAMERA_HEIGHT

    def __init__(self) -> None:
        self.seen: list[Context] = []

    def track(self, context: Context) -> tuple[Trajectory, BoolArray]:
        self.seen.append(context)
        poses = np.tile(np.eye(4), (context.num_past, 1, 1))
        return Trajectory(poses, context.times_s[: context.num_past], is_metric=False), np.zeros(
            context.num_past, bool
        )


class _Guess:
    """A forecaster whose samples differ."""

    def forecast(self, past: Trajectory, times_s: FloatArray, num_samples: int = 1) -> FloatArray:
        sideways = np.zeros((num_samples, len(times_s), 6))
        sideways[..., 0] = np.arange(num_samples)[:, None]
        return past.world_from_cam[-1] @ se3.exp(sideways)


def test_chained_shows_its_odometry_only_what_that_asked_for() -> None:
    odometry = _Blind()
    source = Chained(odometry, constant.ConstantTurn())
    assert source.needs == PrivilegedInput.CAMERA_HEIGHT
    motion = source.estimate(replace(context(drive()), camera_height_m=1.5))
    assert odometry.seen[0].past is None
    assert odometry.seen[0].future is None
    assert odometry.seen[0].camera_height_m == 1.5
    assert not motion.past.is_metric
    assert not motion.tracked.any()


def test_chained_keeps_samples_that_differ_and_only_one_of_equal_ones() -> None:
    assert (
        Chained(RecordedPast(), _Guess()).estimate(context(drive()), num_samples=5).futures.shape[0]
        == 5
    )
    assert (
        Chained(RecordedPast(), constant.Hold())
        .estimate(context(drive()), num_samples=5)
        .futures.shape[0]
        == 1
    )


def test_chained_is_built_from_nested_tables() -> None:
    table = {
        "name": "chained",
        "odometry": {"name": "ground-truth"},
        "forecaster": {"name": "constant-turn"},
    }
    source = registry.build("pose_sources", table)
    assert source == Chained(RecordedPast(), constant.ConstantTurn())
    assert isinstance(source.odometry, Odometry)
    np.testing.assert_array_equal(
        source.estimate(context(drive())).futures, ConstantTurn().estimate(context(drive())).futures
    )


def test_chained_alone_tracks_and_forecasts_without_recorded_poses() -> None:
    source = registry.build("pose_sources", "chained")
    assert source == Chained(Monocular(), MotionPrior())
    assert source.needs == PrivilegedInput.CAMERA_HEIGHT
    assert registry.build("pose_sources", registry.describe(source)) == source


def test_a_bad_setting_is_refused_at_once() -> None:
    with pytest.raises(BadData, match="num_steps is 0"):
        ConstantTurn(num_steps=0)
    with pytest.raises(BadData, match="num_steps is -1"):
        ConstantVelocity(num_steps=-1)
