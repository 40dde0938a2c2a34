"""Trajectory files of other software as an odometry, on a rendered drive of 0.5 m per frame."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import street

from geovp_classic import registry
from geovp_classic.data.formats import pose_files
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.interfaces import Odometry
from geovp_classic.pose_sources.chained import Chained
from geovp_classic.types import Context, FloatArray, PrivilegedInput, Trajectory

NUM_PAST = 6
OTHER_FROM_WORLD = se3.exp(np.array([9.0, -2.0, 4.0, 0.3, 1.2, -0.4]))
CLIP = replace(street.clip(), name="street/000003")  # frames 3 to 12 of a sequence


def context_of(odometry: Odometry) -> Context:
    return CLIP.split(NUM_PAST, odometry.needs)[0]


def write(path: Path, keep: list[int], unit_m: float = 1.0, *, is_tum: bool = True) -> Path:
    """Write poses of the clip's frames in another world frame and unit."""
    truth = CLIP.trajectory
    poses = OTHER_FROM_WORLD @ truth.world_from_cam
    poses[:, :3, 3] /= unit_m
    if is_tum:
        pose_files.write_tum(path, Trajectory(poses[keep], truth.times_s[keep], is_metric=False))
    else:  # with the three frames before the clip
        poses = np.concatenate([np.tile(np.eye(4), (3, 1, 1)), poses])
        pose_files.write_kitti(path, Trajectory(poses, np.arange(13.0), is_metric=False))
    return path


def build(path: Path, **settings: str) -> Odometry:
    return registry.build("odometries", {"name": "recorded", "path": str(path), **settings})


def relative(poses: FloatArray) -> FloatArray:
    return se3.inverse(poses[0]) @ poses


@pytest.mark.parametrize("is_tum", [True, False])
def test_the_poses_of_the_clips_frames_are_read(tmp_path: Path, is_tum: bool) -> None:
    write(tmp_path / "street.txt", list(range(10)), is_tum=is_tum)
    odometry = build(tmp_path / "{sequence}.txt")
    assert odometry.needs == PrivilegedInput.NONE
    context = context_of(odometry)
    truth = relative(CLIP.trajectory.world_from_cam[:NUM_PAST])
    past, tracked = odometry.track(context)
    assert past.is_metric
    assert tracked.all()
    np.testing.assert_allclose(relative(past.world_from_cam), truth, atol=1e-6)
    without_first, _ = odometry.track(context.recent(5))  # of masked contexts, too
    np.testing.assert_allclose(without_first.world_from_cam, past.world_from_cam[1:], atol=1e-6)
    # A changed file is read again.
    write(tmp_path / "street.txt", list(range(10)), unit_m=2.0, is_tum=is_tum)
    past, _ = build(tmp_path / "{sequence}.txt").track(context)
    halved = relative(past.world_from_cam)[:, :3, 3]
    np.testing.assert_allclose(halved, truth[:, :3, 3] / 2, atol=1e-6)


def test_lost_frames_are_bridged_and_marked_without_later_poses(tmp_path: Path) -> None:
    """Frames 2 and 5, the last one, are lost. The drive is one screw motion."""
    path = write(tmp_path / "lost.txt", [0, 1, 3, 4, 6, 7, 8, 9])
    past, tracked = build(path).track(context_of(build(path)))
    assert tracked.tolist() == [True, True, False, True, True, False]
    truth = relative(CLIP.trajectory.world_from_cam[:NUM_PAST])
    np.testing.assert_allclose(relative(past.world_from_cam), truth, atol=1e-6)
    lines = path.read_text().splitlines()
    false = tmp_path / "false.txt"  # other poses after the observed frames
    stationary = [f"{line.split()[0]} 0 0 0 0 0 0 1" for line in lines[5:]]
    false.write_text("\n".join([*lines[:5], *stationary]))
    motion = Chained(build(path)).estimate(context_of(build(path)))
    other = Chained(build(false)).estimate(context_of(build(false)))
    np.testing.assert_array_equal(motion.futures, other.futures)
    np.testing.assert_array_equal(motion.past.world_from_cam, other.past.world_from_cam)


def test_the_ground_plane_gives_metres_to_a_file_of_any_unit(tmp_path: Path) -> None:
    path = write(tmp_path / "unit.txt", [0, 1, 2, 4, 5], unit_m=7.0)
    odometry = build(path, scale="ground-plane")
    assert odometry.needs == PrivilegedInput.CAMERA_HEIGHT
    past, _ = odometry.track(context_of(odometry))
    assert past.is_metric
    assert se3.step_lengths(past.world_from_cam) == pytest.approx(0.5, rel=0.05)
    assert past.scale_uncertainty < 0.1


@pytest.mark.parametrize("times_per_s", [1, 1e9])
def test_unix_times_in_seconds_or_nanoseconds_are_matched(
    tmp_path: Path, times_per_s: float
) -> None:
    """SLAM systems write the stamps of EuRoC and of bags, which their clips have, too."""
    context = context_of(build(write(tmp_path / "relative.txt", [0, 1, 2])))
    unix = replace(context, times_s=context.times_s + 1_700_000_000.25)
    lines = [
        f"{time_s * times_per_s:.6f} {step / 2} 0 0 0 0 0 1"
        for step, time_s in enumerate(unix.times_s)
    ]
    (tmp_path / "slam.txt").write_text("\n".join(lines))
    past, tracked = build(tmp_path / "slam.txt").track(unix)
    assert tracked.all()
    np.testing.assert_allclose(past.world_from_cam[:, 0, 3], np.arange(NUM_PAST) / 2, atol=1e-5)
    with pytest.raises(BadData, match="data set's clock, Unix time in seconds or nanoseconds"):
        build(tmp_path / "relative.txt").track(unix)
