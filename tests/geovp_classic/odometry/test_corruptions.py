"""Hard images: the odometry bridges and says so, and never raises or answers with anything but
rigid poses.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
import pytest

from geovp_classic.geometry import alignment, se3
from geovp_classic.odometry.monocular import Monocular
from geovp_classic.types import ByteArray, Clip, Context, FloatArray, Intrinsics, Trajectory

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


@pytest.fixture(scope="module")
def clip(straight: tuple[ByteArray, FloatArray], camera: Intrinsics) -> Clip:
    frames, poses = straight
    times_s = 0.1 * np.arange(len(frames))
    return Clip(
        "corridor", frames, times_s, camera, Trajectory(poses, times_s, True), camera_height_m=1.65
    )


def middle(clip: Clip, count: int) -> range:
    first = max(1, (len(clip) - count + 1) // 2)
    return range(first, min(len(clip), first + count))


def truth(clip: Clip) -> FloatArray:
    assert clip.trajectory is not None
    return clip.trajectory.world_from_cam


def changed(
    clip: Clip, which: range, corrupt: Callable[[ByteArray], FloatArray | ByteArray]
) -> Corrupted:
    frames = clip.frames.copy()
    for i in which:
        frames[i] = corrupt(frames[i])
    return frames, truth(clip)


def picked(clip: Clip, picks: list[int]) -> Corrupted:
    return clip.frames[picks], truth(clip)[picks]


def blur(clip: Clip, length_px: float) -> Corrupted:
    return changed(clip, middle(clip, 3), lambda frame: cv2.blur(frame, (round(length_px), 1)))


def exposure(clip: Clip, stops: float) -> Corrupted:
    later = range(len(clip) // 2, len(clip))
    return changed(clip, later, lambda frame: cv2.convertScaleAbs(frame, alpha=2.0**stops))


def black(clip: Clip, count: float) -> Corrupted:
    return changed(clip, middle(clip, round(count)), np.zeros_like)


def flat(clip: Clip, share: float) -> Corrupted:
    """All images lose this share of their contrast, in fog."""
    fog = 128 * share
    return changed(
        clip, range(len(clip)), lambda frame: cv2.addWeighted(frame, 1 - share, frame, 0, fog)
    )


def noise(clip: Clip, deviation: float) -> Corrupted:
    rng = np.random.default_rng(0)

    def noisy(frame: ByteArray) -> FloatArray:
        return np.clip(frame + rng.normal(0, deviation, frame.shape[:2])[..., None], 0, 255)

    return changed(clip, range(len(clip)), noisy)


def dropped(clip: Clip, count: float) -> Corrupted:
    """Images in the middle are missing; the first one stands at the beginning for as long."""
    gone = middle(clip, round(count))
    kept = [i for i in range(len(clip)) if i not in gone]
    return picked(clip, [kept[0]] * len(gone) + kept)


def repeated(clip: Clip, count: float) -> Corrupted:
    centre = len(clip) // 2
    picks = [*range(centre + 1), *[centre] * round(count), *range(centre + 1, len(clip))]
    return picked(clip, picks[: len(clip)])


def occluded(clip: Clip, share: float) -> Corrupted:
    """From the middle on, a lorry at the same place fills this share of each image."""
    width_px = round(share * clip.intrinsics.width_px)
    lorry = clip.frames[0, ::-1, :width_px]

    def occlude(frame: ByteArray) -> ByteArray:
        frame[:, :width_px] = lorry
        return frame

    return changed(clip, range(len(clip) // 2, len(clip)), occlude)


def standing(clip: Clip, deviation: float) -> Corrupted:
    """The first image all the time, with noise."""
    frames, poses = picked(clip, [0] * len(clip))
    return noise(replace(clip, frames=frames), deviation)[0], poses


def turning(clip: Clip, deg_per_frame: float) -> Corrupted:
    """The camera looks to and fro on the spot: the first image, warped."""
    matrix, size_px = clip.intrinsics.matrix, (clip.intrinsics.width_px, clip.intrinsics.height_px)
    angles_rad = np.radians(SWING_DEG * np.sin(deg_per_frame * np.arange(len(clip)) / SWING_DEG))
    first_from_cam = se3.exp(angles_rad[:, None] * np.array([0, 0, 0, 0, 1.0, 0]))
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    warps = matrix @ first_from_cam[:, :3, :3] @ np.linalg.inv(matrix)
    frames = [cv2.warpPerspective(clip.frames[0], warp, size_px, flags=flags) for warp in warps]
    return np.stack(frames), first_from_cam


def errors(clip: Clip, corrupt: Callable[[Clip, float], Corrupted], severity: float) -> Errors:
    """Trajectory's own checks raise on anything not rigid."""
    frames, poses = corrupt(clip, severity)
    times_s = np.append(clip.times_s, clip.times_s[-1] + 0.1)
    trajectory, tracked = Monocular().track(
        Context(frames, times_s, clip.intrinsics, camera_height_m=1.65)
    )
    found = trajectory.world_from_cam
    steps, true_steps = (se3.inverse(path[:-1]) @ path[1:] for path in (found, poses))
    rotation_deg = float(np.degrees(se3.rotation_angle_rad(se3.inverse(true_steps) @ steps)).mean())
    bridged = float(1 - tracked.mean())
    here, there = found[:, :3, 3], poses[:, :3, 3]
    length = np.linalg.norm(true_steps[:, :3, 3], axis=1).sum()
    if length < 0.1:
        return Errors(bridged, rotation_deg, np.nan)
    if np.ptp(here, axis=0).max() < 1e-9:
        return Errors(bridged, rotation_deg, 100.0)
    scale, aligned = alignment.umeyama(here, there, with_scale=True)
    miss = scale * here @ aligned[:3, :3].T + aligned[:3, 3] - there
    return Errors(
        bridged, rotation_deg, float(100 * np.sqrt((miss**2).sum(axis=1).mean()) / length)
    )


HARDEST = [(blur, 32), (exposure, -2), (black, 4), (noise, 40)]
HARDEST += [(dropped, 3), (repeated, 3), (occluded, 1), (standing, 10), (turning, 4)]


@pytest.mark.parametrize(("corrupt", "severity"), HARDEST)
def test_nothing_raises_and_all_poses_are_finite(
    clip: Clip, corrupt: Callable[[Clip, float], Corrupted], severity: float
) -> None:
    found = errors(clip, corrupt, severity)
    assert 0 <= found.bridged <= 1
    assert np.isfinite(found.rotation_deg)


@pytest.mark.parametrize("count", [1, 2])
def test_black_images_are_bridged_by_the_last_motion(clip: Clip, count: int) -> None:
    found = errors(clip, black, count)
    assert found.bridged == pytest.approx(count / 10)
    assert found.path_percent < 2


def test_a_dropped_image_is_no_reason_to_guess(clip: Clip) -> None:
    found = errors(clip, dropped, 1)
    assert found.bridged == 0
    assert found.path_percent < 1


def test_a_repeated_image_is_bridged(clip: Clip) -> None:
    found = errors(
        clip, repeated, 1
    )  # the film lets the camera stand for a tenth of a second, the bridge doesn't
    assert found.bridged == pytest.approx(0.1)
    assert found.path_percent < 3


def test_exposure_jumps_cost_nothing(clip: Clip) -> None:
    found = errors(clip, exposure, -1)
    assert found.path_percent < 1
    assert found.bridged == 0


def test_no_texture_at_all_is_all_bridged_and_stands(clip: Clip) -> None:
    found = errors(clip, flat, 1)
    assert (found.bridged, found.path_percent) == (1, 100)


def test_standing_and_turning_are_not_turned_into_noise(clip: Clip) -> None:
    assert errors(clip, standing, 5).rotation_deg < 0.01
    assert errors(clip, turning, 1).rotation_deg < 0.05


def test_random_images_of_any_size_are_survived() -> None:
    rng = np.random.default_rng(0)
    for height_px, width_px in ((8, 8), (17, 40), (64, 64)):
        camera = Intrinsics(50.0, 50.0, width_px / 2, height_px / 2, width_px, height_px)
        frames = rng.integers(0, 256, (5, height_px, width_px, 3), dtype=np.uint8)
        given = Context(frames, np.arange(6.0), camera, camera_height_m=1.65)
        trajectory, tracked = Monocular().track(given)
        assert (len(trajectory), len(tracked)) == (5, 5)
