"""Motion segmentation: pixels where an object's motion explains the images and a static background
does not.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.dynamic_objects import epipolar_residual
from geovp_classic.geometry import pinhole
from geovp_classic.geometry.epipolar import IN_FRONT
from geovp_classic.geometry.ground_plane import GroundPlane
from geovp_classic.parallel import parallel_map
from geovp_classic.types import BoolArray, FloatArray, Intrinsics, Trajectory

WINDOW_PX = 3  # over which differences of grey values are averaged
MARGIN_GREY = (
    1.0  # grey values 0..255 by which the object must explain a pixel better than the background
)
MARGIN_SHARE = 0.25  # and this share of the object's own error
HIGHEST = 1.35  # camera heights: vans, seen by a car's camera
ASIDE = 0.4  # of the evidence's extent: how far the object may extend beside it
BELOW_PX = 2
MIN_BETTER = 0.4  # of the evidence that the object's motion must explain better
MARGIN_PX = 1


Box = tuple[slice, slice]  # rows and columns of the image


@dataclass(frozen=True)
class Observations:
    """The observed frames with their geometry."""

    images: FloatArray  # [P, H, W] float32 grey 0..255, equally exposed
    camera: Intrinsics
    past: Trajectory  # [P]
    inverse_depth: FloatArray  # [H, W] of the last frame
    road: GroundPlane

    def seconds(self, step: int) -> float:
        """Between the last frame and the one `step` frames before it."""
        return float(self.past.times_s[-1] - self.past.times_s[-1 - step])


def segment(
    evidence: BoolArray,  # [H, W]
    depth: float,
    velocity: FloatArray,  # [3] in the last camera's frame
    steps: tuple[int, ...],
    observed: Observations,
) -> BoolArray | None:
    """The mask [H, W] of an object at one depth; None when its motion does not explain the
    evidence.

    Gaps are filled: uniform doors and panes match anywhere.
    """
    box = _box(evidence, depth, observed)
    own, street = _photometric_errors(box, depth, velocity, steps, observed, _columns(evidence))
    better = (street - own > MARGIN_GREY + MARGIN_SHARE * own).min(axis=0)
    seed = evidence[box]
    if better[seed].mean() < MIN_BETTER:
        return None
    mask = np.zeros(evidence.shape, dtype=bool)
    mask[box] = _fill_rows_and_columns(_connected_to(better, seed & better))
    return mask


def photometric_error(
    body: BoolArray,
    depth: float,
    velocity: FloatArray,
    steps: tuple[int, ...],
    observed: Observations,
) -> float:
    """Mean difference of grey values between an object's body [H, W] and earlier frames where it
    was then.
    """
    box = _columns(body.T), _columns(body)
    inverse_depth = np.full(body[box].shape, 1 / depth)
    return float(
        np.mean(
            [
                _grey_difference(inverse_depth, velocity, step, box, observed)[body[box]]
                for step in steps
            ]
        )
    )


def _photometric_errors(
    box: Box,
    depth: float,
    velocity: FloatArray,
    steps: tuple[int, ...],
    observed: Observations,
    columns: slice,
) -> tuple[FloatArray, FloatArray]:
    """Grey differences [K, h, w] in the box under the object's motion and as static background.

    In the columns of the evidence, depth was estimated from the object as if static: there the
    background is interpolated from both sides of the box. Elsewhere the estimated depth counts,
    too.
    """
    estimated = observed.inverse_depth[box]
    outside = np.ones(estimated.shape, dtype=bool)
    outside[:, columns.start - box[1].start : columns.stop - box[1].start] = False
    between = _interpolated_between(observed.inverse_depth, box)

    def compare(step: int) -> tuple[FloatArray, FloatArray]:
        own = _grey_difference(np.full(estimated.shape, 1 / depth), velocity, step, box, observed)
        behind = _grey_difference(between, np.zeros(3), step, box, observed)
        found = _grey_difference(estimated, np.zeros(3), step, box, observed)
        return own, np.where(outside, np.minimum(behind, found), behind)

    own, street = (np.stack(errors) for errors in zip(*parallel_map(compare, steps), strict=True))
    return own, street


def _columns(mask: BoolArray) -> slice:
    columns = np.flatnonzero(mask.any(axis=0))
    return slice(int(columns[0]), int(columns[-1]) + 1)


def _box(evidence: BoolArray, depth: float, observed: Observations) -> Box:
    """Rows and columns where the object may be: around the evidence, from its foot to HIGHEST above
    the road.
    """
    height, width = evidence.shape
    rows, columns = _columns(evidence.T), _columns(evidence)
    aside_px = int(ASIDE * max(rows.stop - rows.start, columns.stop - columns.start))
    bottom = min(rows.stop + BELOW_PX, height)
    top = int(bottom - HIGHEST * observed.road.height * observed.camera.fy_px / depth)
    left, right = max(columns.start - aside_px, 0), min(columns.stop + aside_px, width)
    return slice(max(min(top, rows.start), 0), bottom), slice(left, right)


def _interpolated_between(inverse_depth: FloatArray, box: Box) -> FloatArray:
    """Inverse depth [h, w] in the box, interpolated between its left and right neighbours row by
    row.
    """
    rows, columns = box
    width = inverse_depth.shape[1]
    ends = [column for column in (columns.start - 1, columns.stop) if 0 <= column < width] or [0]
    left, right = inverse_depth[rows, ends[0]], inverse_depth[rows, ends[-1]]
    share = np.linspace(0, 1, columns.stop - columns.start)
    return np.asarray(left[:, None] * (1 - share) + right[:, None] * share)


def _grey_difference(
    inverse_depth: FloatArray, velocity: FloatArray, step: int, box: Box, observed: Observations
) -> FloatArray:
    """Grey difference [h, w] in the box to the frame `step` before the last one, for a body with
    that velocity.
    """
    other_from_last = epipolar_residual.cam_from_last(observed.past.world_from_cam, step)
    shift = other_from_last[:3, 3] - observed.seconds(step) * other_from_last[:3, :3] @ velocity
    points = (
        pinhole.rays(observed.camera)[box] @ other_from_last[:3, :3].T
        + inverse_depth[..., None] * shift
    )
    points[..., 2] = np.maximum(points[..., 2], IN_FRONT)
    place = np.asarray(pinhole.project(points, observed.camera)[0], np.float32)
    return epipolar_residual.grey_difference(
        observed.images[-1][box], observed.images[-1 - step], place, WINDOW_PX
    )


def _connected_to(better: BoolArray, seed: BoolArray) -> BoolArray:
    """The parts of `better` [H, W] that are connected to the seed."""
    _, labels = cv2.connectedComponents(
        cv2.dilate(better.astype(np.uint8), np.ones((5, 5), np.uint8))
    )
    return np.asarray(better & np.isin(labels, np.unique(labels[seed])))


def _fill_rows_and_columns(mask: BoolArray) -> BoolArray:
    """The mask [h, w] without gaps in any row, and then in any column; MARGIN_PX wider."""
    whole = _fill_rows(_fill_rows(mask).T).T
    kernel = np.ones((2 * MARGIN_PX + 1,) * 2, np.uint8)
    return np.asarray(cv2.dilate(whole.astype(np.uint8), kernel) > 0)


def _fill_rows(mask: BoolArray) -> BoolArray:
    """From the first to the last pixel of every row."""
    inside: BoolArray = np.logical_or.accumulate(mask, axis=1)
    inside &= np.logical_or.accumulate(mask[:, ::-1], axis=1)[:, ::-1]
    return inside
