"""What spoilt images do to an odometry: error and share of bridged poses against the strength of each fault.

`python -m benchmarks.faults kitti ROOT` (or `synthetic`) prints the table for the default odometry.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from benchmarks.commands import command, watched
from geovp_classic import registry
from geovp_classic.errors import BadData
from geovp_classic.geometry import alignment, se3
from geovp_classic.interfaces import Odometry
from geovp_classic.types import ByteArray, Clip, Context, FloatArray, Trajectory

SWING_DEG = 8.0  # how far a camera that turns on the spot looks to each side


@dataclass(frozen=True)
class Spoilt:
    """A clip's images after a fault, and what is then true."""

    frames: ByteArray  # [T, H, W, 3]
    world_from_cam: FloatArray  # [T, 4, 4]


Spoil = Callable[[Clip, float, np.random.Generator], Spoilt]


@dataclass(frozen=True)
class Fault:
    """A way to spoil a clip, and how strongly it is tried; strength 0 leaves the clip as it is."""

    name: str
    unit: str
    strengths: tuple[float, ...]
    spoil: Spoil


@dataclass(frozen=True)
class FaultRow:
    """What became of one clip."""

    fault: str
    strength: float
    clip: str
    bridged: float  # share of the poses
    rotation_deg: float  # mean error of a step
    path_percent: float  # rms position error after Sim(3) alignment, of the path's length; NaN when the truth stands


def measure(odometry: Odometry, clips: Iterable[Clip], faults: Sequence[Fault], seed: int = 0) -> list[FaultRow]:
    """One row per clip, fault and strength; an odometry that raises or says nonsense raises here as well."""
    rows = []
    for clip in clips:
        for fault in faults:
            for strength in fault.strengths:
                rng = np.random.default_rng(seed)
                spoilt = fault.spoil(clip, strength, rng)
                trajectory, tracked = odometry.track(_context(clip, spoilt).only(odometry.needs))
                rotation_deg, path_percent = _errors(trajectory, spoilt.world_from_cam)
                bridged = float(1 - tracked.mean())
                rows.append(FaultRow(fault.name, strength, clip.name, bridged, rotation_deg, path_percent))
    return rows


def table(rows: Sequence[FaultRow], faults: Sequence[Fault]) -> str:
    """Medians over clips as lines of text, one per fault and strength."""
    lines = [f"{'fault':<12}{'strength':>12}{'bridged %':>11}{'rotation deg/step':>19}{'path error %':>14}"]
    for fault in faults:
        for strength in fault.strengths:
            own = [row for row in rows if (row.fault, row.strength) == (fault.name, strength)]
            numbers = np.array([[row.bridged, row.rotation_deg, row.path_percent] for row in own])
            bridged, rotation_deg = np.median(numbers[:, :2], axis=0)
            moving = numbers[np.isfinite(numbers[:, 2]), 2]  # where the truth stands there is no path
            path_percent = np.median(moving) if len(moving) else np.nan
            shown = f"{strength:g} {fault.unit}"
            lines.append(f"{fault.name:<12}{shown:>12}{100 * bridged:>11.0f}{rotation_deg:>19.3f}{path_percent:>14.2f}")
    return "\n".join(lines)


def blur(clip: Clip, strength: float, rng: np.random.Generator) -> Spoilt:
    """Three images in the middle smeared sideways by `strength` pixels."""
    length = max(1, round(strength))
    return _changed(clip, _middle(clip, 3), lambda frame: _blurred(frame, length))


def exposure(clip: Clip, strength: float, rng: np.random.Generator) -> Spoilt:
    """From the middle on, images 2 ** strength times as bright."""
    later = range(len(clip) // 2, len(clip))
    return _changed(clip, later, lambda frame: np.asarray(cv2.convertScaleAbs(frame, alpha=2.0**strength), np.uint8))


def black(clip: Clip, strength: float, rng: np.random.Generator) -> Spoilt:
    """`strength` images in the middle are black."""
    return _changed(clip, _middle(clip, round(strength)), np.zeros_like)


def flat(clip: Clip, strength: float, rng: np.random.Generator) -> Spoilt:
    """All images lose this share of their contrast, in fog."""

    def spoil(frame: ByteArray) -> ByteArray:
        return np.asarray(cv2.addWeighted(frame, 1 - strength, frame, 0, 128 * strength), np.uint8)

    return _changed(clip, range(len(clip)), spoil)


def noise(clip: Clip, strength: float, rng: np.random.Generator) -> Spoilt:
    """Gaussian noise with this standard deviation, in grey values."""

    def spoil(frame: ByteArray) -> ByteArray:
        noisy = frame + rng.normal(0, strength, frame.shape[:2])[..., None]
        return np.clip(noisy, 0, 255).astype(np.uint8)

    return _changed(clip, range(len(clip)), spoil)


def dropped(clip: Clip, strength: float, rng: np.random.Generator) -> Spoilt:
    """`strength` images in the middle are missing; the first ones are seen again at the end of the queue, unmoved."""
    gone = _middle(clip, round(strength))
    kept = [i for i in range(len(clip)) if i not in gone]
    return _picked(clip, [kept[0]] * len(gone) + kept)


def repeated(clip: Clip, strength: float, rng: np.random.Generator) -> Spoilt:
    """The middle image comes `strength` more times."""
    middle = len(clip) // 2
    picks = [*range(middle + 1), *[middle] * round(strength), *range(middle + 1, len(clip))]
    return _picked(clip, picks[: len(clip)])


def occluded(clip: Clip, strength: float, rng: np.random.Generator) -> Spoilt:
    """Another car, always at the same place, fills this share of the image from the middle of the clip on."""
    height_px, width_px = clip.frames.shape[1:3]
    tall, broad = round(height_px * np.sqrt(strength)), round(width_px * np.sqrt(strength))
    paint = cv2.GaussianBlur(rng.uniform(0, 255, (height_px, width_px)), (0, 0), 2.0)
    lightness = (paint - paint.min()) / max(float(np.ptp(paint)), 1.0)
    car = (20 + 180 * lightness).astype(np.uint8)[:tall, :broad, None]
    top, left = height_px - tall, (width_px - broad) // 2

    def spoil(frame: ByteArray) -> ByteArray:
        frame = frame.copy()
        frame[top : top + tall, left : left + broad] = car
        return frame

    return _changed(clip, range(len(clip) // 2, len(clip)), spoil)


def standing(clip: Clip, strength: float, rng: np.random.Generator) -> Spoilt:
    """The first image all the time, with noise of this standard deviation."""
    return noise(_with(clip, _picked(clip, [0] * len(clip))), strength, rng)


def turning(clip: Clip, strength: float, rng: np.random.Generator) -> Spoilt:
    """The camera looks to and fro on the spot, by up to `strength` degrees an image: the first one, warped."""
    matrix, frames, poses = clip.intrinsics.matrix, [], []
    size_px = (clip.intrinsics.width_px, clip.intrinsics.height_px)
    for i in range(len(clip)):
        yaw_deg = SWING_DEG * np.sin(strength * i / SWING_DEG)
        first_from_cam = se3.exp(np.array([0, 0, 0, 0, np.radians(yaw_deg), 0]))
        first_from_now = matrix @ first_from_cam[:3, :3] @ np.linalg.inv(matrix)
        flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
        frames.append(cv2.warpPerspective(clip.frames[0], first_from_now, size_px, flags=flags))
        poses.append(first_from_cam)
    return Spoilt(np.stack(frames), np.stack(poses))


FAULTS = (
    Fault("blur", "px", (0, 4, 8, 16, 32), blur),
    Fault("exposure", "stops", (0, 0.5, 1, 2, -1, -2), exposure),
    Fault("black", "frames", (0, 1, 2, 4), black),
    Fault("flat", "", (0, 0.5, 0.8, 0.95, 1), flat),
    Fault("noise", "grey", (0, 5, 10, 20, 40), noise),
    Fault("dropped", "frames", (0, 1, 2, 3), dropped),
    Fault("repeated", "frames", (0, 1, 2, 3), repeated),
    Fault("occluded", "share", (0, 0.25, 0.5, 0.75, 1), occluded),
    Fault("standing", "grey", (0, 2, 5, 10), standing),
    Fault("turning", "deg", (0.2, 0.5, 1, 2, 4), turning),
)


def _middle(clip: Clip, count: int) -> range:
    first = max(1, (len(clip) - count + 1) // 2)
    return range(first, min(len(clip), first + count))


def _changed(clip: Clip, which: Iterable[int], spoil: Callable[[ByteArray], ByteArray]) -> Spoilt:
    frames = clip.frames.copy()
    for i in which:
        frames[i] = spoil(frames[i])
    return Spoilt(frames, _truth(clip))


def _picked(clip: Clip, picks: Sequence[int]) -> Spoilt:
    return Spoilt(clip.frames[list(picks)], _truth(clip)[list(picks)])


def _with(clip: Clip, spoilt: Spoilt) -> Clip:
    trajectory = Trajectory(spoilt.world_from_cam, clip.times_s, is_metric=True)
    return replace(clip, frames=spoilt.frames, trajectory=trajectory, depths=None, moving=None)


def _blurred(frame: ByteArray, length: int) -> ByteArray:
    return np.asarray(cv2.blur(frame, (length, 1)), np.uint8)


def _truth(clip: Clip) -> FloatArray:
    assert clip.trajectory is not None
    return clip.trajectory.world_from_cam


def _context(clip: Clip, spoilt: Spoilt) -> Context:
    """The clip as nothing but past, with one time to come."""
    times_s = np.append(clip.times_s, clip.times_s[-1] + 0.1)
    return Context(spoilt.frames, times_s, clip.intrinsics, camera_height_m=clip.camera_height_m)


def _errors(trajectory: Trajectory, truth: FloatArray) -> tuple[float, float]:
    found = trajectory.world_from_cam
    steps, true_steps = se3.inverse(found[:-1]) @ found[1:], se3.inverse(truth[:-1]) @ truth[1:]
    rotation_deg = float(np.degrees(se3.rotation_angle_rad(se3.inverse(true_steps) @ steps)).mean())
    length = float(np.linalg.norm(true_steps[:, :3, 3], axis=1).sum())
    here, there = found[:, :3, 3], truth[:, :3, 3]
    if length < 0.1:
        return rotation_deg, float("nan")
    if np.ptp(here, axis=0).max() < 1e-9:
        return rotation_deg, 100.0
    scale, aligned = alignment.umeyama(here, there, with_scale=True)
    miss = scale * here @ aligned[:3, :3].T + aligned[:3, 3] - there
    return rotation_deg, float(100 * np.sqrt((miss**2).sum(axis=1).mean()) / length)


@command
def main(arguments: Sequence[str]) -> str:
    """The table of the default odometry on ten clips of a data set."""
    name, *root = arguments or [""]
    if (name, len(root)) not in (("synthetic", 0), ("kitti", 1)):
        raise BadData(f"faults: given {' '.join(arguments)!r}, expected `synthetic` or `kitti ROOT`")
    spec = {"name": name, "num_frames": 12, **({"root": root[0], "sequences": ["03[0:180)"]} if root else {})}
    dataset = registry.build("datasets", spec)
    odometry = registry.build("odometries", "monocular")
    count = min(10, len(dataset))
    clips = (dataset[i * len(dataset) // count] for i in range(count))
    rows = measure(odometry, watched(clips, count, "faults"), FAULTS)
    return table(rows, FAULTS)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
