"""What contradicts a path: a street that stands still, poses that were not measured, or where no
vehicle drove.
"""

from itertools import combinations

import cv2
import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.geometry.optical_flow import track_points
from geovp_classic.types import BoolArray, ByteArray, FloatArray

CORNERS, WINDOW_PX = (20, 150), 11  # the least and the most that are looked at
ROWS = (
    0.1,
    0.5,
)  # of the image's height: below captions, above the camera's own vehicle and most others
STILL_PX, SLOW_PX = 0.25, 5.0
STILL_SHARE = 0.2  # of the corners. In 104 clips of a driving car no corner stays where it is
STILL_EXTENT = (
    0.5,
    0.08,
)  # of the image's width and height: a vehicle that is followed is narrower
BLOCK_PX, NOISY_VARIANCE, WHITE = (
    8,
    9.0,
    1.5,
)  # see changes_by_noise_alone; of grey values; 1 for white noise
SIDEWAYS = 0.5  # of the way along the axis
TOLERANCE = 0.3  # of a median step
LEAST_SHARE = 0.6  # of the frames that must agree, or nothing is said
NUM_TRIALS = 300
SEED = 0


def is_standing(
    greys: list[ByteArray],  # [H, W] each
) -> bool:
    """Whether the street stands still behind what moves, however much of the image that covers, or
    behind noise.

    Corners of the last image that are in the same place in three earlier ones, from left to right,
    and hardly any that moved a little, as those of a creeping camera do.
    """
    if changes_by_noise_alone(greys):
        return True
    (height, width), (least, most) = greys[-1].shape, CORNERS
    inner = np.zeros((height, width), np.uint8)
    inner[round(ROWS[0] * height) : round(ROWS[1] * height)] = 255
    corners = cv2.goodFeaturesToTrack(greys[-1], most, 0.01, height / 32, mask=inner)
    if len(greys) < 4 or corners is None or len(corners) < least:
        return False
    pixels = np.asarray(corners.reshape(-1, 2), np.float32)
    farthest_px = np.zeros(len(pixels))
    for step in (0, len(greys) // 3, 2 * len(greys) // 3):
        there, found, _ = track_points((greys[-1], greys[step]), pixels, pixels, WINDOW_PX, (1, 1))
        farthest_px = np.maximum(
            farthest_px, np.where(found, np.linalg.norm(there - pixels, axis=1), np.inf)
        )
        still, slow = farthest_px < STILL_PX, (farthest_px >= STILL_PX) & (farthest_px < SLOW_PX)
        if still.mean() < STILL_SHARE:
            return False
    if slow.sum() > still.sum() / 2:
        return False
    low, high = np.percentile(pixels[still], (10, 90), axis=0)
    return bool(((high - low) > np.array(STILL_EXTENT) * (width, height)).all())


def changes_by_noise_alone(
    greys: list[ByteArray],  # [H, W] each
) -> bool:
    """Whether much changes from the first to the second half of the images, all of it white noise.

    A mean over a block of n x n pixels has a share of 1 / n^2 of the variance of white noise, but
    most of that of textures, which are correlated from pixel to pixel, once they have moved.
    """
    half, (height, width) = len(greys) // 2, greys[-1].shape
    if half == 0 or min(height, width) < BLOCK_PX:
        return False
    first, second = (
        np.mean(images, axis=0, dtype=np.float32) for images in (greys[:half], greys[-half:])
    )
    change = np.subtract(second, first)
    blocks = cv2.resize(
        change, (width // BLOCK_PX, height // BLOCK_PX), interpolation=cv2.INTER_AREA
    )
    variance = float(change.var())
    return variance > NOISY_VARIANCE and float(blocks.var()) * BLOCK_PX**2 < WHITE * variance


def is_sideways(
    world_from_cam: FloatArray,  # [P, 4, 4]
) -> bool:
    """Whether the camera went more than half as far to its side as along its axis: rarely what a
    vehicle's does.
    """
    steps = np.abs((se3.inverse(world_from_cam[:-1]) @ world_from_cam[1:])[:, :3, 3]).sum(axis=0)
    return bool(steps[0] > SIDEWAYS * steps[2])


def measured(
    tracked: BoolArray,  # [P]
    most_bridged: int,  # images in a row that were not tracked, before tracking starts anew
) -> BoolArray:
    """Which poses [P] were measured relative to one another: the tracked ones since the start that
    had most of them.

    What was tracked from different starts is related by nothing but continued motion. The image of
    a start, which is the last one of a gap, counts as well.
    """
    steps = np.flatnonzero(tracked)
    starts = np.flatnonzero(np.diff(steps) > most_bridged + 1) + 1  # in the list of steps
    longest = max(np.split(steps, starts)[::-1], key=len)  # of equally long ones the last
    found: BoolArray = np.zeros(len(tracked), dtype=bool)
    found[longest] = True
    if len(starts) and longest[0] > steps[0]:
        found[longest[0] - 1] = True
    return found


def driven(
    world_from_cam: FloatArray,  # [P, 4, 4], in any unit
    times_s: FloatArray,  # [P]
) -> BoolArray:
    """Which poses [P] lie where a constant acceleration that most of them agree with puts them
    along the path.

    A least median of squares (Rousseeuw 1984) over parabolas through three poses. All, where no
    step goes backwards among others that go forwards, or no parabola fits most of them.
    """
    count = len(times_s)
    everyone = np.ones(count, dtype=bool)
    ahead = (se3.inverse(world_from_cam[:-1]) @ world_from_cam[1:])[:, 2, 3]
    progress, step = (
        np.concatenate([[0.0], np.cumsum(ahead)]),
        float(np.median(np.abs(ahead))) if count > 1 else 0.0,
    )
    if count < 5 or not (ahead < -TOLERANCE * step).any():
        return everyone
    triples = np.array(list(combinations(range(count), 3)))
    if len(triples) > NUM_TRIALS:
        triples = np.random.default_rng(SEED).choice(triples, NUM_TRIALS, replace=False)
    seconds = times_s - times_s[0]
    powers = np.stack([np.ones(count), seconds, seconds**2], axis=-1)
    parabolas = np.linalg.solve(powers[triples], progress[triples][..., None])
    errors = np.abs(progress - (powers @ parabolas)[..., 0])  # [trials, P]
    best = errors[np.median(errors, axis=1).argmin()]
    agree = best <= TOLERANCE * step
    return agree if agree.mean() >= LEAST_SHARE else everyone
