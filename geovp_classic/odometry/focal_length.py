"""The focal length of an unknown camera from its motion, with the principal point at the image's
centre.

A map that is tracked with a wrong focal length and then bundle-adjusted together with it moves it
towards the right one, but only part of the way: the points that were kept are those that agree with
the wrong one. The step is zero at the right focal length, so its zero is searched. Square pixels
and no distortion are assumed. Motion without any rotation says nothing: a longer focal length and a
faster camera give the same images.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from geovp_classic.observation import scene_window_of
from geovp_classic.odometry.bundle import adjusted_focal
from geovp_classic.odometry.features import CornerTracker, all_corners
from geovp_classic.odometry.lens import Lens
from geovp_classic.odometry.tracking import KeyframePolicy, Tracker
from geovp_classic.parallel import parallel_map, single_threaded_blas
from geovp_classic.types import ByteArray, FloatArray, Intrinsics

WINDOW = 30  # images; 3 s at KITTI's rate
MIN_IMAGES = 15  # of a window; shorter ones agree with wrong focal lengths too often
STARTS = (0.35, 0.6, 1.0, 1.7)  # focal lengths by image width: views of 110 to 33 degrees
MAX_ROUNDS = 4  # of the search for zero between two of these
CLOSE = 0.01  # a step (of the logarithm) that ends the search
# standard deviation of a step; on KITTI, true errors times slope are 0.006 (root mean square)
STEP_NOISE = 0.008
SYSTEMATIC = (
    0.025  # relative error that all windows share: the principal point is not at the centre
)
MIN_KEYFRAMES = 5
NUM_POINTS = 500  # observed most often, in the bundle adjustment
MAX_SD = 0.1  # of a sure estimate's logarithm
QUANTILE = 1.645  # of a 90 % interval


@dataclass(frozen=True)
class FocalLength:
    """A focal length with its 90 % interval."""

    focal_px: float
    low_px: float
    high_px: float
    num_windows: int  # that had something to say

    @property
    def is_sure(self) -> bool:
        """Whether the interval is narrow enough for prediction."""
        return bool(np.log(self.high_px / self.low_px) < 2 * QUANTILE * MAX_SD)


@single_threaded_blas
def estimate_focal(windows: Iterable[Sequence[ByteArray]]) -> FocalLength | None:
    """The focal length of grey images [H, W] of one size, in windows of consecutive ones; None when
    none can tell.
    """
    found = [each for each in map(_root, windows) if each is not None]
    if not found:
        return None
    logs, sds = np.array(found).T
    weight = 1 / sds**2
    mean = float((weight * logs).sum() / weight.sum())
    scatter = float((weight * (logs - mean) ** 2).sum()) / max(len(logs) - 1, 1)
    sd = float(np.hypot(np.sqrt(max(scatter, 1.0) / weight.sum()), SYSTEMATIC))
    low, focal, high = np.exp(mean + QUANTILE * sd * np.array([-1, 0, 1])).tolist()
    return FocalLength(focal, low, high, len(found))


def _root(greys: Sequence[ByteArray]) -> tuple[float, float] | None:
    """The logarithm of the focal length at which a window's step is zero, and its standard
    deviation.
    """
    if len(greys) < MIN_IMAGES:
        return None
    shape = greys[0].shape
    seen = scene_window_of(np.stack(greys))
    greys = [
        grey[seen] for grey in greys
    ]  # a hood stands still in the image, whatever the focal length
    images = list(zip(greys, parallel_map(all_corners, greys), strict=True))
    starts = np.log(np.array(STARTS) * greys[0].shape[1])
    steps = np.array([_step(images, shape, seen, start) for start in starts])
    starts, steps = starts[np.isfinite(steps)], steps[np.isfinite(steps)]
    positive = int((steps > 0).sum())
    if (
        not 0 < positive < len(steps) or (steps[:positive] < 0).any()
    ):  # it must fall through zero once
        return None
    low, high = starts[positive - 1 : positive + 1]
    step_low, step_high = steps[positive - 1 : positive + 1]
    sd = STEP_NOISE * (high - low) / (step_low - step_high)
    for _ in range(MAX_ROUNDS):
        middle = (low * step_high - high * step_low) / (step_high - step_low)
        step = _step(images, shape, seen, middle)
        if not abs(step) > CLOSE:  # or NaN
            break
        low, step_low, high, step_high = (
            (middle, step, high, step_high) if step > 0 else (low, step_low, middle, step)
        )
    return float(middle), float(sd)


def _step(
    images: Sequence[tuple[ByteArray, FloatArray]],  # each with its corners
    shape: tuple[int, ...],
    seen: tuple[slice, slice],
    log_focal: float,
) -> float:
    """How far bundle adjustment moves the logarithm of a focal length that a window was tracked
    with; NaN: lost.

    The images are these rows and columns of whole ones of the shape (H, W).
    """
    (height_px, width_px), (rows, columns), focal_px = shape, seen, float(np.exp(log_focal))
    whole = Intrinsics(
        focal_px, focal_px, (width_px - 1) / 2, (height_px - 1) / 2, width_px, height_px
    )
    camera = whole.cropped(
        columns.start, rows.start, columns.stop - columns.start, rows.stop - rows.start
    )
    policy = KeyframePolicy(len(images), 0.001, adjust_every=5)
    tracker = Tracker(CornerTracker(), Lens(camera), policy, seed=0)
    for number, (grey, corners) in enumerate(images):
        tracker.push(grey, float(number), corners)
    points = tracker.map
    if len(points) < MIN_KEYFRAMES:
        return np.nan
    counts: FloatArray = np.where(points.triangulated, points.observed.sum(axis=0), 0)
    chosen = np.argsort(-counts, kind="stable")[:NUM_POINTS]
    chosen = chosen[counts[chosen] >= 2]
    adjusted = adjusted_focal(
        points.cam_from_world, points.points[chosen], points.observations[:, chosen], Lens(camera)
    )
    return float(np.log(adjusted)) - log_focal if adjusted > 0 else np.nan
