"""Dynamic objects: detected in the last frame, placed on the road, segmented, and their velocity
estimated.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.dynamic_objects import epipolar_residual, segmentation, velocity
from geovp_classic.dynamic_objects.segmentation import Observations
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole
from geovp_classic.geometry.ground_plane import GroundPlane
from geovp_classic.types import BoolArray, FloatArray, Intrinsics, Trajectory

JOIN_SHARE = 1 / 20  # of the image's height: evidence this close belongs to one object
SMALLEST_SHARE = 4e-4  # of the image's pixels that must be evidence, or the object is rejected
SAME_SHARE = 0.5  # of a cluster on the mask of an object found before: it is the same object
FARTHEST_HEIGHTS = 40.0  # camera heights: largest distance of the foot of an object on the road
SPEEDS_HEIGHTS_HZ = (
    0.7,
    25.0,
)  # camera heights per second; of cars and cyclists between 1.2 and 40 m/s
SMALLEST_HEIGHTS = (0.4, 0.2)  # height and width of objects on the road, in camera heights
LARGEST_HEIGHTS = (2.0, 5.0)
MAX_PHOTOMETRIC_ERROR = 25.0  # grey values; larger errors are chance matches of sky and leaves
FOOT_PERCENT = 90  # of the rows of an object's pixels are above its foot; below is its shadow
SHADOW_SHARE = 0.25  # of the mask's height is shadow and road that the object has just left


@dataclass(frozen=True)
class DynamicObject:
    """A flat object that faces the last camera and moves at a constant velocity."""

    mask: BoolArray  # [H, W], where the last frame shows it
    depth: float  # of the last frame, in the poses' unit
    # [3], in the last camera's frame, in the poses' unit per second, relative to the street
    velocity: FloatArray


@dataclass(frozen=True)
class DynamicObjects:
    """Detects dynamic objects where flow and images contradict every static point on or above the
    road.
    """

    steps: tuple[int, ...] = (1, 2, 3)  # how many frames back the last one is compared with
    min_strength: float = 0.7  # of the evidence, see epipolar_residual
    min_shift_px: float = 1.0

    def __post_init__(self) -> None:
        if not self.steps or min(self.steps) < 1:
            raise BadData(
                f"dynamic objects: steps is {self.steps}, expected numbers of frames back from "
                "the last one"
            )

    def find(
        self,
        images: FloatArray,  # [P, H, W] float32 grey 0..255
        camera: Intrinsics,
        past: Trajectory,  # [P]
        inverse_depth: FloatArray,  # [H, W] of the last frame
        road: GroundPlane | None,
    ) -> list[DynamicObject]:
        """The dynamic objects of the last frame; none without a road or without frames that far
        back.
        """
        steps = tuple(step for step in self.steps if step < len(past))
        if not steps or road is None:
            return []
        poses = past.world_from_cam
        equal = epipolar_residual.equalise_exposure(images, camera, poses, inverse_depth, steps)
        found = epipolar_residual.residual_evidence(
            equal, camera, poses, inverse_depth, road, steps
        )
        clusters = _clusters(
            (found.strength > self.min_strength) & (found.shift_px > self.min_shift_px)
        )
        if not clusters:
            return []
        others = tuple(step for step in range(1, len(past)) if step not in steps)
        equal = epipolar_residual.equalise_exposure(equal, camera, poses, inverse_depth, others)
        observed = Observations(equal, camera, past, inverse_depth, road)
        objects: list[DynamicObject] = []
        for cluster in clusters:
            if not any(found_object.mask[cluster].mean() > SAME_SHARE for found_object in objects):
                found_object = _dynamic_object(cluster, found.flow_pixels, steps, observed)
                objects += [] if found_object is None else [found_object]
        return objects


def _clusters(evidence: BoolArray) -> list[BoolArray]:
    """Evidence [H, W] by connected parts, gaps of JOIN_SHARE bridged, large ones first; small ones
    are dropped.
    """
    join_px = max(3, int(JOIN_SHARE * evidence.shape[0]))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (join_px, join_px))
    bridged = cv2.dilate(evidence.astype(np.uint8), kernel)
    count, labels = cv2.connectedComponents(bridged)
    parts = [evidence & (labels == label) for label in range(1, count)]
    large = [part for part in parts if part.sum() >= SMALLEST_SHARE * evidence.size]
    return sorted(large, key=np.sum, reverse=True)


def _dynamic_object(
    evidence: BoolArray, flow_pixels: FloatArray, steps: tuple[int, ...], observed: Observations
) -> DynamicObject | None:
    """The object that a cluster of evidence belongs to; None when it is unlike a vehicle on the
    road.
    """
    depth = _foot_depth(evidence, observed)
    if depth is None:
        return None
    own = velocity.from_flow(evidence, depth, flow_pixels, steps, observed)
    mask = segmentation.segment(evidence, depth, own, steps, observed)
    if mask is None or not _has_vehicle_size(mask, depth, observed):
        return None
    depth = _foot_depth(mask, observed)
    if depth is None:
        return None
    body = _body(mask, observed)
    own = velocity.tracked(
        velocity.from_flow(body, depth, flow_pixels, steps, observed), body, depth, observed
    )
    slowest, fastest = np.array(SPEEDS_HEIGHTS_HZ) * observed.road.height
    accepted = (
        segmentation.photometric_error(body, depth, own, steps, observed) < MAX_PHOTOMETRIC_ERROR
    )
    return (
        DynamicObject(mask, depth, own)
        if accepted and slowest < np.linalg.norm(own) < fastest
        else None
    )


def _body(mask: BoolArray, observed: Observations) -> BoolArray:
    """The pixels [H, W] of the mask with the object's own flow: those with texture, above its
    shadow.
    """
    rows = np.flatnonzero(mask.any(axis=1))
    above = np.arange(len(mask)) < rows[-1] - SHADOW_SHARE * len(rows)
    steps = [
        np.abs(cv2.Sobel(observed.images[-1].astype(np.float32), -1, *axis, scale=1 / 8))
        for axis in ((1, 0), (0, 1))
    ]
    texture = np.maximum(*steps)
    body: BoolArray = mask & above[:, None]
    return body & (texture >= np.median(texture[body]))


def _has_vehicle_size(mask: BoolArray, depth: float, observed: Observations) -> bool:
    """Whether the mask is as high and wide as vehicles are, and whole: not cut by the image's sides
    or its foot.
    """
    rows, columns = np.nonzero(mask)
    heights_px = (
        observed.road.height / depth * np.array([observed.camera.fy_px, observed.camera.fx_px])
    )
    size = (np.array([np.ptp(rows), np.ptp(columns)]) + 1) / heights_px
    whole = (
        columns.min() > 0 and columns.max() < mask.shape[1] - 1 and rows.max() < mask.shape[0] - 1
    )
    return bool(whole and (size > SMALLEST_HEIGHTS).all() and (size < LARGEST_HEIGHTS).all())


def _foot_depth(mask: BoolArray, observed: Observations) -> float | None:
    """The depth of the road at the mask's lowest pixels; None when that is beyond FARTHEST_HEIGHTS
    or the horizon.
    """
    rows, columns = np.nonzero(mask)
    foot = np.array([np.median(columns), np.percentile(rows, FOOT_PERCENT)])
    road = observed.road
    inverse_depth = float(
        pinhole.unproject(foot, np.array(1.0), observed.camera) @ road.normal / road.height
    )
    return 1 / inverse_depth if inverse_depth * road.height > 1 / FARTHEST_HEIGHTS else None
