"""Hard images: the odometry bridges and says so, and never raises or answers with anything but
rigid poses.
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import pytest

from geovp_classic.geometry import se3
from geovp_classic.metrics import drift
from geovp_classic.odometry.monocular import Monocular
from geovp_classic.types import ByteArray, Context, FloatArray, Intrinsics, Trajectory
from tests.geovp_classic.odometry.corridor import CAMERA, STRAIGHT

SWING_DEG = 8.0  # how far a camera that turns on the spot looks to each side
Corrupted = tuple[
    ByteArray, FloatArray
]  # frames [T, H, W, 3] and the poses [T, 4, 4] that are then true


@dataclass(frozen=True)
class Errors:
    """How an odometry did on one corrupted clip."""

    bridged: float  # share of the poses
    rotation_deg: float  # mean error of a step
    # rms position error after Sim(3) alignment, of the path's length; NaN for a camera that stands
    path_percent: float


FRAMES, POSES = STRAIGHT
COUNT = len(FRAMES)


def middle(count: int) -> range:
    first = max(1, (COUNT - count + 1) // 2)
    return range(first, min(COUNT, first + count))


def changed(which: range, corrupt: Callable[[ByteArray], FloatArray | ByteArray]) -> Corrupted:
    frames = FRAMES.copy()
    for i in which:
        frames[i] = corrupt(frames[i])
    return frames, POSES


def picked(picks: list[int]) -> Corrupted:
    return FRAMES[picks], POSES[picks]


def blur(length_px: int) -> Corrupted:
    return changed(middle(3), lambda frame: cv2.blur(frame, (length_px, 1)))


def exposure(stops: float) -> Corrupted:
    later = range(COUNT // 2, COUNT)
    return changed(later, lambda frame: cv2.convertScaleAbs(frame, alpha=2.0**stops))


def black(count: int) -> Corrupted:
    return changed(middle(count), np.zeros_like)


def noisy(frames: ByteArray, deviation: float) -> ByteArray:
    noise = np.random.default_rng(0).normal(0, deviation, (*frames.shape[:3], 1))
    return np.clip(frames + noise, 0, 255).astype(np.uint8)


def noise(deviation: float) -> Corrupted:
    return noisy(FRAMES, deviation), POSES


def dropped(count: int) -> Corrupted:
    """Images in the middle are missing; the first one stands at the beginning for as long."""
    gone = middle(count)
    kept = [i for i in range(COUNT) if i not in gone]
    return picked([kept[0]] * len(gone) + kept)


def repeated(count: int) -> Corrupted:
    centre = COUNT // 2
    picks = [*range(centre + 1), *[centre] * count, *range(centre + 1, COUNT)]
    return picked(picks[:COUNT])


def standing(deviation: float) -> Corrupted:
    """The first image all the time, with noise."""
    frames, poses = picked([0] * COUNT)
    return noisy(frames, deviation), poses


def turning(deg_per_frame: float) -> Corrupted:
    """The camera looks to and fro on the spot: the first image, warped."""
    matrix, size_px = CAMERA.matrix, (CAMERA.width_px, CAMERA.height_px)
    angles_rad = np.radians(SWING_DEG * np.sin(deg_per_frame * np.arange(COUNT) / SWING_DEG))
    first_from_cam = se3.exp(angles_rad[:, None] * np.array([0, 0, 0, 0, 1.0, 0]))
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    warps = matrix @ first_from_cam[:, :3, :3] @ np.linalg.inv(matrix)
    frames = [cv2.warpPerspective(FRAMES[0], warp, size_px, flags=flags) for warp in warps]
    return np.stack(frames), first_from_cam


def errors(corrupted: Corrupted) -> Errors:
    """Trajectory's own checks raise on anything not rigid."""
    frames, poses = corrupted
    times_s = 0.1 * np.arange(COUNT + 1)
    trajectory, tracked = Monocular().track(Context(frames, times_s, CAMERA, camera_height_m=1.65))
    truth = Trajectory(poses, times_s[:-1], True)
    _, rotation_deg = drift.relative_error(trajectory, truth)
    bridged = float(1 - tracked.mean())
    length = se3.step_lengths(poses).sum()
    if length < 0.1:
        return Errors(bridged, rotation_deg.mean(), np.nan)
    misses = drift.absolute_error_m(drift.aligned(trajectory, truth, "sim3"), truth)
    path_percent = 100 * drift.root_mean_square(misses) / length
    return Errors(bridged, rotation_deg.mean(), path_percent)


HARDEST = [(blur, 32), (exposure, -2), (black, 4), (noise, 40)]
HARDEST += [(dropped, 3), (repeated, 3), (standing, 10), (turning, 4)]


@pytest.mark.parametrize(("corrupt", "severity"), HARDEST)
def test_nothing_raises_and_all_poses_are_finite(
    corrupt: Callable[[int], Corrupted], severity: int
) -> None:
    found = errors(corrupt(severity))
    assert 0 <= found.bridged <= 1
    assert np.isfinite(found.rotation_deg)


@pytest.mark.parametrize(
    ("corrupted", "bridged", "max_path_percent"),
    [
        (black(1), 0.1, 2),
        (black(2), 0.2, 2),
        (dropped(1), 0, 1),  # is no reason to guess
        (repeated(1), 0.1, 3),  # the film lets the camera stand, the bridge does not
        (exposure(-1), 0, 1),
    ],
)
def test_bad_images_are_bridged_by_the_last_motion_and_others_are_tracked(
    corrupted: Corrupted, bridged: float, max_path_percent: float
) -> None:
    found = errors(corrupted)
    assert found.bridged == pytest.approx(bridged)
    assert found.path_percent < max_path_percent


def test_standing_and_turning_are_not_turned_into_noise() -> None:
    assert errors(standing(5)).rotation_deg < 0.01
    assert errors(turning(1)).rotation_deg < 0.05


def test_random_images_of_any_size_are_survived() -> None:
    rng = np.random.default_rng(0)
    for height_px, width_px in ((8, 8), (17, 40), (64, 64)):
        camera = Intrinsics(50.0, 50.0, width_px / 2, height_px / 2, width_px, height_px)
        frames = rng.integers(0, 256, (5, height_px, width_px, 3), dtype=np.uint8)
        given = Context(frames, np.arange(6.0), camera, camera_height_m=1.65)
        trajectory, tracked = Monocular().track(given)
        assert (len(trajectory), len(tracked)) == (5, 5)
