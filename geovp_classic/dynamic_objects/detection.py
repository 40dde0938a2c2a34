"""Dynamic objects: detected in the last frame, placed on the road, segmented, and their velocity
estimated.
"""

from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from geovp_classic.dynamic_objects.epipolar_residual import EpipolarResidual
from geovp_classic.dynamic_objects.posed_images import PosedImages
from geovp_classic.dynamic_objects.segmentation import (
    MotionSegmentation,
    bounding_box,
)
from geovp_classic.dynamic_objects.velocity import VelocityEstimator
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole
from geovp_classic.types import BoolArray, FloatArray


@dataclass(frozen=True)
class DynamicObject:
    """A flat object that faces the last camera and moves at a constant velocity."""

    mask: BoolArray  # [H, W], where the last frame shows it
    depth: float  # of the last frame, in the poses' unit
    # [3], in the last camera's frame, in the poses' unit per second, relative to the street
    velocity: FloatArray


@dataclass(frozen=True)
class DynamicObjects:
    """Detection of vehicles, where the images contradict all static points on or above the road.

    Lengths are in heights of the camera above the road. Limits are those of cars and cyclists.
    """

    steps: tuple[int, ...] = (
        1,
        2,
        3,
    )  # how many frames back the last one is compared with
    residual: EpipolarResidual = field(default_factory=EpipolarResidual)
    segmentation: MotionSegmentation = field(default_factory=MotionSegmentation)
    velocity: VelocityEstimator = field(default_factory=VelocityEstimator)
    join_fraction: float = (
        1 / 20
    )  # of the image's height; evidence this close is one object
    min_evidence_fraction: float = 4e-4  # of the image's pixels, per object
    duplicate_fraction: float = (
        0.5  # of evidence on the mask of a larger object: it is the same
    )
    max_distance: float = 40.0  # of the foot of an object
    min_speed_hz: float = (
        0.7  # heights per second; 1.2 m/s for a camera at 1.65 m
    )
    max_speed_hz: float = 25.0  # 40 m/s
    min_size: tuple[float, float] = (0.4, 0.2)  # height and width
    max_size: tuple[float, float] = (2.0, 5.0)
    max_photometric_error: float = (
        25.0  # grey values; sky and leaves match by chance
    )
    foot_percentile: float = 90.0  # of an object's rows; its shadow is below
    shadow_fraction: float = (
        0.25  # of the mask's height: shadow and road that was just left
    )

    def __post_init__(self) -> None:
        if not self.steps or min(self.steps) < 1:
            raise BadData(
                f"dynamic objects: steps is {self.steps}, expected numbers of frames back from "
                "the last one"
            )

    def detect(self, observed: PosedImages) -> list[DynamicObject]:
        """Return the dynamic objects of the last frame; none without earlier frames."""
        steps = tuple(step for step in self.steps if step < len(observed.past))
        if not steps:
            return []
        observed = replace(observed, steps=steps)
        evidence, flow_pixels = self.residual.evidence(observed)
        objects: list[DynamicObject] = []
        for cluster in self._clusters(evidence):
            overlaps = [other.mask[cluster].mean() for other in objects]
            if max(overlaps, default=0) > self.duplicate_fraction:
                continue
            candidate = self._dynamic_object(cluster, flow_pixels, observed)
            if candidate is not None:
                objects.append(candidate)
        return objects

    def _clusters(self, evidence: BoolArray) -> list[BoolArray]:
        """Return connected parts of the evidence [H, W], large ones first; gaps are bridged."""
        join_px = max(3, int(self.join_fraction * evidence.shape[0]))
        kernel = cv2.getStructuringElement(
            cv2.MORPH_ELLIPSE, (join_px, join_px)
        )
        bridged = cv2.dilate(evidence.astype(np.uint8), kernel)
        count, labels = cv2.connectedComponents(bridged)
        parts = [evidence & (labels == label) for label in range(1, count)]
        min_pixels = self.min_evidence_fraction * evidence.size
        large = [part for part in parts if part.sum() >= min_pixels]
        return sorted(large, key=np.sum, reverse=True)

    def _dynamic_object(
        self,
        evidence: BoolArray,
        flow_pixels: FloatArray,
        observed: PosedImages,
    ) -> DynamicObject | None:
        """Return the object of a cluster; None when it is unlike a vehicle on the road."""
        depth = self._foot_depth(evidence, observed)
        if depth is None:
            return None
        velocity = self.velocity.from_flow(
            evidence, depth, flow_pixels, observed
        )
        mask = self.segmentation.segment(evidence, depth, velocity, observed)
        if mask is None or not self._has_vehicle_size(mask, depth, observed):
            return None
        depth = self._foot_depth(mask, observed)
        if depth is None:
            return None
        body = self._body(mask)
        velocity = self.velocity.from_flow(body, depth, flow_pixels, observed)
        velocity = self.velocity.track(velocity, body, depth, observed)
        error = self.segmentation.photometric_error(
            body, depth, velocity, observed
        )
        speed_hz = np.linalg.norm(velocity) / observed.road.height
        is_vehicle = self.min_speed_hz < speed_hz < self.max_speed_hz
        if error >= self.max_photometric_error or not is_vehicle:
            return None
        return DynamicObject(mask, depth, velocity)

    def _foot_depth(
        self, mask: BoolArray, observed: PosedImages
    ) -> float | None:
        """Return the depth of the road at the mask's lowest pixels; None beyond the limit."""
        rows, columns = np.nonzero(mask)
        foot_u = np.median(columns)
        foot_v = np.percentile(rows, self.foot_percentile)
        foot = np.array([foot_u, foot_v])
        ray = pinhole.unproject(foot, np.array(1.0), observed.camera)
        inverse_heights = float(ray @ observed.road.normal)
        if inverse_heights <= 1 / self.max_distance:
            return None
        return observed.road.height / inverse_heights

    def _has_vehicle_size(
        self, mask: BoolArray, depth: float, observed: PosedImages
    ) -> bool:
        """Return whether the mask is as large as vehicles, and not cut by the image's border."""
        rows, columns = bounding_box(mask)
        height, width = mask.shape
        if columns.start == 0 or columns.stop == width or rows.stop == height:
            return False
        camera = observed.camera
        height_px = rows.stop - rows.start
        width_px = columns.stop - columns.start
        angles = np.array([height_px / camera.fy_px, width_px / camera.fx_px])
        size = depth * angles / observed.road.height
        is_large = (size > self.min_size).all()
        is_small = (size < self.max_size).all()
        return bool(is_large and is_small)

    def _body(self, mask: BoolArray) -> BoolArray:
        """Return the pixels [H, W] of the mask above the object's shadow."""
        rows, _ = bounding_box(mask)
        shadow_px = self.shadow_fraction * (rows.stop - rows.start)
        shadow_top = rows.stop - 1 - shadow_px
        is_above = np.arange(len(mask)) < shadow_top
        return mask & is_above[:, None]
